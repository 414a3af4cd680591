"""Some spoilt grammars, formatted, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_fmt import SUBJECT


def test_formatting_spoilt_grammars(tmp_path: Path) -> None:
    withstand(SUBJECT, 300, tmp_path)
