"""Leaves and buds at time t."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pcsg.growth.chance import derive
from pcsg.growth.geometry import Drawn, Instant
from pcsg.growth.lengths import Order
from pcsg.growth.seasons import bud_growth, bud_opening, colouring, falling, unfolding
from pcsg.growth.species import Species
from pcsg.growth.state import Buds, Leaves

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Shoots = Sequence[tuple[Order, NDArray[np.uint64], Drawn, int]]
"""Orders with the names of their branches, what is drawn of them, and how much of that is alive."""

_SMALLEST = 1e-3
"""Leaves and buds with less than this part of their size are left out."""

_BUD_ANGLE = 40.0


def _outward(species: Species, drawn: Drawn, order: Order, node: Ints) -> Floats:
    """Return the directions in which metamers bear their leaves and buds."""
    branch = drawn.branch[node]
    d, b = drawn.direction[node], drawn.axis[branch]
    u = b - d * np.einsum("ij,ij->i", d, b)[:, None]
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    index = node - drawn.first[branch]  # the running metamer
    phi = np.radians(species.phyllotaxis * index)[:, None]
    return np.asarray(np.cos(phi) * u + np.sin(phi) * np.cross(d, u))


def _nodes_of(drawn: Drawn, alive: int, years: range) -> Ints:
    """Return the nodes that end metamers of shoots of some years."""
    n = int(drawn.count[:alive].sum())
    year = drawn.year[:n]
    return np.flatnonzero((year > 0) & (year >= years.start) & (year < years.stop))


def find_leaves(species: Species, now: Instant, shoots: Shoots) -> Leaves:
    """Return the leaves of this year's shoots, of evergreens those of earlier years too."""
    keep = round(species.season.evergreen)
    parts: list[Leaves] = []
    for order, keys, drawn, alive in shoots:
        node = _nodes_of(drawn, alive, range(now.year - keep, now.year + 1))
        branch, year = drawn.branch[node], drawn.year[node]
        rows, m = drawn.rows[branch], drawn.shoot_m[drawn.of_shoot[node]]
        j = drawn.metamer[node]
        along = j / m
        dying = order.death[rows] == now.year
        key = derive(keys[rows], year, j)
        new = year == now.year
        size = np.where(new, unfolding(species, now.tau, j, m), 1.0)
        oldest = (year == now.year - keep) | dying
        size *= 1.0 - np.where(oldest, falling(species, now.tau, key, dying), 0.0)
        size *= species.leaf.length * species.curves["G_l"](along)
        out = _outward(species, drawn, order, node)
        factor = drawn.factor[branch]
        kept = np.flatnonzero(size > _SMALLEST * species.leaf.length)
        turned = np.where(oldest, colouring(species, now.tau, along), 0.0)
        radius = (drawn.radius[node] * factor)[:, None]
        parts.append(
            Leaves(
                position=(drawn.position[node] + 0.8 * radius * out)[kept],
                axis=drawn.direction[node][kept],
                outward=out[kept],
                size=size[kept],
                autumn=turned[kept],
                key=key[kept],
            )
        )
    names = Leaves.__dataclass_fields__
    return Leaves(**{k: np.concatenate([getattr(p, k) for p in parts]) for k in names})


def find_buds(species: Species, now: Instant, shoots: Shoots) -> Buds:
    """Return the buds that form on this year's shoots, and those of last year's that open."""
    forming, opening = bud_growth(species, now.tau), bud_opening(species, now.tau)
    angle = np.radians(_BUD_ANGLE)
    parts: list[Buds] = []
    for order, _, drawn, alive in shoots:
        for year, part in ((now.year, forming), (now.year - 1, opening)):
            if part <= _SMALLEST:
                continue
            node = _nodes_of(drawn, alive, range(year, year + 1))
            m = drawn.shoot_m[drawn.of_shoot[node]]
            at_end = drawn.metamer[node] == m
            fading = drawn.factor[drawn.branch[node]]
            radius = (drawn.radius[node] * fading)[:, None]
            d, out = drawn.direction[node], _outward(species, drawn, order, node)
            lateral = np.cos(angle) * d + np.sin(angle) * out
            size = species.bud.length * part * fading
            last = np.flatnonzero(
                at_end & (drawn.along[node] >= 0.999999 * drawn.length[drawn.branch[node]])
            )
            parts.append(Buds(drawn.position[node] + 0.7 * radius * out, lateral, 0.8 * size))
            parts.append(Buds(drawn.position[node][last], d[last], 1.3 * size[last]))
    if not parts:
        return Buds(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    names = Buds.__dataclass_fields__
    return Buds(**{k: np.concatenate([getattr(p, k) for p in parts]) for k in names})
