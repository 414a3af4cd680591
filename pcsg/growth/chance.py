"""Random numbers that depend on names only: seed, branch, what for.

A counter-based generator (Salmon, Moraes, Dror, Shaw 2011) with the mixer of SplitMix64 (Steele,
Lea, Flood 2014): constant in time, and independent of what is evaluated first.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Keys = NDArray[np.uint64]

# What numbers are for.
AZIMUTH, HEADING, SIDEWAYS, FALL, TURN = range(1, 6)

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def mix(key: Any) -> Keys:
    """Return well-mixed 64-bit numbers."""
    with np.errstate(over="ignore"):
        z = np.asarray(key, np.uint64) + _GOLDEN
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(z ^ (z >> np.uint64(31)))


def derive(key: ArrayLike, *names: ArrayLike) -> Keys:
    """Return keys of what is named by whole numbers under keys."""
    found = np.asarray(key, np.uint64)
    for name in names:
        found = mix(found ^ mix(np.asarray(name, np.int64).astype(np.uint64)))
    return found


def uniform(key: Keys) -> NDArray[np.float64]:
    """Return numbers in [0, 1)."""
    return np.asarray((key >> np.uint64(11)).astype(np.float64) * 2.0**-53)


def normal(key: Keys) -> NDArray[np.float64]:
    """Return normally distributed numbers, by the method of Box and Muller."""
    radius = np.sqrt(-2.0 * np.log1p(-uniform(key)))
    return np.asarray(radius * np.cos(2.0 * np.pi * uniform(mix(key))))
