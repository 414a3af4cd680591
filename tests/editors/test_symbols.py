"""Names of a grammar: whatever is renamed, it stays a grammar that says the same."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from pcsg.editors.assistance import uses
from pcsg.editors.symbols import SOLID, Names, files_of
from pcsg.errors import Source
from pcsg.grammar import check_text
from pcsg.graph.graph import GLOBALS

GRAMMARS = Path(__file__).parents[2] / "grammars"
ALONE = [p for p in sorted(GRAMMARS.glob("*.pcsg")) if "#include" not in p.read_text("utf-8")]


def names_in(text: str, path: Path) -> list[Names]:
    return files_of(Source(str(path), text, str(path.parent)), {})


@pytest.mark.parametrize("path", ALONE, ids=lambda p: p.stem)
def test_renaming_breaks_no_grammar(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    files = names_in(text, path)
    before, _ = check_text(text, folder=path.parent)
    assert before is not None
    kinds = {(o.space, o.name): o for o in files[0].occurrences if o.name not in GLOBALS}
    listed = sorted(kinds.values(), key=str)
    for found in random.Random(path.stem).sample(listed, min(4, len(listed))):
        places = uses(files, found)
        assert any(o.defines for o in places), found
        made = text
        for place in sorted(places, key=lambda o: -o.start):
            made = made[: place.start] + "renamed" + made[place.end :]
        after, problems = check_text(made, folder=path.parent)
        assert after is not None, (found, problems)
        if found.space == SOLID:
            assert len(after.nodes) == len(before.nodes)


@pytest.mark.parametrize("path", sorted(GRAMMARS.glob("*.pcsg")), ids=lambda p: p.stem)
def test_every_name_of_a_shipped_grammar_is_defined(path: Path) -> None:
    files = names_in(path.read_text(encoding="utf-8"), path)
    defined = {(o.space, o.name) for names in files for o in names.occurrences if o.defines}
    used = {(o.space, o.name) for names in files for o in names.occurrences}
    assert {name for _, name in used - defined} <= GLOBALS.keys()


def test_the_open_text_of_an_included_file_counts(tmp_path: Path) -> None:
    part = tmp_path / "part.pcsg"
    part.write_text("old = box\n")
    whole = Source(str(tmp_path / "a.pcsg"), '#include "part.pcsg"\n{} new\n', str(tmp_path))
    found = files_of(whole, {part.resolve(): "new = box\n"})
    assert [o.name for o in found[1].occurrences] == ["new"]
    assert [o.space for o in found[0].occurrences] == [SOLID]


def test_files_that_include_one_another_come_once(tmp_path: Path) -> None:
    a, b = tmp_path / "a.pcsg", tmp_path / "b.pcsg"
    a.write_text('#include "b.pcsg"\n#include "none.pcsg"\n{} S\n')
    b.write_text('#include "a.pcsg"\nS = box\n')
    assert len(files_of(Source(str(a), a.read_text(), str(tmp_path)), {})) <= 3


def test_no_file_outside_of_the_folder_is_read(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.pcsg").write_text("secret = box\n")
    (tmp_path / "in" / "notes.txt").write_text("notes = box\n")
    text = '#include "../secret.pcsg"\n#include "notes.txt"\n#include "a\0.pcsg"\n{} S\n'
    files = files_of(Source(str(tmp_path / "in" / "a.pcsg"), text, str(tmp_path / "in")), {})
    assert len(files) == 1
