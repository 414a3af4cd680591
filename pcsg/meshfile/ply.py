"""PLY, as text and binary of either byte order.

Format: Greg Turk, "The PLY Polygon File Format", 1994. Elements other than ``vertex``, ``face``
and ``tristrips`` are passed over.
"""

from __future__ import annotations

from collections.abc import Mapping
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
from pcsg.meshfile.plybody import BinaryBody, Body, Column, Element, Property, TextBody
from pcsg.meshfile.words import as_utf8, shown

_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDICES = ("vertex_indices", "vertex_index")
_UV_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"))
_COLOR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_RANGES = {"i1": 2**7 - 1, "u1": 2**8 - 1, "i2": 2**15 - 1, "u2": 2**16 - 1}
"""What is 1 in colours of short integers; long ones mostly hold bytes."""
_FULL = 2**32 - 1

_Columns = Mapping[str, Column]


def read_ply(name: str, data: bytes) -> Mesh:
    """Read a PLY file; `name` is for messages."""
    data = as_utf8(name, data)
    order, elements, at, line = _read_header(name, data)
    body: Body = BinaryBody(name, data, at, order) if order else TextBody(name, data, at, line)
    columns: dict[str, _Columns] = {}
    for element in elements:
        found = zip((p.name for p in element.properties), body.read(element), strict=True)
        columns.setdefault(element.name, dict(found))
    if "vertex" not in columns:
        raise MeshFileError(name, None, "no element `vertex`")
    if "face" not in columns and "tristrips" not in columns:
        raise MeshFileError(name, None, "no element `face`: points without faces are no surface")
    return _Builder(name, columns["vertex"]).mesh(columns.get("face"), columns.get("tristrips"))


def _read_header(name: str, data: bytes) -> tuple[str, list[Element], int, int]:
    """Return the byte order, the elements, and where the body begins: its byte and its line."""
    if not data.startswith(b"ply"):
        raise MeshFileError(name, "line 1", "a PLY file begins with `ply`")
    order: str | None = None
    elements: list[Element] = []
    at = line = 0

    def fail(reason: str) -> NoReturn:
        raise MeshFileError(name, f"line {line}", reason)

    # An old form of line ends is a carriage return alone.
    first = data[: data.find(b"\n") + 1 or len(data)]
    newline = b"\r" if b"\r" in first.rstrip(b"\r\n") else b"\n"
    while True:
        end = data.find(newline, at)
        if end < 0:
            raise MeshFileError(name, None, "the header has no `end_header`")
        line += 1
        words = data[at:end].decode("latin-1").split()
        at = end + 1
        match words:
            case ["end_header"]:
                break
            case ["format", kind, _]:
                if kind not in _FORMATS:
                    fail(f"unknown format `{shown(kind.encode())}`; expected {', '.join(_FORMATS)}")
                order = _FORMATS[kind]
            case ["element", element, size]:
                if not (size.isascii() and size.isdigit() and len(size) < 16):
                    fail(f"`{size}` is not a number of elements")
                elements.append(Element(element, int(size)))
            case ["property", "list", count, kind, label] if elements:
                if _TYPES.get(count, "f")[0] == "f" or kind not in _TYPES:
                    fail(f"unknown types `{count} {kind}`")
                elements[-1].properties.append(Property(label, _TYPES[kind], _TYPES[count]))
            case ["property", kind, label] if elements:
                if kind not in _TYPES:
                    fail(f"unknown type `{kind}`")
                elements[-1].properties.append(Property(label, _TYPES[kind]))
            case [] | ["ply"] | ["comment" | "obj_info", *_]:
                pass
            case _:
                said = shown(" ".join(words).encode())
                fail(f"`{said}` does not belong in a header")
    if order is None:
        fail("the header has no `format`")
    for e in elements:
        if not e.properties:
            fail(f"the element `{e.name}` has no properties")
    return order, elements, at, line


class _Builder:
    """Makes a mesh of columns."""

    def __init__(self, name: str, vertex: _Columns) -> None:
        self.name, self.vertex = name, vertex
        self.notes = Notes()
        points = _numbers(vertex, "x", "y", "z")
        if points is None:
            raise MeshFileError(name, None, "vertices have no properties `x`, `y` and `z`")
        self.points = points

    def mesh(self, face: _Columns | None, strips: _Columns | None) -> Mesh:
        """Return the mesh of faces and strips."""
        lists = np.zeros(0), np.zeros(0, np.int64)
        if face is not None:
            lists = self._lists("faces", face)
        corners, counts = self._checked("face", *lists), lists[1]
        faces = len(counts)
        if strips is not None:
            triangles = _cut_strips(*self._lists("tristrips", strips))
            threes = np.full(len(triangles) // 3, 3)
            corners = np.concatenate([corners, self._checked("triangle", triangles, threes)])
            counts = np.concatenate([counts, threes])
        points = checked_vertices(
            self.name, self.points, corners, lambda k: f"vertex {k}", self.notes
        )
        uv = _face_uv(face, counts, faces) if face else None
        for labels in _UV_NAMES if uv is None else ():
            of_vertices = self._finite("texture coordinates", _numbers(self.vertex, *labels))
            if of_vertices is not None:
                uv = of_vertices[corners]
                break
        normals = self._finite("normals", _numbers(self.vertex, "nx", "ny", "nz"))
        colors = self._finite("colours", _colors(self.vertex))
        of_corners = None if colors is None else colors[corners]
        painted = _colors(face) if face else None
        if painted is not None:
            own = np.full((len(corners), 3), np.nan) if of_corners is None else of_corners
            own[: int(counts[:faces].sum())] = np.repeat(painted, counts[:faces], axis=0)
            of_corners = own
        return make_mesh(
            points,
            corners,
            offsets_of(counts),
            uv,
            None if normals is None else normals[corners],
            of_corners,
            self.notes,
        )

    def _lists(self, what: str, columns: _Columns) -> tuple[Floats, Integers]:
        """Return numbers of vertices, and how many each record has."""
        found = next((columns[k] for k in _INDICES if k in columns), None)
        if found is None or found.counts is None:
            raise MeshFileError(self.name, None, f"{what} have no list `{_INDICES[0]}`")
        return found.values, found.counts

    def _checked(self, what: str, said: Floats, counts: Integers) -> Integers:
        known = len(self.points)
        bad = np.flatnonzero(~((said >= 0) & (said < known) & (np.floor(said) == said)))
        if len(bad):
            where = np.searchsorted(offsets_of(counts), bad[0], side="right") - 1
            reason = f"there is no vertex {said[bad[0]]:g}: {known} are given"
            raise MeshFileError(self.name, f"{what} {where}", reason)
        return said.astype(np.int64)

    def _finite(self, what: str, values: Floats | None) -> Floats | None:
        """Return values of vertices; note those that are not finite."""
        if values is not None:
            wrong = ~finite_rows(values)
            if wrong.any():
                place = f"vertex {int(wrong.argmax())}"
                self.notes.add(f"left out: {what} that are not finite", place, int(wrong.sum()))
        return values


def _numbers(columns: _Columns, *labels: str) -> Floats | None:
    """Return the columns of numbers beside each other, None if one is missing."""
    found = [columns[k] for k in labels if k in columns and columns[k].counts is None]
    if len(found) < len(labels):
        return None
    return np.stack([c.values for c in found], axis=1)


def _colors(columns: _Columns) -> Floats | None:
    """Return linear colours; their type tells what is white."""
    for labels in _COLOR_NAMES:
        values = _numbers(columns, *labels)
        if values is not None:
            kinds = {columns[k].kind for k in labels}
            top = _RANGES.get(kinds.pop()) if len(kinds) == 1 else None
            return linear_from_display(values, _FULL if values.max(initial=0.0) > 2**16 else top)
    return None


def _face_uv(face: _Columns, counts: Integers, faces: int) -> Floats | None:
    """Return texture coordinates that faces carry in a list, as MeshLab writes them."""
    column = face.get("texcoord")
    if column is None or column.counts is None or not faces:
        return None
    if (column.counts != 2 * counts[:faces]).any():
        return None
    found = np.full((int(counts.sum()), 2), np.nan)
    found[: len(column.values) // 2] = column.values.reshape(-1, 2)
    return found


def _cut_strips(values: Floats, counts: Integers) -> Floats:
    """Return the triangles of strips, one after the other; a negative number ends a strip."""
    if len(values) < 3:
        return np.zeros(0)
    # Strips begin with their lists, and behind ends.
    begins = np.zeros(len(values), np.bool_)
    first = offsets_of(counts)[:-1]
    begins[first[first < len(values)]] = True
    begins[1:] |= values[:-1] < 0.0
    place = np.arange(len(values))
    start = np.maximum.accumulate(np.where(begins, place, 0))
    k = place[:-2]
    whole = (start[k] == start[k + 2]) & ~(values[k + 2] < 0.0)
    k = k[whole]
    odd = (k - start[k]) % 2
    found: Floats = values[np.stack([k, k + 1 + odd, k + 2 - odd], axis=1)].ravel()
    return found
