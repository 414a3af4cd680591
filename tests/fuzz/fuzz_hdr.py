"""Pictures in Radiance's format, spoilt, as skies and textures."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

from driver import Subject
from lights import use_picture
from mutations import spoil_bytes, spoil_text

HEAD = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"
WORDS = ("-Y ", "+X ", "-X ", "+Y ", "\n", "\n\n", "#?RGBE", "EXPOSURE=1e9\n", "999999999 ", "0 ")


def seeds() -> Sequence[bytes]:
    rng = random.Random(1)
    flat = HEAD + b"-Y 5 +X 7\n" + rng.randbytes(4 * 35)
    runs = HEAD + b"-Y 4 +X 9\n" + b"".join(_row(rng, 9) for _ in range(4))
    long = HEAD + b"-Y 2 +X 300\n" + b"".join(_row(rng, 300) for _ in range(2))
    return [flat, runs, long]


def _row(rng: random.Random, width: int) -> bytes:
    """Return a row by runs of equal and of different values."""
    row = bytes([2, 2, width >> 8, width & 255])
    for _ in range(4):
        left = width
        while left:
            n = min(left, rng.randint(1, 127))
            row += bytes([128 + n, rng.randrange(256)]) if rng.random() < 0.5 else bytes([n])
            row += b"" if row[-2] == 128 + n else rng.randbytes(n)
            left -= n
    return row


def mutate(rng: random.Random, data: bytes) -> bytes:
    head, mark, body = data.partition(b"\n\n")
    line, end, pixels = body.partition(b"\n")
    what = rng.randrange(4)
    if what == 0:
        return spoil_bytes(rng, data)
    if what == 1:
        line = spoil_text(rng, line.decode("latin-1"), WORDS, 2).encode("utf-8", "replace")
    elif what == 2:
        pixels = spoil_bytes(rng, pixels)
    else:
        head = spoil_text(rng, head.decode("latin-1"), WORDS, 2).encode("utf-8", "replace")
    return head + mark + line + end + pixels


def run(data: bytes, folder: Path) -> None:
    use_picture(folder / "a.hdr", data)


SUBJECT = Subject("hdr", seeds, mutate, run)
