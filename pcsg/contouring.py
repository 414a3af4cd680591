"""Triangle meshes of any solid: marching cubes, with vertices where rays cross the surface."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.marching import march
from pcsg.trace.hits import Hits, Spans

Floats = NDArray[np.float64]


class Solid(Protocol):
    """What a scene tells of its solid."""

    @property
    def bounds(self) -> Floats:
        """(2, 3) corners of the box about it."""
        ...

    def spans(self, origins: Floats, directions: Floats) -> Spans:
        """Return the inside intervals of rays."""
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
    low, high = solid.bounds
    if not (np.isfinite(solid.bounds).all() and (low <= high).all()):
        raise UsageError("a scene without bounds cannot be contoured")

    def columns(o: Floats, d: Floats) -> tuple[NDArray[np.int64], Floats, Floats]:
        found = solid.spans(o, d)
        return found.offsets, found.t_in, found.t_out

    def first(o: Floats, d: Floats) -> Floats:
        return solid.intersect(o, d, 0.0, 1.0).t

    vertices, faces = march(low, high, resolution, columns, first)
    if not len(faces):
        raise UsageError(f"nothing is as thick as a cell at a resolution of {resolution}")
    return vertices, faces


def write_triangles(vertices: Floats, faces: NDArray[np.int64]) -> bytes:
    """Return a mesh as the text of an OBJ file."""
    lines = ["# pcsg contour"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()
