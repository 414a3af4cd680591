"""Rays that leave surfaces: where they begin, and how far they look for a light."""

from __future__ import annotations

import math

from pcsg.jit import njit
from pcsg.render.tracer import Bools, Floats

OFFSET = 1e-8
"""Start of secondary rays off the surface, relative to position and distance."""


@njit(entry=True)
def begin_rays(
    position: Floats,
    facing: Floats,
    translucency: Floats,
    transmission: Floats,
    sheet: Bools,
    scale: Floats,
    towards: Floats,
    origins: Floats,
    layered: Bools,
) -> None:
    """Write where rays begin that leave N surfaces, and which go through a translucent layer.

    Parameters
    ----------
    position, facing, translucency, transmission, sheet
        Of the surfaces, see `Surface` and `Matter`.
    scale
        (N,) what errors of positions are relative to.
    towards
        (N, 3) unit directions of the rays.
    origins, layered
        (N, 3) and (N,): written.
    """
    for i in range(len(scale)):
        cosine = (
            facing[i, 0] * towards[i, 0]
            + facing[i, 1] * towards[i, 1]
            + facing[i, 2] * towards[i, 2]
        )
        step = OFFSET * scale[i]
        if cosine < 0.0:
            step = -step
        for k in range(3):
            origins[i, k] = position[i, k] + step * facing[i, k]
        opaque = translucency[i] <= 0.0 or transmission[i] >= 1.0
        layered[i] = cosine < 0.0 and not opaque and not sheet[i]


@njit(entry=True)
def limit_rays(
    position: Floats,
    origins: Floats,
    towards: Floats,
    distance: Floats,
    scale: Floats,
    t_max: Floats,
) -> None:
    """Write until where rays from `origins` look for what hides lights, a little less than there.

    Parameters
    ----------
    distance
        (N,) of the lights from the surfaces' positions; infinite for sun and sky.
    t_max
        (N,): written.
    """
    for i in range(len(scale)):
        t_max[i] = math.inf
        if distance[i] < math.inf:
            left = distance[i]
            for k in range(3):
                left += (position[i, k] - origins[i, k]) * towards[i, k]
            t_max[i] = max(left - 2.0 * OFFSET * scale[i], 0.0)
