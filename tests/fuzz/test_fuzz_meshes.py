"""Some spoilt mesh files, always the same ones; ``make fuzz`` tries others."""

from __future__ import annotations

from pathlib import Path

import fuzz_glb
import fuzz_obj
import fuzz_ply
import fuzz_stl
import pytest
from driver import withstand

SUBJECTS = {
    module.SUBJECT.name: module.SUBJECT for module in (fuzz_obj, fuzz_ply, fuzz_stl, fuzz_glb)
}


@pytest.mark.parametrize("name", SUBJECTS)
def test_spoilt_meshes(name: str, tmp_path: Path) -> None:
    withstand(SUBJECTS[name], 150, tmp_path)
