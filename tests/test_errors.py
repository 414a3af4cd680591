"""Errors come back from other processes as they were, and say nothing that a terminal obeys."""

from __future__ import annotations

import copy
import importlib
import multiprocessing
import pickle
import pkgutil
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

import pcsg
from pcsg.catalogue import diagnose
from pcsg.commands.guard import say
from pcsg.errors import (
    Diagnostic,
    EnvironmentFault,
    EvaluationFault,
    GrammarError,
    PcsgError,
    Source,
    SourceSpan,
    UsageError,
    printable,
)
from pcsg.inputs import TooLargeError
from pcsg.meshfile.mesh import MeshFileError

SOURCE = Source("tree.pcsg", "{} spere\n", "folder")
MISTAKE = diagnose(
    "unknown-primitive",
    "unknown primitive `spere`",
    SourceSpan(SOURCE, 3, 8, SourceSpan(SOURCE, 0, 2)),
    notes=[("a note", None)],
)
EXAMPLES = {
    PcsgError: PcsgError("a"),
    GrammarError: GrammarError([MISTAKE, MISTAKE]),
    UsageError: UsageError("a"),
    EvaluationFault: EvaluationFault(MISTAKE),
    EnvironmentFault: EnvironmentFault("a"),
    TooLargeError: TooLargeError("a"),
    MeshFileError: MeshFileError("a.obj", "line 3", "no polygons"),
}


def all_errors() -> Iterator[type[PcsgError]]:
    for module in pkgutil.walk_packages(pcsg.__path__, "pcsg."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    waiting = [PcsgError]
    while waiting:
        yield (kind := waiting.pop())
        waiting += kind.__subclasses__()


def same(a: PcsgError, b: PcsgError) -> bool:
    return type(a) is type(b) and str(a) == str(b) and vars(a) == vars(b) and a.args == b.args


def test_every_error_has_an_example() -> None:
    named = {kind.__qualname__ for kind in all_errors() if kind.__module__.startswith("pcsg.")}
    assert named == {kind.__qualname__ for kind in EXAMPLES}


@pytest.mark.parametrize("error", EXAMPLES.values(), ids=lambda e: type(e).__name__)
def test_errors_pickle_by_value(error: PcsgError) -> None:
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        assert same(pickle.loads(pickle.dumps(error, protocol)), error)
    assert same(copy.copy(error), error)
    assert same(copy.deepcopy(error), error)


def fail(error: PcsgError) -> None:
    raise error


def test_errors_come_through_a_pool_of_processes() -> None:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        for error in EXAMPLES.values():
            with pytest.raises(type(error)) as caught:
                pool.submit(fail, error).result(timeout=120)
            assert str(caught.value) == str(error)


EVIL = "\x1b]0;title\x07\x1b[2Ja\x9b31m\u202eb\r\x00\udcff"


def test_control_characters_are_shown_not_obeyed() -> None:
    shown = printable(EVIL + "\tä\n")
    assert shown == "␛]0;title␇␛[2Ja\ufffd31m\ufffdb␍␀\ufffd\tä\n"
    assert shown.encode()


def test_no_message_reaches_a_terminal_raw(capsys: pytest.CaptureFixture[str]) -> None:
    source = Source(f"{EVIL}.pcsg", f"{{}} {EVIL}")
    mistake = Diagnostic("a", EVIL, SourceSpan(source, 3, 5), EVIL, EVIL, ((EVIL, None),))
    for error in (GrammarError([mistake]), UsageError(EVIL), EvaluationFault(mistake)):
        assert not set(str(error)) & set(EVIL) - set(";]0[title2Jab31m")
    say(EVIL)
    assert capsys.readouterr().err == printable(EVIL) + "\n"


def test_carets_stay_below_what_they_mean() -> None:
    line = "{} \x1b[31m spere"
    span = SourceSpan(Source("a", line), line.index("spere"), len(line))
    _, text, carets = str(GrammarError([Diagnostic("a", "b", span)])).splitlines()
    assert text.index("spere") == carets.index("^")


def test_commands_write_through_one_place() -> None:
    commands = Path(pcsg.__file__).parent / "commands"
    raw = {p.name for p in commands.glob("*.py") if "typer.echo(" in p.read_text(encoding="utf-8")}
    assert raw == {"guard.py"}
