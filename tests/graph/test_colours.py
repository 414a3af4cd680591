"""Colours that are written from 0 to 255 are told, and no others."""

from __future__ import annotations

import pytest

import pcsg
from pcsg.grammar import check_text


def warnings_of(text: str) -> list[str]:
    _, diagnostics = check_text(text)
    return [d.message for d in diagnostics if d.code == "colour-range"]


@pytest.mark.parametrize(
    "text",
    [
        "color(255, 0, 0) sphere",
        "color(0, 0, 10) sphere",
        "material(m) box\nmaterial m { color = (200, 180, 160) }",
        "material(m) box\nmaterial m { texture = t }\ntexture t { color2 = (30, 30, 30) }",
    ],
)
def test_colours_from_0_to_255_are_told(text: str) -> None:
    (message,) = warnings_of(text)
    assert "go from 0 to 1" in message


@pytest.mark.parametrize(
    "text",
    [
        "color(1, 1, 1) sphere",
        "color(2, 2, 2) sphere",  # brighter than light allows, but no mistake of units
        "color(20.5, 0, 0) sphere",
        "color(300, 0, 0) sphere",
        "{c = 20} color(c, c, c) sphere",  # who computes knows
        "material(m) box\nmaterial m { emission = (255, 200, 100) }",
        "sphere\nsun { color = (255, 200, 100) }\nsky { zenith = (20, 30, 90) }",
    ],
)
def test_other_colours_are_not(text: str) -> None:
    assert not warnings_of(text)


def test_each_colour_is_told_once() -> None:
    text = " | ".join(["color(255, 0, 0) sphere"] * 30)
    (message,) = warnings_of(text)
    assert message.endswith("(at 30 places)")


def test_graphs_of_python_are_told_too() -> None:
    (warning,) = pcsg.Scene(pcsg.color(255, 128, 0) * pcsg.sphere).warnings
    assert warning.hint is not None and "(1, 0.216, 0)" in warning.hint
