"""Tables of `scatter` (.csv), spoilt."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

from driver import Subject
from models import look_at, warm_up
from mutations import NUMBERS, spoil_text

from pcsg.errors import PcsgError

TREES = """x,y,z,rotz,scale,age,kind
0,0,0,0,1,3,oak
3,0,0,30,0.5,4,birch
0,3,0,60,2,5,oak
"""
LEAVES = "x;y;z;nx;ny;nz;sx\n" + "\n".join(f"{k};{k % 3};0;1;{k % 5};2;0.5" for k in range(20))
PLACES = "\t".join(f"m{i}{j}" for i in "123" for j in "1234") + "\n1 0 0 5 0 1 0 0 0 0 1 0".replace(
    " ", "\t"
)

WORDS = ("\n", "\r\n", ",", ";", "\t", '"', '""', " ", "oak", "x", "ROW", "\ufeff", "\0", *NUMBERS)

GRAMMAR = 'scatter("t.csv", kind = "oak,birch") uscale(age) box'
PLAIN = 'scatter("t.csv") box'


def seeds() -> Sequence[str]:
    return [TREES, LEAVES, PLACES]


def mutate(rng: random.Random, text: str) -> str:
    return spoil_text(rng, text, WORDS, most=4)


def run(text: str, folder: Path) -> None:
    (folder / "t.csv").write_bytes(text.encode("utf-8", "surrogatepass"))
    for grammar in (GRAMMAR, PLAIN):
        file = folder / "stand.pcsg"
        file.write_text(grammar, encoding="utf-8")
        try:
            look_at(file)
        except PcsgError as error:
            assert str(error)


def prepare() -> None:
    """Load or compile the kernels."""
    warm_up()


SUBJECT = Subject("tables", seeds, mutate, run, prepare)
