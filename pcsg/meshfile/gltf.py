"""The document of a glTF file: its objects by number, buffers, and accessors as arrays.

Format: Khronos Group, "glTF 2.0 Specification", section 3.6. A document is a tree of JSON without
a schema, so nothing in it is taken for granted.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn
from urllib.parse import unquote_to_bytes

import numpy as np

from pcsg.meshfile.mesh import Floats, Integers, MeshFileError
from pcsg.meshfile.words import shown

TRIANGLES, STRIP, FAN = 4, 5, 6
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_COMPRESSIONS = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_MOST_EMPTY = 2**20
"""Values of an accessor without data; more are no use, and a few bytes could ask for any number."""


_MOST_VALUES = 2**22
"""Numbers that accessors of a small file may have together, since they may overlap."""


class Document:
    """A glTF document with its binary data.

    Parameters
    ----------
    name
        The file, for messages.
    content
        Its JSON.
    binary
        The data behind it.
    """

    def __init__(self, name: str, content: Any, binary: bytes) -> None:
        if not isinstance(content, dict):
            raise MeshFileError(name, None, "its JSON is not a glTF document: it is no object")
        self.name, self.content, self.binary = name, content, binary
        self._buffers: dict[int, bytes] = {}
        self._accessors: dict[int, Floats] = {}
        self._left = max(_MOST_VALUES, 2 * len(binary))

    def fail(self, place: str | None, reason: str) -> NoReturn:
        """Raise the error of the file."""
        raise MeshFileError(self.name, place, reason)

    def list_of(self, owner: Mapping[str, Any], key: str, place: str = "its JSON") -> Sequence[Any]:
        """Return a list; empty where there is none."""
        found = owner.get(key, [])
        if not isinstance(found, list):
            self.fail(place, f"`{key}` is not a list")
        return found

    def object_of(
        self, owner: Mapping[str, Any], key: str, place: str = "its JSON"
    ) -> Mapping[str, Any]:
        """Return an object; empty where there is none."""
        found = owner.get(key, {})
        if not isinstance(found, dict):
            self.fail(place, f"`{key}` is not an object")
        return found

    def integer_of(
        self, owner: Mapping[str, Any], key: str, place: str, default: int | None = None
    ) -> int:
        """Return a whole number from 0 to 2^53; without a default it must be there."""
        found = owner.get(key, default)
        if isinstance(found, float) and found.is_integer():
            found = int(found)
        if not isinstance(found, int) or isinstance(found, bool) or not 0 <= found <= 2**53:
            self.fail(place, f"`{key}` is not a number from 0")
        return found

    def numbers_of(self, owner: Mapping[str, Any], key: str, default: Sequence[float]) -> Floats:
        """Return as many numbers as the default has."""
        found = owner.get(key, default)
        if not isinstance(found, list | tuple) or len(found) != len(default):
            self.fail("its JSON", f"`{key}` needs {len(default)} numbers")
        # JSON has integers of any size, and Python reads NaN in it.
        if not all(isinstance(x, int | float) and abs(x) < 1e300 for x in found):
            self.fail("its JSON", f"`{key}` needs finite numbers")
        return np.array(found, np.float64)

    def item(self, kind: str, number: Any, place: str = "its JSON") -> Mapping[str, Any]:
        """Return an object of a kind, such as ``meshes``, by its number."""
        items = self.list_of(self.content, kind)
        if not isinstance(number, int) or isinstance(number, bool):
            self.fail(place, f"`{shown(str(number).encode())}` is not a number of `{kind}`")
        if not 0 <= number < len(items):
            self.fail(place, f"there is no {number} in `{kind}`, which has {len(items)}")
        if not isinstance(items[number], dict):
            self.fail(place, f"{number} in `{kind}` is not an object")
        found: Mapping[str, Any] = items[number]
        return found

    def accessor(self, number: Any, *widths: int, place: str = "its JSON") -> Floats:
        """Return the values of an accessor, float64 (count, width); one of the widths must fit."""
        accessor = self.item("accessors", number, place)
        place = f"accessor {number}"
        kind = accessor.get("type")
        width = _WIDTHS.get(kind, 0) if isinstance(kind, str) else 0
        if width not in widths:
            self.fail(place, f"the type `{shown(str(kind).encode())}` does not fit here")
        if number not in self._accessors:
            self._accessors[number] = self._read(accessor, width, place)
        return self._accessors[number]

    def _read(self, accessor: Mapping[str, Any], width: int, place: str) -> Floats:
        code = _COMPONENTS.get(self.integer_of(accessor, "componentType", place))
        if code is None:
            self.fail(place, f"unknown `componentType` {accessor['componentType']}")
        kind = np.dtype(code)
        count = self.integer_of(accessor, "count", place)
        self._left -= count * width
        if "bufferView" in accessor:
            offset = self.integer_of(accessor, "byteOffset", place, 0)
            raw = self._values(accessor["bufferView"], offset, kind, count, width, place)
            values = raw.astype(np.float64)
        elif count > _MOST_EMPTY or self._left < 0:
            self.fail(place, f"{count} values without data; at most {_MOST_EMPTY} are zero")
        else:
            values = np.zeros((count, width))
        if "sparse" in accessor:
            self._replace(values, self.object_of(accessor, "sparse", place), kind, place)
        if accessor.get("normalized") is True and kind.kind in "iu":
            values = np.maximum(values / np.iinfo(kind).max, -1.0)
        return values

    def _replace(
        self, values: Floats, sparse: Mapping[str, Any], kind: np.dtype[Any], place: str
    ) -> None:
        """Put the values of a sparse accessor to their places."""
        count = self.integer_of(sparse, "count", place)
        at = self.object_of(sparse, "indices", place)
        instead = self.object_of(sparse, "values", place)
        code = _COMPONENTS.get(self.integer_of(at, "componentType", place))
        if code is None or code[1] != "u":
            self.fail(place, "its sparse indices need a type of whole numbers from 0")
        offset = self.integer_of(at, "byteOffset", place, 0)
        view = at.get("bufferView")
        indices = self._values(view, offset, np.dtype(code), count, 1, place).ravel()
        if len(indices) and int(indices.max()) >= len(values):
            self.fail(place, f"there is no value {indices.max()} to replace: {len(values)} are")
        offset = self.integer_of(instead, "byteOffset", place, 0)
        view = instead.get("bufferView")
        values[indices] = self._values(view, offset, kind, count, values.shape[1], place)

    def _values(
        self, view: Any, offset: int, kind: np.dtype[Any], count: int, width: int, place: str
    ) -> np.ndarray[Any, Any]:
        """Return values of a view as they are stored, (count, width)."""
        described = self.item("bufferViews", view, place)
        where = f"buffer view {view}"
        for compression in _COMPRESSIONS:
            if compression in self.object_of(described, "extensions", where):
                self.fail(place, f"its data need {compression}, which is not supported")
        data = self._buffer(described.get("buffer"), where)
        start = self.integer_of(described, "byteOffset", where, 0)
        room = self.integer_of(described, "byteLength", where, max(0, len(data) - start))
        size = kind.itemsize * width
        stride = self.integer_of(described, "byteStride", where, 0) or size
        begin = start + offset
        end = begin + (stride * (count - 1) + size if count else 0)
        limit = min(len(data), start + room)
        if stride < size or end > limit:
            self.fail(place, f"needs bytes {begin} to {end}, the data end at {limit}")
        if self._left < 0:
            self.fail(place, "accessors overlap: together they are larger than the file allows")
        return np.ndarray(
            (count, width), kind, data, begin if count else 0, (stride, kind.itemsize)
        )

    def _buffer(self, number: Any, place: str) -> bytes:
        buffer = self.item("buffers", number, place)
        if "uri" not in buffer:
            if number != 0:
                self.fail(place, f"buffer {number} has no data")
            return self.binary
        if number not in self._buffers:
            self._buffers[number] = self._decode(buffer["uri"], f"buffer {number}")
        return self._buffers[number]

    def _decode(self, uri: Any, place: str) -> bytes:
        if not isinstance(uri, str):
            self.fail(place, "its `uri` is not a text")
        if not uri.startswith("data:"):
            reason = f"its data lie in another file, `{shown(uri.encode('utf-8', 'replace'))}`"
            self.fail(place, f"{reason}; pack everything into the GLB")
        head, _, body = uri.partition(",")
        try:
            if head.endswith(";base64"):
                return base64.b64decode(body + "=" * (-len(body) % 4))
            return unquote_to_bytes(body)
        except (binascii.Error, ValueError) as error:
            self.fail(place, f"its data are damaged: {error}")


def of_vertices(document: Document, place: str, number: Any, n: int, *widths: int) -> Floats:
    """Return an attribute of n vertices.

    Raises
    ------
    MeshFileError
        There are not n values.
    """
    values = document.accessor(number, *widths, place=place)
    if len(values) != n:
        document.fail(place, f"{len(values)} values for {n} vertices")
    return values


def triangles_of(indices: Integers, mode: int) -> Integers:
    """Return triangles (T, 3) of a list, a strip or a fan."""
    if mode == TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    k = np.arange(max(0, len(indices) - 2))
    if mode == FAN:
        return indices[np.stack([k + 1, k + 2, np.zeros_like(k)], axis=1)]
    odd = k % 2
    return indices[np.stack([k, k + 1 + odd, k + 2 - odd], axis=1)]
