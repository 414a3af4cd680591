"""The clear sky as it is: Preetham, Shirley and Smits 1999, *A practical analytic model for
daylight*, with the sun's light dimmed and reddened by the same air.

Luminance is in kcd/m2 and illuminance in klx; `SCALE` turns them into the renderer's numbers, in
which the sun overhead has the strength of the setting's default.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pcsg.render.sky import Sky
from pcsg.render.tracer import Floats

SCALE = 0.03
"""Radiance in the renderer's numbers of a luminance of 1 kcd/m2; 100 klx become 3."""

# The paper's appendix A.2: A to E of Perez' formula, for Y, x and y, slope and offset in T.
_PEREZ = np.array(
    [
        [
            [0.1787, -1.4630],
            [-0.3554, 0.4275],
            [-0.0227, 5.3251],
            [0.1206, -2.5771],
            [-0.0670, 0.3703],
        ],
        [
            [-0.0193, -0.2592],
            [-0.0665, 0.0008],
            [-0.0004, 0.2125],
            [-0.0641, -0.8989],
            [-0.0033, 0.0452],
        ],
        [
            [-0.0167, -0.2608],
            [-0.0950, 0.0092],
            [-0.0079, 0.2102],
            [-0.0441, -1.6537],
            [-0.0109, 0.0529],
        ],
    ]
)

# Likewise for the zenith's x and y: rows T2, T, 1; columns the sun's angle^3, ^2, ^1, 1.
_ZENITH_X = np.array(
    [
        [0.00166, -0.00375, 0.00209, 0.0],
        [-0.02903, 0.06377, -0.03202, 0.00394],
        [0.11693, -0.21196, 0.06052, 0.25886],
    ]
)
_ZENITH_Y = np.array(
    [
        [0.00275, -0.00610, 0.00317, 0.0],
        [-0.04214, 0.08970, -0.04153, 0.00516],
        [0.15346, -0.26756, 0.06670, 0.26688],
    ]
)

_RGB_FROM_XYZ = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
"""Linear sRGB (IEC 61966-2-1)."""

GROUND = (0.30, 0.28, 0.25)
"""Albedo of what lies below the horizon."""


def luminance_xyy(sun_height: float, turbidity: float, directions: Floats, sun: Floats) -> Floats:
    """Return (N, 3) Y in kcd/m2 and chromaticities x, y of the sky in directions above the horizon.

    Parameters
    ----------
    sun_height
        Sine of the sun's elevation, at least 0.
    """
    t = turbidity
    angle = math.acos(sun_height)
    chi = (4.0 / 9.0 - t / 120.0) * (math.pi - 2.0 * angle)
    powers = np.array([angle**3, angle**2, angle, 1.0])
    turbid = np.array([t * t, t, 1.0])
    zenith = np.array(
        [
            (4.0453 * t - 4.9710) * math.tan(chi) - 0.2155 * t + 2.4192,
            turbid @ _ZENITH_X @ powers,
            turbid @ _ZENITH_Y @ powers,
        ]
    )
    coefficients = _PEREZ @ np.array([t, 1.0])
    cos_gamma = np.clip(directions @ sun, -1.0, 1.0)
    # At the horizon itself Perez' formula has no value.
    shape = _perez(coefficients, np.maximum(directions[:, 2], 0.01), cos_gamma)
    overhead = _perez(coefficients, np.ones(1), np.array([sun_height]))
    return np.asarray(np.maximum(zenith * shape / overhead, 0.0))


def _perez(coefficients: Floats, cos_theta: Floats, cos_gamma: Floats) -> Floats:
    """Return Perez' five-parameter formula, (N, 3)."""
    a, b, c, d, e = coefficients.T
    gamma = np.arccos(cos_gamma)[:, None]
    by_height = 1.0 + a * np.exp(b / cos_theta[:, None])
    return np.asarray(by_height * (1.0 + c * np.exp(d * gamma) + e * np.square(cos_gamma)[:, None]))


def sunlight(sun_height: float, turbidity: float) -> tuple[float, float, float]:
    """Return which part of the sun's light in red, green and blue the air lets through.

    Relative to a sun overhead in air of turbidity 2, which is what the colour of the sun's setting
    stands for. Rayleigh's scattering and Angstrom's haze of the paper's appendix A.1.
    """
    parts = _transmitted(sun_height, turbidity) / _transmitted(1.0, 2.0)
    return float(parts[0]), float(parts[1]), float(parts[2])


def _transmitted(sun_height: float, turbidity: float) -> Floats:
    if sun_height <= 0.0:
        return np.zeros(3)
    degrees = math.degrees(math.asin(min(sun_height, 1.0)))
    mass = 1.0 / (sun_height + 0.15 * (degrees + 3.885) ** -1.253)
    micrometres = np.array([0.61, 0.55, 0.465])
    rayleigh = np.exp(-0.008735 * mass * micrometres**-4.08)
    haze = np.exp(-(0.04608 * turbidity - 0.04586) * mass * micrometres**-1.3)
    return np.asarray(rayleigh * haze)


@dataclass(frozen=True)
class PhysicalSky(Sky):
    """The clear sky.

    Attributes
    ----------
    sun
        Unit vector towards the sun; one below the horizon counts as on it.
    turbidity
        2 is very clear, 3 clear, 6 hazy.
    strength
        Factor of the radiance.
    """

    sun: tuple[float, float, float]
    turbidity: float
    strength: float

    rows, columns = 128, 256

    @cached_property
    def _sun(self) -> Floats:
        x, y, z = self.sun
        sun = np.array([x, y, max(z, 0.0)])
        length = float(np.linalg.norm(sun))
        return sun / length if length > 0 else np.array([1.0, 0.0, 0.0])

    @cached_property
    def _below(self) -> Floats:
        """Radiance of the ground under this sky and sun."""
        height = float(self._sun[2])
        # Irradiance of the sky on the ground, by a quadrature over the hemisphere.
        z = np.sqrt((np.arange(24) + 0.5) / 24)
        turn = 2.0 * math.pi * (np.arange(48) + 0.5) / 48
        z, turn = (v.ravel() for v in np.meshgrid(z, turn, indexing="ij"))
        radius = np.sqrt(1.0 - z * z)
        around = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
        sky = self._above(around).mean(axis=0)
        sun = (
            100.0 * SCALE * self.strength * height / math.pi * _transmitted(height, self.turbidity)
        )
        return np.asarray(np.array(GROUND) * (sky + sun))

    def _above(self, directions: Floats) -> Floats:
        found = luminance_xyy(float(self._sun[2]), self.turbidity, directions, self._sun)
        luminance, x, y = found.T
        y = np.maximum(y, 1e-6)
        xyz = np.stack([luminance * x / y, luminance, luminance * (1.0 - x - y) / y], axis=1)
        return np.asarray(np.maximum(SCALE * self.strength * xyz @ _RGB_FROM_XYZ.T, 0.0))

    def radiance(self, directions: Floats) -> Floats:
        """See `Sky`."""
        up = directions.copy()
        up[:, 2] = np.maximum(up[:, 2], 0.0)
        up /= np.maximum(np.sqrt(np.einsum("ij,ij->i", up, up)), 1e-9)[:, None]
        # The horizon is a soft edge of about two degrees: haze hides the real one.
        ground = np.clip(-directions[:, 2] / 0.04, 0.0, 1.0)[:, None]
        return np.asarray(self._above(up) * (1.0 - ground) + self._below * ground)
