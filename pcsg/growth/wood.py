"""From a tree at one instant to the field of its wood.

Each branch is the *union* of its cones, and branches are summed. Galbraith, Muendermann, Wyvill
2004 sum the cones of a branch, too, and shorten each where the next begins, so that the sum bulges
but little; where shoots are shorter than they are thick nothing is left to shorten. A union of
cones that share their radii where they meet does not bulge at all, however short they are, so none
need be joined to others while a tree grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.boxes import along_curve
from pcsg.blobtree.fields import REACH
from pcsg.blobtree.frames import carried_turns
from pcsg.blobtree.nodes import Cones, Field, joint, paint, place, point, total, weight
from pcsg.growth.curves import smooth_step
from pcsg.growth.geometry import SCAR_YEARS, STUB_YEARS
from pcsg.growth.relief import Relief, find_relief
from pcsg.growth.state import State

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TIP = 0.02
"""Length over which the end of a branch tapers, and how far, as a part of its radius there."""

TIP_RADIUS = 0.3

FOOT_DEPTH, FOOT_FLARE, FOOT_HEIGHT = 2.0, 1.35, 2.5
"""In radii of the trunk's foot: how deep it goes into the ground, its radius there, and the height
from which it widens."""

BARK_RADII, BARK_SHADES = (0.004, 0.04), 8
"""Radii, in metres, between which bark goes from a twig's to a trunk's; in how many steps."""

BUD_RADII, BUD_LENGTH, BUD_SHADE = (0.22, 0.05), 0.8, 0.7
"""Of a bud, in its length: radii of foot and tip, length of its axis; how light beside bark."""

THINNEST = 2e-4
"""Of limbs, in metres: what is thinner has no field."""


@dataclass(frozen=True)
class Pieces:
    """Cones of all branches, P of them, in the order of branches and from bases to tips.

    Attributes
    ----------
    branch
        Rows in `Branches`.
    start, end : (P, 3)
        Ends of the axis.
    base, top
        Radii there; the top is not thicker.
    along, length
        Arc length from the branch's base to the start, and from start to end.
    """

    branch: Ints
    start: Floats
    end: Floats
    base: Floats
    top: Floats
    along: Floats
    length: Floats

    def __len__(self) -> int:
        return len(self.branch)

    @cached_property
    def begin(self) -> Ints:
        """Where the pieces of every branch begin, and the end of the last one's."""
        return np.searchsorted(self.branch, np.arange(int(self.branch.max(initial=-1)) + 2))

    @cached_property
    def turns(self) -> Floats:
        """Turns to add to u, so that u = 0 is one line along a branch, (P,)."""
        axis = self.end - self.start
        axis /= np.maximum(np.linalg.norm(axis, axis=1), 1e-300)[:, None]
        same = np.diff(self.branch, prepend=-1) == 0
        return carried_turns(axis, np.where(same, np.arange(len(self)) - 1, -1))

    def cones(self, rows: Ints, blend: str = "union") -> Cones:
        """Return the field of some of them."""
        base, top = self.base[rows], self.top[rows]
        uv = np.stack([self.turns[rows], self.along[rows]], axis=1).astype(np.float32)
        return Cones(
            self.start[rows], self.end[rows] - self.start[rows], base - top, REACH * top, uv, blend
        )


def find_pieces(state: State) -> Pieces:
    """Return the cones of a tree: two for each shoot, however many internodes it has.

    The internodes of a shoot lie on a line, and its radius is almost linear along it. Laterals
    begin so far from the axis of their bearer that the sum does not bulge on its other side.
    """
    n, b = state.nodes, state.branches
    ends = np.append(n.branch[1:] != n.branch[:-1], True) | np.append(
        n.year[1:] != n.year[:-1], True
    )
    kept = np.flatnonzero((n.year == 0) | ends | (n.metamer == n.of // 2))
    rest = b.length[n.branch[kept]] - n.along[kept]
    taper = (1.0 - TIP_RADIUS) * (1.0 - smooth_step(rest / TIP))
    end_radius = np.minimum(state.species.radius.r_tip, n.radius[kept])
    radius = np.maximum(n.radius[kept] - taper * end_radius, THINNEST)
    same = n.branch[kept][1:] == n.branch[kept][:-1]
    lower = np.flatnonzero(same)
    i, j = kept[lower], kept[lower + 1]
    branch = n.branch[i]
    along, end_along = n.along[i], n.along[j]
    start, end = n.position[i], n.position[j]
    base, top = radius[lower], radius[lower + 1]

    # Cut off what lies too near to the bearer's axis.
    begin = _displacements(state)[branch]
    share = np.clip((begin - along) / np.maximum(end_along - along, 1e-12), 0.0, 1.0)
    seen = (share < 1.0) & (b.factor[branch] * base > THINNEST)
    share = share[:, None]
    start = (1.0 - share) * start + share * end
    share = share[:, 0]
    base = (1.0 - share) * base + share * top
    along = (1.0 - share) * along + share * end_along
    rows = np.flatnonzero(seen)
    pieces = Pieces(
        branch=branch[rows],
        start=start[rows],
        end=end[rows],
        base=base[rows],
        top=np.minimum(top, base)[rows],
        along=along[rows],
        length=(end_along - along)[rows],
    )
    return _with_foot(pieces)


def _displacements(state: State) -> Floats:
    """Return how far from its bearer's axis every branch begins, along its own (B,)."""
    found = np.zeros(len(state.branches.length))
    lat = state.laterals
    cos = np.einsum("ij,ij->i", lat.bearer, lat.direction)
    sine = np.sqrt(np.maximum(1.0 - cos * cos, 0.01))
    r_p, r_c = lat.bearer_radius, lat.radius
    found[lat.branch] = np.maximum(np.maximum(r_p - r_c, (1.75 * r_c - r_p) / sine), 0.0)
    return found


def _with_foot(p: Pieces) -> Pieces:
    """Return the pieces with a foot of the trunk that goes into the ground and widens."""
    if not len(p) or p.branch[0] != 0:
        return p
    trunk = p.branch == 0
    r = float(p.base[0])
    height = FOOT_HEIGHT * r
    at = min(int(np.searchsorted(p.along[trunk], height, side="right")) - 1, int(trunk.sum()) - 1)
    part = min(1.0, (height - p.along[at]) / max(p.length[at], 1e-12))
    top = p.start[at] + part * (p.end[at] - p.start[at])
    top_radius = p.base[at] + part * (p.top[at] - p.base[at])
    foot = p.start[0] - FOOT_DEPTH * r * np.array([0.0, 0.0, 1.0])
    slope = (FOOT_FLARE * r - top_radius) / max(FOOT_DEPTH * r + height, 1e-12)
    bottom = max(top_radius + slope * (FOOT_DEPTH * r + height), top_radius)
    return Pieces(
        branch=np.concatenate([[0], p.branch]),
        start=np.concatenate([foot[None], p.start]),
        end=np.concatenate([top[None], p.end]),
        base=np.concatenate([[bottom], p.base]),
        top=np.concatenate([[top_radius], p.top]),
        along=np.concatenate([[-FOOT_DEPTH * r], p.along]),
        length=np.concatenate([[FOOT_DEPTH * r + height], p.length]),
    )


def wood_field(state: State, finest: float = 0.004) -> Field:
    """Return the field of a tree's wood.

    Parameters
    ----------
    finest
        Junctions of limbs thinner than this, in metres, are smooth: their scars and ridges are
        smaller than a millimetre.
    """
    pieces = find_pieces(state)
    parts = [*_branches(state, pieces), *_buds(state), *_scars(state)]
    base = total(*parts) if len(parts) > 1 else parts[0]
    known = [
        (junction, relief.united)
        for relief in find_relief(state, finest)
        if (junction := _junction(pieces, relief)) is not None
    ]
    if known:
        base = joint(base, *(j for j, _ in known), united=[u for _, u in known])
    return paint(base, **_rgb(state.species.bark.old))


def _branches(state: State, p: Pieces) -> list[Field]:
    """Return the sums of all branches of a colour: thin ones have the bark of twigs."""
    young, old = np.array(state.species.bark.young), np.array(state.species.bark.old)
    branch = np.unique(p.branch)
    first, last = p.begin[branch], p.begin[branch + 1]
    thick = np.log(p.base[first] / BARK_RADII[0]) / np.log(BARK_RADII[1] / BARK_RADII[0])
    shade = np.rint(BARK_SHADES * smooth_step(thick)).astype(np.int64)
    parts: list[Field] = []
    for k in np.unique(shade).tolist():
        rows = np.flatnonzero(shade == k)
        colour = young + k / BARK_SHADES * (old - young)
        parts.append(paint(_groups(p, first[rows], last[rows]), **_rgb(colour.tolist())))
    return parts


def _buds(state: State) -> list[Field]:
    """Return buds: short cones, longer than thick, blended with what bears them."""
    buds = state.buds
    if not len(buds.size):
        return []
    base, top = BUD_RADII[0] * buds.size, BUD_RADII[1] * buds.size
    axis = BUD_LENGTH * buds.size[:, None] * buds.axis
    colour = BUD_SHADE * np.array(state.species.bark.young)
    return [paint(Cones(buds.position, axis, base - top, REACH * top), **_rgb(colour.tolist()))]


def _groups(p: Pieces, first: Ints, last: Ints) -> Cones:
    """Return the sum of some branches, near ones beside each other."""
    order = along_curve(0.5 * (p.start[first] + p.end[last - 1]))
    count = (last - first)[order]
    groups = np.cumsum(count) - count
    rows = np.arange(count.sum()) - np.repeat(groups, count) + np.repeat(first[order], count)
    return replace(p.cones(rows), groups=groups)


def _junction(p: Pieces, relief: Relief) -> tuple[Field, Field, Field] | None:
    """Return a bound with the pieces of its two partners that it may reach, None without any."""
    sides = []
    for branch, low, high in relief.partners:
        if branch + 1 >= len(p.begin):
            return None  # no piece of it comes out of its bearer
        rows = np.arange(p.begin[branch], p.begin[branch + 1])
        near = (p.along[rows] < high) & (p.along[rows] + p.length[rows] > low)
        if not near.any():
            return None
        sides.append(p.cones(rows[near]))
    return relief.bound, sides[0], sides[1]


def _scars(state: State) -> list[Field]:
    """Return stubs of lost branches, and the scars that they leave, as negative fields."""
    s = state.stubs
    parts: list[Field] = []
    for k in range(len(s.age)):
        r, r_p, age = float(s.radius[k]), float(s.bearer_radius[k]), float(s.age[k])
        if r_p < 0.003 or r < 0.0015:
            continue
        axis = s.axis[k]
        left = 1.0 - float(smooth_step(age / STUB_YEARS))
        cos = float(s.bearer[k] @ axis)
        bark = r_p / max(np.sqrt(max(1.0 - cos * cos, 0.0)), 0.3)
        if left > 0.02:
            radius = r * (0.4 + 0.6 * left)
            end = s.position[k] + axis * (bark + 0.5 * r * left)
            begin = s.position[k] + axis * max(r_p - radius, 0.0)
            parts.append(
                Cones(
                    begin[None],
                    (end - begin)[None],
                    np.array([0.0]),
                    np.array([REACH * radius * max(left, 0.1)]),
                )
            )
        dig = 0.4 * (1.0 - float(smooth_step(age / SCAR_YEARS))) * (1.0 - left)
        if dig > 0.01:
            at = s.position[k] + axis * bark
            frame = np.concatenate([np.eye(3), at[:, None]], axis=1)
            parts.append(weight(-dig, place(frame, point(1.5 * r / REACH))))
    return parts


def _rgb(colour: Sequence[float]) -> dict[str, float]:
    return dict(zip(("@red", "@green", "@blue"), colour, strict=True))
