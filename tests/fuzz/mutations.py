"""Ways to spoil an input that subjects share."""

from __future__ import annotations

import random
import struct
from collections.abc import Sequence

NUMBERS = (
    "0",
    "-0",
    "1",
    "-1",
    "0.5",
    "1e-300",
    "5e-324",
    "1e9",
    "2147483648",
    "-4294967297",
    "18446744073709551617",
    "1e154",
    "1e300",
    "-1.7976931348623157e308",
    "1e999",
    "nan",
    "inf",
    "-inf",
    "0x10",
    "1_000",
    "1e",
    ".",
    "\u0661",
)
"""Numbers that someone has not thought of."""

_DIGITS = frozenset("0123456789.")


def spoil_text(rng: random.Random, text: str, words: Sequence[str], most: int = 6) -> str:
    """Return a text after some small changes.

    Parameters
    ----------
    words
        That mean something in such texts: put in, or in place of others.
    most
        Changes.
    """
    for _ in range(rng.randint(1, most)):
        at = rng.randrange(len(text) + 1)
        what = rng.randrange(8)
        if what == 0:  # take something out
            text = text[:at] + text[at + rng.randint(1, 12) :]
        elif what == 1:  # take a line out, or say it twice
            lines = text.splitlines(keepends=True) or [""]
            k = rng.randrange(len(lines))
            lines[k : k + 1] = [lines[k]] * rng.choice([0, 2, 2, 5])
            text = "".join(lines)
        elif what == 2:
            text = text[:at] + rng.choice(words) + text[at:]
        elif what in (3, 4):  # another number
            start, end = _number_at(text, at)
            text = text[:start] + rng.choice(NUMBERS) + text[end:]
        elif what == 5:  # something from elsewhere
            k = rng.randrange(len(text) + 1)
            text = text[:at] + text[k : k + rng.randint(1, 60)] + text[at:]
        elif what == 6:
            sign = chr(rng.choice([rng.randrange(32, 127), rng.randrange(0x3000), 0, 0xFEFF]))
            text = text[:at] + sign + text[at + rng.randint(0, 1) :]
        else:
            text = text[:at] if rng.random() < 0.2 else text[:at] + text[at + 1 :]
    return text


def _number_at(text: str, at: int) -> tuple[int, int]:
    """Return where the next number stands, from an offset on."""
    start = at
    while start < len(text) and text[start] not in _DIGITS:
        start += 1
    end = start
    while end < len(text) and text[end] in _DIGITS:
        end += 1
    return start, end


def spoil_bytes(rng: random.Random, data: bytes, most: int = 6) -> bytes:
    """Return bytes after some small changes: flips, numbers at their limits, cuts, repetitions."""
    made = bytearray(data)
    for _ in range(rng.randint(1, most)):
        at = rng.randrange(len(made) + 1)
        what = rng.randrange(7)
        if what == 0 and at < len(made):
            made[at] ^= 1 << rng.randrange(8)
        elif what == 1 and at < len(made):
            made[at] = rng.choice([0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)])
        elif what == 2:
            limit = rng.choice([0, 1, 2**31 - 1, 2**31, 2**32 - 1, rng.getrandbits(32)])
            made[at : at + 4] = struct.pack(rng.choice("<>") + "I", limit)
        elif what == 3:
            value = rng.choice([float("nan"), float("inf"), -1e38, 1e-45, 3.4e38])
            made[at : at + 4] = struct.pack("<f", value)
        elif what == 4:
            del made[at : at + rng.randint(1, 64)]
        elif what == 5:
            k = rng.randrange(len(made) + 1)
            made[at:at] = made[k : k + rng.randint(1, 64)]
        elif rng.random() < 0.3:
            del made[at:]
    return bytes(made)
