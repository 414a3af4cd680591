"""Structure by year: which branches there are, how long, from when until when.

Galbraith, Muendermann, Wyvill 2004, section 3, with the equation numbers of the paper. Branches are
computed order by order, all branches of an order and all years at once; no random numbers enter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.growth.species import Species

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NEVER = 1 << 30
"""Year of death of what does not die."""

MOST_BUDS = 1_500_000
"""Of an order, from which its laterals grow."""

MOST_YEARS = 5_000_000
"""Years of all branches together, of which a table is made."""


@dataclass(frozen=True)
class Order:
    """All branches of one order, n of them, over Y years.

    Attributes
    ----------
    parent : int64 (n,)
        Index in the order below, -1 for the trunk.
    born, death : int64 (n,)
        Year of the bearing shoot, and the last year: alive in year y if born < y <= death.
    scale : float64 (n,)
        s_b of equation (15).
    along : float64 (n,)
        x_s: place on the bearing shoot, from its base, in (0, 1].
    place : float64 (n,)
        x: middle of the bearing shoot, metres from the parent's base.
    metamer : int64 (n,)
        Running index of the metamer on the parent that bears the branch, from 1.
    lengths : float64 (n, Y + 1)
        l_y at the end of every year in metres; 0 until `born`. Goes on after death.
    metamers : int64 (n, Y + 1)
        Number of metamers of the shoot of every year; 0 until `born`.
    """

    parent: Ints
    born: Ints
    death: Ints
    scale: Floats
    along: Floats
    place: Floats
    metamer: Ints
    lengths: Floats
    metamers: Ints

    def __len__(self) -> int:
        return len(self.born)

    def living(self, year: int) -> NDArray[np.bool_]:
        """Return which branches are alive in a year (n,)."""
        return (self.born < year) & (year <= self.death)


def grow_orders(species: Species) -> tuple[Order, ...]:
    """Return all branches by order, the trunk first.

    Raises
    ------
    UsageError
        There are too many.
    """
    orders = [_grow_trunk(species)]
    left = MOST_YEARS
    while len(orders) <= species.order_max:
        below = _grow_laterals(species, orders[-1], len(orders), left)
        if not len(below):
            break
        orders.append(below)
        left -= below.lengths.size
    return tuple(orders)


def _refuse(order: int) -> UsageError:
    return UsageError(
        f"the species has too many branches of order {order}; a larger `smin`, fewer metamers in "
        "`G_m`, a lower `ymax` or `order_max` makes it smaller"
    )


def _times(species: Species) -> Floats:
    return np.arange(species.ymax + 1) / species.ymax


def _grow_trunk(species: Species) -> Order:
    lengths = species.trunk_scale * np.asarray(species.curves["G_h"](_times(species)))
    for y in range(1, species.ymax + 1):
        lengths[y] = max(lengths[y], lengths[y - 1] + species.lmin)
    none = np.zeros(1)
    born = np.zeros(1, np.int64)
    return Order(
        parent=np.array([-1]),
        born=born,
        death=np.array([NEVER]),
        scale=np.ones(1),
        along=none,
        place=none,
        metamer=born,
        lengths=lengths[None],
        metamers=count_metamers(species, lengths[None], born),
    )


def _grow_laterals(species: Species, parents: Order, order: int, most: int) -> Order:
    """Return the branches of the next order, whose years are at most so many together."""
    curves, years = species.curves, species.ymax
    # One row for every metamer of every shoot on which a lateral may sit.
    year = np.arange(years + 1)
    bears = (parents.born[:, None] < year) & (year < parents.death[:, None]) & (year < years)
    p, b = np.nonzero(bears & (parents.metamers > 0))
    m = parents.metamers[p, b]
    before = np.cumsum(parents.metamers, axis=1)[p, b] - m
    if m.sum() > MOST_BUDS:
        raise _refuse(order)
    rows = np.repeat(np.arange(len(m)), m)
    j = np.arange(len(rows)) - np.repeat(np.cumsum(m) - m, m) + 1
    p, b, metamer = p[rows], b[rows], before[rows] + j
    along = j / m[rows]

    place = 0.5 * (parents.lengths[p, b - 1] + parents.lengths[p, b])
    x_max = place / parents.lengths[p, years]
    scale = curves["G_ss"](along) * parents.scale[p] * curves["G_bs"](x_max)  # (15)
    kept = scale >= species.smin
    p, b, metamer, along = p[kept], b[kept], metamer[kept], along[kept]
    place, scale = place[kept], scale[kept]
    if len(p) * (years + 1) > most:
        raise _refuse(order)
    age = np.maximum(1, np.rint(curves["G_a"](scale)).astype(np.int64))  # (11)
    lengths = _lateral_lengths(species, parents.lengths[p], b, place, scale, order)
    return Order(
        parent=p,
        born=b,
        death=np.minimum(b + age, parents.death[p]),
        scale=scale,
        along=along,
        place=place,
        metamer=metamer,
        lengths=lengths,
        metamers=count_metamers(species, lengths, b),
    )


def _lateral_lengths(
    species: Species, of_parent: Floats, born: Ints, place: Floats, scale: Floats, order: int
) -> Floats:
    """Return lengths (n, Y + 1) by equations (6), (7), (12) and (5).

    The recursion (7) runs on undivided, unscaled lengths, and (5) is enforced on the real ones: as
    printed, (12) divides last year's divided length once more.
    """
    young, mature = species.curves["G_s1"], species.curves["G_s2"]
    divisor = 1.0 if order == 1 else 0.5 * order + 1.0
    found = np.zeros_like(of_parent)
    u = np.zeros(len(born))
    for y, t in enumerate(_times(species)):
        grows = np.flatnonzero(born < y)
        l_p = of_parent[grows, y]
        x_y = place[grows] / l_p
        l_d = l_p * ((1.0 - t) * young(x_y) + t * mature(x_y))  # (6)
        u[grows] = np.maximum(l_d, u[grows] + species.lmin)  # (7)
        v = scale[grows] * u[grows] / divisor  # (12)
        found[grows, y] = np.maximum(v, found[grows, y - 1] + species.lmin)  # (5)
    return found


def count_metamers(species: Species, lengths: Floats, born: Ints) -> Ints:
    """Return the number of metamers of every shoot (n, Y + 1), by (14) and the 40-degree rule."""
    shoots = np.diff(lengths, axis=1, prepend=0.0)
    q = np.minimum(1.0, shoots / species.lsmax)
    wanted = np.rint(species.curves["G_m"](q)).astype(np.int64)  # (14)
    table = nearest_allowed(species, int(wanted.max(initial=1)))
    found = table[np.maximum(wanted, 0)]
    year = np.arange(lengths.shape[1])
    return np.where(born[:, None] < year, found, 0)


def is_allowed(species: Species, m: int) -> bool:
    """Return whether a shoot of m metamers keeps its top laterals clear of the shoot before.

    With that shoot's top at azimuth 0, the top and the second of the new one must both be at least
    the least separation away, 40 degrees (for m = 1 only the top).
    """
    azimuths = species.phyllotaxis * np.array([m] if m == 1 else [m, m - 1])
    away = np.abs((azimuths + 180.0) % 360.0 - 180.0)
    return bool((away >= species.min_separation - 1e-9).all())


def nearest_allowed(species: Species, most: int) -> Ints:
    """Return for 0 .. most the nearest allowed number of metamers, the smaller one on a tie."""
    allowed = np.array([m for m in range(1, most + 60) if is_allowed(species, m)] or [1])
    gap = np.abs(np.arange(most + 1)[:, None] - allowed)
    return np.asarray(allowed[gap.argmin(axis=1)])
