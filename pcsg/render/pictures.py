"""Pictures that scenes read: textures and skies, as linear light."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.inputs import read_bytes
from pcsg.render.exr import read_exr
from pcsg.render.formats import BAND
from pcsg.render.view import decode_srgb

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

Pixels = NDArray[np.float32]

FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "GIF", "PPM", "TGA")
"""Formats of Pillow that are read. Others start programs, or are hardly ever met."""

PLENTY = 2**25
"""Pixels of a picture whose file may be as small as it likes."""

MOST = 2**28
"""Pixels of the largest picture that is read."""

PACKING = 32
"""Pixels of a larger picture for each byte of its file, at most."""


def read_linear(path: Path) -> Pixels:
    """Return the (H, W, 3) linear light of a picture: .hdr, .exr, or what Pillow reads.

    What no light is, is mended: what is not a number or negative is black, and what is infinite is
    as bright as the brightest other value.

    Raises
    ------
    UsageError
        It is no picture, damaged, or too large.
    EnvironmentFault
        It cannot be read, or the library for .exr is not installed.
    """
    ending = path.suffix.lower()
    if ending == ".hdr":
        return _read_hdr(read_bytes(path, "picture"), path)
    if ending == ".exr":
        return _mended(read_exr(path, lambda w, h, size: _check_size(w, h, size, path)))
    values = read_values(path)
    for k in range(0, len(values), BAND):
        values[k : k + BAND] = decode_srgb(values[k : k + BAND])
    return values


def read_values(path: Path) -> Pixels:
    """Return the (H, W, 3) values of a picture as they are written, in [0, 1].

    Raises
    ------
    UsageError
        It is no picture, damaged, or too large.
    EnvironmentFault
        It cannot be read.
    """
    return _read(path, _values)


def read_opacity(path: Path) -> Pixels:
    """Return (H, W) how opaque a picture is, in [0, 1]; where it does not say, how bright.

    Raises
    ------
    UsageError
        It is no picture, damaged, or too large.
    EnvironmentFault
        It cannot be read.
    """
    return _read(path, _opacity)


def _read(path: Path, take: Callable[[Picture], Pixels]) -> Pixels:
    """Return what is taken from a picture that Pillow reads."""
    from PIL import Image, UnidentifiedImageError

    data = read_bytes(path, "picture")
    try:
        with warnings.catch_warnings():
            # It warns of large pictures; we have a limit of our own.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data), formats=FORMATS) as picture:
                _check_size(picture.width, picture.height, len(data), path)
                return take(picture)
    except UnidentifiedImageError:
        raise UsageError(f"{path} is not a picture that can be read") from None
    except Image.DecompressionBombError:
        raise UsageError(f"{path} is a picture of too many pixels") from None
    except (UsageError, MemoryError):
        raise
    except Exception as error:  # decoders raise anything when a file is damaged
        raise UsageError(f"{path} is damaged: {error}") from None


def _opacity(picture: Picture) -> Pixels:
    """Return how opaque a picture is; how bright, if it has no opacity."""
    if "transparency" in picture.info or "A" in picture.getbands():
        return np.asarray(picture.convert("RGBA").getchannel("A"), np.float32) / np.float32(255)
    return np.asarray(_values(picture).mean(axis=2))


def _values(picture: Picture) -> Pixels:
    """Return the values of a picture, made in bands to save memory."""
    deep = picture.mode.startswith("I")
    if picture.mode == "P" and "transparency" in picture.info:
        picture = picture.convert("RGBA")  # else Pillow warns of what it leaves out
    if not deep and picture.mode != "RGB":
        picture = picture.convert("RGB")
    raw = np.asarray(picture)
    values = np.empty((*raw.shape[:2], 3), np.float32)
    for k in range(0, len(raw), BAND):
        band = raw[k : k + BAND]
        if deep:
            band = np.clip(band, 0, 65535)[..., None]
        values[k : k + BAND] = band / (65535.0 if deep else 255.0)
    return values


def _check_size(width: int, height: int, size: int, path: Path) -> None:
    """Refuse a picture that is much larger than its file, before room is made for it."""
    pixels = width * height
    if width < 1 or height < 1:
        raise UsageError(f"{path} is a picture without pixels")
    if pixels > MOST or pixels > max(PLENTY, PACKING * size):
        raise UsageError(
            f"{path} is a picture of {width} x {height} pixels in {size:,} bytes: too many"
        )


def _mended(pixels: Pixels) -> Pixels:
    """Return light without what is none."""
    finite = np.isfinite(pixels)
    if not finite.all():
        most = pixels.max(where=finite, initial=0.0)
        pixels = np.where(np.isposinf(pixels), most, np.where(finite, pixels, np.float32(0)))
    return np.maximum(pixels, np.float32(0))


def _read_hdr(data: bytes, path: Path) -> Pixels:
    """Return the pixels of Radiance's format, with or without run lengths (Ward 1991)."""
    head, _, rest = data.partition(b"\n\n")
    if not head.startswith((b"#?RADIANCE", b"#?RGBE")):
        raise UsageError(f"{path} is not a picture in Radiance's format")
    line, _, body = rest.partition(b"\n")
    words = line[:80].split()
    if len(words) != 4 or words[0] != b"-Y" or words[2] != b"+X":
        raise UsageError(f"{path} has its pixels in an order that is not read: {line[:40]!r}")
    if not (words[1].isdigit() and words[3].isdigit()):
        raise UsageError(f"{path} does not say how large it is: {line[:40]!r}")
    height, width = int(words[1]), int(words[3])
    _check_size(width, height, len(data), path)
    # A row takes two bytes for each run of 127 equal values, in four channels.
    if height * min(4 * width, 4 + 8 * -(-width // 127)) > len(body):
        raise UsageError(f"{path} ends too early")
    quads = np.zeros((height, width, 4), dtype=np.uint8)
    packed = bytes([2, 2, width >> 8, width & 255]) if 8 <= width < 32768 else b"never"
    at = 0
    for row in range(height):
        if body[at : at + 4] == packed:
            at = _read_runs(body, at + 4, quads[row], path)
        else:
            plain = np.frombuffer(body, np.uint8, max(min(4 * width, len(body) - at), 0), at)
            if len(plain) < 4 * width:
                raise UsageError(f"{path} ends too early")
            quads[row] = plain.reshape(width, 4)
            at += 4 * width
    pixels = np.empty((height, width, 3), np.float32)
    for k in range(0, height, BAND):
        exponent = quads[k : k + BAND, :, 3].astype(np.int64)
        scale = np.where(exponent > 0, np.ldexp(1.0, exponent - 136), 0.0)
        pixels[k : k + BAND] = quads[k : k + BAND, :, :3] * scale[..., None]
    return pixels


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
                if count - 128 > width - x:
                    raise UsageError(f"{path} is damaged: a row does not end where it should")
                row[x : x + count - 128, channel] = body[at + 1]
                x += count - 128
                at += 2
            else:
                if at + 1 + count > len(body):
                    raise UsageError(f"{path} ends too early")
                values = np.frombuffer(body, np.uint8, count, at + 1)
                if not 0 < count <= width - x:
                    raise UsageError(f"{path} is damaged: a row does not end where it should")
                row[x : x + count, channel] = values
                x += count
                at += 1 + count
    return at
