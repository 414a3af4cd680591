"""Texts of L-systems, spoilt: everything that is done before rays are traced."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence
from pathlib import Path

from driver import Subject
from models import look_at, warm_up
from mutations import spoil_text

from pcsg.blobtree.formulas import CHANCE, FUNCTIONS
from pcsg.blobtree.plantsettings import SETTINGS
from pcsg.blobtree.turtle import COMMANDS

ROOT = Path(__file__).parents[2]

SMALL = (
    "axiom: A(3)\n#define steps 3\nA(n) : n > 0 : 0.5 -> !F(n)[+(40)A(n-1)]//L(0.3)A(n-1)\n",
    "axiom: B[G[HK]M]A\nB > G[H]M -> F\nA -> {.f.+f.}\nignore: +-\n#define steps 2\n",
    "axiom: F\nF -> F[+F]F[-F]F : 1\n#define steps 3\n#define angle 25.7\njunctions: smooth\n",
    "axiom: !(0.2)F[&F!F]/////[&F]'L\nbend: 30\ntip: 0.5\njunctions: aged\nseed: 4\n",
    "module Bud, Leaf(x)\naxiom: Bud\nBud -> F[+Leaf(1)]Bud\n#define steps 3\n"
    "#define elasticity 0.3\ntropism: 0 1 -1\ndecomposition:\nBud -> fBud\ninterpretation:\n"
    "maximum depth: 2\nLeaf(x) -> F\n  L(x)\n",
    "p1: A(x) \u2192 F(x \u00d7 2)[\u2212A(x/2)] // grows\naxiom: A(1)\n#define steps 4\n",
)

WORDS = (
    *COMMANDS,
    *(f"{name}(" for name in (*FUNCTIONS, *CHANCE)),
    *(f"\n{name}: " for name in SETTINGS),
    *(":", "<", ">", "->", "//", "/*", "*/", "^", "&&", "||", "==", "(", ")", ",", "A", "B", "\n"),
    "#define x ",
    "\n#define steps ",
    "\n#define elasticity ",
    *("\ninterpretation:\n", "\ndecomposition:\n", "\nmaximum depth: ", "\nmodule Leaf\n", "\n  "),
    "[+A]",
    "[&F",
    "\nA -> AA\n",
    "\nF -> FF\n",
    "\u2212",
    "\u2227",
)


def seeds() -> Sequence[str]:
    files = sorted((ROOT / "grammars" / "lsystems").glob("*.lsys"))
    whole = [p.read_text(encoding="utf-8") for p in files if p.stem not in ("oak", "ternary")]
    # Small ones are quick, and every change in them matters; most of them may not grow long, since
    # those that grow until they are refused would take nearly all of the time.
    short = [text + "most: 10000\n" for text in SMALL]
    return [*whole, *SMALL, *short * 10]


def mutate(rng: random.Random, text: str) -> str:
    # Who allows long strings wants to wait for them.
    return re.sub(r"(most: *)[0-9]{5,}", r"\g<1>10000", spoil_text(rng, text, WORDS, most=5))


def run(text: str, folder: Path) -> None:
    file = folder / "plant.lsys"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    look_at(file)


SUBJECT = Subject("lsystems", seeds, mutate, run, warm_up)
