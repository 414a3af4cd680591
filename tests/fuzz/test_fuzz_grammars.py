"""Some spoilt grammars, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_grammars import SUBJECT


def test_spoilt_grammars(tmp_path: Path) -> None:
    withstand(SUBJECT, 100, tmp_path)
