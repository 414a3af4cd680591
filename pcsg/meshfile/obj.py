"""Wavefront OBJ: polygons with texture coordinates and normals.

Format: "Appendix B1, Object Files", Advanced Visualizer manual, 1992. Groups, materials, lines,
points and free-form curves are passed over. Colours stand behind the coordinates, as many programs
write them: from 0 to 1, or to 255 where one is 2 or more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NoReturn

import numpy as np

from pcsg.meshfile.mesh import (
    Floats,
    Integers,
    Mesh,
    MeshFileError,
    Notes,
    checked_vertices,
    finite_rows,
    linear_from_display,
    make_mesh,
    offsets_of,
)
from pcsg.meshfile.words import as_utf8, shown

_NONE = 0
"""Index of what a corner does not give; the others count from 1, or from -1 backwards."""


def read_obj(name: str, data: bytes) -> Mesh:
    """Read an OBJ file; `name` is for messages."""
    reader = _Reader(name)
    for number, line in _lines(as_utf8(name, data)):
        words = line.split()
        if not words:
            continue
        keyword = words[0]
        if keyword == b"v":
            reader.add_vertex(number, words)
        elif keyword == b"f":
            reader.add_face(number, words[1:])
        elif keyword == b"vt":
            reader.uvs.append(reader.numbers(number, words, 1, 2))
        elif keyword == b"vn":
            reader.normals.append(reader.numbers(number, words, 3, 3))
    return reader.mesh()


def _lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield lines without comments, continued ones joined, with the number of the first."""
    held: list[bytes] = []
    first = 0
    for number, raw in enumerate(data.splitlines(), 1):
        line = raw.split(b"#", 1)[0].rstrip()
        if not held:
            first = number
        if line.endswith(b"\\"):
            held.append(line[:-1])
            continue
        if held:
            line = b" ".join([*held, line])
            held = []
        yield first, line
    if held:
        yield first, b" ".join(held)


class _Reader:
    def __init__(self, name: str) -> None:
        self.name = name
        self.points: list[tuple[float, ...]] = []
        self.lines_of_points: list[int] = []
        self.uvs: list[tuple[float, ...]] = []
        self.normals: list[tuple[float, ...]] = []
        self.colors: dict[int, tuple[float, ...]] = {}
        self.counts: list[int] = []
        self.lines_of_faces: list[int] = []
        # Of every corner: what it says, and how much of its kind stands above it.
        self.corners: list[int] = []
        self.corner_uvs: list[int] = []
        self.corner_normals: list[int] = []
        self.above: list[tuple[int, int, int]] = []
        self.notes = Notes()

    def fail(self, line: int, reason: str) -> NoReturn:
        raise MeshFileError(self.name, f"line {line}", reason)

    def numbers(
        self, line: int, words: list[bytes], least: int, most: int, what: str = ""
    ) -> tuple[float, ...]:
        """Return at least and at most so many numbers after a keyword."""
        keyword = what or shown(words[0])
        if len(words) <= least:
            self.fail(line, f"`{keyword}` needs {least} number(s), not {len(words) - 1}")
        try:
            return tuple(map(float, words[1 : most + 1]))
        except ValueError:
            self.fail(line, f"`{shown(b' '.join(words[1 : most + 1]))}` are not numbers")

    def add_vertex(self, line: int, words: list[bytes]) -> None:
        """Append a vertex; colours may stand behind it."""
        self.points.append(self.numbers(line, words, 3, 3))
        self.lines_of_points.append(line)
        if len(words) in (7, 8):  # the eighth is an opacity
            color = self.numbers(line, words[3:], 3, 3, "v")
            if all(map(math.isfinite, color)):
                self.colors[len(self.points) - 1] = color
            else:
                self.notes.add("left out: colours that are not finite", f"line {line}")

    def add_face(self, line: int, words: list[bytes]) -> None:
        """Append a polygon."""
        if not words:
            self.fail(line, "a face needs at least 3 corners, not 0")
        for word in words:
            parts = word.split(b"/")
            try:
                self.corners.append(int(parts[0]))
                self.corner_uvs.append(int(parts[1]) if len(parts) > 1 and parts[1] else _NONE)
                normal = int(parts[2]) if len(parts) > 2 and parts[2] else _NONE
            except ValueError:
                self.fail(line, f"`{shown(word)}` is not a corner")
            self.corner_normals.append(normal)
        self.counts.append(len(words))
        self.lines_of_faces.append(line)
        self.above.append((len(self.points), len(self.uvs), len(self.normals)))

    def resolve(self, written: list[int], kind: int, known: int) -> Integers:
        """Return indices from 0 and -1 for what is not there: all count, above and below."""
        above = np.repeat(np.array(self.above, np.int64).reshape(-1, 3)[:, kind], self.counts)
        beyond = known + 1
        # Integers of any size may stand in a file.
        said = np.array([min(max(k, -beyond), beyond) for k in written], np.int64)
        found = np.where(said > 0, said - 1, above + said)
        found[(said == _NONE) | (found < 0) | (found >= known)] = -1
        return found

    def line_of_corner(self, k: int) -> int:
        """Return the line of the face that has corner k."""
        face = int(np.searchsorted(np.cumsum(self.counts), k, side="right"))
        return self.lines_of_faces[face]

    def mesh(self) -> Mesh:
        """Return what was read."""
        known = len(self.points)
        corners = self.resolve(self.corners, 0, known)
        missing = np.flatnonzero(corners < 0)
        if len(missing):
            k = int(missing[0])
            written = shown(str(self.corners[k]).encode(), 20)
            reason = f"there is no vertex {written}: {known} are given"
            self.fail(self.line_of_corner(k), reason)
        points = np.array(self.points, np.float64).reshape(-1, 3)
        points = checked_vertices(
            self.name, points, corners, lambda k: f"line {self.lines_of_points[k]}", self.notes
        )
        colors = None
        if self.colors:
            table = np.full((known, 3), math.nan)
            table[list(self.colors)] = list(self.colors.values())
            colors = linear_from_display(table)[corners]
        uv = self._gather("texture coordinates", "vt", self.uvs, self.corner_uvs, 2)
        normals = self._gather("normals", "vn", self.normals, self.corner_normals, 3)
        offsets = offsets_of(self.counts)

        def place_of_face(k: int) -> str:
            return f"line {self.lines_of_faces[k]}"

        return make_mesh(points, corners, offsets, uv, normals, colors, self.notes, place_of_face)

    def _gather(
        self, what: str, keyword: str, values: list[tuple[float, ...]], said: list[int], width: int
    ) -> Floats | None:
        """Return the values of all corners, NaN where there is none."""
        if not any(said):
            return None
        table = np.zeros((len(values) + 1, width))
        for k, value in enumerate(values):
            table[k, : len(value)] = value
        table[-1] = math.nan
        indices = self.resolve(said, 1 if keyword == "vt" else 2, len(values))
        missing = (indices < 0) & (np.array(said, object) != _NONE)
        if missing.any():
            place = f"line {self.line_of_corner(int(np.argmax(missing)))}"
            self.notes.add(
                f"left out: {what} of corners that name a `{keyword}` which is not there",
                place,
                int(missing.sum()),
            )
        found: Floats = table[indices]
        damaged = ~finite_rows(found) & (indices >= 0)
        if damaged.any():
            place = f"line {self.line_of_corner(int(np.argmax(damaged)))}"
            reason = f"left out: {what} of corners that are not finite"
            self.notes.add(reason, place, int(damaged.sum()))
        return found
