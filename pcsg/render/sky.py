"""Light from all around: what every sky can do, and the sky that is a gradient.

A sky is sampled by a table over the sphere, in cells of equal solid angle: rows by height z, from
below to above, columns by the angle about z.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.render.lights import LightSample, Seen
from pcsg.render.tracer import Floats

if TYPE_CHECKING:
    from pcsg.render.pictures import Pixels


class Sky:
    """Light from all around.

    Attributes
    ----------
    rows, columns
        Of the table by which directions are drawn.
    """

    rows, columns = 64, 128
    is_far = True

    def radiance(self, directions: Floats) -> Floats:
        """Return (N, 3) radiance that comes from (N, 3) unit directions."""
        raise NotImplementedError

    def backdrop(self, directions: Floats) -> Floats:
        """Return (N, 3) radiance shown behind everything."""
        return self.radiance(directions)

    @cached_property
    def _table(self) -> tuple[Floats, Floats, float]:
        """Directions of the cells' centres, their cumulated and their mean brightness."""
        # Four points in every cell: a bright spot may hide between two.
        z = np.linspace(-1.0, 1.0, 4 * self.rows + 1)[1::2]
        turn = np.linspace(0.0, 1.0, 4 * self.columns + 1)[1::2]
        z, turn = (v.ravel() for v in np.meshgrid(z, turn, indexing="ij"))
        tone = self.radiance(_direction(z, turn)).mean(axis=1)
        cells = tone.reshape(self.rows, 2, self.columns, 2).mean(axis=(1, 3)).ravel()
        # Every cell has a chance: light may be where no point of the table lies.
        cells = cells + 1e-3 * cells.mean() + 1e-12
        return cells, np.cumsum(cells) / cells.sum(), float(cells.mean())

    def sample(self, position: Floats, pairs: Floats) -> LightSample:
        """See `Light`."""
        _, cumulated, _ = self._table
        cell = np.minimum(np.searchsorted(cumulated, pairs[:, 0], side="right"), len(cumulated) - 1)
        below = np.where(cell > 0, cumulated[cell - 1], 0.0)
        within = (pairs[:, 0] - below) / np.maximum(cumulated[cell] - below, 1e-300)
        row, column = np.divmod(cell, self.columns)
        # The first number chose the cell; what is left of it chooses the place along the row.
        turn = (column + np.clip(within, 0.0, 1.0 - 1e-12)) / self.columns
        z = 2.0 * (row + pairs[:, 1]) / self.rows - 1.0
        direction = _direction(z, turn)
        density = self.density(direction)
        n = len(position)
        irradiance = self.radiance(direction) / density[:, None]
        return LightSample(direction, np.full(n, np.inf), irradiance, density)

    def density(self, directions: Floats) -> Floats:
        """Return (N,) with which density `sample` draws unit directions."""
        cells, _, mean = self._table
        row = ((directions[:, 2] + 1.0) * 0.5 * self.rows).astype(np.int64)
        turn = np.arctan2(directions[:, 1], directions[:, 0]) / (2.0 * math.pi)
        column = ((turn - np.floor(turn)) * self.columns).astype(np.int64)
        row = np.clip(row, 0, self.rows - 1)
        column = np.clip(column, 0, self.columns - 1)
        return np.asarray(cells[row * self.columns + column] / (mean * 4.0 * math.pi))

    def seen(self, origins: Floats, directions: Floats) -> Seen:
        """See `Light`."""
        return Seen(
            np.full(len(directions), np.inf), self.radiance(directions), self.density(directions)
        )

    def estimate(self, position: Floats) -> Floats:
        """See `Light`."""
        return np.full(len(position), math.pi * self._table[2])

    def ambient(self, normals: Floats) -> Floats:
        """Return (N, 3) irradiance / pi from the whole hemisphere about (N, 3) unit normals.

        By the first three bands of spherical harmonics (Ramamoorthi and Hanrahan 2001), which are
        exact to about one in a hundred.
        """
        return np.maximum(_harmonics(normals) @ self._irradiance_bands, 0.0)

    @cached_property
    def _irradiance_bands(self) -> Floats:
        """(9, 3) coefficients of irradiance / pi."""
        z = np.linspace(-1.0, 1.0, 257)[1::2]
        turn = np.linspace(0.0, 1.0, 513)[1::2]
        z, turn = (v.ravel() for v in np.meshgrid(z, turn, indexing="ij"))
        directions = _direction(z, turn)
        bands = _harmonics(directions)
        light = bands.T @ self.radiance(directions) * (4.0 * math.pi / len(z))
        # The cosine lobe's bands over pi: 1, 2/3, 1/4.
        return np.array([1.0] + [2 / 3] * 3 + [1 / 4] * 5)[:, None] * light


def _direction(z: Floats, turn: Floats) -> Floats:
    radius = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    angle = 2.0 * math.pi * turn
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def _harmonics(d: Floats) -> Floats:
    """Return the (N, 9) real spherical harmonics of degree 0 to 2."""
    x, y, z = d[:, 0], d[:, 1], d[:, 2]
    return np.stack(
        [
            np.full(len(d), 0.28209479177387814),
            0.4886025119029199 * y,
            0.4886025119029199 * z,
            0.4886025119029199 * x,
            1.0925484305920792 * x * y,
            1.0925484305920792 * y * z,
            0.31539156525252005 * (3.0 * z * z - 1.0),
            1.0925484305920792 * x * z,
            0.5462742152960396 * (x * x - y * y),
        ],
        axis=1,
    )


@dataclass(frozen=True)
class GradientSky(Sky):
    """A function of elevation.

    Attributes
    ----------
    zenith, horizon, nadir
        Radiance overhead, at the horizon, and from straight below.
    """

    rows, columns = 64, 1

    zenith: tuple[float, float, float]
    horizon: tuple[float, float, float]
    nadir: tuple[float, float, float]

    def radiance(self, directions: Floats) -> Floats:
        """See `Sky`."""
        return self._gradient(directions, self.nadir)

    def backdrop(self, directions: Floats) -> Floats:
        """Return what is shown behind everything: brighter, and pale below the horizon.

        The automatic camera looks down, so most of a picture's background lies below the horizon;
        what is right as light from there would be a dull picture.
        """
        shown = self._gradient(directions, _tinted(self.horizon, BACKDROP_NADIR))
        return np.asarray(BACKDROP * shown)

    def _gradient(self, directions: Floats, nadir: tuple[float, float, float]) -> Floats:
        z = np.clip(directions[:, 2], -1.0, 1.0)
        down, up = 1.0 - np.maximum(z, 0.0), 1.0 - np.maximum(-z, 0.0)
        above, below = 1.0 - down * down * down, 1.0 - up * up
        light = np.empty((len(z), 3))
        for k, horizon in enumerate(self.horizon):
            sky, ground = self.zenith[k] - horizon, nadir[k] - horizon
            light[:, k] = horizon + above * sky + below * ground
        return light

    def ambient(self, normals: Floats) -> Floats:
        """See `Sky`; exact, since it depends on the normal's height only."""
        table = self._ambient_table
        place = np.clip((normals[:, 2] + 1.0) * (0.5 * (len(table) - 1)), 0.0, len(table) - 1)
        row = np.minimum(place.astype(np.int64), len(table) - 2)
        return np.asarray(table[row] + (place - row)[:, None] * (table[row + 1] - table[row]))

    @cached_property
    def _ambient_table(self) -> Floats:
        """Irradiance by the normal's z from -1 to 1, by a quadrature over the hemisphere."""
        at = np.linspace(-1.0, 1.0, 65)
        cos = np.sqrt((np.arange(32) + 0.5) / 32)
        turn = 2 * np.pi * (np.arange(32) + 0.5) / 32
        # About a normal with height z, a direction (cos, turn) has this height:
        rise = np.sqrt(1 - cos[:, None] ** 2) * np.cos(turn)
        z = at[:, None, None] * cos[:, None] + np.sqrt(1 - at * at)[:, None, None] * rise
        directions = np.zeros((z.size, 3))
        directions[:, 2] = z.ravel()
        return np.asarray(self.radiance(directions).reshape(len(at), -1, 3).mean(axis=1))


NADIR = (0.34, 0.33, 0.31)
"""Colour of what lies below the horizon, as part of the horizon's light."""

BACKDROP = 1.5
"""Brightness of a gradient as a background, relative to the light it gives."""

BACKDROP_NADIR = (0.74, 0.68, 0.62)
"""Like `NADIR`, for the background."""


@dataclass(frozen=True)
class ImageSky(Sky):
    """A picture of everything around: columns from left to right turn against the clock, as seen
    from above, rows go from straight above to straight below.

    Attributes
    ----------
    pixels
        (H, W, 3) radiance.
    turn
        Degrees by which the picture is turned about z.
    """

    rows, columns = 256, 512

    pixels: Pixels
    turn: float

    def radiance(self, directions: Floats) -> Floats:
        """See `Sky`; between pixels, the mean of four."""
        height, width = self.pixels.shape[:2]
        angle = np.arctan2(directions[:, 1], directions[:, 0]) - math.radians(self.turn)
        # Seen from inside, what stands to the left has the larger angle.
        x = (0.5 - angle / (2.0 * math.pi)) * width - 0.5
        y = np.arccos(np.clip(directions[:, 2], -1.0, 1.0)) / math.pi * height - 0.5
        left, top = np.floor(x), np.floor(y)
        s, t = (x - left)[:, None], (y - top)[:, None]
        columns = [(left.astype(np.int64) + k) % width for k in (0, 1)]
        rows = [np.clip(top.astype(np.int64) + k, 0, height - 1) for k in (0, 1)]
        upper = (1 - s) * self.pixels[rows[0], columns[0]] + s * self.pixels[rows[0], columns[1]]
        lower = (1 - s) * self.pixels[rows[1], columns[0]] + s * self.pixels[rows[1], columns[1]]
        return np.asarray((1 - t) * upper + t * lower)


def make_sky(values: Mapping[str, Any], sun: tuple[float, float, float]) -> Sky | None:
    """Return the sky of a setting; None if it gives no light.

    Parameters
    ----------
    sun
        Unit vector towards the sun.

    Raises
    ------
    UsageError
        A sky of kind image has no picture that can be read.
    """
    strength = float(values["strength"])
    if values["kind"] == "none" or not strength > 0:
        return None
    if values["kind"] == "physical":
        from pcsg.render.daylight import PhysicalSky

        return PhysicalSky(sun, float(values["turbidity"]), strength)
    if values["kind"] == "image":
        from pcsg.render.pictures import read_linear

        if values["file"] is None:
            raise UsageError("a sky of kind `image` needs a `file`")
        pixels = read_linear(Path(values["file"]))
        if not float(pixels.max()) * strength <= BRIGHTEST:
            raise UsageError(f"a sky of strength {strength:g} is brighter than any")
        return ImageSky(pixels * np.float32(strength), float(values["turn"]))
    horizon = _scaled(values["horizon"], strength)
    return GradientSky(_scaled(values["zenith"], strength), horizon, _tinted(horizon, NADIR))


BRIGHTEST = 1e24
"""Of the pixels of a sky. Light that is summed up must stay a number."""

DARK = GradientSky((0.0,) * 3, (0.0,) * 3, (0.0,) * 3)
"""The sky of a scene without one."""


def _tinted(
    color: tuple[float, float, float], by: tuple[float, float, float]
) -> tuple[float, float, float]:
    return color[0] * by[0], color[1] * by[1], color[2] * by[2]


def _scaled(color: Any, strength: float) -> tuple[float, float, float]:
    return float(color[0] * strength), float(color[1] * strength), float(color[2] * strength)
