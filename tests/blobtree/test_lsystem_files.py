"""L-systems as other people write them: comments, signs, heads of rules, and what is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import pcsg
from pcsg.blobtree.lsystem import Letter
from pcsg.blobtree.lsystemfile import read_lines, read_lsystem
from pcsg.blobtree.model import Model
from pcsg.blobtree.plant import drawing_of, lsystem_mistakes, numbers_of, plant_of
from pcsg.blobtree.turtle import draw
from pcsg.cli import app
from pcsg.errors import GrammarError, UsageError
from pcsg.grammar import check_file

CASES = Path(__file__).parent / "cases"


def string(text: str, steps: int = 1, seed: int = 0) -> str:
    """Return the modules of an L-system's string, without their numbers."""
    return "".join(x.symbol for x in read_lsystem(text, seed=seed).derive(steps))


def remarks(text: str) -> list[tuple[int, str]]:
    """Return lines and severities of all that an L-system's text is told."""
    return [(r.line, r.severity) for r in sorted(read_lines(text).remarks)]


def test_slashes_in_a_rule_are_rolls() -> None:
    text = (CASES / "slash.lsys").read_text()
    assert string(text) == "!F[&F]/////[&F]///////[&F]"
    skeleton = draw(read_lsystem(text).derive(), 22.5).skeleton
    # Three branches about the trunk, 5 * 22.5 and 12 * 22.5 degrees from the first.
    x, y = (skeleton.end[1:, :2] - skeleton.start[1:, :2]).T
    turned = np.degrees(np.arctan2(y, x))
    np.testing.assert_allclose(np.mod(turned[0] - turned, 360.0), [0.0, 112.5, 270.0], atol=1e-9)


@pytest.mark.parametrize(
    ("line", "made"),
    [
        ("A -> S/////F", "S/////F"),
        ("A -> S ///// F", "S/////F"),
        ("A -> FF--//[--F]A", "FF--//[--F]A"),
        ("A -> F // two branches, one leaf", "F"),
        ("A -> F //and no blank", "F"),
        ("A -> F// no blank before", "F"),
        ("A -> F/* in C's way */[+A]", "F[+A]"),
        ("A -> F /(30)//(30)[&F]", "F///[&F]"),
        ("A -> F //(see page 3)", "F"),
        ("A -> F : 1 // chance", "F"),
        ("// A -> F\nA -> S", "S"),
        ("A -> F[+A // grows\n", "F[+A"),
    ],
)
def test_where_a_comment_begins(line: str, made: str) -> None:
    text = f"axiom: A // the apex\n#define x 2 // and a number\nS -> S\n{line}\n"
    assert string(text) == made


def test_lines_with_two_readings_are_told() -> None:
    assert remarks("axiom: A\nA -> F // F\n") == [(2, "warning")]
    assert string("axiom: A\nA -> F // F\n") == "F//F"
    assert remarks("axiom: A\nA -> F// goes up\n") == [(2, "warning")]
    assert remarks("axiom: A\nA -> F // goes up\n") == []
    assert remarks("axiom: A\nA -> F///F\n") == []
    found = lsystem_mistakes("axiom: A\n  A -> F // F\n", "two.lsys")
    assert found[0].severity == "warning" and str(found[0].span) == "two.lsys:2:3"


def test_constants_that_nothing_reads_are_told_if_others_call_ours_so() -> None:
    rules = "axiom: F\nF -> F[+F]F\n"
    assert remarks(rules + "#define iterations 3\n#define delta 20\n") == [
        (3, "warning"),
        (4, "warning"),
    ]
    assert remarks(rules + "#define n 3\n#define steps n\n") == []
    assert remarks(rules + "#define n 3\n#define steps 4\n") == []
    assert remarks(rules + "#define size 3\n") == []
    assert remarks("axiom: F(n)\n#define n 3\n") == []


def test_comments_over_lines_keep_the_numbers_of_lines() -> None:
    text = "/* a\n b */ axiom: F /* c */ F\n// d /* e\nF -> F(y)\n"
    assert remarks(text) == [(4, "error")]
    assert remarks("axiom: F\n/* for ever\n") == [(2, "error")]


def test_a_probability_may_stand_behind_the_successor() -> None:
    text = (CASES / "trailprob.lsys").read_text()
    found = string(text, 1, seed=3)
    assert found.count("F") == 20 and 0 < found.count("+") < 10
    assert found.count("+") + found.count("-") == 10
    before = text.replace("F -> F[+F] : 0.5", "F : : 0.5 -> F[+F]")
    assert string(before.replace("F -> F[-F] : 0.5", "F : * : 0.5 -> F[-F]"), 1, seed=3) == found
    # A number alone in the place of the condition decides nothing there.
    alone = before.replace("F : : 0.5", "F : 0.5").replace("F -> F[-F] : 0.5", "F : 0.5 -> F[-F]")
    assert string(alone, 1, seed=3) == found
    assert string("axiom: A(3)\nA(x) : x > 2 -> B(x, min(1, 2)) : 1\n") == "B"
    for wrong in ("F : : 0.5 -> F : 0.5", "F -> F : 0.5 : 2", "F -> F : +", "F -> F : -1"):
        assert remarks(f"axiom: F\n{wrong}\n") == [(2, "error")]


def test_a_number_in_the_head_is_a_condition() -> None:
    text = "axiom: A(0) A(1) A(2)\n#define n 2\nA(0) -> B\nA(n-1) -> C(7)\nA(x) -> D(x)\n"
    assert read_lsystem(text).derive(1) == [
        Letter("B", ()),
        Letter("C", (7.0,)),
        Letter("D", (2.0,)),
    ]
    assert string("axiom: B(1) A B(2) A\nB(2) < A -> C\n") == "BABC"
    assert remarks("axiom: A(1)\nA(x+1) -> B\n") == [(2, "error")]
    assert remarks("axiom: A(1)\nA(x) < A(x) -> B\n") == [(2, "error")]


def test_unknown_names_are_told_by_check_with_their_line() -> None:
    _, problems = check_file(CASES / "undef.lsys")
    assert [(p.code, p.span.line if p.span else 0) for p in problems] == [("bad-lsystem", 3)]
    assert "`y` has no value" in problems[0].message
    text = "axiom: F(a)\n#define b c\nF(l) : l > m -> F(l)\nF(l) : : p -> F(q) : 1\nX -> F(len)\n"
    text += "#define length 3\n"
    assert [line for line, _ in remarks(text)] == [1, 2, 3, 4, 5]
    found = lsystem_mistakes("axiom: A\nA -> F(lenght)\n#define length 3\n", "x.lsys")
    assert "did you mean `length`?" in found[0].message
    # Defined below its use it is there when a rule is applied.
    assert remarks("axiom: F(n)\n#define n 3\n") == []


def test_signs_pasted_from_a_page_are_read() -> None:
    printed = (
        "\ufeff\u03c9 : A(2)\u2019\u2032\n"
        "p\u2081 : A(x) : x \u2265 2 \u2227 x \u2264 9 \u2192 "
        "[\u2212(x \u00d7 10) F(x\u2009\u00f7\u20092)] \u2013 \u2227F \u2223 \u2216(5)F\n"
    )
    plain = "axiom: A(2)''\nA(x) : x >= 2 && x <= 9 -> [-(x * 10) F(x / 2)] - ^F | \\(5)F\n"
    assert read_lsystem(printed).derive(1) == read_lsystem(plain).derive(1)
    assert remarks("axiom: A\nA -> F \u2014 F\n") == [(2, "error")]


def test_a_bush_as_its_book_prints_it() -> None:
    # The Algorithmic Beauty of Plants, figure 1.25.
    text = (
        "#define angle 22.5\n\u03c9 : A\n"
        "p\u2081 : A \u2192 [&FL!A]/////\u2019[&FL!A]///////\u2019[&FL!A]\n"
        "p\u2082 : F \u2192 S ///// F\np\u2083 : S \u2192 F L\n"
        "p\u2084 : L \u2192 [\u2019\u2019\u2019\u2227\u2227{\u2212f+f+f\u2212|\u2212f+f+f}]\n"
    )
    assert remarks(text) == []
    leaf = "['''^^{-f+f+f-|-f+f+f}]"
    apex = "[&FL!A]/////'[&FL!A]///////'[&FL!A]"
    assert string(text, 1) == apex
    assert string(text, 2) == apex.replace("FL", "S/////F" + leaf).replace("A", apex)
    drawn = draw(read_lsystem(text).derive(5), 22.5)
    assert {len(p.corners) for p in drawn.polygons} == {7}
    assert drawn.skeleton.base.min() == pytest.approx(0.1 * 0.7**4)


def test_other_spellings_of_the_frame() -> None:
    text = "Lsystem: 1\nderivation length: 2\nAxiom: A\np1: A --> FA\nendlsystem\n"
    system = read_lsystem(text)
    assert "".join(x.symbol for x in system.derive()) == "FFA"
    assert string("axiom: 0\n1 -> 11\n0 => 1[0]0\n", 2) == "11[1[0]0]1[0]0"


def test_lines_may_end_in_any_way() -> None:
    text = "axiom: F\n#define steps 2\nF -> FF\n"
    for end in ("\r\n", "\r"):
        assert string(text.replace("\n", end), 2) == "FFFF"
    found = lsystem_mistakes("axiom: F\rF -> F(y)\r", "mac.lsys")
    assert found[0].span is not None and found[0].span.line == 2


def test_foreign_signs_never_become_letters() -> None:
    for wrong in ("F;F", "F,F", "F~l", "F@(2)", "F?P(1)", "F=F", "F2", "F_F", "F#"):
        assert remarks(f"axiom: A\nA -> {wrong}\n") == [(2, "error")], wrong
    # A rule may name one.
    assert string("axiom: F2\n2 -> F\n") == "FF"


def test_brackets_in_a_right_context_are_branches() -> None:
    # The Algorithmic Beauty of Plants, p. 31.
    text = "axiom: ABC[DE][SG[HI[JK]L]MNO]\nBC < S > G[H]M -> X\n"
    assert string(text) == "ABC[DE][XG[HI[JK]L]MNO]"
    assert string("axiom: SG[K]M\nS > G[H]M -> X\n") == "SG[K]M"
    assert string("axiom: SGM\nS > G[H]M -> X\n") == "SGM"
    # A branch that does not fit stands aside, with what it would have bound.
    assert string("axiom: S[K(1)L][K(2)M]N\nS > [K(x)M]N : x == 2 -> X\n") == "X[KL][KM]N"
    assert string("axiom: S[+H]M\nignore: +\nS > [H]M -> X\n") == "X[+H]M"
    assert string("axiom: S[H[I]K]M\nS > [H[I]K]M -> X\n") == "X[H[I]K]M"
    assert string("axiom: S[A]\nS > [A]B -> X\n") == "S[A]"
    for wrong in ("S > [H -> X", "S > H] -> X", "[H] < S -> X", "[ -> X"):
        assert remarks(f"axiom: S\n{wrong}\n") == [(2, "error")]


def corners(text: str) -> np.ndarray:
    """Return the corners of the polygon that a string draws."""
    (polygon,) = draw(read_lsystem(f"axiom: {text}\n").derive(0)).polygons
    return polygon.corners


def test_dots_are_corners_of_polygons() -> None:
    s, c = np.sin(np.radians(40)), np.cos(np.radians(40))
    found = corners("[+(40)G(3){].G(3).}")
    np.testing.assert_allclose(found, [[0, 3 * s, 3 * c], [0, 0, 0], [0, 0, 3]], atol=1e-12)
    # With dots enough they say where all corners are, and G makes none (section 5.1 there).
    found = corners("{G(1).-(90)G(1)G(1).-(90)G(1).}")
    np.testing.assert_allclose(found, [[0, 0, 1], [0, -2, 1], [0, -2, 0]], atol=1e-12)
    # f makes corners as it does without dots; two in one place are one.
    np.testing.assert_allclose(
        corners("{.f(1).-(90)f(1).}"), [[0, 0, 0], [0, 0, 1], [0, -1, 1]], atol=1e-12
    )
    np.testing.assert_allclose(corners("{G(1)-(90)G(1)}"), corners("{.f(1)-(90)f(1)}"), atol=1e-12)


def test_polygons_stand_on_a_stack() -> None:
    text = "{ f(1) -(90) f(1) { f(1) -(90) f(1) } -(90) f(1) }"
    drawn = draw(read_lsystem(f"axiom: {text}\n").derive(0))
    assert [len(p.corners) for p in drawn.polygons] == [3, 4]
    with pytest.raises(UsageError, match=r"`\}` without `\{`"):
        plant_of("axiom: F }\n")
    with pytest.raises(UsageError, match=r"`\{` without `\}`"):
        plant_of("axiom: F { f f\n")


def test_a_width_without_a_number_is_thinner() -> None:
    drawn = drawing_of("axiom: F!F!F\n")
    np.testing.assert_allclose(drawn.skeleton.base, [0.1, 0.07, 0.049])
    drawn = drawing_of("axiom: F!F!F\n#define width 2\n#define thinning 0.5\n")
    np.testing.assert_allclose(drawn.skeleton.base, [2.0, 1.0, 0.5])


def test_options_reach_definitions(tmp_path: Path) -> None:
    text = "axiom: A\n#define steps 6\n#define long 1\n#define half long/2\nA -> F(half)A\n"
    assert numbers_of(text) == {"steps": 6.0, "long": 1.0}
    file = tmp_path / "rod.lsys"
    file.write_text(text)
    heights = [
        pcsg.load(file, **given).bounds[1, 2]
        for given in ({}, {"steps": 3}, {"steps": 3, "long": 2})
    ]
    assert heights[0] - heights[1] == pytest.approx(1.5, abs=1e-3)
    assert heights[2] - heights[1] == pytest.approx(1.5, abs=1e-3)
    grammar = tmp_path / "rods.pcsg"
    grammar.write_text('blob("rod.lsys", 0, 3)\n')
    assert pcsg.load(grammar).bounds[1, 2] == heights[1]
    done = CliRunner().invoke(app, ["stats", str(file), "-D", "step=3"])
    assert done.exit_code == 2 and "did you mean `steps`?" in done.output
    # A name that the language has for something else is left to the file.
    file.write_text("axiom: F(e)\n#define e 2\n#define pi 3\n#define n\u00e4h 4\n#define SEED 5\n")
    assert pcsg.load(file).bounds[1, 2] > 2.0


def test_settings_are_told_with_the_other_lines(tmp_path: Path) -> None:
    file = tmp_path / "all.lsys"
    file.write_text(
        "axiom: F(\nbark: 1\nF -> F(y)\nseed: -1\nsteps: 3\njunctions: tight\nmost: x\n"
    )
    with pytest.raises(GrammarError) as caught:
        pcsg.load(file)
    found = [d.to_json()["line"] for d in caught.value.diagnostics]
    assert found == [1, 2, 3, 4, 5, 6, 7]
    assert "write `#define steps 3`" in str(caught.value)


def test_a_byte_order_mark_is_no_letter(tmp_path: Path) -> None:
    (tmp_path / "bom.lsys").write_bytes(b"\xef\xbb\xbfaxiom: F\r\n")
    (tmp_path / "bom.pcsg").write_text('blob("bom.lsys")')
    assert pcsg.load(tmp_path / "bom.lsys").bounds[1, 2] > 1.0
    assert pcsg.load(tmp_path / "bom.pcsg").bounds[1, 2] > 1.0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("axiom: F(nran(1))\n", "`nran` takes 2 numbers, not 1"),
        ("axiom: F((-1)^0.5)\n", "cannot be computed: math domain error"),
        ("axiom: F\nF -> F(ln(0))\n#define steps 1\n", "of the rule in line 2 cannot be computed"),
        ("axiom: F(1)\nF(x) -> F(1e200*x*1e200)\n#define steps 1\n", "too large (x = 1)"),
        ("axiom: F(9^9^9)\n", "math range error"),
        ("axiom: F(1e999)\n", "the number is too large"),
        ("#define a 1/0\naxiom: F\n", "division by zero"),
        ("#define steps 1.5\naxiom: F\n", "a whole number from 0, not 1.5"),
        ("#define steps -1\naxiom: F\n", "a whole number from 0, not -1"),
        ("axiom: F(" + "(" * 90 + "1" + ")" * 90 + ")\n", "nests more than"),
        ("axiom: F(" + "+".join("1" * 400) + ")\n", "too many operations"),
        ("axiom: A\nA : : 0-1 -> F\n#define steps 1\n", "below 0"),
        ("axiom: F\nmost: 1000001\n", "`most:` allows up to 1,000,000 parts, not 1,000,001"),
        ("axiom: !(1)L(5e-324)\n", "not singular"),
        ("axiom: A\nA > " + "[B]" * 40 + " -> F\n", "60 modules at most"),
    ],
)
def test_numbers_that_cannot_be_are_told(text: str, told: str) -> None:
    with pytest.raises(UsageError) as caught:
        plant_of(text, "bad.lsys")
    assert told in str(caught.value) and str(caught.value).startswith("bad.lsys")


@pytest.mark.parametrize(
    "text",
    [
        "#define steps 1e9\naxiom: A\nA -> A\n",
        "#define steps 1e9\naxiom: F\nA -> AB\n",
    ],
)
def test_what_does_not_change_ends(text: str) -> None:
    if "A -> A\n" in text:
        with pytest.raises(UsageError, match=r"are looked at in step .* take fewer `steps`"):
            read_lsystem(text).derive()
    else:
        assert read_lsystem(text).derive() == [Letter("F", ())]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("#define steps 99\naxiom: A\nA -> AA\n", "beyond 1,000,000 modules in step 20 of 99"),
        ("#define steps 2\naxiom: F\nF -> " + "F" * 200 + "\n", "more than 20,000 internodes"),
        ("axiom: " + "L" * 20_001 + "\n", "more than 20,000 internodes, leaves"),
        ("axiom: {" + "f" * 20_003 + "}\n", "more than 20,000 internodes, leaves and triangles"),
    ],
)
def test_growth_without_end_is_refused_with_what_to_do(text: str, told: str) -> None:
    with pytest.raises(UsageError) as caught:
        plant_of(text)
    assert told in str(caught.value)
    assert "most: " in str(caught.value) and "fewer" in str(caught.value)


def test_a_string_that_grows_slowly_is_refused_too() -> None:
    system = read_lsystem("axiom: A\nA -> AB\n")
    system.most = 50
    assert len(system.derive(12)) == 13
    with pytest.raises(UsageError, match="more than 300 modules, rules and contexts"):
        system.derive(40)
    system = read_lsystem("axiom: A\nA -> A" + "B" * 10 + "\n")
    system.most = 50
    assert len(system.derive(4)) == 41
    with pytest.raises(UsageError, match="beyond 50 modules in step 5 of 40"):
        system.derive(40)


def test_a_file_may_ask_for_more() -> None:
    text = "axiom: " + "[L]" * 20_001 + "\nmost: 30000\n"
    assert len(drawing_of(text).leaves.size) == 20_001
    with pytest.raises(UsageError, match="more than 10 internodes"):
        plant_of("axiom: FFFFFFFFFFFF\nmost: 10\n")


@pytest.mark.parametrize(
    "text",
    [
        "axiom: !(1e300)F\n",
        "axiom: !(1e-300)F\n",
        "axiom: L(1e300)\n",
        "axiom: F(1e29)F(1e31)\n",
        "axiom: F\n#define width 0\n",
        "axiom: F\ntip: 1e300\n",
        "axiom: F\nbend: 1e300\nthickness: 0\n",
    ],
)
def test_sizes_beyond_measure_are_told(text: str) -> None:
    with pytest.raises(UsageError):
        plant_of(text)


def test_a_bend_of_next_to_nothing_is_none() -> None:
    text = "axiom: !(0.2)F[+(40)!(0.1)F]F\nbend: "
    none, hardly = (Model(plant_of(f"{text}{x}\n")) for x in ("0", "5e-324"))
    np.testing.assert_array_equal(none.bounds, hardly.bounds)


def test_branches_that_coincide_meet_by_age() -> None:
    model = Model(plant_of("axiom: !(0.2)F[&F][&F]\njunctions: aged\nbend: 30\n"))
    assert np.isfinite(model.bounds).all()
