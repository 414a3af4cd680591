"""One golden file for every diagnostic that the front end can raise."""

from __future__ import annotations

from pathlib import Path

import pytest
from errors_page import write_page

from pcsg.catalogue import CATALOGUE, Stage
from pcsg.errors import Diagnostic, GrammarError
from pcsg.grammar import check_file, load_file
from pcsg.graph import faults

GOLDEN = Path(__file__).parent / "golden"
FILES = sorted(GOLDEN.glob("*.pcsg"))
PAGE = Path(__file__).parents[2] / "docs" / "errors.md"

# Raised for what is no grammar, tested below, or while a graph is walked.
ELSEWHERE = {"file-missing", "file-too-large", "bad-species", "bad-lsystem", "odd-lsystem"}


def check(path: Path) -> list[Diagnostic]:
    # Names are relative to the folder, so that the golden files are the same everywhere.
    _, diagnostics = check_file(path.relative_to(Path.cwd()))
    return diagnostics


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_diagnostics_are_as_recorded(
    path: Path, update: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(GOLDEN)
    diagnostics = check(path)
    rendered = "\n".join(d.render() for d in diagnostics) + "\n"
    recorded = path.with_suffix(".txt")
    if update:
        recorded.write_text(rendered, encoding="utf-8")
    assert rendered == recorded.read_text(encoding="utf-8")
    code = path.stem
    if code in CATALOGUE:
        assert code in {d.code for d in diagnostics}
    for d in diagnostics:
        assert d.code in CATALOGUE
        assert d.severity == CATALOGUE[d.code].severity
        assert d.to_json()["message"] == d.message


def test_every_code_has_a_golden_file() -> None:
    front_end = {c for c, m in CATALOGUE.items() if m.stage is not Stage.RUN} - ELSEWHERE
    assert front_end <= {p.stem for p in FILES}


def test_no_golden_file_is_left_over() -> None:
    assert {p.stem for p in GOLDEN.glob("*.txt")} == {p.stem for p in FILES}


def test_the_page_of_errors_is_made_from_the_catalogue(update: bool) -> None:
    page = write_page(GOLDEN)
    if update:
        PAGE.write_text(page, encoding="utf-8")
    assert page == PAGE.read_text(encoding="utf-8")


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "large.pcsg").write_bytes(b" " * (16 * 2**20 + 1))
    expected = {
        tmp_path / "absent.pcsg": "file-missing",
        tmp_path: "file-missing",
        tmp_path / "large.pcsg": "file-too-large",
        Path("with\0nul.pcsg"): "file-missing",
        Path("/dev/zero"): "file-missing",
    }
    for path, code in expected.items():
        with pytest.raises(GrammarError) as caught:
            load_file(path)
        assert [d.code for d in caught.value.diagnostics] == [code]
        assert caught.value.exit_status == 2


def test_all_mistakes_of_a_file_come_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(GOLDEN)
    codes = [d.code for d in check(GOLDEN / "all-at-once.pcsg")]
    assert codes == [
        "unexpected-token",
        "wrong-arguments",
        "unknown-module",
        "unbalanced-bracket",
        "unknown-key",
    ]
    with pytest.raises(GrammarError) as caught:
        load_file("all-at-once.pcsg")
    assert [d.code for d in caught.value.diagnostics] == codes


def test_warnings_do_not_keep_a_grammar_from_loading() -> None:
    graph, diagnostics = check_file(GOLDEN / "never-used.pcsg")
    assert graph is not None
    assert {d.severity for d in diagnostics} == {"warning"}
    assert load_file(GOLDEN / "never-used.pcsg") == graph


def test_faults_of_the_walk_are_in_the_catalogue() -> None:
    running = {code for code, mistake in CATALOGUE.items() if mistake.stage is Stage.RUN}
    told = {
        faults.NOT_FINITE,
        faults.UNASSIGNED_PARAMETER,
        faults.SELECTION_RANGE,
        faults.SINGULAR_MATRIX,
        faults.BAD_ARGUMENT,
        faults.DEPTH_LIMIT,
        faults.LONG_RAY,
        faults.MEMORY_BUDGET,
        faults.TOO_MANY_MODELS,
    }
    assert told == running
