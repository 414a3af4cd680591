"""Some spoilt growing trees, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_species import SUBJECT


def test_spoilt_species(tmp_path: Path) -> None:
    withstand(SUBJECT, 40, tmp_path)
