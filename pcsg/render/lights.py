"""Light: the sun, the sky all around, and points.

Radiance is linear; a surface of albedo a that faces an irradiance E sends out a E / pi.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from pcsg.errors import UsageError
from pcsg.render.sampler import disc_cone, sphere
from pcsg.render.tracer import Floats


class LightSample(NamedTuple):
    """Where light comes from, for N points.

    Attributes
    ----------
    direction
        (N, 3) unit vectors towards the light.
    distance
        (N,) how far it is; inf for the sun.
    irradiance
        (N, 3) on a surface that faces it, if nothing is in the way.
    """

    direction: Floats
    distance: Floats
    irradiance: Floats


class Light(Protocol):
    """A source that a shadow ray can reach."""

    def sample(self, position: Floats, pairs: Floats) -> LightSample:
        """Choose a point of the light for each of (N, 3) positions by (N, 2) numbers."""
        ...


@dataclass(frozen=True)
class Sun:
    """A disc at infinity.

    Attributes
    ----------
    direction
        Unit vector towards it.
    irradiance
        On a surface that faces it.
    angle
        Full diameter in degrees.
    """

    direction: tuple[float, float, float]
    irradiance: tuple[float, float, float]
    angle: float

    def sample(self, position: Floats, pairs: Floats) -> LightSample:
        """See `Light`."""
        axis = np.array(self.direction)
        directions = disc_cone(pairs, axis, math.cos(math.radians(self.angle / 2)))
        n = len(position)
        return LightSample(
            directions, np.full(n, np.inf), np.broadcast_to(np.array(self.irradiance), (n, 3))
        )


@dataclass(frozen=True)
class PointLight:
    """A small ball that shines equally to all sides.

    Attributes
    ----------
    intensity
        Irradiance at distance 1.
    radius
        Of the ball; 0 gives sharp shadows.
    """

    position: tuple[float, float, float]
    intensity: tuple[float, float, float]
    radius: float

    def sample(self, position: Floats, pairs: Floats) -> LightSample:
        """See `Light`."""
        target = np.array(self.position) + self.radius * sphere(pairs)
        towards = target - position
        squared = np.maximum(np.einsum("ij,ij->i", towards, towards), 1e-300)
        distance = np.sqrt(squared)
        irradiance = np.array(self.intensity) / squared[:, None]
        return LightSample(towards / distance[:, None], distance, irradiance)


@dataclass(frozen=True)
class Sky:
    """Light from all around, a function of elevation.

    Attributes
    ----------
    zenith, horizon, nadir
        Radiance overhead, at the horizon, and from straight below.
    """

    zenith: tuple[float, float, float]
    horizon: tuple[float, float, float]
    nadir: tuple[float, float, float]

    def radiance(self, directions: Floats) -> Floats:
        """Return (N, 3) radiance that comes from (N, 3) unit directions."""
        return self._gradient(directions, self.nadir)

    def backdrop(self, directions: Floats) -> Floats:
        """Return (N, 3) radiance shown behind everything: brighter, and pale below the horizon.

        The automatic camera looks down, so most of a picture's background lies below the horizon;
        what is right as light from there would be a dull picture.
        """
        shown = self._gradient(directions, _tinted(self.horizon, BACKDROP_NADIR))
        return np.asarray(BACKDROP * shown)

    def _gradient(self, directions: Floats, nadir: tuple[float, float, float]) -> Floats:
        z = np.clip(directions[:, 2], -1.0, 1.0)
        above = 1.0 - (1.0 - np.maximum(z, 0.0)) ** 3
        below = 1.0 - (1.0 - np.maximum(-z, 0.0)) ** 2
        horizon = np.array(self.horizon)
        sky = above[:, None] * (np.array(self.zenith) - horizon)
        ground = below[:, None] * (np.array(nadir) - horizon)
        return np.asarray(horizon + sky + ground)

    def ambient(self, normals: Floats) -> Floats:
        """Return (N, 3) irradiance / pi from the whole hemisphere about (N, 3) unit normals."""
        at, table = self._ambient_table
        return np.stack([np.interp(normals[:, 2], at, table[:, k]) for k in range(3)], axis=1)

    @cached_property
    def _ambient_table(self) -> tuple[Floats, Floats]:
        """Irradiance by the normal's z, by a quadrature over the hemisphere."""
        at = np.linspace(-1.0, 1.0, 65)
        cos = np.sqrt((np.arange(32) + 0.5) / 32)
        turn = 2 * np.pi * (np.arange(32) + 0.5) / 32
        # About a normal with height z, a direction (cos, turn) has this height:
        rise = np.sqrt(1 - cos[:, None] ** 2) * np.cos(turn)
        z = at[:, None, None] * cos[:, None] + np.sqrt(1 - at * at)[:, None, None] * rise
        directions = np.zeros((z.size, 3))
        directions[:, 2] = z.ravel()
        return at, self.radiance(directions).reshape(len(at), -1, 3).mean(axis=1)


NADIR = (0.34, 0.33, 0.31)
"""Colour of what lies below the horizon, as part of the horizon's light."""

BACKDROP = 1.5
"""Brightness of the sky as a background, relative to the light it gives."""

BACKDROP_NADIR = (0.74, 0.68, 0.62)
"""Like `NADIR`, for the background."""


def make_sun(values: Mapping[str, Any]) -> Sun | None:
    """Return the sun of a setting; None if it gives no light."""
    if not values["strength"] > 0:
        return None
    direction = np.asarray(values["direction"], float)
    if not np.abs(direction).max() > 0:
        raise UsageError("the sun's direction is the zero vector")
    direction = direction / np.linalg.norm(direction)
    return Sun(
        (float(direction[0]), float(direction[1]), float(direction[2])),
        _scaled(values["color"], values["strength"]),
        float(values["angle"]),
    )


def make_points(several: Sequence[Mapping[str, Any]]) -> list[PointLight]:
    """Return the lights of settings ``light {}`` that shine."""
    return [
        PointLight(
            _scaled(values["position"], 1.0),
            _scaled(values["color"], values["strength"]),
            float(values["radius"]),
        )
        for values in several
        if values["strength"] > 0
    ]


def make_sky(values: Mapping[str, Any]) -> Sky:
    """Return the sky of a setting.

    Raises
    ------
    UsageError
        The kind of sky is none that this version can make.
    """
    if values["kind"] == "none":
        return Sky((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    if values["kind"] != "gradient":
        raise UsageError(
            f"a sky of kind `{values['kind']}` cannot be rendered yet; use `gradient` or `none`"
        )
    strength = float(values["strength"])
    horizon = _scaled(values["horizon"], strength)
    return Sky(_scaled(values["zenith"], strength), horizon, _tinted(horizon, NADIR))


def _tinted(
    color: tuple[float, float, float], by: tuple[float, float, float]
) -> tuple[float, float, float]:
    return color[0] * by[0], color[1] * by[1], color[2] * by[2]


def _scaled(color: Any, strength: float) -> tuple[float, float, float]:
    return float(color[0] * strength), float(color[1] * strength), float(color[2] * strength)
