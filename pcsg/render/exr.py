"""Pictures in the format OpenEXR that scenes read.

The library decodes the pixels, and refuses bodies that are damaged. What stands before them is read
here: the library's own way to tell it ends the whole process where it is damaged.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.inputs import open_bytes
from pcsg.render.formats import load_openexr

_MAGIC = 20_000_630
_DEEP = 0x800
_LONGEST = 2**20
"""Bytes of a header, at most."""

_KINDS = (np.uint32, np.float16, np.float32)
"""Kinds of numbers, by the format's numbers for them."""


class _Header(NamedTuple):
    """What a file says of its first picture; channels are kinds of numbers by name."""

    width: int
    height: int
    channels: dict[str, int]


def read_exr(path: Path, check_size: Callable[[int, int, int], None]) -> NDArray[np.float32]:
    """Return the (H, W, 3) light of a picture.

    Parameters
    ----------
    check_size
        Raises an error if a width and a height are too much for a number of bytes.

    Raises
    ------
    UsageError
        It is no picture with the channels R, G and B, or damaged.
    EnvironmentFault
        It cannot be read, or the library is not installed.
    """
    library = load_openexr()
    with open_bytes(path, "picture") as file:
        head = file.read(_LONGEST)
        size = file.seek(0, io.SEEK_END)
    try:
        header = _read_header(head)
    except (ValueError, IndexError, struct.error) as error:
        raise UsageError(f"{path} is damaged, or of a kind that is not read: {error}") from None
    if not set("RGB") <= set(header.channels):
        raise UsageError(f"{path} has no channels R, G and B")
    check_size(header.width, header.height, size)
    pixels = np.empty((header.height, header.width, 3), np.float32)
    try:
        opened = library.InputFile(str(path))
        for k, name in enumerate("RGB"):
            values = np.frombuffer(opened.channel(name), _KINDS[header.channels[name]])
            pixels[..., k] = values.reshape(header.height, header.width)
    except MemoryError:
        raise
    except Exception as error:  # the library raises anything at damaged files
        raise UsageError(f"{path} is damaged, or of a kind that is not read: {error}") from None
    return pixels


def _read_header(data: bytes) -> _Header:
    """Read the attributes of the first picture (the format's technical introduction, 2013)."""
    magic, version = struct.unpack_from("<II", data)
    if magic != _MAGIC:
        raise ValueError("it does not begin as such files do")
    if version & _DEEP:
        raise ValueError("its pixels are deep")
    found: dict[str, bytes] = {}
    at = 8
    while data[at]:
        name, at = _read_word(data, at)
        _, at = _read_word(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        if not 0 <= size <= len(data) - at - 4:
            raise ValueError(f"its attribute {name!r} has no end")
        found[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    for name in ("dataWindow", "channels"):
        if name not in found:
            raise ValueError(f"it has no {name}")
    left, top, right, bottom = struct.unpack("<4i", found["dataWindow"])
    return _Header(right - left + 1, bottom - top + 1, _read_channels(found["channels"]))


def _read_channels(data: bytes) -> dict[str, int]:
    """Return the kinds of the numbers of every channel."""
    channels = {}
    at = 0
    while data[at]:
        name, at = _read_word(data, at)
        kind, _, across, down = struct.unpack_from("<iIii", data, at)
        at += 16
        if name in set("RGB") and (across, down) != (1, 1):
            raise ValueError("its colours are coarser than its pixels")
        if not 0 <= kind < len(_KINDS):
            raise ValueError(f"its channel {name!r} is of no known kind")
        channels[name] = kind
    return channels


def _read_word(data: bytes, at: int) -> tuple[str, int]:
    """Return a text, and where it ends with a zero."""
    end = data.index(0, at, at + 256)
    return data[at:end].decode("latin-1"), end + 1
