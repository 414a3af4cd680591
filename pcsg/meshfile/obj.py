"""Wavefront OBJ: polygons with texture coordinates and normals.

Format: "Appendix B1, Object Files", Advanced Visualizer manual, 1992. Groups, materials, lines,
points and free-form curves are passed over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NoReturn

import numpy as np

from pcsg.meshfile.mesh import (
    Floats,
    Mesh,
    MeshFileError,
    linear_from_srgb,
    make_mesh,
    offsets_of,
)


def read_obj(name: str, data: bytes) -> Mesh:
    """Read an OBJ file; `name` is for messages."""
    reader = _Reader(name)
    for number, line in _lines(data):
        words = line.split()
        if not words:
            continue
        keyword = words[0]
        if keyword == b"v":
            reader.points.append(reader.numbers(number, words, 3))
            if len(words) >= 7:  # colours behind the coordinates, as many programs write them
                reader.colors[len(reader.points) - 1] = reader.numbers(number, words[3:], 3)
        elif keyword == b"f":
            reader.add_face(number, words[1:])
        elif keyword == b"vt":
            reader.uvs.append(reader.numbers(number, words, 1))
        elif keyword == b"vn":
            reader.normals.append(reader.numbers(number, words, 3))
    return reader.mesh()


def _lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield lines without comments, continued ones joined, with the number of the first."""
    held = b""
    first = 0
    number = 0
    for number, raw in enumerate(data.splitlines(), 1):
        line = raw.split(b"#", 1)[0]
        if not held:
            first = number
        if line.rstrip().endswith(b"\\"):
            held += line.rstrip()[:-1] + b" "
            continue
        yield first, held + line
        held = b""
    if held:
        yield first, held


class _Reader:
    def __init__(self, name: str) -> None:
        self.name = name
        self.points: list[tuple[float, ...]] = []
        self.uvs: list[tuple[float, ...]] = []
        self.normals: list[tuple[float, ...]] = []
        self.colors: dict[int, tuple[float, ...]] = {}
        self.counts: list[int] = []
        self.corners: list[int] = []
        self.corner_uvs: list[int] = []
        self.corner_normals: list[int] = []

    def fail(self, line: int, reason: str) -> NoReturn:
        raise MeshFileError(self.name, f"line {line}", reason)

    def numbers(self, line: int, words: list[bytes], least: int) -> tuple[float, ...]:
        """Return up to three finite numbers after a keyword."""
        keyword = words[0].decode("utf-8", "replace")
        if len(words) <= least:
            self.fail(line, f"`{keyword}` needs {least} number(s), not {len(words) - 1}")
        try:
            values = tuple(map(float, words[1:4]))
        except ValueError:
            text = b" ".join(words[1:4]).decode("utf-8", "replace")
            self.fail(line, f"`{text}` are not numbers")
        if not all(map(math.isfinite, values)):
            self.fail(line, f"`{keyword}` needs finite numbers")
        return values

    def add_face(self, line: int, words: list[bytes]) -> None:
        """Append a polygon; indices count from 1, negative ones from the last."""
        if len(words) < 3:
            self.fail(line, f"a face needs at least 3 corners, not {len(words)}")
        for word in words:
            parts = word.split(b"/")
            try:
                point = int(parts[0])
                uv = int(parts[1]) if len(parts) > 1 and parts[1] else 0
                normal = int(parts[2]) if len(parts) > 2 and parts[2] else 0
            except ValueError:
                self.fail(line, f"`{word.decode('utf-8', 'replace')}` is not a corner")
            self.corners.append(self.resolve(line, "vertex", point, len(self.points)))
            # 0 stands for none.
            known = len(self.uvs)
            self.corner_uvs.append(self.resolve(line, "vt", uv, known) if uv else -1)
            known = len(self.normals)
            self.corner_normals.append(self.resolve(line, "vn", normal, known) if normal else -1)
        self.counts.append(len(words))

    def resolve(self, line: int, what: str, index: int, known: int) -> int:
        """Return an index from 0."""
        found = index - 1 if index > 0 else known + index
        if index == 0 or not 0 <= found < known:
            self.fail(line, f"there is no {what} {index}: {known} are given above")
        return found

    def mesh(self) -> Mesh:
        """Return what was read."""
        corners = np.array(self.corners, np.int64)
        colors = None
        if self.colors:
            table = np.full((len(self.points), 3), math.nan)
            table[list(self.colors)] = list(self.colors.values())
            colors = linear_from_srgb(table)[corners]
        return make_mesh(
            np.array(self.points, np.float64).reshape(-1, 3),
            corners,
            offsets_of(self.counts),
            _gather(self.uvs, self.corner_uvs, 2),
            _gather(self.normals, self.corner_normals, 3),
            colors,
        )


def _gather(values: list[tuple[float, ...]], indices: list[int], width: int) -> Floats | None:
    """Return the values of all corners, NaN where there is none."""
    if not values:
        return None
    table = np.zeros((len(values) + 1, width))
    for k, value in enumerate(values):
        table[k, : len(value)] = value[:width]
    table[-1] = math.nan
    found: Floats = table[np.array(indices, np.int64)]
    return found
