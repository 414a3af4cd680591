"""Sun and sky: where light comes from, and how much."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array, real
from pcsg.errors import UsageError

Floats = NDArray[np.float64]

SKIES = ("uniform", "overcast", "clear")


def direction(zenith: ArrayLike, azimuth: ArrayLike) -> Floats:
    """Return unit vectors towards places of the sky, float64 (..., 3).

    Parameters
    ----------
    zenith, azimuth : array_like
        Degrees; azimuth east of north, which is +y.
    """
    a, b = np.radians(np.asarray(zenith, float)), np.radians(np.asarray(azimuth, float))
    a, b = np.broadcast_arrays(a, b)
    return np.stack([np.sin(a) * np.sin(b), np.sin(a) * np.cos(b), np.cos(a)], axis=-1)


@dataclass(frozen=True)
class Sun:
    """A sun: parallel light.

    Attributes
    ----------
    zenith, azimuth : float
        Degrees; azimuth east of north (+y).
    flux : float
        W/m2 on a surface that faces it.
    """

    zenith: float
    azimuth: float
    flux: float

    @property
    def horizontal(self) -> float:
        """W/m2 on a horizontal surface."""
        return self.flux * math.cos(math.radians(self.zenith))

    def draw(self, u: Floats) -> tuple[Floats, Floats]:
        """Return directions towards it (N, 3), and weights (N,) whose mean is 1."""
        towards = direction(self.zenith, self.azimuth)
        return np.tile(towards, (len(u), 1)), np.ones(len(u))


@dataclass(frozen=True)
class Sky:
    """A sky: light from all directions above the horizon.

    Attributes
    ----------
    radiance
        Relative radiance of directions (N, 3), or an array (zeniths, azimuths) of equal steps.
    flux : float
        W/m2 on a horizontal surface.
    """

    radiance: Any
    flux: float

    @property
    def horizontal(self) -> float:
        """W/m2 on a horizontal surface."""
        return self.flux

    def draw(self, u: Floats) -> tuple[Floats, Floats]:
        """Return directions (N, 3), and weights (N,) whose mean is 1: radiance over the mean.

        Parameters
        ----------
        u : float64 (N, 2)
            Uniform in [0, 1).
        """
        cos = np.sqrt(1.0 - u[:, 0])
        zenith, azimuth = np.degrees(np.arccos(cos)), 360.0 * u[:, 1]
        towards = direction(zenith, azimuth)
        return towards, self._relative(zenith, azimuth) / self._mean

    def _relative(self, zenith: Floats, azimuth: Floats) -> Floats:
        if callable(self.radiance):
            return np.asarray(self.radiance(zenith, azimuth), float)
        rows, columns = self.radiance.shape
        i = np.minimum((zenith / 90.0 * rows).astype(np.int64), rows - 1)
        j = np.minimum((azimuth / 360.0 * columns).astype(np.int64), columns - 1)
        return np.asarray(self.radiance[i, j], float)

    @property
    def _mean(self) -> float:
        """The mean of the relative radiance over equal shares of the horizontal flux."""
        rows = columns = 720
        if not callable(self.radiance):
            rows, columns = (math.ceil(720 / n) * n for n in self.radiance.shape)
        edges = np.cos(np.radians(np.linspace(0.0, 90.0, rows + 1))) ** 2
        middles = (
            90.0 * (np.arange(rows) + 0.5) / rows,
            360.0 * (np.arange(columns) + 0.5) / columns,
        )
        zenith, azimuth = np.meshgrid(*middles, indexing="ij")
        values = self._relative(zenith.ravel(), azimuth.ravel()).reshape(rows, columns)
        return float((values.mean(axis=1) * (edges[:-1] - edges[1:])).sum())


def sun(zenith: float, azimuth: float = 180.0, flux: float = 1.0) -> Sun:
    """Return a sun.

    It is apart from the grammar's ``sun { }``, which pictures and ``SUNX`` follow.

    Parameters
    ----------
    zenith, azimuth
        Degrees; azimuth east of north (+y). The sun stands above the horizon.
    flux
        W/m2 on a surface that faces it.
    """
    real(zenith, "zenith", 0.0, 90.0)
    if zenith >= 90.0:
        raise UsageError("the sun stands above the horizon: its zenith is below 90 degrees")
    return Sun(float(zenith), real(azimuth, "azimuth"), real(flux, "flux", 0.0))


def sky(
    kind: str | ArrayLike = "uniform",
    flux: float = 1.0,
    *,
    sun: Sun | None = None,
) -> Sky:
    """Return a sky.

    Parameters
    ----------
    kind
        ``uniform``: the same radiance everywhere; ``overcast``: CIE's standard overcast sky,
        1 + 2 cos(zenith) (Moon and Spencer 1942); ``clear``: CIE's standard clear sky (Kittler
        1967) about a sun; or relative radiances, array_like (zeniths, azimuths), of equal steps
        from the zenith to the horizon and from north over east.
    flux
        W/m2 on a horizontal surface.
    sun
        Of a clear sky.

    Raises
    ------
    UsageError
        There is no such sky.
    """
    real(flux, "flux", 0.0)
    if not isinstance(kind, str):
        values = array(kind, "a sky's radiance")
        if values.ndim != 2 or not np.isfinite(values).all() or (values < 0.0).any():
            raise UsageError("a sky's radiance has shape (zeniths, azimuths), and is not negative")
        if not values.any():
            raise UsageError("a sky's radiance is 0 everywhere")
        return Sky(values, flux)
    if kind == "uniform":
        return Sky(_uniform, flux)
    if kind == "overcast":
        return Sky(_overcast, flux)
    if kind != "clear":
        raise UsageError(f"unknown sky {kind!r}; one of {', '.join(SKIES)}")
    if not isinstance(sun, Sun):
        raise UsageError('a clear sky needs its sun: sky("clear", flux, sun=sun(40))')
    return Sky(_Clear(sun), flux)


def _uniform(zenith: Floats, azimuth: Floats) -> Floats:
    return np.ones_like(zenith)


def _overcast(zenith: Floats, azimuth: Floats) -> Floats:
    found: Floats = 1.0 + 2.0 * np.cos(np.radians(zenith))
    return found


@dataclass(frozen=True)
class _Clear:
    """CIE's standard clear sky: an aureole about the sun, and a brighter horizon."""

    sun: Sun

    def __call__(self, zenith: Floats, azimuth: Floats) -> Floats:
        towards = direction(self.sun.zenith, self.sun.azimuth)
        cos = np.clip(direction(zenith, azimuth) @ towards, -1.0, 1.0)
        about = 0.91 + 10.0 * np.exp(-3.0 * np.arccos(cos)) + 0.45 * cos * cos
        up = np.maximum(np.cos(np.radians(zenith)), 1e-3)
        found: Floats = about * (1.0 - np.exp(-0.32 / up))
        return found


def as_sources(value: Any) -> list[Sun | Sky]:
    """Return checked sources.

    Raises
    ------
    UsageError
        There is none, or something else.
    """
    found = [value] if isinstance(value, (Sun, Sky)) else list(value)
    if not found or not all(isinstance(source, (Sun, Sky)) for source in found):
        raise UsageError("sources are what `light.sun` and `light.sky` return, one or more")
    return found
