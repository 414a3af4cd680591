"""Grammars with blobs, spoilt: fields are unrolled, flattened and bounded."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

from driver import Subject
from models import look_at, warm_up
from mutations import NUMBERS, spoil_text

from pcsg.grammar.fields import FIELD_BLENDS, FIELD_PRIMITIVES, FIELD_UNARY
from pcsg.graph.functions import FUNCTIONS

SEEDS = (
    "blob { move(wdirz(1,2,3),0,0) point(1) }\n",
    "blob { point(1) + move(0.5, 0, 0) segment(2, 0.3) + rotx(30) cone(2, 0.5, 0.2) }\n",
    "blob { pcm(0.4, 0.05) { disc(1, 0.2), box(1, 1, 1, 0.1) } \\ convolution(3, 0.5, 0.2) }\n",
    "blob { gbb { weight(0.9) point(2) } { bend(30) cone(3, 0.4, 0.3) }\n"
    "  { twist(90) box(1,1,3,.1) } }\n",
    "{n = 4} blob { color(0.2, n/9, 0) A }\nA if(n > 0, 1, 2)\n"
    "1: A -> {n = n-1} (cone(1, 0.2, 0.15) + move(0,0,1) rotx(25) uscale(0.8) A)\n"
    "2: A -> point(0.2)\n",
    "blob { ricci(3) { point(1), uscale(2) point(1) } & taper(1, 0.5) segment(2, 1) }\n"
    "| move(4,0,0) blob { r_union { controlled { point(1), disc(1,.3) }, point(.5) } }\n",
)

WORDS = (
    *(f"{name}(" for name in (*FIELD_PRIMITIVES, *FIELD_UNARY, *FUNCTIONS)),
    *(f"{name} {{ " for name in FIELD_BLENDS),
    *"(){}|&\\+=:;,\n",
    "blob { ",
    "scale(",
    "move(",
    "{n = n-1} ",
    *NUMBERS,
)


def seeds() -> Sequence[str]:
    return SEEDS


def mutate(rng: random.Random, text: str) -> str:
    return spoil_text(rng, text, WORDS, most=4)


def run(text: str, folder: Path) -> None:
    file = folder / "blob.pcsg"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    look_at(file)


SUBJECT = Subject("blobs", seeds, mutate, run, warm_up)
