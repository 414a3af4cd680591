"""The container of glTF's binary files: a document, and arrays behind it."""

from __future__ import annotations

import json
import struct
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

_COMPONENTS = {"<f4": 5126, "<u4": 5125}
_VERTICES, _INDICES = 34962, 34963


class Buffers:
    """Arrays of a document, and what it says of them.

    Attributes
    ----------
    arrays
        Of numbers of four bytes.
    views, accessors
        As the document has them.
    """

    def __init__(self) -> None:
        self.arrays: list[NDArray[Any]] = []
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.size = 0

    def add(
        self, array: NDArray[Any], kind: str, *, indices: bool = False, bounds: bool = False
    ) -> int:
        """Return the number of the accessor of an array.

        Parameters
        ----------
        array
            float32 or uint32, little-endian; a row for each element.
        kind
            ``SCALAR``, ``VEC2`` and so on.
        indices
            Whether they are corners of triangles.
        bounds
            Whether the least and the greatest values are told, as of positions they must be.
        """
        self.views.append(
            {
                "buffer": 0,
                "byteOffset": self.size,
                "byteLength": array.nbytes,
                "target": _INDICES if indices else _VERTICES,
            }
        )
        about: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": _COMPONENTS[array.dtype.str],
            "count": len(array),
            "type": kind,
        }
        if bounds:
            about |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.accessors.append(about)
        self.arrays.append(np.ascontiguousarray(array))
        self.size += array.nbytes
        return len(self.accessors) - 1


def write_container(file: IO[bytes], document: dict[str, Any], buffers: Buffers) -> None:
    """Write a document and its arrays."""
    whole = {
        **document,
        "buffers": [{"byteLength": buffers.size}],
        "bufferViews": buffers.views,
        "accessors": buffers.accessors,
    }
    text = json.dumps(whole, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + buffers.size))
    file.write(struct.pack("<I4s", len(text), b"JSON") + text)
    file.write(struct.pack("<I4s", buffers.size, b"BIN\0"))
    for array in buffers.arrays:
        file.write(array.tobytes())
