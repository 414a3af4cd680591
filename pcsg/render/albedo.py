"""How much light rough surfaces send back in one reflection, in tables."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from pcsg.jit import njit
from pcsg.render.facets import MIN_ALPHA
from pcsg.render.tracer import Floats


class Albedo(NamedTuple):
    """Reflected shares of GGX gloss, by roughness and the root of the cosine, both from 0 to 1.

    With Schlick's Fresnel term the share is ``low * F0 + high * F90``; without, ``low + high``.

    Attributes
    ----------
    low, high
        (R, C)
    mean_low, mean_high
        (R,) averages over the cosine-weighted hemisphere.
    glass
        (2, E, R, C) what glass mirrors and refracts together: looked at from outside or inside, by
        its index of refraction; see `glass_row`. Of no size where there is no glass.
    """

    low: Floats
    high: Floats
    mean_low: Floats
    mean_high: Floats
    glass: Floats


ROUGHNESSES, COSINES = 24, 24
"""Rows and columns; columns go by the root of the cosine, since grazing gloss changes fast."""


GLASSES, MOST_GLASS = 9, 0.75
"""Rows for indices of refraction, and the largest root of (ior - 1) / (ior + 1): 3.6."""


class _Facets(NamedTuple):
    """Facets as seen from a direction, over roughness, cosine and numbers to draw them.

    Attributes
    ----------
    squared
        Square of the roughness parameter alpha.
    vz
        Cosine of the viewer.
    vh, hz
        Cosines of the facet to the viewer and to the surface.
    """

    squared: Floats
    vz: Floats
    vh: Floats
    hz: Floats

    def masking(self, lz: Floats) -> Floats:
        """Return G2 / G1 for light at cosines lz on either side."""
        to_viewer = self.vz * np.sqrt(self.squared + (1.0 - self.squared) * lz**2)
        own = np.sqrt(self.squared + (1.0 - self.squared) * self.vz**2)
        return np.asarray(lz * (self.vz + own) / (to_viewer + lz * own))


def _draw_facets(roughnesses: int, cosines: int, side: int) -> _Facets:
    """Return visible normals, as of `visible_normal`, (R, C, side * side)."""
    u, turn = ((v.ravel() + 0.5) / side for v in np.mgrid[0:side, 0:side])
    roughness = np.linspace(0.0, 1.0, roughnesses)
    cosine = np.linspace(0.0, 1.0, cosines) ** 2
    alpha = np.maximum(roughness**2, MIN_ALPHA)[:, None, None]
    vz = np.maximum(cosine, 1e-3)[None, :, None]
    vx = np.sqrt(1.0 - vz * vz)
    length = np.hypot(alpha * vx, vz)
    sx, sz = alpha * vx / length, vz / length
    cz = (1.0 - u) * (1.0 + sz) - sz
    radius = np.sqrt(np.maximum(1.0 - cz * cz, 0.0))
    hx = alpha * (radius * np.cos(2 * np.pi * turn) + sx)
    hy = alpha * radius * np.sin(2 * np.pi * turn)
    hz = np.maximum(cz + sz, 1e-12)
    scale = 1.0 / np.sqrt(hx * hx + hy * hy + hz * hz)
    vh = np.clip((vx * hx + vz * hz) * scale, 0.0, 1.0)
    return _Facets(alpha * alpha, vz, vh, hz * scale)


@cache
def albedo_tables(glass: bool = True) -> Albedo:
    """Return the reflected shares by integration over drawn normals.

    Parameters
    ----------
    glass
        Whether the table for glass is needed.
    """
    facets = _draw_facets(ROUGHNESSES, COSINES, 24)
    lz = 2.0 * facets.vh * facets.hz - facets.vz
    masking = np.where(lz > 0, facets.masking(np.maximum(lz, 0.0)), 0.0)
    edge = (1.0 - facets.vh) ** 5
    low = (masking * (1.0 - edge)).mean(axis=2)
    high = (masking * edge).mean(axis=2)
    # Averages of what stands between the columns, where `share_at` draws straight lines.
    fine = (np.arange(2048) + 0.5) / 2048
    columns = np.linspace(0.0, 1.0, COSINES)
    hats = np.stack([np.interp(fine, columns, hat) for hat in np.eye(COSINES)])
    weight = hats @ (4.0 * fine**3) / len(fine)
    both = _glass_table() if glass else np.ones((2, 0, 0, 0))
    return Albedo(low, high, low @ weight, high @ weight, both)


def _glass_table() -> Floats:
    """Return what glass mirrors and refracts together: (2, E, R, C)."""
    facets = _draw_facets(ROUGHNESSES, COSINES, 18)
    vh, hz = facets.vh, facets.hz
    up = 2.0 * vh * hz - facets.vz
    mirrored = np.where(up > 0, facets.masking(np.maximum(up, 0.0)), 0.0)
    rows = np.linspace(0.0, MOST_GLASS, GLASSES) ** 2
    table = np.empty((2, GLASSES, ROUGHNESSES, COSINES))
    for k, ior in enumerate((1.0 + rows) / (1.0 - rows)):
        for inside, eta in enumerate((ior, 1.0 / ior)):
            beyond = np.sqrt(np.maximum(1.0 - (1.0 - vh**2) / eta**2, 0.0))
            parallel = (eta * vh - beyond) / (eta * vh + beyond)
            across = (vh - eta * beyond) / (vh + eta * beyond)
            fresnel = np.where(beyond > 0.0, 0.5 * (parallel**2 + across**2), 1.0)
            down = -((vh / eta - beyond) * hz - facets.vz / eta)
            refracted = np.where(down > 0, facets.masking(np.maximum(down, 0.0)), 0.0)
            share = fresnel * mirrored + (1.0 - fresnel) * refracted
            table[inside, k] = share.mean(axis=2)
    return table


class Place(NamedTuple):
    """Between which rows and columns of a table something stands, and how far along."""

    row: int
    column: int
    down: float
    right: float


@njit
def place_at(table: Floats, roughness: float, cosine: float) -> Place:
    """Return where a roughness and a cosine stand in tables of this size."""
    row = roughness * (table.shape[0] - 1)
    column = math.sqrt(min(max(cosine, 0.0), 1.0)) * (table.shape[1] - 1)
    i, j = min(int(row), table.shape[0] - 2), min(int(column), table.shape[1] - 2)
    return Place(i, j, row - i, column - j)


@njit
def share_of(table: Floats, at: Place) -> float:
    """Return a table's value between its rows and columns."""
    i, j, s, t = at
    upper = (1 - t) * table[i, j] + t * table[i, j + 1]
    lower = (1 - t) * table[i + 1, j] + t * table[i + 1, j + 1]
    return float((1 - s) * upper + s * lower)


@njit
def share_at(table: Floats, roughness: float, cosine: float) -> float:
    """Return a table's value for a roughness and a cosine."""
    return share_of(table, place_at(table, roughness, cosine))


@njit
def glass_row(eta: float) -> tuple[int, float]:
    """Return the table of a relative index of refraction, and where in it that lies."""
    inside = 1 if eta < 1.0 else 0
    ior = 1.0 / eta if eta < 1.0 else eta
    root = math.sqrt((ior - 1.0) / (ior + 1.0))
    return inside, min(root / MOST_GLASS, 1.0) * (GLASSES - 1)


@njit
def mean_at(table: Floats, roughness: float) -> float:
    """Return an entry of a table over roughness."""
    row = roughness * (len(table) - 1)
    i = min(int(row), len(table) - 2)
    return float(table[i] + (row - i) * (table[i + 1] - table[i]))
