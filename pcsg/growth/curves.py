"""User functions on [0, 1]: control points joined by a curve.

Monotone cubic interpolation (PCHIP: Fritsch and Carlson 1980, with the slopes of Fritsch and
Butland 1984) by default, since it does not overshoot; clamped cubic B-splines and straight lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Kind = Literal["pchip", "bspline", "linear"]
KINDS: tuple[Kind, ...] = ("pchip", "bspline", "linear")


@dataclass(frozen=True)
class Curve:
    """A function on [0, 1], whose argument is clamped.

    Attributes
    ----------
    points
        Control points (x, y), x strictly increasing from 0 to 1.
    kind
        ``pchip`` and ``linear`` pass through the points; of ``bspline`` they are the control
        polygon, at equal steps of its parameter.
    """

    points: tuple[tuple[float, float], ...]
    kind: Kind = "pchip"

    @classmethod
    def make(cls, points: Sequence[Sequence[float]], kind: Kind = "pchip") -> Curve:
        """Return a curve through points given as pairs."""
        return cls(tuple((float(x), float(y)) for x, y in points), kind)

    @cached_property
    def _x(self) -> Floats:
        return np.array([x for x, _ in self.points])

    @cached_property
    def _y(self) -> Floats:
        return np.array([y for _, y in self.points])

    @cached_property
    def _slopes(self) -> Floats:
        return pchip_slopes(self._x, self._y)

    @cached_property
    def _polyline(self) -> tuple[Floats, Floats]:
        return bspline_polyline(self._x, self._y)

    def __call__(self, at: ArrayLike) -> Any:
        """Return the values at arguments of any shape."""
        x = np.clip(np.asarray(at, np.float64), 0.0, 1.0)
        if self.kind == "linear":
            return np.interp(x, self._x, self._y)
        if self.kind == "bspline":
            return np.interp(x, *self._polyline)
        return hermite(x, self._x, self._y, self._slopes)


def pchip_slopes(x: Floats, y: Floats) -> Floats:
    """Return the slopes of the monotone cubic interpolant at its points (n,)."""
    h = np.diff(x)
    e = np.diff(y) / h
    if len(x) == 2:
        return np.repeat(e, 2)
    w1, w2 = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    same = e[:-1] * e[1:] > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        inner = np.where(same, (w1 + w2) / (w1 / e[:-1] + w2 / e[1:]), 0.0)
    first = _end_slope(h[0], h[1], e[0], e[1])
    last = _end_slope(h[-1], h[-2], e[-1], e[-2])
    return np.concatenate([[first], inner, [last]])


def _end_slope(h0: float, h1: float, e0: float, e1: float) -> float:
    """Return the slope at an end from the two intervals there, nearest first."""
    g = ((2.0 * h0 + h1) * e0 - h0 * e1) / (h0 + h1)
    if np.sign(g) != np.sign(e0):
        return 0.0
    if np.sign(e0) != np.sign(e1) and abs(g) > abs(3.0 * e0):
        return 3.0 * e0
    return float(g)


def hermite(at: Floats, x: Floats, y: Floats, slopes: Floats) -> Floats:
    """Return a piecewise cubic given by values and slopes."""
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    h = x[k + 1] - x[k]
    z = (at - x[k]) / h
    e = (y[k + 1] - y[k]) / h
    a, b = slopes[k], slopes[k + 1]
    c2 = 3.0 * e - 2.0 * a - b
    c3 = a + b - 2.0 * e
    return np.asarray(y[k] + h * z * (a + z * (c2 + z * c3)))


def bspline_polyline(x: Floats, y: Floats, n: int = 2049) -> tuple[Floats, Floats]:
    """Return points on the clamped cubic B-spline of a control polygon, by de Boor's algorithm.

    Where x of the polygon increases, x of the curve does, so that it is a function.
    """
    degree = min(3, len(x) - 1)
    inner = np.linspace(0.0, 1.0, len(x) - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.ones(degree)])
    u = np.linspace(0.0, 1.0, n)
    span = np.clip(np.searchsorted(knots, u, side="right") - 1, degree, len(x) - 1)
    points = np.stack([x, y], axis=1)
    d = points[span[:, None] - degree + np.arange(degree + 1)]
    for r in range(1, degree + 1):
        for j in range(degree, r - 1, -1):
            low, high = knots[span - degree + j], knots[span + 1 + j - r]
            a = ((u - low) / (high - low))[:, None]
            d[:, j] = (1.0 - a) * d[:, j - 1] + a * d[:, j]
    return d[:, degree, 0], d[:, degree, 1]


def smooth_step(z: ArrayLike) -> Any:
    """Return the step of fifth order S5 from 0 to 1: slopes and curvatures are 0 at its ends."""
    z = np.clip(np.asarray(z, np.float64), 0.0, 1.0)
    return z**3 * (10.0 - z * (15.0 - 6.0 * z))
