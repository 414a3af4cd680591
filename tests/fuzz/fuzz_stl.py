"""STL files, spoilt: text and binary."""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np
from driver import Data
from mutations import spoil_bytes, spoil_text
from spoiltmeshes import CUBE, LARGE, TRIANGLES, cases_of, subject_of
from writers import stl_bytes

WORDS = (
    "solid ",
    "endsolid\n",
    "facet normal 0 0 0\n",
    "facet ",
    "outer loop\n",
    "outer  loop  vertex ",
    "vertex 0 0 0\n",
    "vertex ",
    "endloop\n",
    "endfacet\n",
    "# ",
    "\0",
    "nan ",
    "\t",
    "\r",
)


def seeds() -> Sequence[bytes]:
    corners = np.array(CUBE)[TRIANGLES]
    return [*cases_of("stl"), stl_bytes(corners), stl_bytes(corners, True)]


def mutate(rng: random.Random, data: Data) -> bytes:
    assert isinstance(data, bytes)
    if rng.random() < LARGE:
        return large(rng)
    if data[:5].lower() == b"solid" and data.isascii() and rng.random() < 0.9:
        return spoil_text(rng, data.decode("ascii"), WORDS).encode("utf-8", "replace")
    return spoil_bytes(rng, data)


def large(rng: random.Random) -> bytes:
    """Return a file that takes long if something goes wrong."""
    n = 10 ** rng.randint(4, 6)
    facet = (
        b"facet normal 0 0 0 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 %d endloop endfacet\n"
    )
    return rng.choice(
        (
            b"solid x\n" + b" " * 10 * n,
            b"solid x\n" + b"outer " * n,
            b"solid x\n" + b"outer loop " * n,
            b"solid x\n" + b"vertex 1 2 3 " * n,
            b"solid " * 2 * n,
            b"\n" * 10 * n + b"solid x\n",
            b"solid x\n" + b"".join(facet % (k % 999) for k in range(n // 10)),
            b"\0" * 80 + b"\xff\xff\xff\xff" + bytes(rng.randrange(256) for _ in range(5000)) * 10,
            b"\0" * 84 + rng.randbytes(50 * n // 10),
            b"\0" * 84 + np.random.default_rng(n).normal(size=n).astype("<f4").tobytes(),
        )
    )


SUBJECT = subject_of("stl", seeds, mutate)
