"""Exact boxes of states by branch and bound over support functions.

The *support* of a solid in a direction d is the largest ``p . d`` over its points. It is known for
primitives, passes through matrices without loss (by the transpose), is the largest of the operands'
for a union, at most the smallest for an intersection, and at most the first operand's for a
difference. So boxes come from the primitives and never from re-boxed boxes, and rotations do not
make them grow (paper section 5, fig 9). Boxes and balls of what lies below only prune the search:
they are upper bounds, hence everything here is conservative.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.code import compose_affine
from pcsg.graph.nodes import Leaf
from pcsg.graph.operators import DIFFERENCE, INTERSECTION
from pcsg.graph.states import LeafStep, OperationStep, StateGraph, StateStep, Step, UnaryStep
from pcsg.vec import IDENTITY, Affine, Vec3

Bounds = tuple[float, float, float, float, float, float]
"""Lower x, y, z, upper x, y, z; lower above upper where empty."""

Direction = tuple[float, float, float]

INF = math.inf
EMPTY: Bounds = (INF, INF, INF, -INF, -INF, -INF)
EVERYTHING: Bounds = (-INF, -INF, -INF, INF, INF, INF)

TOLERANCE = 1e-9
"""Relative to the size of what is bounded."""

QUERY_EXPANSIONS = 2_000
"""Most expansions for one direction of one solid; then its upper bound stands."""

TOTAL_EXPANSIONS = 100_000
"""Most expansions for a graph."""

_NESTED = 6
"""Intersections within intersections that are searched; deeper ones give their upper bound."""

_WIDE = 24
"""Operands of a union from which on their bounds are computed as arrays."""

_DIRECTIONS: tuple[Direction, ...] = (
    (-1.0, 0.0, 0.0),
    (0.0, -1.0, 0.0),
    (0.0, 0.0, -1.0),
    (1.0, 0.0, 0.0),
    (0.0, 1.0, 0.0),
    (0.0, 0.0, 1.0),
)


_ORIGIN = Vec3(0.0, 0.0, 0.0)


class Part(NamedTuple):
    """A hull in the frame of another one."""

    outer_from_inner: Affine
    hull: Hull


@dataclass(slots=True, eq=False)
class Hull:
    """What bounding needs to know of a solid.

    Attributes
    ----------
    box
        Exact to the tolerance, in its own frame.
    center, radius
        A ball that contains it; the radius is infinite where the box is.
    parts
        Operands of a union or an intersection; nothing for a primitive.
    is_intersection
        Whether the parts are intersected.
    leaf, args
        The primitive.
    wide
        Matrices (n, 12) and boxes (n, 6) of many parts, None for few.
    """

    box: Bounds = EVERYTHING
    center: Vec3 = _ORIGIN
    radius: float = INF
    parts: tuple[Part, ...] = ()
    is_intersection: bool = False
    leaf: Leaf | None = None
    args: tuple[float, ...] = ()
    wide: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    @property
    def is_bounded(self) -> bool:
        """Whether the box is finite."""
        return all(map(math.isfinite, self.box))


class Hulls:
    """Hulls of all states of a graph without cycles.

    Parameters
    ----------
    states
        The states.
    bounded_only
        Leave out what is unbounded in unions, such as a half-space for the ground: what remains
        can be framed by a camera.

    Attributes
    ----------
    parts
        The solid of every state, None where it is empty.
    visits
        For every state the steps of its right-hand side, each with the solid below it in the
        frame of the visited node.
    tolerance
        Of the boxes, relative to the size of what is bounded.
    expansions, capped
        How much was searched, and whether a search ended at its limit.
    """

    def __init__(self, states: StateGraph, bounded_only: bool = False) -> None:
        self.states = states
        self.bounded_only = bounded_only
        self.tolerance = TOLERANCE
        self.expansions = 0
        self.capped = False
        self._leaves: dict[tuple[object, ...], Part | None] = {}
        self._boxes: dict[tuple[int, Affine], Bounds] = {}
        self.parts: list[Part | None] = [None] * len(states.states)
        self.visits: list[list[tuple[Step, Part | None]]] = [[] for _ in states.states]
        for k in states.children_first:
            visits = self.visits[k] = self._visit(k)
            self.parts[k] = visits[-1][1] if visits else None

    def _visit(self, k: int) -> list[tuple[Step, Part | None]]:
        """Return every visit of a state with the solid below it, in the visited node's frame."""
        found: list[tuple[Step, Part | None]] = []
        stack: list[Part | None] = []
        for step in self.states.states[k].steps:
            if isinstance(step, UnaryStep):
                below = stack.pop()
                m = step.outer_from_inner
                if below is not None and m is not None:
                    below = Part(compose_affine(m, below.outer_from_inner), below.hull)
                stack.append(below)
            elif isinstance(step, StateStep):
                stack.append(self.parts[step.state])
            elif isinstance(step, LeafStep):
                stack.append(self.leaf_part(step))
            else:
                at = len(stack) - step.arity
                operands = stack[at:]
                del stack[at:]
                stack.append(self.combine(step, operands))
            found.append((step, stack[-1]))
        return found

    def leaf_part(self, step: LeafStep) -> Part | None:
        """Return the hull of a primitive, None where it is empty."""
        node = self.states.graph.nodes[step.node]
        assert isinstance(node, Leaf)
        key = node.solid, node.constants, step.args
        if key not in self._leaves:
            self._leaves[key] = self._finish(Hull(leaf=node, args=step.args))
        return self._leaves[key]

    def combine(self, step: OperationStep, operands: list[Part | None]) -> Part | None:
        """Return the hull of an operation, None where it is empty."""
        if step.operator is DIFFERENCE:
            return operands[0]
        if step.operator is INTERSECTION:
            parts = [p for p in operands if p is not None]
            if len(parts) < len(operands):
                return None
            return self._finish(Hull(parts=tuple(parts), is_intersection=True))
        parts = [p for p in operands if p is not None]
        if self.bounded_only:
            # A union of unbounded solids only stays, to be bounded by an intersection above it.
            parts = [p for p in parts if p.hull.is_bounded] or parts
        if len(parts) <= 1:
            return parts[0] if parts else None
        return self._finish(Hull(parts=tuple(parts)))

    def _finish(self, hull: Hull) -> Part | None:
        """Compute a new hull's box and ball; None for an empty one."""
        if len(hull.parts) > _WIDE and not hull.is_intersection:
            hull.wide = (
                np.array([p.outer_from_inner for p in hull.parts]),
                np.array([p.hull.box for p in hull.parts]),
            )
        if hull.parts:
            # The ball first: it gives the search of the box its scale.
            near = [self._box_of_box(p) for p in hull.parts]
            around = near[0] if hull.is_intersection else join_all(near)
            hull.center, hull.radius = self._ball(hull, around)
        hull.box = self._search_box(Part(IDENTITY, hull), None)
        if any(hull.box[i] > hull.box[i + 3] for i in range(3)):
            return None
        if hull.is_bounded:
            center, radius = self._ball(hull, hull.box)
            if radius < hull.radius:
                hull.center, hull.radius = center, radius
        return Part(IDENTITY, hull)

    def _box_of_box(self, part: Part) -> Bounds:
        m, hull = part
        lower, upper = [], []
        for i in range(3):
            row = m[4 * i : 4 * i + 3]
            ends = [
                sorted((a * hull.box[j], a * hull.box[j + 3])) for j, a in enumerate(row) if a != 0
            ]
            lower.append(m[4 * i + 3] + sum(e[0] for e in ends))
            upper.append(m[4 * i + 3] + sum(e[1] for e in ends))
        return (lower[0], lower[1], lower[2], upper[0], upper[1], upper[2])

    def _ball(self, hull: Hull, box: Bounds) -> tuple[Vec3, float]:
        """Return a ball about the middle of a box that contains the hull or the box."""
        if not all(map(math.isfinite, box)):
            return hull.center, hull.radius
        c = Vec3(*((box[i] + box[i + 3]) / 2.0 for i in range(3)))
        radius = math.hypot(*(box[i + 3] - c[i] for i in range(3)))
        if hull.parts:
            radius = min(radius, self._ball_radius(hull, c))
        return c, radius

    def _ball_radius(self, hull: Hull, c: Vec3) -> float:
        """Return a radius about c that contains all parts (any of them, for an intersection)."""
        radii = []
        for m, part in hull.parts:
            x, y, z = _point(m, part.center)
            radii.append(
                math.dist((x, y, z), c) + (_norm(m) * part.radius if part.radius < INF else INF)
            )
        return min(radii) if hull.is_intersection else max(radii)

    def box(self, part: Part | None, floor: Bounds | None = None) -> Bounds:
        """Return the box of a part in the outer frame.

        Parameters
        ----------
        floor
            A box whose sides need not be found again: a side that cannot exceed it is its side.
        """
        if part is None:
            return floor or EMPTY
        if part.outer_from_inner == IDENTITY:
            return join(floor, part.hull.box) if floor else part.hull.box
        key = id(part.hull), part.outer_from_inner
        known = self._boxes.get(key)
        if known is None:
            known = self._search_box(part, floor)
            if floor is None:
                self._boxes[key] = known
        return join(floor, known) if floor else known

    def loose_box(self, part: Part) -> Bounds:
        """Return a box of a part that may be too large, at once."""
        if part.outer_from_inner == IDENTITY:
            return part.hull.box
        m = part.outer_from_inner
        sides = [_offset(m, d) + _bound(part.hull, _transpose(m, d))[0] for d in _DIRECTIONS]
        return (-sides[0], -sides[1], -sides[2], sides[3], sides[4], sides[5])

    def _search_box(self, part: Part, floor: Bounds | None) -> Bounds:
        sides = []
        for i, d in enumerate(_DIRECTIONS):
            known = -INF if floor is None else (-floor[i] if i < 3 else floor[i])
            sides.append(self.support(part, d, known))
        return (-sides[0], -sides[1], -sides[2], sides[3], sides[4], sides[5])

    def support(self, part: Part, d: Direction, known: float = -INF) -> float:
        """Return the support of a part in an outer direction, but at least what is known."""
        w = _transpose(part.outer_from_inner, d)
        return self._search(part.hull, w, _offset(part.outer_from_inner, d), known, 0)

    def _search(self, hull: Hull, w: Direction, offset: float, known: float, nested: int) -> float:
        """Return ``offset`` plus the support in direction w, but at least `known`."""
        best = known
        bound, exact = _bound(hull, w)
        if offset + bound <= best:
            return best
        if exact:
            return offset + bound
        tolerance = self.tolerance * 0.25 * hull.radius * math.hypot(*w)
        if not tolerance < INF:
            tolerance = 0.0
        heap = [(-(offset + bound), 0, offset, hull, w)]
        pushed, spent = 1, 0
        while heap:
            value, _, at, hull, w = heappop(heap)
            upper = -value
            if upper <= best + tolerance:
                return max(best, upper)
            if spent >= QUERY_EXPANSIONS or self.expansions >= TOTAL_EXPANSIONS:
                self.capped = True
                return upper
            spent += 1
            self.expansions += 1
            if hull.is_intersection:
                if nested >= _NESTED:
                    return upper
                for m, part in hull.parts:
                    u, o = _transpose(m, w), at + _offset(m, w)
                    upper = min(upper, self._search(part, u, o, -INF, nested + 1))
                best = max(best, upper)
                continue
            x, y, z = w
            for m, part in _promising(hull, w, at, best):
                # Searches are most of the time that blocks take to build: no calls here.
                ax, bx, cx, dx, ay, by, cy, dy, az, bz, cz, dz = m
                o = at + (dx * x + dy * y + dz * z)
                u = (ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z)
                bound, exact = _bound(part, u)
                if o + bound <= best:
                    continue
                if exact:
                    best = o + bound
                else:
                    # Of equal bounds the newest comes first, so that ties go down, not wide.
                    heappush(heap, (-(o + bound), -pushed, o, part, u))
                    pushed += 1
        return best


def join(a: Bounds, b: Bounds) -> Bounds:
    """Return the smallest box that contains both."""
    return (
        min(a[0], b[0]),
        min(a[1], b[1]),
        min(a[2], b[2]),
        max(a[3], b[3]),
        max(a[4], b[4]),
        max(a[5], b[5]),
    )


def join_all(boxes: Sequence[Bounds]) -> Bounds:
    """Return the smallest box that contains all boxes."""
    found = EMPTY
    for box in boxes:
        found = join(found, box)
    return found


def _bound(hull: Hull, w: Direction) -> tuple[float, bool]:
    """Return an upper bound of the support, and whether it is the support itself."""
    if hull.leaf is not None:
        return hull.leaf.support(Vec3(*w), hull.args), True
    x, y, z = w
    lx, ly, lz, hx, hy, hz = hull.box
    # Zero times infinity is not a number.
    total, axes = 0.0, 0
    if x != 0.0:
        axes += 1
        total += x * (hx if x > 0.0 else lx)
    if y != 0.0:
        axes += 1
        total += y * (hy if y > 0.0 else ly)
    if z != 0.0:
        axes += 1
        total += z * (hz if z > 0.0 else lz)
    if axes <= 1 and hull.box is not EVERYTHING:
        return total, True
    if hull.radius < INF:
        cx, cy, cz = hull.center
        ball = cx * x + cy * y + cz * z + hull.radius * math.hypot(x, y, z)
        total = min(total, ball)
    return total, False


def _promising(hull: Hull, w: Direction, at: float, best: float) -> tuple[Part, ...] | list[Part]:
    """Return the parts of a union that may exceed `best`, of many parts the best ones first."""
    if hull.wide is None:
        return hull.parts
    m, boxes = hull.wide
    u = m[:, 0:4] * w[0] + m[:, 4:8] * w[1] + m[:, 8:12] * w[2]
    with np.errstate(invalid="ignore"):
        corner = np.where(u[:, :3] > 0.0, boxes[:, 3:], boxes[:, :3]) * u[:, :3]
    corner[u[:, :3] == 0.0] = 0.0
    upper = at + u[:, 3] + corner.sum(axis=1)
    slack = 1e-12 * (np.abs(upper) + abs(at))
    order = np.argsort(-upper, kind="stable")
    return [hull.parts[i] for i in order if not upper[i] + slack[i] <= best]


def _transpose(m: Affine, d: Direction) -> Direction:
    x, y, z = d
    return (
        m.m00 * x + m.m10 * y + m.m20 * z,
        m.m01 * x + m.m11 * y + m.m21 * z,
        m.m02 * x + m.m12 * y + m.m22 * z,
    )


def _offset(m: Affine, d: Direction) -> float:
    return m.m03 * d[0] + m.m13 * d[1] + m.m23 * d[2]


def _point(m: Affine, p: Vec3) -> tuple[float, float, float]:
    return (
        m.m00 * p.x + m.m01 * p.y + m.m02 * p.z + m.m03,
        m.m10 * p.x + m.m11 * p.y + m.m12 * p.z + m.m13,
        m.m20 * p.x + m.m21 * p.y + m.m22 * p.z + m.m23,
    )


def _norm(m: Affine) -> float:
    """Return an upper bound of how much a matrix lengthens a vector."""
    columns = [math.hypot(m[j], m[j + 4], m[j + 8]) for j in range(3)]
    dots = [
        abs(m[i] * m[j] + m[i + 4] * m[j + 4] + m[i + 8] * m[j + 8])
        for i, j in ((0, 1), (0, 2), (1, 2))
    ]
    # Gershgorin's bound of the largest eigenvalue of the Gram matrix: exact for rotations.
    rows = (dots[0] + dots[1], dots[0] + dots[2], dots[1] + dots[2])
    return math.sqrt(max(c * c + r for c, r in zip(columns, rows, strict=True))) * (1.0 + 1e-15)
