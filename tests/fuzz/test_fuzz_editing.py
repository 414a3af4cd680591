"""Some grammars that are being typed, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_editing import SUBJECT


def test_asking_about_spoilt_grammars(tmp_path: Path) -> None:
    withstand(SUBJECT, 200, tmp_path)
