"""Trees: fields of skeletons, with smooth, contact and aged junctions.

After Galbraith, MacMurchy, Wyvill 2004: one cone per internode; the one below is shortened so that
a sum does not bulge; branches that leave one node press each other (precise contact), which makes
the ridge of bark in the axil, the collar of a thin lateral, and a smooth flow into a thick one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.fields import REACH
from pcsg.blobtree.frames import carried_turns, frames_of
from pcsg.blobtree.nodes import (
    Cones,
    Field,
    bend,
    color,
    cone,
    joint,
    pcm,
    place,
    point,
    segment,
    total,
    turn_about_z,
    weight,
)
from pcsg.blobtree.turtle import Skeleton
from pcsg.errors import UsageError

Array = NDArray[np.float64]
Colour = tuple[float, float, float]

SMOOTH, CONTACT, AGED = "smooth", "contact", "aged"
MODES = (SMOOTH, CONTACT, AGED)

LEAST_BEND = 1e-6
"""Degrees; less is none."""

SHORTEST = 0.05
"""What is left of an internode's length at least."""


@dataclass(frozen=True)
class Junctions:
    """How a tree's internodes meet.

    Attributes
    ----------
    mode
        ``smooth`` (sum), ``contact`` (branches of one node press each other) or ``aged`` (they
        press each other in the upper angle only, where the ridge of bark is).
    printed
        Shorten the lower internode by 1.75 times the top radius of the upper one, and by 2.75 times
        the base radius at forks, as the papers print, instead of by the geometric mean of both,
        which is nearest to no bulge and no notch where branches taper.
    bend
        Angle by which laterals are bent: first away from their bearer, then back.
    tip
        Top radius of a last internode over its base radius.
    buds
        Whether tips end in buds.
    amplitude
        Greatest share of contact in an aged junction.
    """

    mode: str = CONTACT
    printed: bool = False
    bend: float = 0.0
    tip: float = 0.3
    buds: bool = True
    amplitude: float = 0.9

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise UsageError(f"junctions are one of {', '.join(MODES)}, not `{self.mode}`")


def merge_short(s: Skeleton) -> Skeleton:
    """Join internodes that are shorter than they are thick to the next one of their axis."""
    n = len(s.base)
    start, end, base, top = s.start.copy(), s.end.copy(), s.base.copy(), s.top.copy()
    parent = s.parent.copy()
    children = np.bincount(parent[parent >= 0], minlength=n)
    gone = np.zeros(n, np.bool_)
    length = np.linalg.norm(end - start, axis=1)
    # From the top down, so that chains of short ones become one.
    only = np.full(n, -1)
    only[parent[parent >= 0]] = np.flatnonzero(parent >= 0)
    for i in range(n - 1, -1, -1):
        j = int(only[i])
        if children[i] != 1 or s.lateral[j] or length[i] >= 1.75 * (base[j] + top[j]):
            continue
        along = float((end[i] - start[i]) @ (end[j] - start[j]))
        if along < 0.8 * length[i] * length[j]:
            continue
        # j takes the place of i.
        end[i], top[i], gone[j] = end[j], top[j], True
        length[i] = np.linalg.norm(end[i] - start[i])
        children[i], only[i] = children[j], only[j]
        parent[parent == j] = i
    kept = np.flatnonzero(~gone)
    number = np.full(n + 1, -1)
    number[kept] = np.arange(len(kept))
    return Skeleton(
        start[kept], end[kept], base[kept], top[kept], number[parent[kept]],
        s.lateral[kept], s.colour[kept],
    )  # fmt: skip


class _Plan:
    """What is derived from a skeleton before fields are made."""

    def __init__(self, s: Skeleton, j: Junctions, palette: Sequence[Colour]) -> None:
        self.s, self.j, self.palette = s, j, palette
        n = len(s.base)
        self.children: list[list[int]] = [[] for _ in range(n)]
        for k in range(n):
            if s.parent[k] >= 0:
                self.children[s.parent[k]].append(k)
        vector = s.end - s.start
        self.length = np.linalg.norm(vector, axis=1)
        if n and self.length.min() <= 0.0:
            raise UsageError("an internode has no length")
        self.axis = vector / self.length[:, None]
        self.base = s.base
        self.top = np.minimum(s.top, s.base)
        tips = np.array([not c for c in self.children], np.bool_)
        self.tips = tips
        self.top = np.where(tips, np.minimum(self.top, j.tip * self.base), self.top)
        self.cut = np.zeros(n)
        self.shift = np.zeros(n)
        for a, children in enumerate(self.children):
            self._offset(a, children)
        self.cut = np.minimum(self.cut, (1.0 - SHORTEST) * self.length)
        self.shift = np.minimum(self.shift, 0.5 * self.length)

    @cached_property
    def coordinates(self) -> tuple[Array, Array]:
        """Turns from every internode's own frame to u = 0, and lengths of axes below (N,)."""
        below = np.where(self.s.lateral, -1, self.s.parent)
        along = np.zeros(len(self.base))
        for k in np.flatnonzero(below >= 0).tolist():
            along[k] = along[below[k]] + self.length[below[k]]
        return carried_turns(self.axis, below), along

    def joined(self, k: int) -> float:
        """Return how much the internode below the k-th is shortened by its radius."""
        radius = self.top[k] if self.j.printed else math.sqrt(self.base[k] * self.top[k])
        return float(1.75 * radius)

    def _offset(self, a: int, children: Sequence[int]) -> None:
        if not children:
            return
        r_a = float(self.top[a])
        if len(children) == 1:
            self.cut[a] = self.joined(children[0])
            return
        most = max(float(self.base[c]) for c in children)
        if self.j.mode == CONTACT:
            reach = 1.75 * most if self.j.printed else max(self.joined(c) for c in children)
            self.cut[a] = max(reach + most - r_a, 0.0)
            for c in children:
                self.shift[c] = max(r_a - float(self.base[c]), 0.0)
            return
        leader = self.leader(children)
        self.cut[a] = self.joined(leader if leader >= 0 else children[0])
        if self.j.mode == SMOOTH:
            return
        for c in children:
            if c != leader:
                sine = max(float(np.linalg.norm(_cross(self.axis[a], self.axis[c]))), 0.2)
                r_c = float(self.base[c])
                self.shift[c] = max(r_a - r_c, (1.75 * r_c - r_a) / sine, 0.0)

    def leader(self, children: Sequence[int]) -> int:
        """Return the child that goes on with the axis, -1 if none does."""
        going_on = [c for c in children if not self.s.lateral[c]]
        return going_on[0] if going_on else -1


def grow(
    skeleton: Skeleton, junctions: Junctions | None = None, palette: Sequence[Colour] = ()
) -> Field:
    """Return the field of a skeleton.

    Parameters
    ----------
    skeleton
        Internodes, parents before children, at least one.
    palette
        Linear colours of the wood by the numbers of the internodes' colours, the last one for all
        beyond; none if it is not painted.

    Raises
    ------
    UsageError
        It has none, or one without length.
    """
    j = junctions or Junctions()
    if not len(skeleton.base):
        raise UsageError("the skeleton has no internodes")
    plan = _Plan(merge_short(skeleton), j, palette)
    if j.mode == CONTACT:
        return _nest(plan)
    base = _wood(plan, list(range(len(plan.base))))
    if j.mode == SMOOTH:
        return base
    return _aged(plan, base)


def _wood(plan: _Plan, numbers: Sequence[int]) -> Field:
    """Return the sum of some internodes, with their buds, painted."""
    if not plan.palette:
        return _unpainted(plan, numbers)
    last = len(plan.palette) - 1
    groups: dict[int, list[int]] = {}
    for k in numbers:
        groups.setdefault(min(int(plan.s.colour[k]), last), []).append(k)
    parts = [color(*plan.palette[c], _unpainted(plan, group)) for c, group in groups.items()]
    return parts[0] if len(parts) == 1 else total(*parts)


def _unpainted(plan: _Plan, numbers: Sequence[int]) -> Field:
    straight = [k for k in numbers if not _is_bent(plan, k)]
    parts: list[Field] = []
    if straight:
        k = np.array(straight)
        start = plan.s.start[k] + plan.axis[k] * plan.shift[k, None]
        rest = plan.length[k] - plan.cut[k] - plan.shift[k]
        rest = np.maximum(rest, SHORTEST * plan.length[k])
        parts.append(
            Cones(
                start,
                plan.axis[k] * rest[:, None],
                plan.base[k] - plan.top[k],
                REACH * plan.top[k],
                _coordinates(plan, k),
            )
        )
    parts += [_bent(plan, k) for k in numbers if _is_bent(plan, k)]
    if plan.j.buds:
        parts += [_bud(plan, k) for k in numbers if plan.tips[k]]
    return parts[0] if len(parts) == 1 else total(*parts)


def _coordinates(plan: _Plan, k: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return turns to add to u, and v at the foot.

    u is 0 along a line that is carried without a twist from internode to internode of an axis, and
    v is the length of the axis from its beginning.
    """
    turns, along = plan.coordinates
    return np.stack([turns[k], (along + plan.shift)[k]], axis=1).astype(np.float32)


def _is_bent(plan: _Plan, k: int) -> bool:
    if abs(plan.j.bend) < LEAST_BEND or not plan.s.lateral[k] or plan.s.parent[k] < 0:
        return False
    return bool(np.linalg.norm(_cross(plan.axis[k], plan.axis[plan.s.parent[k]])) > 0.05)


def _bent(plan: _Plan, k: int) -> Field:
    """Return a lateral, bent in the plane of it and its bearer; its ends stay where they are."""
    c, d = plan.axis[k], plan.axis[plan.s.parent[k]]
    away = (d @ c) * c - d
    away /= np.linalg.norm(away)
    length = max(plan.length[k] - plan.cut[k] - plan.shift[k], SHORTEST * plan.length[k])
    # Not more than the thickness allows: |k| R <= 0.8.
    reach = (plan.base[k] - plan.top[k]) + REACH * plan.top[k]
    t = min(abs(math.radians(plan.j.bend)), 0.8 * length / reach, 2.5)
    arc = length * (0.5 * t) / math.sin(0.5 * t)
    tilt = 0.5 * t
    z = math.cos(tilt) * c + math.sin(tilt) * away
    x = math.cos(tilt) * away - math.sin(tilt) * c
    frame = np.stack([x, _cross(z, x), z, plan.s.start[k] + plan.shift[k] * c], axis=1)
    # u = 0 is where the next internode of the branch has it; in the middle of the arc x is `away`.
    zero = frames_of(c[None])[0][0]
    turn = math.atan2(float(zero @ _cross(c, away)), float(zero @ away))
    wood = cone(arc, float(plan.base[k]), float(plan.top[k]))
    wood = place(turn_about_z(math.degrees(turn)), wood)
    return place(frame, bend(-math.degrees(t), wood))


def _cross(a: Array, b: Array) -> Array:
    """Return the product of two vectors (3,); that of NumPy takes twenty times as long for one."""
    x, y, z = a.tolist()
    u, v, w = b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def _frame(axis: Array, origin: Array) -> Array:
    side = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.8 else np.array([0.0, 1.0, 0.0])
    x = _cross(side, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, _cross(axis, x), axis, origin], axis=1)


def _bud(plan: _Plan, k: int) -> Field:
    """Return a bud at the end of a tip: longer than thick, a little thicker than the tip."""
    r = 1.1 * float(plan.top[k])
    shape = np.diag([r, r, 2.6 * r])
    frame = _frame(plan.axis[k], plan.s.end[k] + 0.6 * r * plan.axis[k])
    return place(np.concatenate([frame[:, :3] @ shape, frame[:, 3:]], axis=1), point(1.0))


def _nest(plan: _Plan) -> Field:
    """Return contact: F_A + PCM(F_B0, F_B1, ...), nested along the tree."""
    n = len(plan.base)
    fields: list[Field | None] = [None] * n
    for k in range(n - 1, -1, -1):
        # A run of single children is one sum; it is made where the run begins.
        parent = int(plan.s.parent[k])
        if parent >= 0 and len(plan.children[parent]) == 1:
            continue
        run, at = [k], k
        while len(plan.children[at]) == 1:
            at = plan.children[at][0]
            run.append(at)
        wood = _wood(plan, run)
        if plan.children[at]:
            above = [f for f in (fields[c] for c in plan.children[at]) if f is not None]
            wood = total(wood, pcm(*above))
        fields[k] = wood
    roots = [f for k, f in enumerate(fields) if plan.s.parent[k] < 0 and f is not None]
    return roots[0] if len(roots) == 1 else pcm(*roots)


def _aged(plan: _Plan, base: Field) -> Field:
    """Return a sum with contact in the upper angles of laterals: ridges of bark."""
    junctions = []
    for a, children in enumerate(plan.children):
        if len(children) < 2:
            continue
        leader = plan.leader(children)
        for c in children:
            if c == leader:
                continue
            other = leader if leader >= 0 else next(o for o in children if o != c)
            junctions.append(ridge(plan, a, other, c))
            if leader < 0:
                break
    return joint(base, *junctions) if junctions else base


def ridge(plan: _Plan, a: int, p: int, c: int) -> tuple[Field, Field, Field]:
    """Return the bound of a bark ridge and its two partners, without offsets.

    The bound is a segment across the plane of both branches, where their upper sides meet
    (growing trees, section 7.3).
    """
    d, e = plan.axis[p], plan.axis[c]
    r_p, r_c = float(plan.base[p]), float(plan.base[c])
    cos = float(np.clip(d @ e, -0.95, 0.98))
    sine = math.sqrt(1.0 - cos * cos)
    normal = _cross(d, e)
    size = float(np.linalg.norm(normal))
    # Of parallel branches any plane will do.
    normal = normal / size if size > 1e-9 else _frame(d, d)[:, 0]
    outwards = e - d * cos
    outwards /= max(float(np.linalg.norm(outwards)), 1e-9)
    middle = plan.s.end[a] + d * (r_c + r_p * cos) / sine + outwards * r_p
    half, reach = 0.9 * r_p, 0.8 * (r_c + r_p)
    frame = _frame(normal, middle - half * normal)
    bound = weight(plan.j.amplitude, place(frame, segment(2.0 * half, reach / REACH)))
    return bound, _axis_field(plan, [a, p]), _axis_field(plan, [c])


def _axis_field(plan: _Plan, numbers: Sequence[int]) -> Field:
    k = np.array(numbers)
    return Cones(
        plan.s.start[k],
        plan.axis[k] * plan.length[k, None],
        plan.base[k] - plan.top[k],
        REACH * plan.top[k],
    )
