"""Grammars of the gallery are copied whole, and names of files that are not there are explained."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

import pcsg
from pcsg.cli import app
from pcsg.commands.gallery import PICTURES


def told(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(words))
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_grammar_is_copied_with_what_it_reads(elsewhere):
    for picture in PICTURES:
        folder = elsewhere / picture.name
        folder.mkdir()
        assert told("gallery", picture.name, "--copy", "-o", str(folder))[0] == 0
        copy = folder / Path(picture.grammar).name
        assert told("check", str(copy)) == (0, f"{copy}: no errors")
    assert (elsewhere / "flock" / "bird.obj").exists()
    assert (elsewhere / "conifer" / "parts" / "spruce.pcsg").exists()
    assert (elsewhere / "grove" / "lsystems" / "oak.lsys").exists()


def test_a_file_that_somebody_has_changed_is_left_as_it_is(elsewhere):
    assert told("gallery", "tree", "--copy")[0] == 0
    assert told("gallery", "tree", "--copy")[0] == 0
    Path("tree.pcsg").write_text("sphere")
    status, text = told("gallery", "tree", "--copy")
    assert status == 2 and "is there already" in text
    assert Path("tree.pcsg").read_text() == "sphere"


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["gallery", "--copy"], "takes the names of pictures"),
        (["gallery", "tree", "--copy", "--render"], "two commands"),
        (["gallery", "tree", "--copy", "-o", "nowhere"], "there is no folder nowhere"),
        (["gallery", "tre", "--copy"], "did you mean `tree`"),
    ],
)
def test_what_cannot_be_copied_is_told(words, text):
    status, output = told(*words)
    assert status == 2 and text in output


@pytest.mark.parametrize("verb", ["render", "check", "stats", "animate"])
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("tree", "`pcsg gallery tree --copy` copies the gallery's tree.pcsg"),
        ("oak.lsys", "`pcsg gallery oak --copy`"),
        ("willow", "did you mean `willow.pcsg`?"),
        ("wilow.pcsg", "did you mean `willow.pcsg`?"),
        ("wilow", "did you mean `willow.pcsg`?"),
        ("nothing-like-it.pcsg", "there is no file nothing-like-it.pcsg"),
    ],
)
def test_a_file_that_is_not_there_is_explained(verb, name, text):
    Path("willow.pcsg").write_text("sphere")
    status, output = told(verb, name)
    assert status == 2 and text in output, output


@pytest.mark.parametrize("words", [["mesh"], ["skeleton"], ["mesh", "--method", "contour"]])
def test_what_is_no_tree_is_explained_too(words):
    Path("willow.pcsg").write_text("sphere")
    for name, text in (("tree", "`pcsg gallery tree --copy`"), ("wilow", "`willow.pcsg`")):
        status, output = told(*words, name)
        assert status == 2 and text in output, output


def test_a_copy_is_the_grammar(elsewhere):
    told("gallery", "sierpinski", "--copy")
    assert pcsg.load("sierpinski.pcsg", c=3).stats()["primitives"] == 64
