"""Scanners: their figures, and the directions of their beams."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array, shown
from pcsg.errors import UsageError, suggest
from pcsg.light.sources import direction

Floats = NDArray[np.float64]

LIGHT = 0.299792458
"""Metres that light goes in a nanosecond."""


FARTHEST = 1e9
"""Of a scanner's place, metres."""

MOST_BEAMS = 10**11
"""Of a scan."""


@dataclass(frozen=True)
class Scanner:
    """A laser scanner.

    Attributes
    ----------
    pattern
        ``raster``: columns of beams from a tripod; ``lines``: lines that spin about the vertical;
        ``mirror``: a mirror that swings across the path of what flies.
    divergence : float
        Full angle of a beam, mrad.
    pulse : float
        Length of a pulse, ns: echoes within half its way are one.
    range_sd, angle_sd : float
        Standard deviations of the range (m) and of a beam's direction (mrad).
    min_range, max_range : float
        Metres.
    rate : float
        Pulses a second.
    zenith : (float, float)
        From and to, degrees, 0 straight up: of a raster; of a mirror, degrees off the vertical to
        either side, downwards.
    azimuth : (float, float)
        From and to, degrees east of north: of a raster and of lines.
    step : float
        Between beams, degrees.
    lines : tuple of float
        Elevations of the lines, degrees above the horizon.
    spacing : float
        Between the lines of a mirror along the path, metres.
    """

    pattern: Literal["raster", "lines", "mirror"] = "raster"
    divergence: float = 0.3
    pulse: float = 5.0
    range_sd: float = 0.005
    angle_sd: float = 0.0
    min_range: float = 0.5
    max_range: float = 600.0
    rate: float = 100_000.0
    zenith: tuple[float, float] = (30.0, 130.0)
    azimuth: tuple[float, float] = (0.0, 360.0)
    step: float = 0.1
    lines: tuple[float, ...] = ()
    spacing: float = 0.5

    def __post_init__(self) -> None:
        """Check the figures."""
        positive = {"pulse": self.pulse, "rate": self.rate, "step": self.step}
        positive |= {"spacing": self.spacing, "max_range": self.max_range}
        for name, value in positive.items():
            if not 0.0 < value < math.inf:
                raise UsageError(f"a scanner's {name} is above 0, not {value:g}")
        for name in ("divergence", "range_sd", "angle_sd", "min_range"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise UsageError(f"a scanner's {name} is not negative")
        if self.pattern not in ("raster", "lines", "mirror"):
            raise UsageError(f"a scanner's pattern is raster, lines or mirror, not {self.pattern}")
        angles = (*self.zenith, *self.azimuth, *self.lines)
        if not all(abs(angle) <= 360.0 for angle in angles):
            raise UsageError("a scanner's angles are from -360 to 360 degrees")
        if self.zenith[0] > self.zenith[1] or self.azimuth[0] > self.azimuth[1]:
            raise UsageError("a scanner's angles go from the smaller to the larger")
        if self.pattern == "lines" and not self.lines:
            raise UsageError("a scanner of lines has their elevations")

    @property
    def resolution(self) -> float:
        """Metres within which echoes are one: half the way of a pulse."""
        return 0.5 * LIGHT * self.pulse

    def but(self, **figures: Any) -> Scanner:
        """Return a scanner with other figures."""
        unknown = set(figures) - set(self.__dataclass_fields__)
        if unknown:
            raise UsageError(f"a scanner has no {sorted(unknown)[0]}")
        return replace(self, **figures)

    @property
    def _across(self) -> int:
        """Beams of a line: of a column, of the lines at a time, or of a swing."""
        if self.pattern == "lines":
            return len(self.lines)
        low, high = self.zenith
        span = high - low if self.pattern == "raster" else 2.0 * high
        return max(1, math.floor(span / self.step + 1e-9) + 1)

    def count(self, leg: Leg) -> int:
        """Return how many beams a leg has."""
        if self.pattern == "mirror":
            along = math.floor(leg.length / self.spacing + 1e-9) + 1
        else:
            span = self.azimuth[1] - self.azimuth[0]
            along = max(1, math.ceil(span / self.step - 1e-9))
        return along * self._across

    def beams(self, leg: Leg, numbers: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Return origins and unit directions of beams, float64 (N, 3) each, without noise."""
        row, column = numbers // self._across, numbers % self._across
        if self.pattern == "mirror":
            along = np.minimum(1.0, row * self.spacing / max(leg.length, 1e-12))
            origins = leg.start + along[:, None] * (leg.end - leg.start)
            off = np.radians(-self.zenith[1] + self.step * column)
            forward = leg.end - leg.start
            level = np.array([forward[0], forward[1], 0.0])
            size = float(np.linalg.norm(level))
            level = level / size if size > 0.0 else np.array([0.0, 1.0, 0.0])
            right = np.array([level[1], -level[0], 0.0])
            down = np.array([0.0, 0.0, -1.0])
            return origins, np.cos(off)[:, None] * down + np.sin(off)[:, None] * right
        turn = self.azimuth[0] + self.step * row
        if self.pattern == "raster":
            zenith = self.zenith[0] + self.step * column
        else:
            zenith = 90.0 - np.array(self.lines)[column]
        span = max(1e-9, self.azimuth[1] - self.azimuth[0])
        share = (turn - self.azimuth[0]) / span
        origins = leg.start + share[:, None] * (leg.end - leg.start)
        return origins, direction(zenith, turn)


@dataclass(frozen=True)
class Leg:
    """A part of a scan: a tripod's place, or a path.

    Attributes
    ----------
    start, end : float64 (3,)
        World coordinates; the same for a tripod.
    """

    start: Floats
    end: Floats = field(default_factory=lambda: np.zeros(3))

    @property
    def length(self) -> float:
        """Metres."""
        return float(np.linalg.norm(self.end - self.start))


SCANNERS: dict[str, Scanner] = {
    # RIEGL VZ-400, data sheet 2017: 0.3 mrad, accuracy 5 mm, 100 or 300 kHz.
    "vz400": Scanner(),
    "vz400-fast": Scanner(rate=300_000.0, max_range=350.0),
    # Velodyne VLP-16, user manual 63-9243: 16 lines, 3 mrad, 30 mm, 300,000 points a second.
    "vlp16": Scanner(
        pattern="lines",
        divergence=3.0,
        range_sd=0.03,
        min_range=0.4,
        max_range=100.0,
        rate=300_000.0,
        step=0.2,
        lines=tuple(float(e) for e in range(-15, 16, 2)),
        pulse=6.0,
    ),
}
"""Known scanners by name."""


def as_scanner(value: str | Scanner) -> Scanner:
    """Return a scanner by its name.

    Raises
    ------
    UsageError
        There is none of that name.
    """
    if isinstance(value, Scanner):
        return value
    if not isinstance(value, str) or value not in SCANNERS:
        hint = suggest(str(value), SCANNERS)
        known = f"one of {', '.join(SCANNERS)}"
        raise UsageError(f"unknown scanner {shown(value)}; {hint or known}")
    return SCANNERS[value]


def as_legs(value: ArrayLike | Any) -> list[Leg]:
    """Return checked legs: places (x, y, z), or pairs of them for paths.

    Raises
    ------
    UsageError
        There is none, or something else.
    """
    legs = []
    for each in value if isinstance(value, (list, tuple)) else [value]:
        places = each if isinstance(each, Leg) else array(each, "a leg")
        if isinstance(places, Leg):
            legs.append(places)
        elif places.shape == (3,) and np.isfinite(places).all():
            legs.append(Leg(places, places))
        elif places.shape == (2, 3) and np.isfinite(places).all():
            legs.append(Leg(places[0], places[1]))
        else:
            raise UsageError("a leg is a place (x, y, z), or two of them for a path")
    if any(np.abs([leg.start, leg.end]).max() > FARTHEST for leg in legs):
        raise UsageError(f"a scanner stands within {FARTHEST:g} of the origin")
    if not legs:
        raise UsageError("a scan has a leg or more: where the scanner stands, or its path")
    return legs
