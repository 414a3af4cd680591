"""Whatever a file holds, reading it gives a graph or a GrammarError, in seconds."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.lark import from_lark
from lark import Lark

from pcsg.errors import GrammarError
from pcsg.grammar import check_text, load_file, load_text
from pcsg.grammar import parse as parse_module

GRAMMARS = Path(__file__).parents[2] / "grammars"
SHIPPED = [p.read_text(encoding="utf-8") for p in sorted(GRAMMARS.glob("*.pcsg"))]

# Spellings of the terminals that tokens.py makes. Words end with a blank, because ignored blanks
# take most of the time.
TERMINALS = r"""
NAME: /[a-dST] /
NUMBER: /[0-9]{1,2}(\.[0-9])? /
STRING: /"[a-z]{0,3}"/
LITERALS: "(1)" | "(-2, .5)" | "(1,2,3)"
CONSTANT: "pi " | "e " | "true "
ELSE: "else "
TRANSFORM: "move " | "weight " | "uscale " | "rotz "
MIRROR: "flipxy "
FOR: "for "
REPEAT: "repeat "
SCATTER: "scatter"
ATTRIBUTE: "color " | "material " | "label "
PRIMITIVE: "sphere " | "cone " | "tri1 " | "empty "
UNION: "|"
INTERSECTION: "&"
DIFFERENCE: "\\"
MINUS: "-"
OPERATOR: "+" | "*" | "/" | "^" | "<" | "==" | " and "
NOT: " not " | "!"
LABEL: /\n[pq][1-3] ?: ?/
NUMBERED: /\n[0-3] ?: ?/
SETTING: "camera " | "\nmaterial " | "sky "
KEY: "fov " | "eye " | "color " | "kind "
BLOB: "blob "
BLEND: "pcm " | "ricci " | "gbb "
FOPEN: " {"
FCLOSE: "}"
LPAREN: "("
RPAREN: ")"
LBRACE: "{"
RBRACE: "}"
COMMA: ","
LIST_COMMA : ","
SEMICOLON: ";" | ";\n"
COLON: ":"
ASSIGN: "="
ARROW: "->" | "\u2192"
"""


def fuzzing_grammar() -> Lark:
    text = Path(parse_module.__file__).with_name("pcsg.lark").read_text(encoding="utf-8")
    text = "\n".join(line for line in text.splitlines() if not line.startswith("%declare"))
    item = "file: item+\nitem: " + " | ".join(parse_module.STARTS) + "\n"
    return Lark(item + text + TERMINALS, start="file", parser="earley")


def read(text: str) -> None:
    """Read a text; anything but a graph or a GrammarError is a failure."""
    graph, diagnostics = check_text(text)
    errors = [d for d in diagnostics if d.severity == "error"]
    assert (graph is None) == bool(errors)
    for d in diagnostics:
        assert d.render()
        if d.span:
            assert 0 <= d.span.start <= d.span.end <= len(d.span.source.text)
    if errors:
        with pytest.raises(GrammarError):
            load_text(text)


@given(from_lark(fuzzing_grammar()))
def test_texts_made_from_the_grammar(text: str) -> None:
    read(text)


@given(st.text(alphabet=st.sampled_from('(){}|\\-=:;,.1c S\n#"/*>e@\u2192\u222a'), max_size=60))
@example("S(")
@example("#define S S")
@example("1:")
@example("w: ")
@example("{")
@example('#include ""')
@example('#include "."')
def test_texts_of_signs(text: str) -> None:
    read(text)


@st.composite
def mutated(draw: st.DrawFn) -> str:
    text = draw(st.sampled_from(SHIPPED))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(text)))
        length = draw(st.integers(0, 12))
        from_there = draw(st.integers(0, len(text)))
        put = draw(
            st.one_of(
                st.just(""),
                st.text(max_size=4),
                st.sampled_from(["(", ")", "{", "}", ";", "->", "1:", "=", "|", "#define ", "\\"]),
                st.just(text[from_there : from_there + 20]),
            )
        )
        text = text[:at] + put + text[at + length :]
    return text


@given(mutated())
def test_mutated_grammars(text: str) -> None:
    read(text)


N = 30_000
LONG = 8_000_000


@pytest.mark.parametrize(
    "text",
    [
        "(" * 1_000_000,
        ")" * 1_000_000,
        "{} " + "(" * 500_000 + "sphere" + ")" * 500_000,
        "}{" * N,
        "{} " + "(" * N + "sphere" + ")" * N,
        "{} " + "(" * N + "sphere" + ")" * (N - 1),
        "flipxy " * 300_000 + "sphere",
        "{} " * N + "sphere",
        "{a=" + "-" * 300_000 + "1} sphere",
        "{a=" + "not " * N + "1} sphere",
        "{a=" + "(" * N + "1" + ")" * N + "} sphere",
        "{a=" + "1+(" * N + "1" + ")" * N + "} sphere",
        "{a=" + "1+" * N + "1} sphere",
        "{a=" + "2^" * N + "1} sphere",
        "{a=" + "sin(" * N + "1" + ")" * N + "} sphere",
        "{} " + "(sphere|" * N + "box" + ")" * N,
        "{} " + "(sphere\\" * (N // 2) + "box" + ")" * (N // 2),
        "sphere" + "|sphere" * N,
        "sphere\n" + "\n".join(f"a{k} = a{k + 1}" for k in range(N // 10)),
        "S\nS 1\n" + "\n".join(f"{k}: S -> {{}} S" for k in range(1, N // 10)),
        "\0" * N,
        "@ " * N,
        "#define a " + "b " * N + "\na",
        "".join(f"#define a{k} a{k + 1}\n" for k in range(N // 10)) + "a0",
        "/*" * N,
        '"' * N,
        "1" * N + ": S -> sphere",
        "{a=" + "1" * N + "} sphere",
        "9" * 5000 + ": S -> sphere\nS",
        "word " * (LONG // 5),
        "word " * (LONG // 5) + "\n" + "@" * LONG,
        "@" * LONG,
        "{a=" + "1+" * (LONG // 2) + "1} sphere",
        "S\n" + "".join(f"{k}: S -> box\n" for k in range(1, 1_000_001)),
        "/**/" * (LONG // 4),
        "{" + ";".join(f"p{k}={k}" for k in range(N // 2)) + "} sphere",
        "|".join(f"ball{k}" for k in range(6000)) + "".join(f"\nbal{k} = box" for k in range(6000)),
        "".join(f"material(m{k}) box|" for k in range(8000))
        + "box"
        + "".join(f"\nmaterial n{k} {{ }}" for k in range(8000)),
        "|".join(f"blob {{ move({k},0,0) point(1) }}" for k in range(6000)),
        "|".join(f"move(q{k},0,0) box" for k in range(4000))
        + "".join(f"|{{p{k}=1}} box" for k in range(40_000)),
    ],
    ids=lambda text: text[:12].strip(),
)
def test_monsters_end_in_seconds(text: str) -> None:
    start = time.process_time()
    try:
        load_text(text)
    except GrammarError as error:
        assert len(str(error)) < 100_000
    assert time.process_time() - start < 30.0


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "noise.pcsg"
    noise = random.Random(1)
    for data in (b"\xff\xfe{\0}\0", bytes(noise.randbytes(5000)), b"\xef\xbb\xbf", b"", b"\xc3"):
        path.write_bytes(data)
        with pytest.raises(GrammarError):
            load_file(path)


def test_loading_is_quick() -> None:
    path = GRAMMARS / "fig5a.pcsg"
    load_file(path)
    start = time.process_time()
    load_file(path)
    assert time.process_time() - start < 0.1
