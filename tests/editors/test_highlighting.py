"""Pygments, the TextMate grammar and the language's own tokens see the same in every file."""

from __future__ import annotations

import json
import tomllib
from importlib import import_module
from pathlib import Path

import pytest
from highlights import check_agreement, told
from pygments.token import Comment, Error, Keyword, Name, Number, Punctuation, Token

from pcsg.editors.pygments import LsysLexer, PcsgLexer
from pcsg.editors.textmate import SCOPES, grammar_text
from pcsg.editors.vocabulary import vocabulary
from pcsg.grammar.tokens import words

ROOT = Path(__file__).parents[2]
GRAMMARS = sorted((ROOT / "grammars").rglob("*.pcsg"))


@pytest.mark.parametrize("path", GRAMMARS, ids=lambda p: p.stem)
def test_all_three_agree_on_shipped_files(path: Path) -> None:
    check_agreement(path.read_text(encoding="utf-8"))


def test_the_file_of_the_grammar_is_made_from_the_words() -> None:
    made = (ROOT / "editors/vscode/syntaxes/pcsg.tmLanguage.json").read_text(encoding="utf-8")
    assert made == grammar_text(), "run python -m pcsg.editors.textmate"
    assert json.loads(made)["scopeName"] == "source.pcsg"


def test_every_reserved_word_has_a_kind() -> None:
    known = {word for listed in vocabulary().values() for word in listed}
    assert words().keys() <= known
    assert vocabulary().keys() <= SCOPES.keys()


def test_words_are_told_by_their_place() -> None:
    assert told("#define a sin(2)") == [
        ("#", "directive"),
        ("define", "directive"),
        ("a", "name"),
        ("sin", "function"),
        ("(", "sign"),
        ("2", "number"),
        (")", "sign"),
    ]
    assert dict(told("2: S -> min | material(m) box\nmaterial m { sky = 1 }")) == {
        "2": "label",
        ":": "sign",
        "S": "name",
        "->": "sign",
        "min": "name",
        "|": "sign",
        "material": "setting",
        "(": "sign",
        "m": "name",
        ")": "sign",
        "box": "primitive",
        "{": "sign",
        "sky": "name",
        "=": "sign",
        "1": "number",
        "}": "sign",
    }


def test_what_is_wrong_is_shown_as_wrong() -> None:
    found = {v: t for _, t, v in PcsgLexer().get_tokens_unprocessed("box $ /* open")}
    assert found["box"] in Name
    assert found["$"] is Error and found["/* open"] is Error


@pytest.mark.parametrize("path", sorted((ROOT / "grammars").rglob("*.lsys")), ids=lambda p: p.stem)
def test_lsystems_are_cut_whole(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    pieces = list(LsysLexer().get_tokens_unprocessed(text))
    assert "".join(value for _, _, value in pieces) == text
    assert not [v for _, t, v in pieces if t is Error or t is Token.Text]
    kinds = {t for _, t, _ in pieces}
    assert Punctuation in kinds and Keyword.Declaration in kinds


def test_lsystem_lines_are_told() -> None:
    text = "#define steps 9\naxiom: !(0.3) A(1)\nA(l) : l > .2 -> F(sqrt(l))\nbark: 0.2 0.1 0.1\n"
    found = {v: t for _, t, v in LsysLexer().get_tokens_unprocessed(text)}
    assert found["#define"] is Comment.Preproc and found["steps"] is Name.Constant
    assert found["axiom"] is Keyword.Declaration and found["bark"] is Keyword.Declaration
    assert found["->"] is Punctuation and found["0.3"] is Number
    assert found["sqrt"] is Name.Function


def test_pygments_finds_them_by_entry_points() -> None:
    named = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    for name, target in named["pygments.lexers"].items():
        module, _, lexer = target.partition(":")
        assert name in getattr(import_module(module), lexer).aliases
