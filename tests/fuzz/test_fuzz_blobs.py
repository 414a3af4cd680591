"""Some spoilt blobs, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

from driver import withstand
from fuzz_blobs import SUBJECT


def test_spoilt_blobs(tmp_path: Path) -> None:
    withstand(SUBJECT, 80, tmp_path)
