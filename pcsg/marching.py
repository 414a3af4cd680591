"""Closed triangle meshes of solids that tell what rays meet: marching cubes in a narrow band.

Rays along the columns of a grid tell which of its points are inside, which decides the topology
(Lorensen and Cline 1987); blocks that the surface does not cross cost nothing, and no grid of the
whole is kept. A ray along the edge of the grid finds the place of each vertex, so that it lies on
the surface however coarse the grid. Vertices of blocks are one if they are on one edge.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import EnvironmentFault, missing_extra

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCK = 32
"""Cells of a block along an axis."""

FINE = 240
"""Vertices are told apart in this part of a cell; those inside of a cell are 1 / 24 off edges."""

Columns = Callable[[Floats, Floats], tuple[Ints, Floats, Floats]]
"""From origins and directions (N, 3) to offsets (N + 1,) and where rays enter and leave."""

First = Callable[[Floats, Floats], Floats]
"""From origins and directions (N, 3) to the first crossings in [0, 1], or infinity."""


def march(
    low: Floats, high: Floats, resolution: int, columns: Columns, first: First
) -> tuple[Floats, Ints]:
    """Return a closed mesh of what a grid sees of a solid, empty if it sees nothing.

    Parameters
    ----------
    low, high
        Corners of the box about it.
    resolution
        Cells along the box's longest side.
    """
    cell = float((high - low).max()) / resolution
    # Cells of nothing all around, so that the mesh is closed; uneven, so that faces of the solid do
    # not lie in the grid's planes.
    low = low - np.array([1.37, 1.43, 1.31]) * cell
    shape = np.ceil((high - low) / cell).astype(np.int64) + 3
    scale = FINE * (int(shape.max()) + 1)
    keys: list[Ints] = []
    places: list[Floats] = []
    faces: list[Ints] = []
    count = 0
    for offset, found, corners in _blocks(low, cell, shape, columns):
        where = offset + found.astype(np.float64)
        fine = np.rint(where * FINE).astype(np.int64)
        keys.append((fine[:, 0] * scale + fine[:, 1]) * scale + fine[:, 2])
        places.append(where)
        faces.append(corners.astype(np.int64) + count)
        count += len(where)
    if not count:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    _, at, number = np.unique(np.concatenate(keys), return_index=True, return_inverse=True)
    place = np.concatenate(places)[at]
    begin = np.floor(place + 1e-4)
    origins = low + cell * begin
    directions = cell * (np.ceil(place - 1e-4) - begin)
    t = first(origins, directions)
    # Where rounding hides the crossing the middle of the edge will do.
    t = np.where(np.isfinite(t), t, 0.5)
    return origins + t[:, None] * directions, number.reshape(-1)[np.concatenate(faces)]


def _blocks(
    low: Floats, cell: float, shape: Ints, columns: Columns
) -> Iterator[tuple[Floats, NDArray[np.float32], NDArray[np.int32]]]:
    """Yield where a block begins, in cells, and the vertices and faces that it has."""
    try:
        from skimage.measure import marching_cubes
    except ImportError:
        raise EnvironmentFault(missing_extra("contouring needs", "scikit-image", "mesh")) from None
    nx, ny, nz = (int(n) for n in shape)
    for i in range(0, nx - 1, BLOCK):
        for j in range(0, ny - 1, BLOCK):
            x = np.arange(i, min(i + BLOCK + 1, nx))
            y = np.arange(j, min(j + BLOCK + 1, ny))
            inside = _column_points(low, cell, x, y, nz, columns)
            for k in range(0, nz - 1, BLOCK):
                part = inside[:, :, k : k + BLOCK + 1]
                if part.any() and not part.all():
                    found = marching_cubes(
                        part.astype(np.float32), 0.5, gradient_direction="ascent"
                    )
                    yield np.array([i, j, k], np.float64), found[0], found[1]


def _column_points(
    low: Floats, cell: float, x: Ints, y: Ints, nz: int, columns: Columns
) -> NDArray[np.bool_]:
    """Return which points of some columns are inside."""
    a, b = (v.ravel() for v in np.meshgrid(x, y, indexing="ij"))
    origins = low + cell * np.stack([a, b, np.zeros_like(a)], axis=1).astype(np.float64)
    directions = np.tile([0.0, 0.0, cell], (len(a), 1))
    offsets, enter, leave = columns(origins, directions)
    ray = np.repeat(np.arange(len(a)), np.diff(offsets))
    begin = np.clip(np.ceil(enter), 0, nz).astype(np.int64)
    end = np.clip(np.floor(leave) + 1, 0, nz).astype(np.int64)
    some = end > begin
    change = np.zeros((len(a), nz + 1), np.int32)
    np.add.at(change, (ray[some], begin[some]), 1)
    np.add.at(change, (ray[some], end[some]), -1)
    inside: NDArray[np.bool_] = np.cumsum(change[:, :nz], axis=1) > 0
    return inside.reshape(len(x), len(y), nz)
