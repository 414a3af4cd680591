"""The examples of docs/science.md run."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = (Path(__file__).parents[1] / "docs" / "science.md").read_text(encoding="utf-8")


def test_the_examples_run() -> None:
    known: dict[str, object] = {}
    for code in re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL):
        exec(code, known)
    assert known["rows"]
