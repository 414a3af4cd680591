"""Numbers in parentheses right behind a word are one token, and nobody sees it."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pcsg.errors import Source, SourceSpan
from pcsg.grammar import check_text, load_file, load_text, parse, tokens
from pcsg.grammar.tokens import tokenize, unfold
from pcsg.graph.expr import Apply, Expr, Number, Parameter
from pcsg.graph.graph import expressions
from pcsg.graph.text import to_pcsg

GRAMMARS = Path(__file__).parents[2] / "grammars"

PIECES = (
    *("move(1,2,3) ", "color(.1,.2,.3) ", "rotz(-30) ", "scale( 1 , -2.5e-1,3)", "uscale(\t1 )"),
    *("A(1,2)", "S(3)", "foo(1,2) ", "Move(1,2,3) ", "mvoe(1,2,3) ", "box(1)", "cone(0.5)"),
    *("and(1)", "pi(2)", "not(1)", "flipxy(1)", "material(1)", "else(1)", "choose(1;2)", "(1,2,3)"),
    *("move(1,2", "move(1,2,)", "move(1 2)", "move(--1,2,3)", "move(1,/**/2,3)", "move(1,\n2,3)"),
    *("move(1e999,2,3)", "move(1e-05,2,3)", "move(1e100,2,3)", "2x(1,2)", "2x.x(1)", "x\u00b2(1)"),
    *(
        "a\u0301(1,2) ",
        "\u0301(1)",
        "move(1,2,3)(4)",
        "S(1)(2)",
        '"a"(1)',
        "/*",
        "{a=max(1,-2)+e(2)} ",
    ),
    *("{a=sin(30)*2} ", "blob{point(1)}", "blob{pcm(.4){point(1),weight(2) point(1)}}", "gbb(1){"),
    *(
        "#define Q move\n",
        "#define Q and\n",
        "#define W move(1,-2,3) cone(.5)\n",
        "#define V(1) x\n",
    ),
    *("#define M 3 *\n", "#define O (\n", "Q(1,2,3) ", "W ", "{a=M(2)} ", "O(1)", "#define(1) x\n"),
    *(
        "#include(1)\n",
        "#foo(1,2)\n",
        "camera(1){eye=(1,2,3)}",
        "camera{eye=f(1,2,3);fov=sin(1)}",
        "camera{eye=1,sin(2),-3}",
    ),
    *(
        "S(2)\n",
        "\nS if(1)\n",
        "\nS (2)\n",
        "\n1: S -> ",
        "p: S(1) -> box\n",
        "\np: F(n): n>sin(1) -> ",
    ),
    *("{c=1} ", "c = ", "|", "&", "\\", "-", "(", ")", "{", "}", "box", "sphere ", "\n", ",", ";"),
)
"""What texts are put together from."""


def place(span: SourceSpan | None) -> object:
    return span and (span.start, span.end, place(span.body))


def shape(expr: Expr) -> object:
    """Return what an expression is; the negative of a number is the negative number."""
    if isinstance(expr, Apply):
        if expr.function == "neg" and isinstance(expr.args[0], Number):
            return -expr.args[0].value, place(expr.span)
        return expr.function, [shape(a) for a in expr.args], expr.seeds, place(expr.span)
    assert isinstance(expr, (Number, Parameter))
    return expr.value if isinstance(expr, Number) else expr.name, place(expr.span)


def reading(text: str) -> object:
    """Return everything that can be seen of what comes of a text."""
    graph, problems = check_text(text)
    if graph is None:
        return [p.to_json() for p in problems]
    nodes = [(type(n), place(n.span), [shape(e) for e in expressions(n)]) for n in graph.nodes]
    return [p.to_json() for p in problems], nodes, graph.successors, to_pcsg(graph)


@given(st.lists(st.sampled_from(PIECES), max_size=8).map("".join))
@example("{} A(1,2)\np: A(x, y) -> move(x,y,0) box")
@example("{} move(1,2) box | color(1) box | cone(1,2,3) | spere(1) | mvoe(1,2,3) box")
@example("#define W move(1,-2,3) cone(.5)\n{} W | move(1,-2) W")
@example("#define Q and\n{a = 1 Q(1)} box")
@example("#define K x(1)\n{} K(2) box")
@example("#define K x(1)\n{} K(2)")
@example("#define Q move\n#define R Q(1,2)\n{} R box")
@example("{} move(1,2,3)(4)")
@example("2x(1,2) box")
def test_one_token_reads_as_many(text: str) -> None:
    one = reading(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tokens, "TAKES_LITERALS", frozenset())
        assert reading(text) == one


@pytest.mark.parametrize("path", sorted(GRAMMARS.glob("*.pcsg")), ids=lambda path: path.stem)
def test_only_mistakes_are_parsed_twice(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(parse, "_parse_slowly")
    load_file(path)
    with pytest.raises(NameError):
        load_text("{} move(1,2,3) | box")


def test_numbers_behind_a_word_are_one_token() -> None:
    source = Source("", "move(1, -2.5,.3) box | A(1) & sin (2) - rot(1,a)")
    found, _ = tokenize(source)
    assert [t.text for t in found if t.type == "LITERALS"] == ["(1, -2.5,.3)", "(1)"]
    parts = unfold(found[1])
    assert [p.text for p in parts] == ["(", "1", ",", "-", "2.5", ",", ".3", ")"]
    assert [p.gap for p in parts] == [False, False, False, True, *[False] * 4]
    assert all(p.text == source.text[p.start : p.end] for p in parts)


def test_a_negative_number_has_the_place_of_its_sign() -> None:
    (move, _) = load_text("move(1, -2.5e0 ,-.5) box").nodes
    spans = [e.span for e in expressions(move)]  # type: ignore[attr-defined]
    assert [span.text for span in spans] == ["1", "-2.5e0", "-.5"]


def test_a_number_in_a_macro_points_at_its_use_and_at_its_body() -> None:
    (move, _) = load_text("#define W move(1, -2,3)\nW box").nodes
    spans = [e.span for e in expressions(move)]  # type: ignore[attr-defined]
    assert [span.text for span in spans] == ["W"] * 3
    assert [span.body.text for span in spans] == ["1", "-2", "3"]


def test_a_long_list_of_numbers_is_read_as_well() -> None:
    numbers = ",".join("1" for _ in range(200))
    graph = load_text(f"{{a = max({numbers})}} box")
    assert to_pcsg(graph).count("1") == 200


def test_numbers_count_where_tokens_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tokens, "MAX_TOKENS", 50)
    text = "{} move(1,2,3) box" + " | move(1,2,3) box" * 12
    graph, problems = check_text(text)
    assert graph is None
    assert [p.code for p in problems] == ["file-too-large"]
