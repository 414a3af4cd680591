"""The surfaces that rays met: what does not need textures, in one pass over the hits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pcsg.graph.settings import LARGEST_COLOR
from pcsg.jit import njit
from pcsg.render.tracer import Bools, Floats, Ints

# Columns of the table of materials.
COLOR, EMISSION, NUMBERS, IOR, BUMP, COLUMNS = 0, 3, 6, 11, 12, 13
"""`NUMBERS` are roughness, metallic, specular, transmission and translucency."""


class Gathered(NamedTuple):
    """What N hits are, before textures.

    Attributes
    ----------
    position, outward, facing, viewer
        (N, 3) where they are, and unit vectors: the geometric normal, the one towards the viewer,
        and to the viewer.
    color, emission
        (N, 3)
    numbers
        (5, N) see `NUMBERS`.
    eta, bump
        (N,)
    sheet
        (N,) whether the surface has no inside.
    """

    position: Floats
    outward: Floats
    facing: Floats
    viewer: Floats
    color: Floats
    emission: Floats
    numbers: Floats
    eta: Floats
    bump: Floats
    sheet: Bools


def make_gathered(n: int) -> Gathered:
    """Return room for n hits; the kernel writes all of it."""
    columns = [(n, 3)] * 6 + [(5, n), (n,), (n,)]
    return Gathered._make([*(np.empty(shape) for shape in columns), np.empty(n, dtype=bool)])


@njit(entry=True)
def gather_hits(
    at: Ints,
    position: Floats,
    normal: Floats,
    leaf: Ints,
    material: Ints,
    override: Floats,
    directions: Floats,
    table: Floats,
    sheets: Bools,
    out: Gathered,
) -> None:
    """Write what hits are made of.

    Parameters
    ----------
    at
        (M,) which of the N hits.
    position, normal, leaf, material, override
        Of all hits: the fields of `Hits`, the last one `color`.
    directions
        (M, 3) unit directions of the rays.
    table
        (materials + 1, COLUMNS); -1 finds the last row.
    sheets
        (leaves + 2,) which leaves have no inside; negative numbers find the last one.
    """
    for i in range(len(at)):
        hit = at[i]
        row = material[hit] if material[hit] >= 0 else len(table) - 1
        along = 0.0
        for k in range(3):
            out.position[i, k] = position[hit, k]
            out.outward[i, k] = normal[hit, k]
            out.viewer[i, k] = -directions[i, k]
            along += normal[hit, k] * directions[i, k]
        sign = -1.0 if along > 0.0 else 1.0
        given = override[hit, 0] >= 0.0
        for k in range(3):
            out.facing[i, k] = sign * normal[hit, k]
            own = min(max(override[hit, k], 0.0), LARGEST_COLOR)
            out.color[i, k] = own if given else table[row, COLOR + k]
            out.emission[i, k] = table[row, EMISSION + k]
        for k in range(5):
            out.numbers[k, i] = table[row, NUMBERS + k]
        sheet = sheets[leaf[hit] if leaf[hit] >= 0 else len(sheets) - 1]
        ior = table[row, IOR]
        eta = 1.0 / ior if along > 0.0 and not sheet else ior
        # Equal indices would leave no way to tell a facet.
        out.eta[i] = 1.0001 if abs(eta - 1.0) < 1e-4 else eta
        out.bump[i] = table[row, BUMP]
        out.sheet[i] = sheet
