"""Hyper-bounding boxes: for every node one box in its own frame, right for all its visits.

Paper section 5. Where the states are finite in number, they come from the primitives (`hulls`),
else from interval arithmetic over the rules (`ranges`), else they are infinite.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.graph import Graph
from pcsg.graph.hulls import EMPTY, INF, TOLERANCE, Bounds, Hulls
from pcsg.graph.ranges import range_boxes
from pcsg.graph.states import StateGraph
from pcsg.graph.unroll import enumerate_states
from pcsg.leaf.registry import Box

STEPS_LIMIT = 60_000
"""Visits to nodes from which on boxes come from intervals: exact ones would take too long."""


@dataclass(frozen=True)
class HyperBoxes:
    """Boxes of a graph.

    Attributes
    ----------
    boxes : float64 (N, 6)
        Lower x, y, z, upper x, y, z of every node in its own frame; infinite where unbounded,
        lower above upper where nothing is visible below. Padded outwards by a relative 1e-9.
    kind
        ``exact``, ``interval`` or ``unbounded``: where they come from.
    scene
        The box of the axiom, in world coordinates.
    scene_box
        The same without unbounded solids in unions, such as a half-space for the ground: what a
        camera frames. Empty where nothing is bounded.
    """

    boxes: NDArray[np.float64]
    kind: str
    scene: Box
    scene_box: Box


def hyper_boxes(
    graph: Graph,
    globals_values: Mapping[str, float] | None = None,
    states: StateGraph | None = None,
) -> HyperBoxes:
    """Return the hyper-bounding box of every node.

    Parameters
    ----------
    globals_values
        Values of SEED, TIME and the like; by default those of `GLOBALS`.
    states
        The graph's states, where they have been enumerated with these values already.
    """
    if states is None:
        states = enumerate_states(graph, globals_values)
    steps = sum(len(s.steps) for s in states.states)
    if states.finite and states.acyclic and steps <= STEPS_LIMIT:
        return _exact_boxes(states)
    boxes, scene, bounded = range_boxes(graph, globals_values)
    known = scene == EMPTY or any(all(map(math.isfinite, box)) for box in (scene, bounded))
    kind = "interval" if known else "unbounded"
    return _hyper_boxes(boxes, kind, scene, bounded)


def _exact_boxes(states: StateGraph) -> HyperBoxes:
    hulls = Hulls(states)
    boxes = [EMPTY] * len(states.graph.nodes)
    for k in reversed(states.children_first):
        # From the top down: large visits come first, and small ones need no search then.
        for step, part in reversed(hulls.visits[k]):
            boxes[step.node] = hulls.box(part, boxes[step.node])
    for k, state in enumerate(states.states):
        boxes[state.node] = hulls.box(hulls.parts[k], boxes[state.node])
    scene = hulls.box(hulls.parts[0])
    bounded = scene
    if any(math.isinf(x) for x in scene) and scene != EMPTY:
        inner = Hulls(states, bounded_only=True)
        bounded = inner.box(inner.parts[0])
        if any(map(math.isinf, bounded)):
            bounded = EMPTY
    return _hyper_boxes(boxes, "exact", scene, bounded)


def _hyper_boxes(boxes: list[Bounds], kind: str, scene: Bounds, bounded: Bounds) -> HyperBoxes:
    array = np.array([pad(b) for b in boxes]).reshape(-1, 6)
    return HyperBoxes(array, kind, _box(pad(scene)), _box(pad(bounded)))


def pad(box: Bounds) -> Bounds:
    """Return a box grown outwards by the tolerance, relative to its size and its place."""
    lower, upper = list(box[:3]), list(box[3:])
    if any(a > b for a, b in zip(lower, upper, strict=True)):
        return EMPTY
    finite = [abs(x) for x in box if x not in (INF, -INF)]
    # Rounding on the way is relative to the largest coordinate.
    by = TOLERANCE * max(finite, default=0.0)
    return (
        lower[0] - by,
        lower[1] - by,
        lower[2] - by,
        upper[0] + by,
        upper[1] + by,
        upper[2] + by,
    )


def _box(b: Bounds) -> Box:
    return Box((b[0], b[1], b[2]), (b[3], b[4], b[5]))
