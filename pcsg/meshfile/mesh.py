"""Polygon meshes as arrays, and the error of a file that holds none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.meshfile.polygons import triangulate

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class MeshFileError(UsageError):
    """A mesh file that is damaged, or says what is not supported.

    Attributes
    ----------
    path
        The file.
    place
        Where in it, such as ``line 12`` or ``byte 84``; None for the whole.
    reason
        What is wrong.
    """

    def __init__(self, path: str, place: str | None, reason: str) -> None:
        self.path, self.place, self.reason = path, place, reason
        super().__init__(f"{path}{f', {place}' if place else ''}: {reason}")


@dataclass(frozen=True, eq=False)
class Mesh:
    """Polygons over shared vertices. Equal vertices are one, whatever the file says.

    Attributes
    ----------
    vertices : float64 (V, 3)
        In the coordinates of the file.
    corners : int64 (C,)
        Vertices of the polygons, one polygon after the other.
    offsets : int64 (F + 1,)
        The corners of polygon f are ``corners[offsets[f]:offsets[f + 1]]``, three or more.
    corner_uv : float64 (C, 2), or None
        Texture coordinates of every corner; NaN where the file gives none.
    corner_normals : float64 (C, 3), or None
        Normals of every corner, of any length; NaN where the file gives none.
    corner_colors : float64 (C, 3), or None
        Colours of every corner, linear, 0 to 1; NaN where the file gives none.
    """

    vertices: Floats
    corners: Integers
    offsets: Integers
    corner_uv: Floats | None = None
    corner_normals: Floats | None = None
    corner_colors: Floats | None = None

    @cached_property
    def triangle_corners(self) -> Integers:
        """Triangles that the polygons are cut into, int64 (T, 3): positions in `corners`.

        None has one vertex twice. They turn as their polygons do.
        """
        cut = triangulate(self.vertices, self.corners, self.offsets)
        a, b, c = self.corners[cut].T
        kept: Integers = cut[(a != b) & (b != c) & (c != a)]
        return kept

    @property
    def triangles(self) -> Integers:
        """Vertices of the triangles, int64 (T, 3)."""
        found: Integers = self.corners[self.triangle_corners]
        return found

    @property
    def polygon_count(self) -> int:
        """Number of polygons."""
        return len(self.offsets) - 1


def make_mesh(
    vertices: Floats,
    corners: Integers,
    offsets: Integers,
    corner_uv: Floats | None = None,
    corner_normals: Floats | None = None,
    corner_colors: Floats | None = None,
) -> Mesh:
    """Return a mesh whose equal vertices are merged; the order of first appearance stays."""
    # Adding zero makes -0 and +0 the same bits.
    rows = np.ascontiguousarray(vertices + 0.0).view(np.dtype((np.void, 24))).ravel()
    _, first, number = np.unique(rows, return_index=True, return_inverse=True)
    kept = np.sort(first)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    merged = rank[number.ravel()]
    return Mesh(
        np.ascontiguousarray(vertices[kept] + 0.0),
        merged[corners] if len(corners) else np.zeros(0, np.int64),
        offsets,
        _if_any(corner_uv),
        _if_any(corner_normals),
        _if_any(corner_colors),
    )


def _if_any(values: Floats | None) -> Floats | None:
    return None if values is None or np.isnan(values).all() else values


def linear_from_srgb(colors: Floats) -> Floats:
    """Return linear colours for those that are written for a display (IEC 61966-2-1)."""
    clipped = np.clip(colors, 0.0, 1.0)
    curved = ((clipped + 0.055) / 1.055) ** 2.4
    linear: Floats = np.where(clipped <= 0.04045, clipped / 12.92, curved)
    return linear


def offsets_of(counts: Sequence[int] | Integers) -> Integers:
    """Return where polygons of these numbers of corners begin, and the end."""
    return np.concatenate([[0], np.cumsum(np.asarray(counts, np.int64))]).astype(np.int64)
