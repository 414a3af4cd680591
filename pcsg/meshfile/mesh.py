"""Polygon meshes as arrays, and the error of a file that holds none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.meshfile.polygons import triangulate

FARTHEST = 1e30
"""Coordinates of a larger size are refused: boxes of scenes are kept in single precision."""

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


_MIX = np.uint64(0x9E3779B97F4A7C15)
"""An odd number without a pattern in its bits."""


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


class Notes:
    """What is left out of a file or mended in it, by kind: how often, and where first."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[int, str]] = {}

    def add(self, what: str, place: str, count: int = 1) -> None:
        """Note what is left out or mended; the first place of a kind is kept."""
        before, first = self._found.get(what, (0, place))
        self._found[what] = before + count, first

    def texts(self) -> tuple[str, ...]:
        """Return a sentence for every kind."""
        return tuple(
            f"{what} ({place})" if count == 1 else f"{what} ({count:,}, the first: {place})"
            for what, (count, place) in self._found.items()
        )


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
    notes
        What of the file is left out or mended, a sentence for each kind.
    """

    vertices: Floats
    corners: Integers
    offsets: Integers
    corner_uv: Floats | None = None
    corner_normals: Floats | None = None
    corner_colors: Floats | None = None
    notes: tuple[str, ...] = ()

    @cached_property
    def _cut(self) -> tuple[Integers, int]:
        cut, crossing = triangulate(self.vertices, self.corners, self.offsets)
        a, b, c = self.corners[cut].T
        return cut[(a != b) & (b != c) & (c != a)], crossing

    @property
    def triangle_corners(self) -> Integers:
        """Triangles that the polygons are cut into, int64 (T, 3): positions in `corners`.

        None has one vertex twice. They turn as their polygons do.
        """
        return self._cut[0]

    @property
    def crossing_polygons(self) -> int:
        """Number of polygons that cross themselves, so that their triangles overlap."""
        return self._cut[1]

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
    notes: Notes | None = None,
    place_of_face: Callable[[int], str] = "face {}".format,
) -> Mesh:
    """Return a mesh whose equal vertices are merged; the order of first appearance stays.

    Corners that repeat the one before are dropped, and polygons of fewer than three. A corner
    whose attribute is not finite has none. `place_of_face` tells where the file gives a polygon.
    """
    notes = notes or Notes()
    # Adding zero makes -0 and +0 the same bits.
    first, number = _find_equal(np.ascontiguousarray(vertices + 0.0))
    kept = np.sort(first)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    merged = rank[number]
    corners = merged[corners] if len(corners) else np.zeros(0, np.int64)
    stays, offsets = _without_repeats(corners, offsets, notes, place_of_face)
    said = (
        None if values is None else values[stays]
        for values in (corner_uv, corner_normals, corner_colors)
    )
    uv, normals, colors = (None if values is None else _if_any(values) for values in said)
    return Mesh(
        np.ascontiguousarray(vertices[kept] + 0.0),
        corners[stays],
        offsets,
        uv,
        normals,
        colors,
        notes.texts(),
    )


def _find_equal(points: Floats) -> tuple[Integers, Integers]:
    """Return the first of every kind of equal rows, and the kind of every row."""
    # Mixed into one number they are sorted ten times as fast.
    keys = np.zeros(len(points), np.uint64)
    for column in points.view(np.uint64).T:
        keys = (keys ^ column ^ (column >> np.uint64(32))) * _MIX
        keys ^= keys >> np.uint64(29)
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    number = number.ravel()
    if not (points[first[number]] == points).all():
        # Rows that are not equal, or not numbers, got the same key.
        rows = points.view(np.dtype((np.void, 24))).ravel()
        _, first, number = np.unique(rows, return_index=True, return_inverse=True)
    return first, number.ravel()


def _without_repeats(
    corners: Integers, offsets: Integers, notes: Notes, place_of_face: Callable[[int], str]
) -> tuple[NDArray[np.bool_], Integers]:
    """Return which corners stay, bool (C,), and the offsets of the polygons that do."""
    counts = np.diff(offsets)
    before = np.arange(len(corners)) - 1
    some = counts > 0
    before[offsets[:-1][some]] = offsets[1:][some] - 1
    stays = corners != corners[before] if len(corners) else np.zeros(0, np.bool_)
    owner = np.repeat(np.arange(len(counts)), counts)
    left = np.bincount(owner[stays], minlength=len(counts))
    few = left < 3
    stays &= ~few[owner]
    # Those that have no area since corners are equal are too usual to be told.
    told = counts < 3
    if told.any():
        place = place_of_face(int(told.argmax()))
        notes.add("left out: faces of fewer than three corners", place, int(told.sum()))
    return stays, offsets_of(left[~few])


def _if_any(values: Floats) -> Floats | None:
    """Return values, all of a corner NaN where one is not finite; None where all are."""
    missing = ~finite_rows(values)
    if missing.all():
        return None
    if missing.any():
        values = np.where(missing[:, None], np.nan, values)
    return values


def finite_rows(values: Floats) -> NDArray[np.bool_]:
    """Return which rows consist of finite numbers."""
    return np.asarray(np.isfinite(values).all(axis=1))


def checked_vertices(
    name: str, points: Floats, used: Integers, place: Callable[[int], str], notes: Notes
) -> Floats:
    """Return vertices (V, 3); those that are no places and not used stand at the origin.

    Parameters
    ----------
    used
        Vertices of corners.
    place
        Tells where the file gives a vertex.

    Raises
    ------
    MeshFileError
        A vertex that is used is not finite or lies beyond `FARTHEST`.
    """
    wrong = ~np.asarray((np.abs(points) <= FARTHEST).all(axis=1))
    if not wrong.any():
        return points
    bad = used[wrong[used]]
    if len(bad):
        reason = f"a vertex needs finite numbers of at most {FARTHEST:g}"
        raise MeshFileError(name, place(int(bad.min())), reason)
    notes.add(
        "left out: vertices that are not finite", place(int(wrong.argmax())), int(wrong.sum())
    )
    return np.where(wrong[:, None], 0.0, points)


def linear_from_display(colors: Floats, top: float | None = None) -> Floats:
    """Return linear colours for those that are written for a display (IEC 61966-2-1).

    Parameters
    ----------
    colors : float64 (n, 3)
    top
        What is 1 among them. None where the file does not say: 255 if one is 2 or more, else 1.
    """
    if top is None:
        finite = colors[np.isfinite(colors)]
        top = 255.0 if finite.max(initial=0.0) >= 2.0 else 1.0
    clipped = np.clip(colors / top, 0.0, 1.0)
    curved = ((clipped + 0.055) / 1.055) ** 2.4
    linear: Floats = np.where(clipped <= 0.04045, clipped / 12.92, curved)
    return linear


def offsets_of(counts: Sequence[int] | Integers) -> Integers:
    """Return where polygons of these numbers of corners begin, and the end."""
    return np.concatenate([[0], np.cumsum(np.asarray(counts, np.int64))]).astype(np.int64)
