"""Pictures in PNG and what else Pillow reads, spoilt, as skies and textures."""

from __future__ import annotations

import io
import random
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from driver import Subject
from lights import use_picture
from mutations import spoil_bytes
from PIL import Image

SIGNATURE = b"\x89PNG\r\n\x1a\n"


def seeds() -> Sequence[bytes]:
    rng = np.random.default_rng(1)
    colours = rng.integers(0, 256, (9, 11, 4)).astype(np.uint8)
    deep = rng.integers(0, 65536, (9, 11)).astype(np.uint16)
    pictures = [
        Image.fromarray(colours[..., :3]),
        Image.fromarray(colours),
        Image.fromarray(colours[..., 0]),
        Image.fromarray(deep),
        Image.fromarray(colours[..., :3]).quantize(16),
        Image.fromarray(colours[..., 0] > 99),
    ]
    kinds = [*zip(pictures, ["PNG"] * 6, strict=True)]
    kinds += [(pictures[0], kind) for kind in ("JPEG", "TIFF", "BMP", "GIF", "PPM", "WEBP", "TGA")]
    made = []
    for picture, kind in kinds:
        file = io.BytesIO()
        picture.save(file, format=kind)
        made.append(file.getvalue())
    return made


def mutate(rng: random.Random, data: bytes) -> bytes:
    if not data.startswith(SIGNATURE) or rng.random() < 0.3:
        return spoil_bytes(rng, data)
    # Check sums that are right let a reader go farther.
    chunks = _chunks(data)
    k = rng.randrange(len(chunks))
    name, body = chunks[k]
    what = rng.randrange(6)
    if what == 0:
        chunks.insert(k, chunks[rng.randrange(len(chunks))])
    elif what == 1:
        del chunks[k]
    elif what == 2 and name == b"IDAT":
        chunks[k] = name, zlib.compress(spoil_bytes(rng, zlib.decompress(body)))
    elif what == 3:
        text = zlib.compress(bytes(10 ** rng.choice([1, 2, 3, 4, 4, 5, 5, 5, 5, 7])))
        chunks.insert(1, (b"zTXt", b"a\0\0" + text))
    else:
        chunks[k] = name, spoil_bytes(rng, body)
    return SIGNATURE + b"".join(
        struct.pack(">I", len(b)) + n + b + struct.pack(">I", zlib.crc32(n + b)) for n, b in chunks
    )


def _chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """Return names and contents."""
    found, at = [], len(SIGNATURE)
    while at < len(data):
        (size,) = struct.unpack(">I", data[at : at + 4])
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += size + 12
    return found


def run(data: bytes, folder: Path) -> None:
    use_picture(folder / "a.png", data)


SUBJECT = Subject("png", seeds, mutate, run)
