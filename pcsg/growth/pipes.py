"""Radii by the pipe model: a limb's cross-section is that of all leaves it has ever carried.

Shinozaki, Yoda, Hozumi, Kira 1964. In place of the distance from the tip, where a species says
``"rule": "pipe"``: r^2 = r_tip^2 times the leaves, those of the present year as their internodes
grow, those of its laterals over the time of growth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pcsg.growth.curves import smooth_step
from pcsg.growth.geometry import Drawn, Instant, seats_of
from pcsg.growth.lengths import Order
from pcsg.growth.seasons import elongation
from pcsg.growth.species import Species

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def leaves_carried(orders: Sequence[Order]) -> tuple[Floats, ...]:
    """Return how many leaves branches and all they bear have had by the ends of years.

    For every order (n, Y + 1); lost branches count with what they had.
    """
    found: list[Floats] = []
    above: Floats | None = None
    for k in range(len(orders) - 1, -1, -1):
        order = orders[k]
        year = np.arange(order.lengths.shape[1])
        grown = np.where(year <= order.death[:, None], order.metamers, 0)
        total = np.cumsum(grown, axis=1).astype(np.float64)
        if above is not None:
            np.add.at(total, orders[k + 1].parent, above)
        found.append(total)
        above = total
    return tuple(found[::-1])


def pipe_radii(
    species: Species,
    orders: Sequence[Order],
    carried: Sequence[Floats],
    now: Instant,
    drawn: Sequence[Drawn],
) -> list[Drawn]:
    """Return branches with the radii of the pipe model, the trunk first."""
    season = species.season
    part = float(smooth_step((now.tau - season.burst) / (season.grow_end - season.burst)))
    found: list[Drawn] = []
    for k, d in enumerate(drawn):
        leaves = _own_leaves(species, now, d)
        if k + 1 < len(drawn):
            _add_laterals(leaves, orders[k + 1], carried[k + 1], now, part, d, len(orders[k]))
        # From the tip down, branch by branch.
        running = np.cumsum(leaves[::-1])[::-1]
        after = np.append(running, 0.0)[d.first + d.count]
        radius = species.radius.r_tip * np.sqrt(np.maximum(running - after[d.branch], 1.0))
        cap = np.ones(len(d.rows))
        if k:
            bearer = found[-1]
            local = np.full(len(orders[k - 1]), -1)
            local[bearer.rows] = np.arange(len(bearer.rows))
            above = local[orders[k].parent[d.rows]]
            seat = seats_of(orders[k], d.rows, bearer, above)
            cap = np.minimum(1.0, species.radius.cap * bearer.radius[seat] / radius[d.first])
        found.append(replace(d, radius=cap[d.branch] * radius, cap=cap))
    return found


def _own_leaves(species: Species, now: Instant, d: Drawn) -> Floats:
    """Return the leaf of every node, parts of one where its internode grows; none at bases."""
    leaves = (d.year > 0).astype(np.float64)
    new = np.flatnonzero(d.year == now.year)
    m = d.shoot_m[d.of_shoot[new]]
    leaves[new] = elongation(species, now.tau, d.metamer[new], m)
    return leaves


def _add_laterals(
    leaves: Floats,
    laterals: Order,
    carried: Floats,
    now: Instant,
    part: float,
    d: Drawn,
    n_bearers: int,
) -> None:
    """Add what laterals have carried to the nodes where they are, or were."""
    local = np.full(n_bearers, -1)
    local[d.rows] = np.arange(len(d.rows))
    above = local[laterals.parent]
    rows = np.flatnonzero((laterals.born < now.year) & (above >= 0))
    before, after = carried[rows, now.year - 1], carried[rows, now.year]
    np.add.at(
        leaves,
        seats_of(laterals, rows, d, above[rows]),
        before + part * (after - before),
    )
