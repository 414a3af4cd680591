"""Fog: air that takes light away on its way to the eye, and sends its own colour instead.

Its density is the same up to a height, and falls exponentially above it, so that the part of light
that comes through has a closed form along any ray.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pcsg.render.sky import Sky
from pcsg.render.tracer import Floats


@dataclass(frozen=True)
class Fog:
    """Fog over a plane.

    Attributes
    ----------
    color
        Radiance of fog that nothing is seen through.
    density
        Part of the light that is lost, per length, where it is small; up to the height z.
    z
        Where it begins to thin.
    height
        Over which it thins to 1/e; infinite for everywhere the same.
    """

    color: tuple[float, float, float]
    density: float
    z: float
    height: float

    def clearness(self, origins: Floats, directions: Floats, t: Floats) -> Floats:
        """Return the part of light (N,) that comes through from distances t along unit rays."""
        with np.errstate(over="ignore", invalid="ignore"):
            if math.isinf(self.height):
                return np.asarray(np.exp(-self.density * t))
            rise, start = directions[:, 2], origins[:, 2] - self.z
            below = _length_below(start, rise, t)
            # Where the part above begins; it ends at t or where the ray goes below.
            first = np.maximum(start, 0.0)
            length = t - below
            x = rise * length / self.height
            # (1 - exp(-x)) / x, where x = 0 and where it is infinite.
            mean = np.where(np.abs(x) > 1e-8, -np.expm1(-x) / np.where(x == 0.0, 1.0, x), 1.0)
            above = np.exp(-first / self.height) * length * mean
            endless = np.isinf(length) & (rise > 0.0)
            slope = np.where(endless, rise, 1.0)
            above = np.where(endless, np.exp(-first / self.height) * self.height / slope, above)
            above = np.where(length > 0.0, above, 0.0)
            return np.asarray(np.exp(-self.density * (below + above)))


def _length_below(start: Floats, rise: Floats, t: Floats) -> Floats:
    """Return the lengths (N,) of rays below the height 0, of those that begin at heights."""
    crossing = -start / np.where(rise == 0.0, 1.0, rise)
    crossing = np.where(rise == 0.0, np.inf, np.maximum(crossing, 0.0))
    into = (start > 0.0) & (rise < 0.0)
    out = np.where(into, t - np.minimum(crossing, t), np.minimum(crossing, t))
    out = np.where(np.isinf(t) & into, np.inf, out)
    never = (start > 0.0) & (rise >= 0.0)
    always = (start <= 0.0) & (rise <= 0.0)
    return np.where(never, 0.0, np.where(always, t, out))


def make_fog(values: Mapping[str, Any], sky: Sky, ground: float | None) -> Fog | None:
    """Return the fog of a setting; None if there is none.

    Parameters
    ----------
    sky
        Gives the fog its colour, if the setting does not.
    ground
        Height of the ground; None if there is none.
    """
    if not values["density"] > 0.0:
        return None
    color = values["color"]
    if color is None:
        turn = np.arange(64) * (2.0 * math.pi / 64)
        level = np.stack([np.cos(turn), np.sin(turn), np.zeros(64)], axis=1)
        color = sky.backdrop(level).mean(axis=0).tolist()
    z, height = values["z"], values["height"]
    if z is None:
        z = ground or 0.0
    red, green, blue = (float(c) for c in color)
    return Fog((red, green, blue), values["density"], float(z), height or math.inf)
