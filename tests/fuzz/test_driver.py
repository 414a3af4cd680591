"""The driver sees what it is there for: foreign exceptions, warnings, hangs, memory, deaths."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import driver
import pytest
from driver import Subject, explore, make_input, withstand

from pcsg.errors import UsageError


def misbehave(data: str, _folder: Path) -> None:
    if data == "key":
        raise KeyError(data)
    if data == "warning":
        warnings.warn("careless", RuntimeWarning, stacklevel=1)
    if data == "hang":
        while True:
            pass
    if data == "memory":
        bytearray(driver.MEMORY + 2**20)
    if data == "usage":
        raise UsageError("as it should be")
    if data == "death":
        os._exit(3)


def subject_of(data: str) -> Subject:
    return Subject("driver", lambda: [data], lambda _rng, seed: seed, misbehave)


def test_errors_of_ours_are_fine(tmp_path: Path) -> None:
    withstand(subject_of("usage"), 3, tmp_path)


@pytest.mark.parametrize(
    ("data", "told"), [("key", "KeyError"), ("warning", "RuntimeWarning"), ("hang", "Hang")]
)
def test_failures_are_seen(
    data: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "SECONDS", 0.2)
    with pytest.raises(AssertionError, match=told):
        withstand(subject_of(data), 1, tmp_path)


def test_an_input_depends_on_its_number_alone() -> None:
    subject = Subject("any", lambda: ["a", "b"], lambda rng, _: str(rng.random()), misbehave)
    once = [make_input(subject, ["a", "b"], 7, k) for k in range(40)]
    assert once[33] == make_input(subject, ["a", "b"], 7, 33)
    assert len(set(once)) > 35


BAD = """
import random
from driver import Subject
from test_driver import misbehave
KINDS = ["key", "usage", "death", "memory", "fine"]
SUBJECT = Subject("bad", lambda: KINDS, lambda rng, _: rng.choice(KINDS), misbehave)
"""


def test_what_fails_is_kept_and_the_rest_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path(tmp_path, "fuzz_bad.py").write_text(BAD)
    monkeypatch.syspath_prepend(tmp_path)
    counts = explore("bad", 1, range(8), tmp_path / "kept")
    inputs = [
        make_input(driver.find_subject("bad"), ["key", "usage", "death", "memory", "fine"], 1, k)
        for k in range(8)
    ]
    assert counts.pop("died with 3") == inputs.count("death") > 0
    assert counts.pop("memory") >= inputs.count("memory") > 0
    (kind,) = counts
    assert kind.startswith("KeyError")
    assert counts[kind] == inputs.count("key") > 0
    kept = [p for p in Path(tmp_path, "kept").iterdir() if not p.suffix]
    assert {p.read_text() for p in kept} == {"key", "death", "memory"}


def test_the_command_runs_from_the_root() -> None:
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", "grammars", "-n", "2"],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert "grammars: 2 inputs, 0 failures" in done.stdout
