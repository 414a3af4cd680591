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
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.code import compose_affine
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Attribute, Leaf
from pcsg.graph.states import LeafItem, StateGraph, StateItem
from pcsg.jit import njit, plain
from pcsg.vec import IDENTITY, Affine, Vec3, cross, dot

Floats = NDArray[np.float64]

MOST_COVERS = 64
"""Where the cut ends."""

MOST_SPLIT = 200_000
"""Things in one state that are looked at one by one."""

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


class Part(NamedTuple):
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

    lower: Vec3
    upper: Vec3
    power: float
    ball: float


class Glow(NamedTuple):
    """Something that shines in the frame of a state.

    Attributes
    ----------
    state
        Number of the state, -1 for a primitive.
    part
        Its light, in its own frame.
    place
        Its place.
    """

    state: int
    part: Part
    place: Affine


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
    return cut_light(shining.parts[0], shining.items)


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
        self.parts: list[Part | None] = [None] * len(states.states)
        for k in states.children_first:
            self.parts[k] = _gather(self.items(k))

    def items(self, k: int, most: float = math.inf) -> list[Glow]:
        """Return what shines in a state, but nothing where that is more than `most`."""
        found: list[Glow] = []
        for item in self.states.states[k].content or ():
            if isinstance(item, LeafItem):
                leaf = self._leaf(item)
                if leaf is not None:
                    found.append(Glow(-1, leaf, item.state_from_leaf))
            elif isinstance(item, StateItem):
                inner = self.parts[item.state]
                if inner is not None:
                    found.append(Glow(item.state, inner, item.state_from_child))
        return found if len(found) <= most else []

    def _leaf(self, item: LeafItem) -> Part | None:
        """Return what a primitive sends out, in its own frame; None for nothing."""
        number = material_number(item.attributes[_MATERIAL])
        strength = self.strengths[number] if number >= 0 else 0.0
        node = self.states.graph.nodes[item.node]
        assert isinstance(node, Leaf)
        return leaf_part(node, item.args, strength)


def material_number(attribute: float) -> int:
    """Return the number of a material; -1 for none, and where nothing reads it."""
    return -1 if math.isnan(attribute) else int(attribute)


def leaf_part(node: Leaf, args: tuple[float, ...], strength: float) -> Part | None:
    """Return what a primitive sends out, in its own frame; None for nothing."""
    if not strength > 0.0:
        return None
    box = node.bounds_of(args)
    if not all(map(math.isfinite, (*box.lower, *box.upper))) or box.lower[0] > box.upper[0]:
        return None
    lower, upper = Vec3(*box.lower), Vec3(*box.upper)
    ball = math.inf
    if node.solid.ball is not None and not node.constants:
        away = np.array(node.solid.ball[0]) - (np.array(lower) + np.array(upper)) / 2
        ball = node.solid.ball[1] + float(np.linalg.norm(away))
    return Part(lower, upper, strength * _surface(IDENTITY, lower, upper), ball)


def _gather(items: list[Glow]) -> Part | None:
    """Return all that shines in a state."""
    if not items:
        return None
    lower, upper = _NOTHING
    power = 0.0
    for glow in items:
        own = _box(glow.place, glow.part.lower, glow.part.upper)
        lower, upper = _join(lower, upper, *own)
        # Not `sum`, which rounds in another way.
        power += _power_of(glow, glow.place)
    return Part(lower, upper, power, math.inf)


def _power_of(glow: Glow, place: Affine) -> float:
    """Return what something sends out in its place."""
    part = glow.part
    if glow.state >= 0:
        found: float = part.power * _growth(place)
    else:
        found = part.power * _widening(place, part.lower, part.upper)
    return found


def cut_light(root: Part | None, items: Callable[[int, float], list[Glow]]) -> Floats:
    """Return the covers of a cut through a hierarchy of light.

    Parameters
    ----------
    root
        What shines in the axiom.
    items
        Returns what shines in a state, but nothing where that is more than so many.
    """
    rows: list[Floats] = []
    # Most light first; numbers tell apart what shines alike.
    numbers = itertools.count()
    waiting: list[tuple[float, int, int, Part, Affine]] = []
    if root is not None:
        waiting.append((-root.power, next(numbers), 0, root, IDENTITY))
    while waiting:
        power, _, k, part, world = heapq.heappop(waiting)
        room = MOST_COVERS - len(rows) - len(waiting)
        found = items(k, room)
        if not found:
            for group in _split(items(k, MOST_SPLIT), part, room):
                share = group.power / max(part.power, 1e-300)
                rows.append(_cover(group, world, -power * share))
        for glow in found:
            place = compose_affine(world, glow.place)
            power = _power_of(glow, place)
            if glow.state >= 0:
                entry = -power, next(numbers), glow.state, glow.part, place
                heapq.heappush(waiting, entry)
            else:
                rows += _pieces(glow.part, place, power)
    return np.array(rows) if rows else np.empty((0, COLUMNS))


def _split(items: list[Glow], whole: Part, most: int) -> list[Part]:
    """Return what shines in a state as a few groups of neighbours, each about as bright.

    Parameters
    ----------
    items
        All of it; nothing where it is too much, which is one group then.
    """
    if not items or most < 2:
        return [whole]
    corners = (_box(x.place, x.part.lower, x.part.upper) for x in items)
    boxes = np.array([(*lower, *upper) for lower, upper in corners])
    powers = np.array([_power_of(x, x.place) for x in items])
    middles = boxes[:, :3] + boxes[:, 3:]
    # Most light first; numbers tell apart what shines alike.
    groups = [(-float(powers.sum()), 0, np.arange(len(items)))]
    single: list[NDArray[np.intp]] = []
    while groups and len(groups) + len(single) < most:
        _, number, members = heapq.heappop(groups)
        if len(members) == 1:
            single.append(members)
            continue
        axis = int(np.ptp(middles[members], axis=0).argmax())
        order = members[np.argsort(middles[members, axis], kind="stable")]
        half = len(order) // 2
        for k, some in enumerate((order[:half], order[half:])):
            heapq.heappush(groups, (-float(powers[some].sum()), 2 * number + 1 + k, some))
    return [
        Part(
            Vec3(*boxes[some, :3].min(axis=0).tolist()),
            Vec3(*boxes[some, 3:].max(axis=0).tolist()),
            float(powers[some].sum()),
            math.inf,
        )
        for some in [*single, *(members for _, _, members in groups)]
    ]


# The arithmetic of the hierarchy, the same in Python and in compiled code.


@njit
def surface(place: Affine, lower: Vec3, upper: Vec3) -> float:
    """Return the surface of a box in its place."""
    x, y, z = upper.x - lower.x, upper.y - lower.y, upper.z - lower.z
    a = Vec3(place.m00 * x, place.m10 * x, place.m20 * x)
    b = Vec3(place.m01 * y, place.m11 * y, place.m21 * y)
    c = Vec3(place.m02 * z, place.m12 * z, place.m22 * z)
    ab, ac, bc = cross(a, b), cross(a, c), cross(b, c)
    return 2.0 * (math.sqrt(dot(ab, ab)) + math.sqrt(dot(ac, ac)) + math.sqrt(dot(bc, bc)))


@njit
def widening(place: Affine, lower: Vec3, upper: Vec3) -> float:
    """Return how much larger the surface of a box is in its place."""
    return surface(place, lower, upper) / max(surface(IDENTITY, lower, upper), 1e-300)


@njit
def growth(place: Affine) -> float:
    """Return how much larger surfaces are in a place, on average."""
    a = Vec3(place.m00, place.m10, place.m20)
    b = Vec3(place.m01, place.m11, place.m21)
    c = Vec3(place.m02, place.m12, place.m22)
    determinant: float = dot(cross(a, b), c)
    larger: float = abs(determinant) ** (2.0 / 3.0)
    return larger


@njit
def place_box(place: Affine, lower: Vec3, upper: Vec3) -> tuple[Vec3, Vec3]:
    """Return the corners of the box about a box in its place."""
    x, y, z = (lower.x + upper.x) / 2, (lower.y + upper.y) / 2, (lower.z + upper.z) / 2
    u, v, w = (upper.x - lower.x) / 2, (upper.y - lower.y) / 2, (upper.z - lower.z) / 2
    cx = place.m00 * x + place.m01 * y + place.m02 * z + place.m03
    cy = place.m10 * x + place.m11 * y + place.m12 * z + place.m13
    cz = place.m20 * x + place.m21 * y + place.m22 * z + place.m23
    hx = abs(place.m00) * u + abs(place.m01) * v + abs(place.m02) * w
    hy = abs(place.m10) * u + abs(place.m11) * v + abs(place.m12) * w
    hz = abs(place.m20) * u + abs(place.m21) * v + abs(place.m22) * w
    return Vec3(cx - hx, cy - hy, cz - hz), Vec3(cx + hx, cy + hy, cz + hz)


@njit
def join_corners(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> tuple[Vec3, Vec3]:
    """Return the corners of the box about two boxes."""
    lower = Vec3(min(a.x, c.x), min(a.y, c.y), min(a.z, c.z))
    return lower, Vec3(max(b.x, d.x), max(b.y, d.y), max(b.z, d.z))


_surface, _widening, _growth = plain(surface), plain(widening), plain(growth)
_box, _join = plain(place_box), plain(join_corners)
_NOTHING = Vec3(math.inf, math.inf, math.inf), Vec3(-math.inf, -math.inf, -math.inf)


def _linear(place: Affine) -> Floats:
    return np.array(place).reshape(3, 4)[:, :3]


def _cover(part: Part, place: Affine, power: float) -> Floats:
    """Return the cover of a part in its place: a ball, or a box if it is flat."""
    row = np.zeros(COLUMNS)
    lower, upper = np.array(part.lower), np.array(part.upper)
    linear = _linear(place)
    row[CENTER] = linear @ (lower + upper) / 2 + np.array(place)[3::4]
    sides = linear * (upper - lower) / 2
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


def _pieces(part: Part, place: Affine, power: float) -> list[Floats]:
    """Return covers along a primitive, which is cut where it is longer than wide."""
    low, high = np.array(part.lower), np.array(part.upper)
    lengths = np.linalg.norm(_linear(place), axis=0) * (high - low)
    axis = int(lengths.argmax())
    middle = float(np.sort(lengths)[1])
    count = min(math.ceil(float(lengths[axis]) / max(middle, 1e-300) - 0.5), MOST_PIECES)
    if count < 2:
        return [_cover(part, place, power)]
    ends = np.linspace(low[axis], high[axis], count + 1)
    found = []
    for start, end in itertools.pairwise(ends):
        low[axis], high[axis] = start, end
        piece = Part(Vec3(*low.tolist()), Vec3(*high.tolist()), 0.0, math.inf)
        found.append(_cover(piece, place, power / count))
    return found
