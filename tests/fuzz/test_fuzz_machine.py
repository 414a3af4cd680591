"""Some spoilt files of machine code, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_machine import SUBJECT


def test_spoilt_files_of_machine_code(tmp_path: Path) -> None:
    withstand(SUBJECT, 1000, tmp_path)
