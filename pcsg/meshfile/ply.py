"""PLY, as text and binary of either byte order.

Format: Greg Turk, "The PLY Polygon File Format", 1994. Elements other than ``vertex`` and
``face`` are passed over.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np

from pcsg.meshfile.mesh import (
    Floats,
    Integers,
    Mesh,
    MeshFileError,
    linear_from_srgb,
    make_mesh,
    offsets_of,
)

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
_CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDICES = ("vertex_indices", "vertex_index")
_UV_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"))


@dataclass
class _Property:
    """A property; `count` is the type of a list's length, None for a number."""

    name: str
    kind: str
    count: str | None = None


@dataclass
class _Element:
    name: str
    size: int
    properties: list[_Property] = field(default_factory=list)


@dataclass
class _Column:
    """Values of a property, and for lists how many belong to each."""

    values: list[float] | Floats
    counts: list[int] | Integers | None


def read_ply(name: str, data: bytes) -> Mesh:
    """Read a PLY file; `name` is for messages."""
    order, elements, at, line = _read_header(name, data)
    body = _Binary(name, data, at, order) if order else _Text(name, data, at, line)
    columns = {
        element.name: dict(
            zip((p.name for p in element.properties), body.read(element), strict=True)
        )
        for element in elements
    }
    for wanted in ("vertex", "face"):
        if wanted not in columns:
            raise MeshFileError(name, None, f"no element `{wanted}`")
    with np.errstate(invalid="ignore"):
        return _build(name, columns["vertex"], columns["face"])


def _read_header(name: str, data: bytes) -> tuple[str, list[_Element], int, int]:
    """Return the byte order, the elements, and where the body begins: its byte and its line."""
    if not data.startswith(b"ply"):
        raise MeshFileError(name, "line 1", "a PLY file begins with `ply`")
    order: str | None = None
    elements: list[_Element] = []
    at = line = 0

    def fail(reason: str) -> NoReturn:
        raise MeshFileError(name, f"line {line}", reason)

    while True:
        end = data.find(b"\n", at)
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
                    fail(f"unknown format `{kind}`; expected {', '.join(_FORMATS)}")
                order = _FORMATS[kind]
            case ["element", element, size]:
                if not (size.isascii() and size.isdigit() and len(size) < 16):
                    fail(f"`{size}` is not a number of elements")
                elements.append(_Element(element, int(size)))
            case ["property", "list", count, kind, label] if elements:
                if _TYPES.get(count, "f")[0] == "f" or kind not in _TYPES:
                    fail(f"unknown types `{count} {kind}`")
                elements[-1].properties.append(_Property(label, _TYPES[kind], _TYPES[count]))
            case ["property", kind, label] if elements:
                if kind not in _TYPES:
                    fail(f"unknown type `{kind}`")
                elements[-1].properties.append(_Property(label, _TYPES[kind]))
            case [] | ["ply"] | ["comment" | "obj_info", *_]:
                pass
            case _:
                fail(f"`{' '.join(words)}` does not belong in a header")
    if order is None:
        fail("the header has no `format`")
    for e in elements:
        if not e.properties:
            fail(f"the element `{e.name}` has no properties")
    return order, elements, at, line


class _Text:
    """The body of a text file, one line for each element."""

    def __init__(self, name: str, data: bytes, at: int, line: int) -> None:
        self.name = name
        self.lines: Iterator[tuple[int, bytes]] = (
            (k, text) for k, text in enumerate(data[at:].splitlines(), line + 1) if text.strip()
        )
        self.last = line

    def read(self, element: _Element) -> Sequence[_Column]:
        """Read the columns of an element."""
        columns = [_Column([], None if p.count is None else []) for p in element.properties]
        for done in range(element.size):
            number, text = next(self.lines, (-1, b""))
            if number < 0:
                reason = f"the file ends after {done} of {element.size} `{element.name}`"
                raise MeshFileError(self.name, f"line {self.last}", reason)
            self.last = number
            try:
                values = list(map(float, text.split()))
                for column in columns:
                    n = 1 if column.counts is None else int(values.pop(0))
                    if not 0 <= n <= len(values):
                        raise ValueError
                    column.values += values[:n]
                    del values[:n]
                    if column.counts is not None:
                        column.counts.append(n)  # type: ignore[union-attr]
            except (ValueError, IndexError, OverflowError):
                shown = text.decode("latin-1").strip()[:40]
                reason = f"`{shown}` is not a `{element.name}` as the header says"
                raise MeshFileError(self.name, f"line {number}", reason) from None
        return columns


class _Binary:
    """The body of a binary file."""

    def __init__(self, name: str, data: bytes, at: int, order: str) -> None:
        self.name, self.data, self.at, self.order = name, data, at, order

    def read(self, element: _Element) -> Sequence[_Column]:
        """Read the columns of an element, at once where all its lists are as long as the first."""
        try:
            return self._read_uniform(element)
        except (_NotUniformError, struct.error):
            return self._read_one_by_one(element)

    def _read_uniform(self, element: _Element) -> Sequence[_Column]:
        if not element.size:
            raise _NotUniformError
        at = self.at
        fields: list[tuple[str, str, int]] = []
        for k, p in enumerate(element.properties):
            n = 1
            if p.count is not None:
                (n,) = struct.unpack_from(self.order + _CODES[p.count], self.data, at)
                if not 0 <= n <= len(self.data):
                    raise _NotUniformError
                at += struct.calcsize(_CODES[p.count])
                fields.append((f"length {k}", self.order + p.count, 1))
            fields.append((f"{k}", self.order + p.kind, n))
            at += n * struct.calcsize(_CODES[p.kind])
        record = np.dtype([(label, kind, (n,)) for label, kind, n in fields])
        if self.at + record.itemsize * element.size > len(self.data):
            raise _NotUniformError
        rows = np.frombuffer(self.data, record, element.size, self.at)
        columns = []
        for k, p in enumerate(element.properties):
            values = rows[f"{k}"]
            counts = None
            if p.count is not None:
                counts = rows[f"length {k}"].ravel().astype(np.int64)
                if (counts != values.shape[1]).any():
                    raise _NotUniformError
            columns.append(_Column(values.ravel().astype(np.float64), counts))
        self.at += record.itemsize * element.size
        return columns

    def _read_one_by_one(self, element: _Element) -> Sequence[_Column]:
        columns = [_Column([], None if p.count is None else []) for p in element.properties]
        for done in range(element.size):
            for p, column in zip(element.properties, columns, strict=True):
                try:
                    n = 1
                    if p.count is not None:
                        n = int(self._take(_CODES[p.count])[0])
                        if n < 0:
                            reason = f"a list of {n} numbers"
                            raise MeshFileError(self.name, f"byte {self.at}", reason)
                        column.counts.append(n)  # type: ignore[union-attr]
                    column.values += self._take(f"{n}{_CODES[p.kind]}")  # type: ignore[operator]
                except struct.error:
                    reason = f"the file ends after {done} of {element.size} `{element.name}`"
                    raise MeshFileError(self.name, f"byte {len(self.data)}", reason) from None
        return columns

    def _take(self, codes: str) -> tuple[float, ...]:
        values = struct.unpack_from(self.order + codes, self.data, self.at)
        self.at += struct.calcsize(self.order + codes)
        return values


class _NotUniformError(Exception):
    """The records of an element have different lengths."""


def _build(name: str, vertex: Mapping[str, _Column], face: Mapping[str, _Column]) -> Mesh:
    """Return the mesh of the columns of vertices and faces."""

    def numbers(*labels: str) -> Floats | None:
        found = [vertex[k] for k in labels if k in vertex and vertex[k].counts is None]
        if len(found) < len(labels):
            return None
        return np.stack([np.asarray(c.values, np.float64) for c in found], axis=1)

    points = numbers("x", "y", "z")
    if points is None:
        raise MeshFileError(name, None, "vertices have no properties `x`, `y` and `z`")
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(wrong):
        raise MeshFileError(name, f"vertex {wrong[0]}", "a vertex needs finite numbers")
    indices = next((face[k] for k in _INDICES if k in face), None)
    if indices is None or indices.counts is None:
        raise MeshFileError(name, None, f"faces have no list `{_INDICES[0]}`")
    counts = np.asarray(indices.counts, np.int64)
    offsets = offsets_of(counts)
    few = np.flatnonzero(counts < 3)
    if len(few):
        reason = f"a face needs at least 3 corners, not {counts[few[0]]}"
        raise MeshFileError(name, f"face {few[0]}", reason)
    corners = np.asarray(indices.values, np.float64)
    bad = np.flatnonzero(~((corners >= 0) & (corners < len(points)) & (corners // 1 == corners)))
    if len(bad):
        where = f"face {np.searchsorted(offsets, bad[0], side='right') - 1}"
        reason = f"there is no vertex {corners[bad[0]]:g}: {len(points)} are given"
        raise MeshFileError(name, where, reason)
    at = corners.astype(np.int64)
    uv = _face_uv(face, counts)
    for labels in _UV_NAMES if uv is None else ():
        of_vertices = numbers(*labels)
        if of_vertices is not None:
            uv = of_vertices[at]
            break
    normals, colors = numbers("nx", "ny", "nz"), numbers("red", "green", "blue")
    if colors is not None:
        # Bytes, unless all are fractions.
        colors = linear_from_srgb(colors / 255.0 if colors.max(initial=0.0) > 1.0 else colors)
    return make_mesh(
        points,
        at,
        offsets,
        uv,
        None if normals is None else normals[at],
        None if colors is None else colors[at],
    )


def _face_uv(face: Mapping[str, _Column], counts: Integers) -> Floats | None:
    """Return texture coordinates that faces carry in a list, as MeshLab writes them."""
    column = face.get("texcoord")
    if column is None or column.counts is None or not len(counts):
        return None
    if (np.asarray(column.counts, np.int64) != 2 * counts).any():
        return None
    return np.asarray(column.values, np.float64).reshape(-1, 2)
