"""Some calls with nonsense, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_arguments import SUBJECT


def test_calls_with_nonsense(tmp_path: Path) -> None:
    withstand(SUBJECT, 400, tmp_path)
