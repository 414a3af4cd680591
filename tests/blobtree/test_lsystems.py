"""L-systems: strings by recurrences that can be derived by hand, and what the turtle draws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pcsg
from pcsg.blobtree.lsystem import Letter
from pcsg.blobtree.lsystemfile import read_lsystem
from pcsg.blobtree.model import Model
from pcsg.blobtree.plant import plant_of
from pcsg.blobtree.tree import Junctions, grow, merge_short
from pcsg.blobtree.turtle import draw
from pcsg.errors import GrammarError, UsageError

GRAMMARS = Path(__file__).parent.parent.parent / "grammars"


def letters(text: str, steps: int, seed: int = 0) -> str:
    return "".join(x.symbol for x in read_lsystem(text, seed=seed).derive(steps))


def count(model: str, symbol: str, steps: int) -> int:
    """How often a module is in the string of one of the models that come with pcsg."""
    text = (GRAMMARS / "lsystems" / f"{model}.lsys").read_text(encoding="utf-8")
    return letters(text, steps).count(symbol)


def test_algae() -> None:
    text = "axiom: B\nA -> A B\nB -> A\n"
    assert [len(letters(text, n)) for n in range(7)] == [1, 1, 2, 3, 5, 8, 13]
    assert [count("algae", "F", n) for n in range(7)] == [1, 1, 2, 3, 5, 8, 13]


def test_models_have_the_numbers_of_their_recurrences() -> None:
    for n in range(6):
        assert count("koch", "F", n) == 5**n
        # Every apex makes four internodes and three apices.
        assert count("ternary", "F", n) == 1 + 2 * (3**n - 1)
        # B(n) = C(n) = 1 + 2 B(n-1), A(n) = 1 + B(n-1) + A(n-1), all without one at first.
        assert count("monopodial", "F", n) == 2**n - 1
        # Three shoots of an apex, which become apices in the next step.
        assert count("bush", "F", 2 * n) == (3 ** (n + 1) - 3) // 2
        assert count("bush", "L", 2 * n) == 3 ** (n + 1) - 3


def test_a_ternary_tree_thickens_as_it_grows() -> None:
    text = (GRAMMARS / "lsystems" / "ternary.lsys").read_text(encoding="utf-8")
    trunk = draw(read_lsystem(text).derive(5)).skeleton
    assert trunk.base[0] == pytest.approx(0.012 * 1.62**5)
    np.testing.assert_allclose(trunk.end[0], [0.0, 0.0, 1.6 * 1.109**5], atol=1e-12)


def test_the_herb_flowers_when_the_signal_arrives() -> None:
    # After s steps there are 1 + s // 2 nodes, of which the signal has passed s - 8.
    arrives = next(s for s in range(40) if s - 8 == 1 + s // 2)
    assert arrives == 17
    for s in range(arrives + 1):
        assert count("herb", "M", s) == 1 + s // 2
        assert count("herb", "K", s) == 0
    assert [count("herb", x, arrives + 1) for x in "MKAP"] == [9, 1, 0, 0]
    assert [count("herb", x, arrives + 2) for x in "MKAP"] == [9, 0, 0, 8]
    assert [count("herb", x, arrives + 3) for x in "MKA{"] == [9, 0, 0, 8]


def test_a_fern_unrolls_its_fronds_one_by_one() -> None:
    for n in (0, 1, 5, 12, 30, 35):
        ages = [n - k for k in range(1, 10) if n >= k]
        assert count("fern", "F", n) == sum(1 + min(age, 20) for age in ages)
        pinnae = sum(2 * min(max(age - 1, 0), 20) for age in ages)
        assert count("fern", "L", n) == pinnae + sum(age > 20 for age in ages)


def test_colours_count_for_wood_leaves_and_polygons() -> None:
    text = (
        "axiom: !(0.1) F(1) [ ' +(90) F(1) ' L(1) ] [ ''' -(90) f(2) { G(1) +(90) G(1) } ]\n"
        "bark: 0.1 0 0, 0.2 0 0\nleaves: 0 0.1 0, 0 0.2 0, 0 0.3 0\n"
    )
    model = Model(plant_of(text))
    places = [[0, 0, 0.3], [0, 0.6, 1], [0, 1.6, 1], [0, -2.9, 1.3]]
    found = model.attributes(places)["color"]
    expected = [[0.1, 0, 0], [0.2, 0, 0], [0, 0.3, 0], [0, 0.3, 0]]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    for wrong in ("1 2", "1 2 3, 4", ""):
        with pytest.raises(UsageError, match="`bark:` takes three numbers for each colour"):
            plant_of(f"axiom: F\nbark: {wrong}\n")


@pytest.mark.parametrize("path", sorted(GRAMMARS.rglob("*.lsys")), ids=lambda path: path.stem)
def test_every_model_draws_something(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    model = Model(plant_of(text, path.name))
    low, high = model.bounds
    assert model.primitives > 20 and (high - low)[2] > 0.5
    assert text.startswith("// ")


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_koch_curve(n: int) -> None:
    string = read_lsystem("#define angle 90\naxiom: F\nF -> F+F-F-F+F").derive(n)
    drawing = draw(string, 90.0)
    assert len(drawing.skeleton.base) == 5**n
    end = drawing.skeleton.end[-1] - drawing.skeleton.start[0]
    np.testing.assert_allclose(np.linalg.norm(end), 3.0**n)


def test_ternary_tree_has_its_internodes() -> None:
    text = "axiom: !(0.2) A(1)\nA(l) -> F(l)[&(30)A(l*.7)]/(120)[&(30)A(l*.7)]/(120)[&(30)A(l*.7)]"
    for n in (1, 2, 3):
        drawing = draw(read_lsystem(text).derive(n))
        assert len(drawing.skeleton.base) == (3**n - 1) // 2
        assert int((drawing.skeleton.parent < 0).sum()) == 1


def test_parameters_and_conditions() -> None:
    system = read_lsystem("axiom: A(1, 2)\nA(x, y) : x*y < 20 -> A(x+1, y*2) B(x^2)\n")
    assert system.derive(2) == [
        Letter("A", (3.0, 8.0)),
        Letter("B", (4.0,)),
        Letter("B", (1.0,)),
    ]


def test_signals_move_through_contexts() -> None:
    text = "axiom: BAAAA\nB < A -> B\nB -> A\n"
    assert [letters(text, n) for n in range(5)] == ["BAAAA", "ABAAA", "AABAA", "AAABA", "AAAAB"]


def test_contexts_skip_branches_and_what_is_ignored() -> None:
    text = "axiom: B[+A]-A\nignore: +-\nB < A -> C\n"
    assert letters(text, 1) == "B[+C]-C"
    assert letters("axiom: A[X]B\nA > B -> C\n", 1) == "C[X]B"


def test_probabilities_by_their_counts() -> None:
    text = "axiom: " + "A" * 4000 + "\nA : : 0.25 -> B\nA : : 0.75 -> C\n"
    found = letters(text, 1, seed=5)
    assert abs(found.count("B") / 4000 - 0.25) < 0.03
    assert found == letters(text, 1, seed=5)
    assert found != letters(text, 1, seed=6)


def test_the_turtle_widths_and_branches() -> None:
    drawing = draw(read_lsystem("axiom: !(2)F(3)!(1)[+(90)F(2)]F(4)").derive(0))
    s = drawing.skeleton
    np.testing.assert_allclose(s.base, [2.0, 1.0, 1.0])
    np.testing.assert_allclose(s.top, [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(s.parent, [-1, 0, 0])
    np.testing.assert_array_equal(s.lateral, [True, True, False])
    np.testing.assert_allclose(s.end[2], [0.0, 0.0, 7.0], atol=1e-12)
    assert s.end[1][2] == pytest.approx(3.0)


def test_brackets_and_lengths_that_cannot_be_are_told() -> None:
    with pytest.raises(UsageError, match="`\\[` without `\\]`"):
        plant_of("axiom: F [ F\n")
    with pytest.raises(UsageError, match="`\\]` without `\\[`"):
        plant_of("axiom: F ] F\n")
    with pytest.raises(UsageError, match="leads too far"):
        plant_of("axiom: F(1e300) F(1e300)\n")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("axiom: A\nAB -> C\n", "a rule rewrites exactly one module"),
        ("axiom: F\nbarck: 1 2 3\n", "unknown setting `barck`; did you mean `bark`?"),
        ("axiom: F\niterations: 3\n", "`iterations` is no setting; write `#define steps 3`"),
        ("axiom: F\nstepps: 3\n", "unknown setting `stepps`; did you mean `steps`?"),
        ("axiom: F\ntip: thin\n", "`tip:` takes a number, not `thin`"),
        ("axiom: F\njunctions: tight\n", "junctions are one of smooth, contact, aged"),
        ("axiom: !(-1) F\n", "this `blob` cannot be made: bad.lsys: !(-1): a width must be > 0"),
    ],
)
def test_mistakes_of_a_file_are_not_shown_in_a_grammar_nobody_wrote(
    tmp_path: Path, text: str, told: str
) -> None:
    file = tmp_path / "bad.lsys"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(GrammarError) as caught:
        pcsg.load(file)
    message = str(caught.value)
    line = None if "width" in told else 2
    assert message.startswith(f"{file}:{line}:1: " if line else f"{file}: ") and told in message
    assert "material(plant)" not in message
    assert caught.value.diagnostics[0].to_json()["line"] == line


def test_cut_and_polygons_and_leaves() -> None:
    drawing = draw(read_lsystem("axiom: F[%F L(2)]L(0.5){G+(120)G+(120)G}").derive(0))
    assert len(drawing.skeleton.base) == 1
    np.testing.assert_allclose(drawing.leaves.size, [0.5])
    assert drawing.polygons[0].corners.shape == (4, 3)


@pytest.mark.parametrize("mode", ["smooth", "contact", "aged"])
@pytest.mark.parametrize("bend", [0.0, 40.0])
def test_a_fork_is_wood_everywhere_along_its_skeleton(mode: str, bend: float) -> None:
    text = "axiom: !(0.3) F(2) !(0.24) [ +(35) F(1.6) ] [ -(40) !(0.2) F(1.6) ] F(1.8)"
    skeleton = draw(read_lsystem(text).derive(0)).skeleton
    model = Model(grow(skeleton, Junctions(mode=mode, bend=bend)))
    # The middle of the trunk and of the leader; laterals bend away.
    for k in (0, 3):
        s = np.linspace(0.02, 0.9, 40)[:, None]
        along = skeleton.start[k] + s * (skeleton.end[k] - skeleton.start[k])
        assert model.contains(along).all()
    assert model.contains(skeleton.end - 0.02 * (skeleton.end - skeleton.start)).all()


def test_short_internodes_are_merged() -> None:
    skeleton = draw(read_lsystem("axiom: !(1) F(.2)F(.2)F(.2)F(9)").derive(0)).skeleton
    merged = merge_short(skeleton)
    assert len(merged.base) == 1
    np.testing.assert_allclose(merged.end[0], [0.0, 0.0, 9.6])


def test_mistakes_are_told_by_their_lines() -> None:
    with pytest.raises(UsageError, match=r"x.lsys:2: .*exactly one module[\s\S]*x.lsys:3: "):
        read_lsystem("axiom: A\nAB -> C\nA -> F(1\n", "x.lsys")
    with pytest.raises(UsageError, match="there is no line `axiom"):
        read_lsystem("A -> B\n")
    with pytest.raises(UsageError, match="unknown setting"):
        plant_of("axiom: F\nbarck: 1 2 3\n")


def test_a_file_is_a_scene_and_seeds_are_other_trees(tmp_path: Path) -> None:
    file = tmp_path / "twig.lsys"
    file.write_text("axiom: !(0.2) F(1) [ +(20+ran(50)) !(0.1) F(1) ] F(1)\n")
    one, two = pcsg.load(file), pcsg.load(file, SEED=3)
    assert one.contains([[0.0, 0.0, 0.5]])[0]
    assert not np.array_equal(one.bounds, two.bounds)
    file.write_text("A -> B\n")
    with pytest.raises(GrammarError, match="axiom"):
        pcsg.load(file)
