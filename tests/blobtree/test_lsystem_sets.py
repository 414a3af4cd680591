"""Rules of interpretation and decomposition, modules with names, lines that go on, tropism."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pcsg.blobtree.lsystemfile import read_lsystem
from pcsg.blobtree.plant import drawing_of
from pcsg.blobtree.turtle import Pull, draw
from pcsg.errors import UsageError

WILLOW = Path(__file__).parents[2] / "grammars" / "lsystems" / "willow.lsys"


def grown(text: str, steps: int) -> str:
    """Return the modules of a string, those with names in angle brackets."""
    return shown(read_lsystem(text).derive(steps))


def drawn(text: str, steps: int) -> str:
    """Return the modules of what is drawn."""
    system = read_lsystem(text)
    return shown(system.interpret(system.derive(steps)))


def shown(string: list) -> str:
    return "".join(x.symbol if len(x.symbol) == 1 else f"<{x.symbol}>" for x in string)


SHOOT = "axiom: A\nA -> IA\ninterpretation:\nI -> F[+F]\nA -> L\n"


def test_what_is_drawn_does_not_grow() -> None:
    assert grown(SHOOT, 3) == "IIIA"
    assert drawn(SHOOT, 2) == "F[+F]F[+F]L"
    other = SHOOT.replace("interpretation", "homomorphism") + "endhomomorphism\nI -> II\n"
    assert grown(other, 2) == "IIIA"
    assert drawn(other, 1) == "F[+F]L"


def test_what_is_drawn_sees_numbers_and_conditions() -> None:
    text = "axiom: I(1)I(3)\ninterpretation:\nI(x) : x > 2 -> F(x)F(x/2)\nI(x) -> f(2*x)\n"
    system = read_lsystem(text)
    assert [(x.symbol, x.args) for x in system.interpret(system.derive())] == [
        ("f", (2.0,)),
        ("F", (3.0,)),
        ("F", (1.5,)),
    ]


@pytest.mark.parametrize(("depth", "string"), [("", "FA"), (3, "FFFA"), (100, "F" * 100 + "A")])
def test_interpretation_goes_as_deep_as_it_is_told(depth: int | str, string: str) -> None:
    line = f"maximum depth: {depth}\n" if depth else ""
    assert drawn(f"axiom: A\ninterpretation:\n{line}A -> FA\n", 0) == string


def test_decomposition_follows_every_step_and_the_axiom() -> None:
    text = "axiom: A\nA -> BA\nB -> C\ndecomposition:\nC -> +f\nA -> .A\n"
    assert grown(text, 0) == ".A"
    assert grown(text, 1) == ".B.A"
    assert grown(text, 2) == ".+f.B.A"


def test_modules_may_have_names() -> None:
    text = "module Bud, Leaf(size), Le\naxiom: Bud\nBud -> F[+Leaf(2)]Le/Bud\nLe < Bud -> F\n"
    assert grown(text, 1) == "F[+<Leaf>]<Le>/<Bud>"
    assert read_lsystem(text).derive(1)[3].args == (2.0,)
    assert grown("axiom: Bud\nB -> F\n", 1) == "Fud"


def test_lines_go_on() -> None:
    text = "axiom: A\nA -> F [+F] \\\n   [-F]\n  // what follows\n  B\nB -> F\n"
    assert grown(text, 2) == "F[+F][-F]F"
    assert grown("axiom: A\nA -> F\\\n+A\n", 1) == "F+A"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("axiom: A\ninterpretation:\nA < B -> F\n", "behind `interpretation:` have no contexts"),
        ("axiom: A\nmaximum depth: 2\n", "stands behind `interpretation:`"),
        ("axiom: A\ndecomposition:\nmaximum depth: 0\n", "a whole number from 1 to 100"),
        ("module 3D\naxiom: A\n", "`3D` is no name of a module"),
        ("axiom: A\nA -> B // a comment\n  C\n", "expected a rule"),
        ("axiom: F\ntropism: 0 0\n", "`tropism:` takes three numbers"),
        ("axiom: F\ntropism: 0 0 0\n", "`tropism:` takes three numbers"),
        (
            "most: 50\naxiom: A\ninterpretation:\nmaximum depth: 100\nA -> AAFA\n",
            "when it is drawn",
        ),
    ],
)
def test_what_cannot_be_is_told(text: str, told: str) -> None:
    with pytest.raises(UsageError) as caught:
        drawing_of(text)
    assert told in str(caught.value)


def test_the_willow_has_its_internodes() -> None:
    system = read_lsystem(WILLOW.read_text(encoding="utf-8"))
    for n in range(5):
        string = system.derive(n)
        wood, buds = (sum(x.symbol == symbol for x in string) for symbol in "FA")
        assert (wood, buds) == (1 + 2 * (3**n - 1), 3**n)
        assert sum(x.symbol == "F" for x in system.interpret(string)) == wood + 3 * buds


def test_internodes_are_pulled_down() -> None:
    drawing = drawing_of("#define elasticity 0.3\naxiom: &(90)F(2)F(1)F(1)\n")
    (x0, y0, z0), (x1, y1, z1), (x2, _, z2) = drawing.skeleton.end - drawing.skeleton.start
    assert (y0, y1, z0) == pytest.approx((0.0, 0.0, 0.0), abs=1e-15)
    side = math.copysign(1.0, x0)
    assert (side * x1, z1) == pytest.approx((math.cos(0.3), -math.sin(0.3)))
    # The nearer to the pull, the less is left of it: the product has the length of a sine.
    angle = 0.3 + 0.3 * math.cos(0.3)
    assert (side * x2, z2) == pytest.approx((math.cos(angle), -math.sin(angle)))


def test_the_pull_has_a_direction_and_keeps_frames_upright() -> None:
    text = "#define elasticity 0.2\ntropism: 1 0 0\naxiom: F(1)F(1)L\n"
    drawing = drawing_of(text)
    end = drawing.skeleton.end[1] - drawing.skeleton.start[1]
    np.testing.assert_allclose(end, [math.sin(0.2), 0.0, math.cos(0.2)], atol=1e-15)
    frame = drawing.leaves.frame[0]
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)


def test_without_elasticity_nothing_is_pulled() -> None:
    string = read_lsystem("axiom: F&(40)F[+F]/F\n").derive()
    one, other = draw(string), draw(string, pull=Pull(0.0, (1.0, 2.0, 3.0)))
    np.testing.assert_array_equal(one.skeleton.end, other.skeleton.end)
