"""Rays that leave surfaces: where they begin, and how far they look for a light."""

from __future__ import annotations

import math

from pcsg.jit import njit
from pcsg.render.tracer import Bools, Floats, Ints

OFFSET = 1e-8
"""Start of secondary rays off the surface, relative to position and distance."""


@njit(entry=True)
def begin_rays(
    rows: Ints,
    position: Floats,
    facing: Floats,
    translucency: Floats,
    transmission: Floats,
    sheet: Bools,
    scale: Floats,
    towards: Floats,
    origins: Floats,
    directions: Floats,
    layered: Bools,
) -> None:
    """Write rays that leave some of N surfaces, and which of them go through a translucent layer.

    Parameters
    ----------
    rows
        (M,) which surfaces rays leave.
    position, facing, translucency, transmission, sheet
        Of the surfaces, see `Surface` and `Matter`.
    scale
        (N,) what errors of positions are relative to.
    towards
        (N, 3) unit directions of the rays.
    origins, directions, layered
        (M, 3), (M, 3) and (M,): written.
    """
    for k in range(len(rows)):
        i = rows[k]
        x, y, z = towards[i, 0], towards[i, 1], towards[i, 2]
        cosine = facing[i, 0] * x + facing[i, 1] * y + facing[i, 2] * z
        step = OFFSET * scale[i]
        if cosine < 0.0:
            step = -step
        for axis in range(3):
            origins[k, axis] = position[i, axis] + step * facing[i, axis]
        directions[k, 0], directions[k, 1], directions[k, 2] = x, y, z
        opaque = translucency[i] <= 0.0 or transmission[i] >= 1.0
        layered[k] = cosine < 0.0 and not opaque and not sheet[i]


@njit(entry=True)
def limit_rays(
    rows: Ints,
    position: Floats,
    origins: Floats,
    directions: Floats,
    distance: Floats,
    scale: Floats,
    t_max: Floats,
) -> None:
    """Write until where rays from `origins` look for what hides lights, a little less than there.

    Parameters
    ----------
    rows
        (M,) which of N surfaces they leave.
    origins, directions
        (M, 3) of the rays.
    distance
        (N,) of the lights from the surfaces' positions; infinite for sun and sky.
    t_max
        (M,): written.
    """
    for k in range(len(rows)):
        i = rows[k]
        t_max[k] = math.inf
        if distance[i] < math.inf:
            left = distance[i]
            for axis in range(3):
                left += (position[i, axis] - origins[k, axis]) * directions[k, axis]
            t_max[k] = max(left - 2.0 * OFFSET * scale[i], 0.0)
