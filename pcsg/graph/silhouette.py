"""How far a scene reaches in any direction: what a camera must not cut off.

Boxes say where things may be: that of a rotated twig is larger than the twig, that of a cut solid
than what is left of it. The supports of `hulls` say where things are, whatever their directions
and however thin they are, as long as nothing is cut off from them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.hulls import INF, Hulls, Part
from pcsg.graph.nodes import Leaf
from pcsg.graph.operators import UNION
from pcsg.graph.states import LeafStep, OperationStep, StateGraph
from pcsg.leaf.registry import Model

MOST_STEPS = 10_000
"""Steps of states from which on nothing is said: it would take longer than the first rays."""

TOLERANCE = 1e-4
"""Of the answers, relative to the size of the scene."""


def find_reach(states: StateGraph, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far the primitives reach that no operation cuts.

    Parameters
    ----------
    states
        All that the axiom reaches.
    directions
        (N, 3)

    Returns
    -------
    (N,) float64
        The largest ``p . d`` of their points; -inf where there are none, or too many. Unbounded
        ones do not count.
    """
    nothing = np.full(len(directions), -INF)
    steps = sum(len(s.steps) for s in states.states)
    if not (states.finite and states.acyclic) or steps > MOST_STEPS:
        return nothing
    hulls = _Uncut(states, bounded_only=True)
    root = hulls.parts[0]
    if root is None or not root.hull.is_bounded or hulls.capped:
        return nothing
    hulls.tolerance = TOLERANCE
    reach = [hulls.support(root, (x, y, z)) for x, y, z in directions.tolist()]
    # A search that ended early has an upper bound, which may be far too large.
    return nothing if hulls.capped else np.array(reach)


class _Uncut(Hulls):
    """Hulls of what stands in unions only."""

    def leaf_part(self, step: LeafStep) -> Part | None:
        """Return the hull of a primitive; None for a model that only has a box."""
        node = self.states.graph.nodes[step.node]
        assert isinstance(node, Leaf)
        if node.constants and type(node.model(step.args)).support is Model.support:
            return None
        return super().leaf_part(step)

    def combine(self, step: OperationStep, operands: list[Part | None]) -> Part | None:
        """Return the hull of an operation, None where it cuts."""
        if step.operator is not UNION:
            return None
        bounded = [p for p in operands if p is not None and p.hull.is_bounded]
        return super().combine(step, [*bounded])
