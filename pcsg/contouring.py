"""Triangle meshes of any solid: marching cubes, with vertices where rays cross the surface.

Whether points of a grid are inside decides the topology (Lorensen and Cline 1987), so that the mesh
is closed; a ray along the edge of the grid finds the place of each vertex, so that it lies on the
surface however coarse the grid.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import EnvironmentFault, UsageError
from pcsg.trace.hits import Hits

Floats = NDArray[np.float64]


class Solid(Protocol):
    """What a scene tells of its solid."""

    @property
    def bounds(self) -> Floats:
        """(2, 3) corners of the box about it."""
        ...

    def contains(self, points: Floats) -> NDArray[np.bool_]:
        """Return which points (N, 3) are inside."""
        ...

    def intersect(self, origins: Floats, directions: Floats, t_min: float, t_max: float) -> Hits:
        """Return the first crossings of rays in [t_min, t_max]."""
        ...


def contour(solid: Solid, resolution: int = 64) -> tuple[Floats, NDArray[np.int64]]:
    """Return a closed triangle mesh of a solid.

    Parameters
    ----------
    resolution
        Cells along the longest side of its box. What is thinner than a cell may be missed, and
        surfaces without volume are.

    Returns
    -------
    vertices : float64 (V, 3)
        On the surface.
    faces : int64 (F, 3)
        Counterclockwise as seen from outside.

    Raises
    ------
    UsageError
        The solid has no bounds, or no cell's corner is inside.
    EnvironmentFault
        scikit-image is not installed.
    """
    if not 2 <= resolution <= 1_024:
        raise UsageError(f"the resolution must lie between 2 and 1024, not {resolution}")
    try:
        from skimage.measure import marching_cubes
    except ImportError:
        raise EnvironmentFault("contouring needs scikit-image: pip install 'pcsg[mesh]'") from None
    low, high = solid.bounds
    if not (np.isfinite(solid.bounds).all() and (low <= high).all()):
        raise UsageError("a scene without bounds cannot be contoured")
    cell = float((high - low).max()) / resolution
    # Uneven, so that faces of the scene do not lie in the grid's planes.
    low = low - np.array([1.37, 1.43, 1.31]) * cell
    shape = np.ceil((high - low) / cell).astype(np.int64) + 3
    inside = np.zeros(shape, np.float32)
    y, z = (a.ravel() for a in np.meshgrid(*map(np.arange, shape[1:]), indexing="ij"))
    for x in range(shape[0]):
        points = low + cell * np.column_stack([np.full(len(y), x), y, z])
        inside[x] = solid.contains(points).reshape(shape[1:])
    if not inside.any():
        raise UsageError(f"nothing is as thick as a cell at a resolution of {resolution}")
    places, faces, _, _ = marching_cubes(inside, 0.5, gradient_direction="ascent")
    begin = np.floor(places)
    origins, directions = low + cell * begin, cell * np.ceil(places) - cell * begin
    hits = solid.intersect(origins, directions, 0.0, 1.0)
    # Where rounding hides the crossing the middle of the edge will do.
    t = np.where(np.isfinite(hits.t), hits.t, 0.5)
    return origins + t[:, None] * directions, faces.astype(np.int64)


def write_triangles(vertices: Floats, faces: NDArray[np.int64]) -> bytes:
    """Return a mesh as the text of an OBJ file."""
    lines = ["# pcsg contour"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()
