"""The formats that pictures are written in."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import EnvironmentFault, missing_extra

BAND = 64
"""Rows of a picture that are worked on at a time, to save memory."""

LEVEL = 3
"""Of packing. 6 takes twice the time, to save nothing of an even picture and 4 % of a noisy one."""

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def write_png(file: IO[bytes], pixels: NDArray[np.generic], texts: Mapping[str, str]) -> None:
    """Write sRGB pixels, uint8 or uint16 (H, W, 3 or 4), with texts by keyword."""
    height, width, channels = pixels.shape
    bits = 8 * pixels.dtype.itemsize
    raw = pixels.astype(pixels.dtype.newbyteorder(">")).reshape(height, -1).view(np.uint8)
    rows = _filtered(raw, channels * pixels.dtype.itemsize)
    file.write(_SIGNATURE)
    _write_chunk(
        file, b"IHDR", struct.pack(">IIBBBBB", width, height, bits, {3: 2, 4: 6}[channels], 0, 0, 0)
    )
    _write_chunk(file, b"sRGB", b"\x00")
    for keyword, text in texts.items():
        if text.isascii():
            _write_chunk(file, b"tEXt", keyword.encode() + b"\x00" + text.encode())
        else:
            _write_chunk(file, b"iTXt", keyword.encode() + b"\x00\x00\x00\x00\x00" + text.encode())
    _write_chunk(file, b"IDAT", zlib.compress(rows.tobytes(), LEVEL))
    _write_chunk(file, b"IEND", b"")


def _filtered(raw: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Return rows of bytes as differences to what their neighbours foretell, which packs better.

    Every row is foretold in the way that leaves the least (section 12.8 of the PNG specification).

    Parameters
    ----------
    step
        Bytes from a pixel to the next.
    """
    padded = np.pad(raw, ((1, 0), (0, 0)))
    bands = range(0, len(raw), BAND)
    return np.concatenate([_filter_band(padded[k : k + BAND + 1], step) for k in bands])


def _filter_band(padded: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Return the rows of a band but the first, which is only the one above, filtered."""
    raw, above = padded[1:], padded[:-1]
    before, corner = np.zeros_like(raw), np.zeros_like(raw)
    before[:, step:], corner[:, step:] = raw[:, :-step], above[:, :-step]
    a, b, c = (values.astype(np.int16) for values in (before, above, corner))
    to_a, to_b, to_c = np.abs(b - c), np.abs(a - c), np.abs(a + b - 2 * c)
    nearest = np.where((to_a <= to_b) & (to_a <= to_c), a, np.where(to_b <= to_c, b, c))
    foretold = (np.zeros_like(raw), before, above, (a + b) // 2, nearest)
    left = np.stack([raw - values.astype(np.uint8) for values in foretold])
    which = np.abs(left.view(np.int8).astype(np.int16)).sum(axis=2).argmin(axis=0)
    best = left[which, np.arange(len(raw))]
    return np.concatenate([which[:, None].astype(np.uint8), best], axis=1)


def _write_chunk(file: IO[bytes], name: bytes, data: bytes) -> None:
    file.write(struct.pack(">I", len(data)) + name + data)
    file.write(struct.pack(">I", zlib.crc32(name + data)))


def write_exr(
    path: Path, layers: Mapping[str, NDArray[np.generic]], texts: Mapping[str, str]
) -> None:
    """Write layers (H, W[, 3]) as channels of an OpenEXR file, linear and unscaled.

    Raises
    ------
    EnvironmentFault
        The library is not installed.
    OSError
        The system refuses.
    """
    library = load_openexr()
    channels = {}
    for name, values in layers.items():
        if np.issubdtype(values.dtype, np.integer):
            # The format knows no negative numbers of 32 bits; real ones hold labels up to 2^24.
            values = values.astype(np.float32)
        pixels = np.ascontiguousarray(values, dtype=np.float32)
        if values.ndim == 3 and name != "RGB":
            axes = "XYZ" if name == "normal" else "RGB"
            for k, axis in enumerate(axes):
                channels[f"{name}.{axis}"] = np.ascontiguousarray(pixels[..., k])
        else:
            channels["Z" if name == "depth" else name] = pixels
    header: dict[str, Any] = {
        "compression": library.ZIP_COMPRESSION,
        "type": library.scanlineimage,
        **texts,
    }
    try:
        library.File(header, channels).write(str(path))
    except RuntimeError as error:
        # What the system says stands behind the name.
        raise OSError(str(error).rpartition('". ')[2]) from error


def load_openexr() -> Any:
    """Return the library OpenEXR.

    Raises
    ------
    EnvironmentFault
        It is not installed.
    """
    try:
        import OpenEXR
    except ImportError:
        raise EnvironmentFault(
            missing_extra("files in the format .exr need", "the library OpenEXR", "exr")
        ) from None
    return OpenEXR
