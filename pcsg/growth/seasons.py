"""What happens within a year: shoots elongate, leaves unfold, turn and fall, buds form and open.

Galbraith, Muendermann, Wyvill 2004, section 5; the delay of metamers after Muendermann 2003. Times
are parts of a year, from winter (0) to winter (1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.growth.chance import FALL, derive, uniform
from pcsg.growth.curves import smooth_step
from pcsg.growth.species import Species

Floats = NDArray[np.float64]
Keys = NDArray[np.uint64]

_AFTER_START = 0.05
_OPENING = 0.05
_FALLING = 0.04
_BEGUN = 1e-6


def step(species: Species, name: str, z: ArrayLike) -> Any:
    """Return a growth curve at local times; 0 before it begins, 1 after it ends."""
    curve = species.curves.get(name)
    return smooth_step(z) if curve is None else curve(np.clip(z, 0.0, 1.0))


def metamer_start(species: Species, j: ArrayLike, m: ArrayLike) -> Floats:
    """Return when metamer j of m (from 1) begins to elongate."""
    season = species.season
    window = season.grow_end - season.burst
    delay = (1.0 - season.metamer) * window / np.maximum(np.asarray(m) - 1, 1)
    return np.asarray(season.burst + (np.asarray(j) - 1) * delay)


def elongation(species: Species, tau: float, j: ArrayLike, m: ArrayLike) -> Floats:
    """Return how much of its length the internode of metamer j of m has; 0 below a millionth."""
    season = species.season
    duration = season.metamer * (season.grow_end - season.burst)
    grown = step(species, "g_int", (tau - metamer_start(species, j, m)) / duration)
    return np.where(grown < _BEGUN, 0.0, grown)


def unfolding(species: Species, tau: float, j: ArrayLike, m: ArrayLike) -> Floats:
    """Return how much of its size the leaf of metamer j of m has; all are whole at `leaf_end`."""
    season = species.season
    begin = metamer_start(species, j, m) + _AFTER_START
    duration = np.minimum(season.unfold, np.maximum(season.leaf_end - begin, _AFTER_START))
    return np.asarray(step(species, "g_leaf", (tau - begin) / duration))


def falling(species: Species, tau: float, key: Keys, dying: ArrayLike) -> Floats:
    """Return how much of their size leaves have lost; those of dying branches fall before."""
    season = species.season
    begin, end = season.fall
    latest = end - _FALLING
    start = begin + (latest - begin) * uniform(derive(key, FALL))
    start = np.where(dying, np.minimum(start, season.shed[0] - _FALLING), start)
    return np.asarray(step(species, "g_fall", (tau - start) / _FALLING))


def colouring(species: Species, tau: float, outwards: ArrayLike) -> Floats:
    """Return how far leaves have turned; `outwards` is 1 for the outermost, which turn last."""
    begin, end = species.season.colour
    half = 0.5 * (end - begin)
    start = begin + half * np.asarray(outwards)
    return np.asarray(step(species, "g_col", (tau - start) / half))


def bud_growth(species: Species, tau: float) -> float:
    """Return how much of their size this year's buds have."""
    begin, end = species.season.buds
    return float(step(species, "g_bud", (tau - begin) / (end - begin)))


def bud_opening(species: Species, tau: float) -> float:
    """Return how much of their size last year's buds still have."""
    return float(1.0 - smooth_step((tau - species.season.burst) / _OPENING))


def fading(species: Species, tau: float) -> float:
    """Return the factor of the radii of branches that are shed this year."""
    begin, end = species.season.shed
    return float(1.0 - smooth_step((tau - begin) / (end - begin)))
