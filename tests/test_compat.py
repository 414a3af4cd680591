"""``make compat`` itself: what it asks for, and what it says of pairs that do not exist."""

from __future__ import annotations

import subprocess
from pathlib import Path

import compat
import pytest


def test_both_ends_of_numba_are_tried() -> None:
    oldest, newest = compat.numbas()
    assert oldest.startswith("numba==") and newest.startswith("numba>=") and ",<" in newest


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("ERROR: No matching distribution found for numba==0.61.0\n", "no numba==0.61.0"),
        ("RuntimeError: Cannot install on Python version 3.14.0; only versions", "no numba for"),
        ("error: the disk is full", "install FAILED"),
    ],
)
def test_a_pair_that_does_not_exist_is_told_from_a_failure(
    said: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(line: list[str], **_options: object) -> subprocess.CompletedProcess[str]:
        status = int("install" in line)
        return subprocess.CompletedProcess(line, status, "", said if status else "")

    monkeypatch.setattr(subprocess, "run", run)
    found = compat.try_pair("python3.14", "numba==0.61.0", tmp_path)
    assert any(told in text for text in found)
    assert any(text.endswith("FAILED") for text in found) == ("FAILED" in told)


def test_tests_that_are_run_exist() -> None:
    assert all((compat.ROOT / test).is_file() for test in compat.TESTS)
