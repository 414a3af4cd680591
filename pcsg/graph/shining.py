"""Where a scene shines: covers of its shining parts, so that shadow rays can be sent to them.

The unrolled graph is a hierarchy of light: every state knows the box about what shines in it, and
about how much that is. A cut through the hierarchy, opened where most light comes from, covers all
that shines by a limited number of covers, whether that is one lamp or a million fireflies. Covers
are balls, or boxes about what is flat.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.code import compose_affine
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Attribute, Leaf
from pcsg.graph.states import LeafItem, StateGraph, StateItem
from pcsg.vec import IDENTITY, Affine

Floats = NDArray[np.float64]

MOST_COVERS = 64
"""Where the cut ends."""

MOST_PIECES = 32
"""Into how many covers a long primitive is cut."""

FLAT = 0.4
"""What is thinner than this part of its width is covered by a box."""

CENTER, RADIUS, POWER, VOLUME, AXES, INVERSE, COLUMNS = slice(0, 3), 3, 4, 5, 6, 15, 24
"""Columns of a cover; `VOLUME` is 0 for a ball. A box has its half axes in the nine columns from
`AXES`, and the rows of the matrix into its frame in those from `INVERSE`."""

_MATERIAL = ATTRIBUTE_SLOTS.index("@material")


def dark_nodes(graph: Graph, strengths: Sequence[float]) -> frozenset[int]:
    """Return the nodes of a graph below which nothing shines, whatever rules are taken.

    Parameters
    ----------
    strengths
        How much a surface of every material shines.
    """
    numbers = graph.numbers_of("material")
    # Nodes with the material that holds above them; who leads there; where light is.
    found, todo = {(0, -1)}, [(0, -1)]
    above: dict[tuple[int, int], list[tuple[int, int]]] = {}
    lit: list[tuple[int, int]] = []
    while todo:
        n, material = here = todo.pop()
        node = graph.nodes[n]
        if isinstance(node, Leaf) and material >= 0 and strengths[material] > 0.0:
            lit.append(here)
        if isinstance(node, Attribute) and node.kind.name == "material":
            material = numbers[node.reference or ""]
        for below in graph.successors[n]:
            there = below, material
            above.setdefault(there, []).append(here)
            if there not in found:
                found.add(there)
                todo.append(there)
    bright = set(lit)
    while lit:
        for there in above.get(lit.pop(), ()):
            if there not in bright:
                bright.add(there)
                lit.append(there)
    return frozenset(range(len(graph.nodes))) - {n for n, _ in bright}


class _Part(NamedTuple):
    """What shines in a frame.

    Attributes
    ----------
    lower, upper
        Corners of a box about it.
    power
        Emission times surface, about.
    ball
        Radius of the ball about the box's centre that contains it, if that is less than the box.
    """

    lower: Floats
    upper: Floats
    power: float
    ball: float


def shining_covers(states: StateGraph, strengths: Sequence[float]) -> Floats:
    """Return covers of all that shines.

    Parameters
    ----------
    states
        All that the axiom reaches.
    strengths
        How much a surface of every material shines.

    Returns
    -------
    (K, `COLUMNS`) float64
        Centre, radius, about how much light it sends to distance 1, and more. What has no bounds is
        left out.
    """
    if not (states.finite and states.acyclic):
        return np.empty((0, COLUMNS))
    shining = _Shining(states, strengths)
    return shining.cut() if shining.parts[0] is not None else np.empty((0, COLUMNS))


class _Shining:
    """The hierarchy of light of a graph.

    Attributes
    ----------
    parts
        What shines in every state; None where nothing does.
    """

    def __init__(self, states: StateGraph, strengths: Sequence[float]) -> None:
        self.states = states
        self.strengths = strengths
        self.parts: list[_Part | None] = [None] * len(states.states)
        for k in states.children_first:
            self.parts[k] = self._gather(k)

    def _items(self, k: int) -> list[tuple[LeafItem | StateItem, _Part, Affine]]:
        """Return what shines in a state: the item, its light, and its place in the state."""
        found: list[tuple[LeafItem | StateItem, _Part, Affine]] = []
        for item in self.states.states[k].content or ():
            if isinstance(item, LeafItem):
                leaf = self._leaf(item)
                if leaf is not None:
                    found.append((item, leaf, item.state_from_leaf))
            elif isinstance(item, StateItem):
                inner = self.parts[item.state]
                if inner is not None:
                    found.append((item, inner, item.state_from_child))
        return found

    def _leaf(self, item: LeafItem) -> _Part | None:
        """Return what a primitive sends out, in its own frame; None for nothing."""
        material = item.attributes[_MATERIAL]
        number = -1 if math.isnan(material) else int(material)
        strength = self.strengths[number] if number >= 0 else 0.0
        node = self.states.graph.nodes[item.node]
        assert isinstance(node, Leaf)
        box = node.bounds_of(item.args)
        finite = all(map(math.isfinite, (*box.lower, *box.upper)))
        if not strength > 0.0 or not finite or box.lower[0] > box.upper[0]:
            return None
        lower, upper = np.array(box.lower), np.array(box.upper)
        ball = math.inf
        if node.solid.ball is not None and not node.constants:
            away = np.array(node.solid.ball[0]) - (lower + upper) / 2
            ball = node.solid.ball[1] + float(np.linalg.norm(away))
        return _Part(lower, upper, strength * _surface(lower, upper, IDENTITY), ball)

    def _gather(self, k: int) -> _Part | None:
        """Return all that shines in a state."""
        items = self._items(k)
        if not items:
            return None
        boxes = [_placed_box(part, place) for _, part, place in items]
        power = sum(_placed_power(item, part, place) for item, part, place in items)
        lower = np.min([box[0] for box in boxes], axis=0)
        upper = np.max([box[1] for box in boxes], axis=0)
        return _Part(lower, upper, power, math.inf)

    def cut(self) -> Floats:
        """Return the covers of a cut."""
        rows: list[Floats] = []
        # Most light first; numbers tell apart what shines alike.
        numbers = itertools.count()
        waiting: list[tuple[float, int, int, Affine]] = []

        def wait(k: int, world: Affine, power: float) -> None:
            heapq.heappush(waiting, (-power, next(numbers), k, world))

        root = self.parts[0]
        wait(0, IDENTITY, root.power if root else 0.0)
        while waiting:
            power, _, k, world = heapq.heappop(waiting)
            items = self._items(k)
            if len(rows) + len(waiting) + len(items) > MOST_COVERS:
                part = self.parts[k]
                assert part is not None
                rows.append(_cover(part, world, -power))
                continue
            for item, part, place in items:
                inner = compose_affine(world, place)
                power = _placed_power(item, part, inner)
                if isinstance(item, StateItem):
                    wait(item.state, inner, power)
                else:
                    rows += _pieces(part, inner, power)
        return np.array(rows)


def _linear(place: Affine) -> Floats:
    return np.array(place).reshape(3, 4)[:, :3]


def _scale(place: Affine) -> float:
    """Return how much a place lengthens, on average."""
    return math.cbrt(abs(float(np.linalg.det(_linear(place)))))


def _surface(lower: Floats, upper: Floats, place: Affine) -> float:
    """Return the surface of a box in its place."""
    sides = _linear(place) * (upper - lower)
    pairs = ((0, 1), (0, 2), (1, 2))
    return 2.0 * sum(float(np.linalg.norm(np.cross(sides[:, i], sides[:, j]))) for i, j in pairs)


def _placed_power(item: LeafItem | StateItem, part: _Part, place: Affine) -> float:
    """Return what a part sends out in its place."""
    if isinstance(item, StateItem):
        return part.power * _scale(place) ** 2
    before = _surface(part.lower, part.upper, IDENTITY)
    return part.power * _surface(part.lower, part.upper, place) / max(before, 1e-300)


def _placed_box(part: _Part, place: Affine) -> tuple[Floats, Floats]:
    """Return the corners of the box about a part in its place."""
    center = _linear(place) @ (part.lower + part.upper) / 2 + np.array(place)[3::4]
    half = np.abs(_linear(place)) @ (part.upper - part.lower) / 2
    return center - half, center + half


def _cover(part: _Part, place: Affine, power: float) -> Floats:
    """Return the cover of a part in its place: a ball, or a box if it is flat."""
    row = np.zeros(COLUMNS)
    linear = _linear(place)
    row[CENTER] = linear @ (part.lower + part.upper) / 2 + np.array(place)[3::4]
    sides = linear * (part.upper - part.lower) / 2
    signs = np.array([(1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)])
    radius = float(np.linalg.norm(signs @ sides.T, axis=1).max())
    lengths = np.linalg.norm(sides, axis=0)
    thin, middle = int(lengths.argmin()), float(np.sort(lengths)[1])
    if lengths[thin] < FLAT * middle:
        # Sheets have no thickness.
        if lengths[thin] < 1e-3 * middle:
            normal = np.cross(sides[:, thin - 2], sides[:, thin - 1])
            sides[:, thin] = 1e-3 * middle * normal / np.linalg.norm(normal)
        sides *= 1.0 + 1e-6
        row[VOLUME] = 8.0 * abs(float(np.linalg.det(sides)))
        row[AXES:INVERSE] = sides.T.ravel()
        row[INVERSE:] = np.linalg.inv(sides).ravel()
        radius *= 1.01
    elif part.ball < math.inf:
        radius = min(radius, part.ball * float(np.linalg.norm(linear, 2)))
    row[RADIUS] = radius * (1.0 + 1e-9)
    # A convex body of surface A shows A / 4 on average.
    row[POWER] = power / 4
    return row


def _pieces(part: _Part, place: Affine, power: float) -> list[Floats]:
    """Return covers along a primitive, which is cut where it is longer than wide."""
    lengths = np.linalg.norm(_linear(place), axis=0) * (part.upper - part.lower)
    axis = int(lengths.argmax())
    middle = float(np.sort(lengths)[1])
    count = min(math.ceil(float(lengths[axis]) / max(middle, 1e-300) - 0.5), MOST_PIECES)
    if count < 2:
        return [_cover(part, place, power)]
    ends = np.linspace(part.lower[axis], part.upper[axis], count + 1)
    found = []
    for start, end in itertools.pairwise(ends):
        lower, upper = part.lower.copy(), part.upper.copy()
        lower[axis], upper[axis] = start, end
        found.append(_cover(_Part(lower, upper, 0.0, math.inf), place, power / count))
    return found
