"""Some spoilt pictures, checkpoints and tiles, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

import pytest
from driver import find_subject, withstand


@pytest.mark.parametrize("name", ["hdr", "exr", "png", "checkpoints", "tiles"])
def test_spoilt_files(tmp_path: Path, name: str) -> None:
    if name == "exr":
        pytest.importorskip("OpenEXR", reason="the extra exr is not installed")
    withstand(find_subject(name), 100, tmp_path)
