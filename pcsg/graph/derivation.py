"""How a grammar derives the solid at a point: modules, rules, values of parameters.

Only states are looked into whose boxes hold the point, so that one of 4^40 solids is found within
some hundred visits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.code import compose_affine
from pcsg.graph.graph import Graph
from pcsg.graph.leaves import Path
from pcsg.graph.nodes import Leaf, Selection
from pcsg.graph.states import LeafItem, StateItem
from pcsg.graph.unroll import StatesOnDemand
from pcsg.vec import IDENTITY, Affine, Vec3, invert, transform_point, transform_vector

MOST_STATES = 3000
"""States that are made before the search is given up: about a second."""

MOST_VISITS = 60_000
"""Solids and states that are looked at."""

THROUGH = 1e-3
"""Longest way through a surface, in the frame of a unit primitive."""

SLACK = 1e-6
"""Of boxes, relative to their size: the point lies on a surface."""


@dataclass(frozen=True)
class Derivation:
    """How a solid came about.

    Attributes
    ----------
    path
        Modules from the axiom down, and the numbers of the rules taken.
    values
        Of the grammar's parameters that matter in the last rule.
    arguments
        Of the solid.
    """

    path: Path
    values: Mapping[str, float]
    arguments: tuple[float, ...]


def find_derivation(
    graph: Graph,
    values: Mapping[str, float],
    boxes: NDArray[np.float64],
    leaf: int,
    point: Vec3,
    across: Vec3,
) -> Derivation | None:
    """Return how the solid was derived whose surface passes through a point.

    Parameters
    ----------
    values
        Of SEED, TIME and the like.
    boxes
        (N, 6) hyper-bounding boxes of the nodes.
    leaf
        Number of the leaf node.
    point
        On its surface, in world coordinates.
    across
        A short way through the surface: its two sides are tried.

    Returns
    -------
    Derivation or None
        None where the search was given up.
    """
    known = StatesOnDemand(graph, values)
    states = known.states
    stack: list[tuple[int, Affine, Path]] = [(0, IDENTITY, ())]
    visits, near = 0, None
    while stack:
        k, world, path = stack.pop()
        below = []
        for item in known.content(k):
            visits += 1
            if visits > MOST_VISITS or len(states) > MOST_STATES:
                return None
            if isinstance(item, StateItem):
                child = states[item.state]
                place = compose_affine(world, item.state_from_child)
                if not _holds(boxes[child.node], place, point):
                    continue
                node = graph.nodes[child.node]
                step = ((node.name, child.rule),) if isinstance(node, Selection) else ()
                below.append((item.state, place, (*path, *step)))
            elif isinstance(item, LeafItem) and item.node == leaf:
                place = compose_affine(world, item.state_from_leaf)
                if _is_surface_of(graph, item, place, point, across):
                    return Derivation(path, known.values(k), item.args)
                if near is None and _holds(_box_of(graph, item), place, point):
                    near = Derivation(path, known.values(k), item.args)
        stack.extend(reversed(below))
    # At an edge neither side of the surface need be inside.
    return near


def _holds(box: NDArray[np.float64], world_from_local: Affine, point: Vec3) -> bool:
    """Return whether a box in a frame holds a point of the world, about."""
    local_from_world, exists = invert(world_from_local)
    if not exists:
        return False
    p = transform_point(local_from_world, point)
    slack = SLACK * max((abs(x) for x in box if math.isfinite(x)), default=0.0)
    return all(box[i] - slack <= p[i] <= box[i + 3] + slack for i in range(3))


def _box_of(graph: Graph, item: LeafItem) -> NDArray[np.float64]:
    """Return the box of a primitive in its own frame."""
    node = graph.nodes[item.node]
    assert isinstance(node, Leaf)
    box = node.model(item.args).bounds if node.constants else node.solid.bounds_of(item.args)
    return np.array([*box.lower, *box.upper])


def _is_surface_of(
    graph: Graph, item: LeafItem, world_from_leaf: Affine, point: Vec3, across: Vec3
) -> bool:
    """Return whether the surface of a primitive passes through a point."""
    node = graph.nodes[item.node]
    assert isinstance(node, Leaf)
    leaf_from_world, exists = invert(world_from_leaf)
    if not exists:
        return False
    if node.constants or node.is_sheet:
        return _holds(_box_of(graph, item), world_from_leaf, point)
    p = transform_point(leaf_from_world, point)
    by = transform_vector(leaf_from_world, across)
    # What is itself smaller than the way would lie between its ends.
    shorter = min(1.0, THROUGH / max(math.hypot(*by), 1e-300))
    args, pool = np.array(item.args), (np.zeros(0), np.zeros(0, np.float32), np.zeros(0, np.int32))
    sides = [
        bool(node.solid.inside(Vec3(p.x + s * by.x, p.y + s * by.y, p.z + s * by.z), args, 0, pool))
        for s in (-shorter, shorter)
    ]
    return sides[0] != sides[1]
