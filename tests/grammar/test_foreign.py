"""Newcomers get the sentence that they need."""

from __future__ import annotations

from pathlib import Path

import pytest

from pcsg.grammar import check_text

SHIPPED = sorted(Path(__file__).parents[2].glob("grammars/**/*.pcsg"))

# What is typed, and what to write instead.
SPELLINGS = {
    "difference { box { -1, 1 } sphere { 0, 1.3 } }": r"`box \ uscale(1.3) sphere` takes away",
    "union() { cube([1,2,3]); }": "`|` joins",
    "sphere { <0,0,0>, 1 pigment { color rgb <1,0,0> } }": "uscale(2) sphere",
    "translate(1,2,3) box": "`move(x,y,z)`",
    "{} rotate(0,0,30) box": "`rotz(a)`",
    "cube([1,2,3])": "`scale(1,2,3) cube`",
    "cylinder(h=2, r=1)": "`scale(1,2,3) cylinder`",
    "{ x 1 rz 30 } box": "`move(1,0,0) rotz(30)`",
    "{ s 0.5 y -2 } box": "`uscale(0.5) move(0,-2,0)`",
    "{ s 1 2 3 } box": "`scale(1,2,3)`",
    "10 * { rz 36 } box": "`repeat(10, rotz(36))`",
    "3 * { x 1 } 4 * { y 1 } box": "`repeat(3, move(1,0,0))`",
    "rule R1 maxdepth 10 { box }": "`1: R1 -> ...`; a parameter counts the depth",
    "rule R1 { box }": "`1: R1 -> ...`",
    "set maxdepth 20\nbox": "`{depth = 20} S`",
    "startshape S": "`{} S`",
    "shape S { SQUARE [] }": "`1: S -> ...`",
    "module arm(n) { box }": "`p: arm(n) -> ...`",
    "for (i = 0; i < 3; i++) box": "`for(i, 0, 9) ...`",
    "for (i = [0:5]) box": "`for(i, 0, 5) ...`",
    "for (i = [0:2:10]) box": "`for(i, 0, 10) ...`",
    "F -> F[+F]F": "`plant.lsys`",
    "{n=3} A\nA if(n>0,2,1)\n1: A -> box\n2: A -> {n--} A": "`{n = n - 1}`",
    "{n=3} A\nA if(n>0,2,1)\n1: A -> box\n2: A -> {n *= 0.5} A": "`{n = n * 0.5}`",
    "n = n + 1;\nbox": "`{n = n + 1} ...`",
    "radius = 0.5\nuscale(radius) sphere": "`{radius = 0.5} ...`",
    "#declare R = 2;\nsphere": "`R = ...` for a solid",
    "{n=3} A\nA if n > 0 then 2 else 1\n1: A -> box\n2: A -> box": "`A if(n > 0, 2, 1)`",
    "mesh(parts/teapot.obj)": '`mesh("parts/teapot.obj")`',
    "color = 1,0,0\nbox": "`color(1,0,0) ...`",
    "move 1 0 0 box": "`move(1,0,0)`",
}


@pytest.mark.parametrize("text", SPELLINGS)
def test_a_foreign_spelling_is_told_with_what_to_write(text: str) -> None:
    _, problems = check_text(text)
    told = [d for d in problems if d.code == "foreign-spelling"]
    assert len(told) == len(problems) == 1
    assert SPELLINGS[text] in (told[0].hint or "")


def test_other_mistakes_are_told_beside_it() -> None:
    text = "{} (A | shpere)\n1: A -> translate(1,0,0) box\n"
    codes = [d.code for d in check_text(text)[1]]
    assert codes == ["unknown-primitive", "foreign-spelling"]


def test_comments_and_what_is_right_are_no_foreign_spellings() -> None:
    text = "// translate(1,2,3) {x 1}\n{x = 1} move(x,0,0) (box | shpere) // rotate\n"
    assert [d.code for d in check_text(text)[1]] == ["unknown-primitive"]


@pytest.mark.parametrize("text", ["{" * 100_000, "(" + "a = 1 " * 50_000, "{x " * 50_000 + "1}"])
def test_long_lines_take_no_longer(text: str) -> None:
    assert check_text(text)[0] is None
