"""Rows of docs/validation.md, with few rays."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import validation
from pcsg.trace.measures import Measured


@pytest.mark.parametrize(
    ("section", "rays"), [("exchange", 0.02), ("triangles", 0.02), ("scans", 0.2)]
)
def test_rows_pass(section: str, rays: float) -> None:
    for row in validation.SECTIONS[section](rays):
        assert abs(row.found.value - row.expected) <= max(
            row.tolerance, 4.5 * row.found.se + 1e-9
        ), row


def test_a_row_can_fail() -> None:
    assert validation.Row("a", "b", 1.0, Measured(1.02, 0.01), 0.001).passes
    assert not validation.Row("a", "b", 1.0, Measured(1.04, 0.01), 0.001).passes


def test_no_row_of_the_page_fails() -> None:
    page = (Path(__file__).parents[2] / "docs" / "validation.md").read_text(encoding="utf-8")
    assert page.count("| yes |") > 50
    assert "**no**" not in page
