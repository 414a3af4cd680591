"""What is common to mesh files that are text: encodings, and lines of places."""

from __future__ import annotations

import codecs

from pcsg.meshfile.mesh import MeshFileError

_WIDE = ((codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))


def as_utf8(name: str, data: bytes) -> bytes:
    """Return a text as UTF-8 without a byte order mark; `name` is for messages.

    Raises
    ------
    MeshFileError
        Its mark promises UTF-16, and it is not.
    """
    if data.startswith(codecs.BOM_UTF8):
        return data[len(codecs.BOM_UTF8) :]
    for mark, encoding in _WIDE:
        if data.startswith(mark):
            try:
                return data[len(mark) :].decode(encoding).encode()
            except UnicodeError:
                reason = "its byte order mark says UTF-16, but it is not; save it as UTF-8"
                raise MeshFileError(name, "byte 0", reason) from None
    return data


def line_of(data: bytes, at: int) -> str:
    """Return the place of a byte as ``line 12``."""
    return f"line {len((data[:at] + b'.').splitlines())}"


def shown(text: bytes, most: int = 60) -> str:
    """Return the beginning of a text for a message."""
    whole = text.decode("utf-8", "replace")
    return whole if len(whole) <= most else whole[:most] + "..."
