"""Some grammars that assemble modules, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_engines import SUBJECT


def test_engines_agree_on_assemblies(tmp_path: Path) -> None:
    withstand(SUBJECT, 60, tmp_path)
