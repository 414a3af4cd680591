"""Some spoilt skeletons, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_skeletons import SUBJECT


def test_spoilt_skeletons(tmp_path: Path) -> None:
    withstand(SUBJECT, 60, tmp_path)
