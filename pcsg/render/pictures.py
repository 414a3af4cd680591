"""Pictures that scenes read: textures and skies, as linear light."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import EnvironmentFault, UsageError
from pcsg.render.formats import load_openexr
from pcsg.render.tracer import Floats
from pcsg.render.view import decode_srgb

LINEAR = (".hdr", ".exr")
"""Endings of files that hold linear light; all others are sRGB."""


def read_linear(path: Path) -> Floats:
    """Return the (H, W, 3) linear light of a picture: .hdr, .exr, or anything Pillow reads.

    Raises
    ------
    UsageError
        It is no picture.
    EnvironmentFault
        It cannot be read, or the library for .exr is not installed.
    """
    ending = path.suffix.lower()
    try:
        if ending == ".hdr":
            return _read_hdr(path.read_bytes(), path)
        if ending == ".exr":
            return _read_exr(path)
        return np.asarray(decode_srgb(read_values(path)))
    except OSError as error:
        raise EnvironmentFault(f"cannot read {path}: {error.strerror or error}") from error


def read_values(path: Path) -> Floats:
    """Return the (H, W, 3) values of a picture as they are written, in [0, 1]."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as picture:
            if picture.mode.startswith("I"):
                deep = np.asarray(picture, dtype=float) / 65535.0
                return np.repeat(deep[..., None], 3, axis=2)
            return np.asarray(picture.convert("RGB"), dtype=float) / 255.0
    except UnidentifiedImageError:
        raise UsageError(f"{path} is not a picture that can be read") from None
    except OSError as error:
        raise EnvironmentFault(f"cannot read {path}: {error.strerror or error}") from error


def _read_exr(path: Path) -> Floats:
    library = load_openexr()
    with library.File(str(path)) as file:
        channels = file.channels()
        name = next((n for n in ("RGB", "RGBA") if n in channels), None)
        if name is None:
            raise UsageError(f"{path} has no channels R, G and B")
        return np.asarray(channels[name].pixels[..., :3], dtype=float)


def _read_hdr(data: bytes, path: Path) -> Floats:
    """Return the pixels of Radiance's format, with or without run lengths (Ward 1991)."""
    head, _, rest = data.partition(b"\n\n")
    if not head.startswith((b"#?RADIANCE", b"#?RGBE")):
        raise UsageError(f"{path} is not a picture in Radiance's format")
    size, _, body = rest.partition(b"\n")
    words = size.split()
    if len(words) != 4 or words[0] != b"-Y" or words[2] != b"+X":
        raise UsageError(f"{path} has its pixels in an order that is not read: {size!r}")
    height, width = int(words[1]), int(words[3])
    quads = np.zeros((height, width, 4), dtype=np.uint8)
    at = 0
    for row in range(height):
        start = body[at : at + 4]
        if 8 <= width < 32768 and start[:2] == b"\x02\x02" and start[2] << 8 | start[3] == width:
            at = _read_runs(body, at + 4, quads[row], path)
        else:
            plain = np.frombuffer(body[at : at + 4 * width], dtype=np.uint8)
            if len(plain) < 4 * width:
                raise UsageError(f"{path} ends too early")
            quads[row] = plain.reshape(width, 4)
            at += 4 * width
    exponent = quads[..., 3].astype(np.int64)
    scale = np.where(exponent > 0, np.ldexp(1.0, exponent - 136), 0.0)
    return np.asarray(quads[..., :3] * scale[..., None])


def _read_runs(body: bytes, at: int, row: NDArray[np.uint8], path: Path) -> int:
    """Fill a row, one channel after the other; return where the next one begins."""
    width = len(row)
    for channel in range(4):
        x = 0
        while x < width:
            if at + 1 >= len(body):
                raise UsageError(f"{path} ends too early")
            count = body[at]
            if count > 128:
                row[x : x + count - 128, channel] = body[at + 1]
                x += count - 128
                at += 2
            else:
                values = np.frombuffer(body[at + 1 : at + 1 + count], dtype=np.uint8)
                row[x : x + len(values), channel] = values
                x += max(count, 1)
                at += 1 + count
    return at
