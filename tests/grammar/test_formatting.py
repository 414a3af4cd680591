"""`pcsg fmt`: what it changes, what it leaves, and that the grammar stays the same."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
import strategies as cases
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from pcsg.cli import app
from pcsg.errors import GrammarError, Source
from pcsg.grammar import check_text
from pcsg.grammar.formatting import format_text
from pcsg.grammar.tokens import BETWEEN, tokenize, unfold_all
from pcsg.graph.digest import digest_of
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Calculation
from pcsg.graph.text import to_pcsg

GRAMMARS = sorted((Path(__file__).parents[2] / "grammars").rglob("*.pcsg"))


def formatted(text: str) -> str:
    return format_text(Source("<text>", text))


def meaning(text: str) -> tuple[list[tuple[str, str, bool]], list[str]]:
    """Return the tokens, one for each number, and the comments without blanks at ends of lines."""
    tokens, problems = tokenize(Source("<text>", text))
    assert not problems
    parts = unfold_all(tokens)
    comments, at = [], 0
    for start, end in [*((p.start, p.end) for p in parts), (len(text), 0)]:
        found = [m[0] for m in BETWEEN.finditer(text, at, start) if m.lastgroup == "COMMENT"]
        comments += [re.sub(r"[ \t\r\f\v]+(?=\n|$)", "", c) for c in found]
        at = end
    return [(p.type, p.text, p.first) for p in parts], comments


def crumple(rng: random.Random, text: str) -> str:
    """Return the text with other blanks: some more, some gone where nothing depends on them."""
    tokens, _ = tokenize(Source("<text>", text))
    made, at = "", 0
    for before, token in zip([None, *tokens], tokens, strict=False):
        between = text[at : token.start]
        names = before is not None and before.type in ("NAME", "PRIMITIVE", "NUMBER", "TRANSFORM")
        if "/" not in between and "\n" not in between:
            if not between and not names and token.type != "LITERALS":
                between = rng.choice(["", "", " ", "\t", "  "])
            elif between and not names and not text[token.start].isalnum():
                between = rng.choice([between, "", " \t"])
        elif "/" not in between:
            more = ["\n\n\n\n"] if "\n\n" in between else []  # `#define` reads on for one line
            between = between.replace("\n", rng.choice(["\n", " \n", "\r\n", *more]))
        made += between + text[token.start : token.end]
        at = token.end
    return made + text[at:]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("sphere", "sphere\n"),
        ("", ""),
        (" \n\n", ""),
        ("a = box  \r\n\r\nb = a\t\r\n", "a = box\n\nb = a\n"),
        ("\n\na = box\n\n\n\n\nb = a\n\n", "a = box\n\n\nb = a\n"),
        ("1:S->box", "1: S -> box\n"),
        ("1 : S\u2192box", "1: S \u2192 box\n"),
        ("p1 : F(n):n > 0->box", "p1: F(n): n > 0 -> box\n"),
        ("{c=6}S", "{c=6} S\n"),
        ("{c= 6 ;d =7;}S", "{c = 6; d = 7;} S\n"),
        ("box|cone&sphere\\torus(.5)", "box | cone & sphere \\ torus(.5)\n"),
        ("rotx(6)uscale(2)(A|B)", "rotx(6) uscale(2) (A | B)\n"),
        ("{d=1}{c=2}A", "{d=1} {c=2} A\n"),
        ("move(1 ,2 ,3) box", "move(1,2,3) box\n"),
        ("move(0, -1, c -1) box", "move(0, -1, c - 1) box\n"),
        ("move(a+ b, c*(d)/2, - 1) box", "move(a + b, c*(d)/2, - 1) box\n"),
        (
            "material bark{color=(1,0,0);roughness=1}",
            "material bark { color=(1,0,0); roughness=1 }\n",
        ),
        ("blob{point(1)+move(q,0,0) line}", "blob { point(1)+move(q,0,0) line }\n"),
        ("blob { pcm(0.4){a , b} }", "blob { pcm(0.4) { a , b } }\n"),
        ("\tbox// a\tb  \n", "    box // a\tb\n"),
        ("/* a  \n\t b */  box\n", "/* a\n\t b */  box\n"),
        ('mesh("a b\t.obj")uscale(2)', 'mesh("a b\t.obj") uscale(2)\n'),
        ("A (1)", "A (1)\n"),
        ("#define a (1)\n#define b(1)\n", "#define a (1)\n#define b(1)\n"),
    ],
)
def test_what_is_set_in_order(before: str, after: str) -> None:
    assert formatted(before) == after
    assert formatted(after) == after


@pytest.mark.parametrize(
    "text",
    [
        "A = (  move( 0.5,  0.5) B\n     | move(-0.5, -0.5) B )\n",
        "#define red    1\n#define white  2\n",
        "{ a   = 1;   // the first\n  bcd = 22;  // the second\n} S\n",
        "a = move(0,0,1) b\nc = move(0, 0, 1) d\n",
    ],
)
def test_the_authors_layout_stays(text: str) -> None:
    assert formatted(text) == text


@pytest.mark.parametrize("path", GRAMMARS, ids=lambda p: p.name)
def test_shipped_grammars_are_in_order(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert formatted(text) == text


@pytest.mark.parametrize("path", GRAMMARS, ids=lambda p: p.name)
def test_crumpled_grammars_are_the_same(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(path.parent)  # files are named from there
    text = path.read_text(encoding="utf-8")
    crumpled = crumple(random.Random(path.name), text)
    made = formatted(crumpled)
    assert crumpled != text and made != crumpled
    assert formatted(made) == made
    assert meaning(made) == meaning(crumpled) == meaning(text)
    graphs = [check_text(t)[0] for t in (text, crumpled, made)]
    if graphs[0] is not None:  # parts have no axiom
        assert len({digest_of(g) for g in graphs if g is not None}) == 1
        assert None not in graphs


@given(cases.graphs(), st.randoms(use_true_random=False))
def test_random_grammars_are_the_same(graph: Graph, rng: random.Random) -> None:
    for node in graph.nodes:
        if isinstance(node, Calculation):
            node.call = False  # text has calls of attributed modules only
    text = to_pcsg(graph)
    crumpled = crumple(rng, text)
    made = formatted(crumpled)
    assert formatted(made) == made
    assert meaning(made) == meaning(crumpled) == meaning(text)
    read = [check_text(t)[0] for t in (text, made)]
    assert read[0] is not None and read[1] is not None
    assert digest_of(read[0]) == digest_of(read[1])


@pytest.mark.parametrize("text", ["box $", "/* box", 'mesh("a\n', "uscale(1x) box"])
def test_what_cannot_be_cut_into_tokens_is_told(text: str) -> None:
    with pytest.raises(GrammarError):
        formatted(text)


def test_other_mistakes_do_not_matter() -> None:
    assert formatted("1:S->(cilinder") == "1: S -> (cilinder\n"


# The command


def call(*arguments: object, given: str | bytes | None = None) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["fmt", *map(str, arguments)], input=given)
    assert "Traceback" not in result.output and "mistake in pcsg" not in result.output
    return result.exit_code, result.output


def test_files_are_formatted_in_place_and_keep_their_rights(tmp_path: Path) -> None:
    a, b = tmp_path / "a.pcsg", tmp_path / "b.pcsg"
    a.write_bytes(b"\xef\xbb\xbf1:S->box\r\n")
    b.write_text("sphere\n")
    a.chmod(0o640)
    before = b.stat().st_mtime_ns
    assert call(a, b)[0] == 0
    assert a.read_bytes() == b"1: S -> box\n"
    assert a.stat().st_mode & 0o777 == 0o640
    assert b.stat().st_mtime_ns == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.pcsg", "b.pcsg"]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    real, link = tmp_path / "real.pcsg", tmp_path / "link.pcsg"
    real.write_text("a=box|b")
    link.symlink_to(real)
    assert call(link)[0] == 0
    assert link.is_symlink()
    assert real.read_text() == "a=box | b\n"


def test_check_writes_nothing(tmp_path: Path) -> None:
    file = tmp_path / "a.pcsg"
    file.write_text("sphere|box")
    status, said = call("--check", file)
    assert status == 2
    assert "a.pcsg: not formatted" in said
    assert file.read_text() == "sphere|box"
    assert call(file)[0] == 0
    assert call("--check", file) == (0, "")


def test_standard_input_goes_to_standard_output() -> None:
    assert call("-", given="sphere|box") == (0, "sphere | box\n")
    assert call("-", "--check", given="sphere | box\n") == (0, "")
    assert call("-", "--check", given="sphere|box")[0] == 2
    assert call("-", given=b"\xff")[0] == 2


def test_one_bad_file_does_not_keep_the_others(tmp_path: Path) -> None:
    bad, good = tmp_path / "bad.pcsg", tmp_path / "good.pcsg"
    bad.write_text("box $")
    good.write_text("box|box")
    status, said = call(bad, tmp_path / "none.pcsg", good)
    assert status == 2
    assert "stray-character" in said and "none.pcsg" in said
    assert bad.read_text() == "box $"
    assert good.read_text() == "box | box\n"


def test_other_kinds_of_files_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.lsys"
    file.write_text("axiom: A\n")
    status, said = call(file)
    assert status == 2 and ".pcsg" in said
    assert call(tmp_path)[0] == 2
