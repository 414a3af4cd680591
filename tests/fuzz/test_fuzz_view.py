"""Some spoilt messages of a page, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_view import SUBJECT


def test_spoilt_messages(tmp_path: Path) -> None:
    withstand(SUBJECT, 400, tmp_path)
