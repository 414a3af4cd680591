"""Where everything is at time t: positions, directions and radii, order by order.

Galbraith, Muendermann, Wyvill 2004, sections 3 and 5. What depends on a length uses that of the
instant, so that everything is continuous over the year and over its turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.growth.chance import AZIMUTH, HEADING, SIDEWAYS, derive, normal
from pcsg.growth.lengths import Order
from pcsg.growth.seasons import elongation, fading
from pcsg.growth.species import Species

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Keys = NDArray[np.uint64]

FADED = 0.02
"""A fading branch with a smaller factor is left out."""

STUB_YEARS = 3.0
"""How long a stub stays."""

SCAR_YEARS = 10.0
"""How long the scar of a lost branch is seen."""

_STRAIGHT = 0.05
"""Below this sine between a branch and its target, its axis of bending turns to a sure one."""


MOST_NODES = 400_000
"""Internodes of a tree at most; three times a cottonwood of 27 years."""


def check_nodes(count: int, now: Instant) -> None:
    """Refuse a tree of too many internodes.

    Raises
    ------
    UsageError
        With what makes it smaller.
    """
    if count > MOST_NODES:
        raise UsageError(
            f"the tree has more than {MOST_NODES:,} internodes at t = {now.t:g}; an earlier time, "
            "a larger `smin` or fewer metamers in `G_m` makes it smaller"
        )


@dataclass(frozen=True)
class Drawn:
    """Branches of one order at time t: n branches, s shoots, k nodes.

    Attributes
    ----------
    rows : (n,)
        Rows of the order; the last ones, `ghosts` in number, are lost but have stubs.
    length, factor, cap : (n,)
        Length now, factor of shedding, cap of the radius.
    start, axis : (n, 3)
        h0 and the axis of bending.
    first, count : (n,)
        Their nodes.
    shoot_m : (s,)
        Metamers of shoots, also those that do not grow yet.
    position, direction : (k, 3)
        Of nodes.
    along, branch, year, metamer, of_shoot, radius : (k,)
        Likewise; `metamer` from 1 within the shoot, `of_shoot` -1 at a base; radius without factor.
    """

    rows: Ints
    ghosts: int
    length: Floats
    factor: Floats
    cap: Floats
    start: Floats
    axis: Floats
    first: Ints
    count: Ints
    shoot_m: Ints
    position: Floats
    direction: Floats
    along: Floats
    branch: Ints
    year: Ints
    metamer: Ints
    of_shoot: Ints
    radius: Floats


@dataclass(frozen=True)
class Instant:
    """A time: the year it lies in, from 1, and the part of it that is over."""

    t: float
    year: int
    tau: float


def instant(t: float) -> Instant:
    """Return the year of a time > 0 and the part of it that is over, in (0, 1]."""
    year = max(1, math.ceil(t))
    return Instant(t, year, t - (year - 1))


def thickness(species: Species, rest: Floats) -> Floats:
    """Return the radius of a limb by the distance from its tip, before the cap."""
    r = species.radius
    return np.asarray(r.r_tip + r.k * np.maximum(rest, 0.0) ** r.p)


def lengths_at(species: Species, order: Order, rows: Ints, now: Instant) -> Floats:
    """Return lengths of branches at an instant; of lost ones, those when they died."""
    last = np.minimum(order.death[rows], now.year)
    m = order.metamers[rows, last]
    before = order.lengths[rows, last - 1]
    whole = order.lengths[rows, last] - before
    grows = last == now.year
    done = np.ones(len(rows))
    of_row = np.repeat(np.flatnonzero(grows), m[grows])
    j = np.arange(len(of_row)) - np.repeat(np.cumsum(m[grows]) - m[grows], m[grows]) + 1
    parts = elongation(species, now.tau, j, m[of_row])
    done[grows] = np.bincount(of_row, parts, minlength=len(rows))[grows] / np.maximum(m[grows], 1)
    return np.asarray(before + whole * done)


def draw_order(
    species: Species,
    order: Order,
    keys: Keys,
    now: Instant,
    number: int,
    parents: Drawn | None,
    of_parent: Ints,
) -> Drawn:
    """Return the branches of an order.

    Parameters
    ----------
    keys : (rows of the order,)
        Names of its branches.
    number
        The order.
    parents, of_parent
        What bears them, and the local numbers of rows of the order below there, -1 where missing.
    """
    alive = order.living(now.year)
    factor = np.where(order.death == now.year, fading(species, now.tau), 1.0)
    wanted = np.flatnonzero(alive & (factor >= FADED))
    ghosts = np.zeros(0, np.int64)
    if parents is not None:
        wanted = wanted[of_parent[order.parent[wanted]] >= 0]
        if 0 < number <= species.scar.lost:
            since = now.t - (order.death - 1 + species.season.shed[0])
            lost = (since > 0.0) & (since < SCAR_YEARS) & ~(alive & (factor >= FADED))
            ghosts = np.flatnonzero(lost)
            ghosts = ghosts[of_parent[order.parent[ghosts]] >= 0]
    rows = np.concatenate([wanted, ghosts])
    length = lengths_at(species, order, rows, now)
    has_length = length > 0.0
    n_ghosts = int(has_length[len(wanted) :].sum())
    rows, length = rows[has_length], length[has_length]
    factor = factor[rows]

    if parents is None:
        start, axis, cap, foot = _start_trunk(rows)
    else:
        above = of_parent[order.parent[rows]]
        start, axis, cap, foot = _start_laterals(
            species, order, keys, rows, length, number, parents, above
        )
    return _draw_shoots(
        species, order, keys, now, rows, n_ghosts, length, factor, start, axis, cap, foot
    )


def _start_trunk(rows: Ints) -> tuple[Floats, Floats, Floats, Floats]:
    up, x = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    n = len(rows)
    return up[:n], x[:n], np.ones(n), np.zeros((n, 3))


def seats_of(order: Order, rows: Ints, parents: Drawn, above: Ints) -> Ints:
    """Return the nodes of the bearers at which branches leave them."""
    return np.asarray(parents.first[above] + order.metamer[rows])


def _start_laterals(
    species: Species,
    order: Order,
    keys: Keys,
    rows: Ints,
    length: Floats,
    number: int,
    parents: Drawn,
    above: Ints,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return h0, the axis of bending, the cap of the radius, and the foot of laterals."""
    angles = species.angles
    seat = seats_of(order, rows, parents, above)
    d = parents.direction[seat]
    b_p = parents.axis[above]
    u = _unit(b_p - d * _dot(d, b_p))
    w = np.cross(d, u)
    noise = angles.azimuth_noise * normal(derive(keys[rows], AZIMUTH))
    phi = np.radians(species.phyllotaxis * order.metamer[rows] + noise)
    first = order.lengths[rows, order.born[rows] + 1]
    q = np.minimum(1.0, first / species.lsmax)
    size = np.minimum(1.0, length / species.lmax)
    beta = np.radians(angles.short + (angles.long - angles.short) * np.sqrt(q) + angles.sag * size)
    around = np.cos(phi)[:, None] * u + np.sin(phi)[:, None] * w
    h0 = np.cos(beta)[:, None] * d + np.sin(beta)[:, None] * around
    target = d
    if number >= 2:
        target = _unit((1.0 - angles.tropism) * d + angles.tropism * np.array([0.0, 0.0, 1.0]))
    across = np.cross(h0, target)
    sine = np.linalg.norm(across, axis=1)
    # Where a branch begins in the direction of its target, u takes over, without a jump.
    axis = _unit(across + np.maximum(0.0, 1.0 - sine / _STRAIGHT)[:, None] * u)
    cap = np.minimum(1.0, species.radius.cap * parents.radius[seat] / thickness(species, length))
    return h0, axis, cap, parents.position[seat]


def _draw_shoots(
    species: Species,
    order: Order,
    keys: Keys,
    now: Instant,
    rows: Ints,
    ghosts: int,
    length: Floats,
    factor: Floats,
    start: Floats,
    axis: Floats,
    cap: Floats,
    foot: Floats,
) -> Drawn:
    """Return branches with the nodes of all their shoots."""
    n = len(rows)
    born, last = order.born[rows], np.minimum(order.death[rows], now.year)
    years = last - born
    branch = np.repeat(np.arange(n), years)
    year = born[branch] + 1 + np.arange(len(branch)) - np.repeat(np.cumsum(years) - years, years)
    row = rows[branch]
    m = order.metamers[row, year]
    l0 = order.lengths[row, year - 1]
    whole = order.lengths[row, year] - l0
    grows = year == now.year

    # Metamers, those that have begun to elongate.
    check_nodes(int(m.sum()), now)
    shoot = np.repeat(np.arange(len(branch)), m)
    j = np.arange(len(shoot)) - np.repeat(np.cumsum(m) - m, m) + 1
    share = j / m[shoot]
    g = np.flatnonzero(grows[shoot])
    part = elongation(species, now.tau, j[g], m[shoot[g]])
    share[g] = _running_sums(part, shoot[g]) / m[shoot[g]]
    begun = np.ones(len(shoot), np.bool_)
    begun[g] = part > 0.0
    grown = np.where(grows, 0.0, 1.0)
    grown[shoot[g]] = share[g]  # the last metamer's stays

    # Directions: the heading by the place of the shoot's middle on the branch (8), (9).
    end = l0 + whole * grown
    middle = 0.5 * (l0 + end) / length[branch]
    s = np.minimum(1.0, length / species.lmax)[branch]
    theta = (1.0 - s) * species.curves["G_o1"](middle) + s * species.curves["G_o2"](middle)
    theta = np.where(row_is_trunk(order, row), 0.0, theta)
    key = derive(keys[row], year)
    turn = species.angles.noise * normal(derive(key, HEADING))
    aside = species.angles.noise * normal(derive(key, SIDEWAYS))
    b = axis[branch]
    direction = rotate(start[branch], b, np.radians(theta + turn))
    direction = rotate(direction, np.cross(b, direction), np.radians(aside))

    # Places: shoots end where the next ones begin.
    step = direction * (whole * grown)[:, None]
    before = _running_sums(step, branch) - step + foot[branch]

    kept = np.flatnonzero(begun)
    shoot, j, share = shoot[kept], j[kept], share[kept]
    position = before[shoot] + direction[shoot] * (whole[shoot] * share)[:, None]
    along = l0[shoot] + whole[shoot] * share
    nodes = np.bincount(branch[shoot], minlength=n)
    first = np.cumsum(nodes + 1) - (nodes + 1)
    at = np.arange(len(shoot)) + branch[shoot] + 1
    k = len(shoot) + n
    first_shoot = np.cumsum(years) - years

    def with_bases(of_base: NDArray[Any], of_node: NDArray[Any]) -> NDArray[Any]:
        found = np.empty((k, *of_node.shape[1:]), of_node.dtype)
        found[first], found[at] = of_base, of_node
        return found

    of_branch = with_bases(np.arange(n), branch[shoot])
    all_along = with_bases(np.zeros(n), along)
    rest = length[of_branch] - all_along
    return Drawn(
        rows=rows,
        ghosts=ghosts,
        length=length,
        factor=factor,
        cap=cap,
        start=start,
        axis=axis,
        first=first,
        count=nodes + 1,
        shoot_m=m,
        position=with_bases(foot, position),
        direction=with_bases(direction[first_shoot], direction[shoot]),
        along=all_along,
        branch=of_branch,
        year=with_bases(np.zeros(n, np.int64), year[shoot]),
        metamer=with_bases(np.zeros(n, np.int64), j),
        of_shoot=with_bases(np.full(n, -1), shoot),
        radius=cap[of_branch] * thickness(species, rest),
    )


def row_is_trunk(order: Order, row: Ints) -> NDArray[np.bool_]:
    """Return which rows are the trunk, whose heading is straight up."""
    return np.asarray(order.parent[row] < 0)


def rotate(v: Floats, axis: Floats, angle: Floats) -> Floats:
    """Return vectors (n, 3) rotated about unit axes by angles in radians (Rodrigues)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.asarray(c * v + s * np.cross(axis, v) + (1.0 - c) * _dot(axis, v) * axis)


def _running_sums(values: Floats, group: Ints) -> Floats:
    """Return sums from the beginning of each group; groups are consecutive."""
    if not len(values):
        return values
    # Subtracting totals of other groups would lose digits; each group is summed by itself.
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    place = np.arange(len(group)) - np.repeat(starts, np.diff(starts, append=len(group)))
    found = values.copy()
    for k in range(1, int(place.max()) + 1):
        rows = np.flatnonzero(place == k)
        found[rows] += found[rows - 1]
    return found


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", a, b)[:, None])


def _unit(v: Floats) -> Floats:
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))
