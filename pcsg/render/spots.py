"""Lamps that shine into a cone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.graph.evaluate import unit
from pcsg.render.lights import Ball, LightSample, Seen, scale_color
from pcsg.render.tracer import Floats


@dataclass(frozen=True)
class Spot:
    """A ball that shines into a cone. The camera does not see it.

    How much a point gets depends on its direction from the ball's centre.

    Attributes
    ----------
    ball
        What it would be if it shone to all sides.
    axis
        Unit vector along the middle of the cone.
    angle
        Full angle of the cone in degrees.
    soft
        Part of the angle over which it fades at the edge.
    """

    ball: Ball
    axis: tuple[float, float, float]
    angle: float
    soft: float

    @property
    def is_far(self) -> bool:
        """See `Light`."""
        return self.ball.is_far

    @cached_property
    def _cosines(self) -> tuple[float, float]:
        """Of where nothing is left, and of where it begins to fade."""
        half = math.radians(self.angle / 2)
        outer, inner = math.cos(half), math.cos(half * (1.0 - self.soft))
        return outer, max(inner, outer + 1e-9)

    def share(self, position: Floats) -> Floats:
        """Return (N,) how much of its light goes to positions (N, 3), from 0 to 1."""
        away = position - np.array(self.ball.position)
        length = np.sqrt(np.maximum(np.einsum("ij,ij->i", away, away), 1e-300))
        outer, inner = self._cosines
        s = np.clip((away @ np.array(self.axis) / length - outer) / (inner - outer), 0.0, 1.0)
        return np.asarray(s * s * (3.0 - 2.0 * s))

    def sample(self, position: Floats, pairs: Floats) -> LightSample:
        """See `Light`."""
        found = self.ball.sample(position, pairs)
        return found._replace(irradiance=found.irradiance * self.share(position)[:, None])

    def seen(self, origins: Floats, directions: Floats) -> Seen:
        """See `Light`."""
        found = self.ball.seen(origins, directions)
        return found._replace(radiance=found.radiance * self.share(origins)[:, None])

    def estimate(self, position: Floats) -> Floats:
        """See `Light`."""
        return self.ball.estimate(position) * self.share(position)


def make_spots(several: Sequence[Mapping[str, Any]]) -> list[Spot]:
    """Return the lamps of settings ``spot {}`` that shine.

    Raises
    ------
    UsageError
        One shines nowhere.
    """
    found = []
    for values in several:
        position, target = scale_color(values["position"], 1.0), values["target"]
        if position == tuple(target):
            raise UsageError("a spot's position and target are the same point")
        if values["strength"] > 0:
            color = scale_color(values["color"], values["strength"])
            ball = Ball(position, color, float(values["radius"]))
            x, y, z = (float(b - a) for a, b in zip(position, target, strict=True))
            spot = Spot(ball, unit((x, y, z)), float(values["angle"]), float(values["soft"]))
            found.append(spot)
    return found
