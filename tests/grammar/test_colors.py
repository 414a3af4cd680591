"""Colours as people write them."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pcsg
from pcsg.commands.options import parse_setting
from pcsg.errors import GrammarError, UsageError


def shade(text: str) -> list[float]:
    """Return the colour of a sphere behind an attribute."""
    hits = pcsg.loads(f"{text} sphere").intersect([[0, 0, 5]], [[0, 0, -1]])
    return [float(x) for x in hits.color[0]]


def linear(shown: float) -> float:
    return shown / 12.92 if shown <= 0.04045 else ((shown + 0.055) / 1.055) ** 2.4


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("#7a9b3c", (0x7A, 0x9B, 0x3C)),
        ("#fff", (255, 255, 255)),
        ("#0A0", (0, 0xAA, 0)),
        ("olive", (128, 128, 0)),
        ("SkyBlue", (135, 206, 235)),
    ],
)
def test_names_and_digits_are_colours_of_a_screen(text: str, shown: tuple[int, ...]) -> None:
    assert shade(f'color("{text}")') == pytest.approx([linear(x / 255) for x in shown])


@given(st.floats(-400, 800), st.floats(0, 1), st.floats(0, 1))
def test_hsv_is_that_of_others(h: float, s: float, v: float) -> None:
    expected = [linear(x) for x in colorsys.hsv_to_rgb((h / 360.0) % 1.0, s, v)]
    assert shade(f"color(hsv({h!r}, {s!r}, {v!r}))") == pytest.approx(expected, abs=1e-9)


def test_hsv_follows_parameters() -> None:
    text = "for(k, 0, 5) move(3*k,0,0) color(hsv(60*k, 1, 1)) sphere"
    hits = pcsg.loads(text).intersect([[3 * k, 0, 5] for k in range(6)], [[0, 0, -1]] * 6)
    ramp = [[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1]]
    np.testing.assert_allclose(hits.color, ramp, atol=1e-12)


def test_settings_take_them_in_files_and_on_the_command_line() -> None:
    scene = pcsg.loads('sphere\nsky { zenith = "#7a9b3c"; horizon = hsv(120, 1, 0.5) }')
    (sky,) = scene.setting_values("sky")
    given = parse_setting("sky", 'zenith=#7a9b3c horizon="olive"')
    assert sky["zenith"] == pytest.approx(given["zenith"])
    assert sky["horizon"] == pytest.approx([0, linear(0.5), 0])
    assert given["horizon"] == pytest.approx([linear(128 / 255), linear(128 / 255), 0])
    with pytest.raises(UsageError, match="a colour"):
        parse_setting("sky", "zenith=#12")


MISTAKES = {
    'color("olvie") sphere': "did you mean `olive`?",
    'color("#12") sphere': "`#12` is not a colour",
    "color(hsv(1,2)) sphere": "`hsv` takes 3 arguments, not 2",
    'label("a") sphere': "`label` takes no text",
    'sphere\nsky { zenith = "blu" }': "did you mean `blue`?",
    'sphere\nsky { zenith = hsv(1) }': "`hsv` takes 3 arguments, not 1",
    'sphere\ncamera { eye = "blue" }': "does not fit",
}  # fmt: skip


@pytest.mark.parametrize("text", MISTAKES)
def test_what_is_no_colour_is_told(text: str) -> None:
    with pytest.raises(GrammarError) as told:
        pcsg.loads(text)
    assert MISTAKES[text] in str(told.value)


PALETTE = 'palette leaf { stops = ((0, "#203010"), (0.4, (0.2, 0.5, 0.1)), (1, "olive")) }'


def test_a_palette_blends_linear_colours_between_its_stops() -> None:
    text = f"for(k, 0, 6) move(3*k,0,0) color(palette(leaf, 0.3*k - 0.3)) sphere\n{PALETTE}"
    hits = pcsg.loads(text).intersect([[3 * k, 0, 5] for k in range(7)], [[0, 0, -1]] * 7)
    dark = [linear(x / 255) for x in (0x20, 0x30, 0x10)]
    olive = [linear(x / 255) for x in (128, 128, 0)]
    stops = np.array([dark, [0.2, 0.5, 0.1], olive])
    x = 0.3 * np.arange(7) - 0.3
    expected = np.stack([np.interp(x, [0, 0.4, 1], stops[:, k]) for k in range(3)], 1)
    np.testing.assert_allclose(hits.color, expected, atol=1e-12)


def test_a_palette_of_one_stop_is_one_colour() -> None:
    text = "color(palette(a, 7)) sphere\npalette a { stops = ((2, (0.1, 0.2, 0.3))) }"
    hits = pcsg.loads(text).intersect([[0, 0, 5]], [[0, 0, -1]])
    assert hits.color[0].tolist() == [0.1, 0.2, 0.3]


def test_palettes_are_written_back() -> None:
    scene = pcsg.loads(f"{{x = 0.5}} color(palette(leaf, x)) sphere\n{PALETTE}")
    again = pcsg.loads(scene.to_pcsg())
    assert again.to_pcsg() == scene.to_pcsg()
    rays = [[0, 0, 5]], [[0, 0, -1]]
    assert again.intersect(*rays).color.tolist() == scene.intersect(*rays).color.tolist()


WRONG_PALETTES = {
    "color(palette(leave, 1)) sphere\n" + PALETTE: "did you mean `leaf`?",
    "color(palette(leaf)) sphere\n" + PALETTE: "a palette takes its name and a number",
    "color(palette(1, 2)) sphere\n" + PALETTE: "a palette takes its name and a number",
    "color(palette(leaf, foo(1))) sphere\n" + PALETTE: "unknown function `foo`",
    "sphere\npalette a { stops = ((0, (1,1,1)), (0, (0,0,0))) }": "stops grow, but 0 does not",
    "{n = 1} sphere\npalette a { stops = ((n, (1,1,1))) }": "a stop is not a constant number",
    "sphere\npalette a { stops = (1, 2, 3) }": "does not fit",
    "sphere\npalette a { }": "a palette has stops",
    "sphere\npalette { stops = ((0, (1,1,1))) }": "the palette has no name",
    'sphere\npalette a { stops = ((0, "blu")) }': "did you mean `blue`?",
    "sphere\nsky { zenith = ((0, (1,1,1))) }": "does not fit",
    "sphere\ncamera { fov = ((0, (1,1,1))) }": "does not fit",
}


@pytest.mark.parametrize("text", WRONG_PALETTES)
def test_what_is_wrong_with_a_palette_is_told(text: str) -> None:
    with pytest.raises(GrammarError) as told:
        pcsg.loads(text)
    assert WRONG_PALETTES[text] in str(told.value)
