"""Light in canopies: interception by band, gap fractions, reflectance, view factors.

    sun = pcsg.light.sun(zenith=36, azimuth=180, flux=1000)
    r = pcsg.light.interception(scene, sun, {"par": {1: (.06, .04), "soil": .15}}, periodic=cell)
    print(r); r["par"].absorbed[1]

Every function names its units and gives standard errors; docs/science.md has examples.
"""

from pcsg.light.absorption import Band, Interception, interception
from pcsg.light.gaps import (
    GapFraction,
    gap_fraction,
    hemispherical,
    lai,
    leaf_angles,
    projection,
)
from pcsg.light.reflectance import Reflectance, brf
from pcsg.light.sources import Sky, Sun, direction, sky, sun
from pcsg.light.viewfactors import exchange

__all__ = [
    "Band",
    "GapFraction",
    "Interception",
    "Reflectance",
    "Sky",
    "Sun",
    "brf",
    "direction",
    "exchange",
    "gap_fraction",
    "hemispherical",
    "interception",
    "lai",
    "leaf_angles",
    "projection",
    "sky",
    "sun",
]
