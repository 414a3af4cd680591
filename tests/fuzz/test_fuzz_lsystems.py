"""Some spoilt L-systems, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_lsystems import SUBJECT


def test_spoilt_lsystems(tmp_path: Path) -> None:
    withstand(SUBJECT, 120, tmp_path)
