"""PLY files, spoilt: text and binary."""

from __future__ import annotations

import random
from collections.abc import Sequence

from driver import Data
from mutations import spoil_bytes, spoil_text
from spoiltmeshes import CUBE, LARGE, QUADS, cases_of, subject_of
from writers import ply_bytes

KINDS = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double", "uint8", "half")
WORDS = (
    *(f"property {kind} x\n" for kind in KINDS),
    *(f"property list {kind} int k\n" for kind in KINDS),
    *KINDS,
    "element vertex 3\n",
    "element face 1\n",
    "element tristrips 1\n",
    "end_header\n",
    "list ",
    "property uchar red\nproperty uchar green\nproperty uchar blue\n",
    "property list uchar float texcoord\n",
    "format ascii 1.0\n",
    "comment x\n",
    "3 0 1 2\n",
    "nan ",
    "-1 ",
    "\r",
)
FORMS = ("ascii", "binary_little_endian", "binary_big_endian")


def seeds() -> Sequence[bytes]:
    written = [ply_bytes(CUBE, QUADS, form, junk) for form in FORMS for junk in (False, True)]
    return [*cases_of("ply"), *written]


def mutate(rng: random.Random, data: Data) -> bytes:
    assert isinstance(data, bytes)
    if rng.random() < LARGE:
        return large(rng)
    end = data.find(b"end_header\n") + 11
    head, body = data[:end], data[end:]
    if rng.random() < 0.5:
        head = spoil_text(rng, head.decode("latin-1"), WORDS, 3).encode("utf-8", "replace")
    if rng.random() < 0.7:
        if b"ascii" in head:
            body = spoil_text(rng, body.decode("latin-1"), WORDS).encode("utf-8", "replace")
        else:
            body = spoil_bytes(rng, body)
    return head + body


def large(rng: random.Random) -> bytes:
    """Return a file that takes long if something goes wrong."""
    n = 10 ** rng.randint(4, 6)
    text = ply_bytes(CUBE, QUADS, rng.choice(FORMS))
    many = text.replace(b"face 6", b"face %d" % n)
    return rng.choice(
        (
            many + b"\0" * n * 10,
            many + b"0\n" * n,
            many + b"3 0 1 2\n" * n,
            many + b" " * 10 * n,
            text.replace(b"uchar int", b"int uchar") + b"\0" * n,
            text.replace(b"vertex 8", b"vertex %d" % 10 ** rng.randint(9, 14)),
            text.replace(
                b"property double z\n", b"property double z\n" + b"property uchar a\n" * n
            ),
            text.replace(b"end_header", b"comment " + b"x" * 10 * n + b"\nend_header"),
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
            b"property float z\nelement face 1\nproperty list int int vertex_index\nend_header\n"
            b"0 0 0\n1 0 0\n0 1 0\n%d " % n + b"0 1 2 " * n,
        )
    )


SUBJECT = subject_of("ply", seeds, mutate)
