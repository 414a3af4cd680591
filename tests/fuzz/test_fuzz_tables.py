"""Some spoilt tables, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_tables import SUBJECT


def test_spoilt_tables(tmp_path: Path) -> None:
    withstand(SUBJECT, 100, tmp_path)
