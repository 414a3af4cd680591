"""Curves of a species, and a small tree, as one picture: what an editor of curves looks at."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pcsg.growth.curves import Curve
from pcsg.growth.model import GrowthModel
from pcsg.growth.species import CURVES
from pcsg.growth.state import State

_CELL = (232, 168)
_ACROSS = 4
_INK, _PALE, _LINE, _POINT = (40, 44, 48), (206, 208, 204), (28, 104, 72), (196, 92, 40)
_PAPER = (250, 249, 245)
_SCALE = 2
"""Pictures are drawn larger, and smoothed."""

MEANINGS = {
    "G_h": "trunk length by time",
    "G_s1": "silhouette, young",
    "G_s2": "silhouette, mature",
    "G_o1": "heading, length 0",
    "G_o2": "heading, greatest length",
    "G_bs": "scale along the bearer",
    "G_ss": "scale along the shoot",
    "G_a": "age when lost, by scale",
    "G_m": "metamers by length",
    "G_l": "leaf size along the shoot",
}


def plot_species(model: GrowthModel, t: float | None = None) -> Image.Image:
    """Return a picture of all curves of a species, beside its tree at a time, if one is given."""
    curves = model.species.curves
    names = [*CURVES, *(name for name in curves if name not in CURVES)]
    rows = math.ceil(len(names) / _ACROSS)
    width, height = _ACROSS * _CELL[0], rows * _CELL[1] + 34
    tree = 0 if t is None else int(0.8 * height)
    size = ((width + tree) * _SCALE, height * _SCALE)
    picture = Image.new("RGB", size, _PAPER)
    draw = ImageDraw.Draw(picture)
    title = ImageFont.load_default(16 * _SCALE)
    draw.text((14 * _SCALE, 9 * _SCALE), model.species.species, _INK, title)
    for k, name in enumerate(names):
        x, y = k % _ACROSS * _CELL[0], k // _ACROSS * _CELL[1] + 30
        _draw_curve(draw, name, curves[name], x, y)
    if t is not None:
        _draw_tree(draw, model.at(t), width, 0, tree, height)
    return picture.resize((width + tree, height), Image.Resampling.LANCZOS)


def _draw_curve(draw: ImageDraw.ImageDraw, name: str, curve: Curve, x: int, y: int) -> None:
    font, small = ImageFont.load_default(12 * _SCALE), ImageFont.load_default(9 * _SCALE)
    left, top, right, bottom = x + 40, y + 34, x + _CELL[0] - 14, y + _CELL[1] - 22
    grid = np.linspace(0.0, 1.0, 129)
    values = np.asarray(curve(grid))
    low = min(0.0, float(values.min()), min(v for _, v in curve.points))
    high = max(float(values.max()), max(v for _, v in curve.points), low + 1e-9)

    def place(u: float, v: float) -> tuple[float, float]:
        return (
            (left + u * (right - left)) * _SCALE,
            (bottom - (v - low) / (high - low) * (bottom - top)) * _SCALE,
        )

    for part in (0.0, 0.5, 1.0):
        draw.line([place(part, low), place(part, high)], _PALE, _SCALE)
        value = low + part * (high - low)
        draw.line([place(0.0, value), place(1.0, value)], _PALE, _SCALE)
        draw.text(
            (place(0.0, value)[0] - 4 * _SCALE, place(0.0, value)[1]),
            f"{value:.3g}",
            _INK,
            small,
            "rm",
        )
    draw.text((left * _SCALE, (y + 7) * _SCALE), name, _INK, font)
    about = MEANINGS.get(name, "growth within a year")
    draw.text(((left + 38) * _SCALE, (y + 9) * _SCALE), about, _INK, small)
    draw.line([place(u, v) for u, v in zip(grid, values, strict=True)], _LINE, 2 * _SCALE, "curve")
    for u, v in curve.points:
        a, b = place(u, v)
        r = 3 * _SCALE
        draw.ellipse((a - r, b - r, a + r, b + r), _POINT)


def _draw_tree(
    draw: ImageDraw.ImageDraw, state: State, x: int, y: int, width: int, height: int
) -> None:
    """Draw limbs as lines, seen from far away, thin ones first; leaves as dots."""
    n = state.nodes
    high = max(state.height, 1e-6)
    wide = 2.0 * float(np.abs(n.position[:, :2]).max(initial=1e-6))
    scale = min((height - 50) / high, (width - 30) / wide)
    middle, floor = x + width / 2, y + height - 22

    def place(points: np.ndarray) -> np.ndarray:
        across = 0.866 * points[:, 0] + 0.5 * points[:, 1]
        return np.stack([middle + across * scale, floor - points[:, 2] * scale], axis=1) * _SCALE

    ends = place(n.position)
    inner = np.ones(len(n.branch), np.bool_)
    inner[state.branches.first] = False
    upper = np.flatnonzero(inner)
    for k in upper[np.argsort(n.radius[upper], kind="stable")].tolist():
        thick = max(1, round(2.0 * n.radius[k] * scale * _SCALE))
        draw.line([tuple(ends[k - 1]), tuple(ends[k])], (92, 80, 64), thick)
    for a, b in _dots(state, place):
        draw.ellipse((a - 1, b - 1, a + 1, b + 1), (88, 130, 60))
    draw.line(
        [((x + 12) * _SCALE, floor * _SCALE), ((x + width - 12) * _SCALE, floor * _SCALE)],
        _INK,
        _SCALE,
    )
    font = ImageFont.load_default(11 * _SCALE)
    text = f"t = {state.time:g} years, {state.height:.1f} m"
    draw.text((middle * _SCALE, (floor + 11) * _SCALE), text, _INK, font, "mm")


def _dots(state: State, place: object) -> Iterator[tuple[float, float]]:
    assert callable(place)
    for a, b in place(
        state.leaves.position + 0.5 * state.leaves.size[:, None] * state.leaves.outward
    ):
        yield float(a), float(b)
