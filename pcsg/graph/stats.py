"""Statistics of a graph: what ``pcsg stats`` and ``Scene.stats`` tell."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.bounds import HyperBoxes, hyper_boxes
from pcsg.graph.counts import count_primitives
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Leaf
from pcsg.graph.states import LeafItem, StateGraph
from pcsg.graph.unroll import enumerate_states
from pcsg.leaf.blob import BlobSource
from pcsg.leaf.mesh import MeshModel

OPEN_EDGES = 10
"""Open edges of a mesh that are told."""


class Counts(NamedTuple):
    """What is counted in the states of a graph.

    Attributes
    ----------
    states
        Their number without the axiom, None where there are too many.
    primitives
        The exact number of primitives, None where it is not known.
    leaves
        Leaves with data that were met, each with its numbers once.
    """

    states: int | None
    primitives: int | None
    leaves: Sequence[tuple[Leaf, tuple[float, ...]]]


class Census(NamedTuple):
    """What statistics are made of.

    Attributes
    ----------
    counts
        What is counted.
    boxes
        ``exact``, ``interval`` or ``unbounded``: where the bounds come from.
    bounds, scene_bounds : float64 (2, 3)
        The box of the axiom, and the one without unbounded solids in unions; lower above upper
        where nothing is there.
    nbytes
        Bytes of what was made for it, by name.
    """

    counts: Counts
    boxes: str
    bounds: NDArray[np.float64]
    scene_bounds: NDArray[np.float64]
    nbytes: Mapping[str, int]


def take_census(
    graph: Graph,
    globals_values: Mapping[str, float] | None = None,
    states: StateGraph | None = None,
    boxes: HyperBoxes | None = None,
    counts: Counts | None = None,
) -> Census:
    """Return what statistics are made of.

    Parameters
    ----------
    globals_values
        Values of SEED, TIME and the like; by default those of `GLOBALS`.
    states, boxes
        Results of `enumerate_states` and `hyper_boxes` with these values, where they are known.
    counts
        What was counted elsewhere.
    """
    states = states or enumerate_states(graph, globals_values)
    boxes = boxes or hyper_boxes(graph, globals_values, states)
    counts = counts or Counts(
        states.count if states.finite else None,
        count_primitives(graph, globals_values),
        _data_leaves(graph, states),
    )
    made = {"boxes": boxes.boxes.nbytes}
    scene, bounded = (np.array([b.lower, b.upper]) for b in (boxes.scene, boxes.scene_box))
    return Census(counts, boxes.kind, scene, bounded, made)


def graph_stats(
    graph: Graph,
    globals_values: Mapping[str, float] | None = None,
    census: Census | None = None,
    nbytes: Mapping[str, int] | None = None,
) -> dict[str, Any]:
    """Return a graph's statistics as an object that JSON can carry.

    Parameters
    ----------
    globals_values
        Values of SEED, TIME and the like; by default those of `GLOBALS`.
    census
        What was counted with these values, where that is known.
    nbytes
        Bytes of packed forms by their names, which later stages know.

    Returns
    -------
    dict
        ``nodes`` by kind and in total, ``edges``, ``parameters``, ``states`` (None where they are
        more than the budget), ``primitives`` (an exact integer of any size, None where the
        derivation does not end), ``boxes`` (exact, interval or unbounded), ``bounds`` and
        ``scene_bounds`` (lower and upper corner; None where infinite or empty), ``bytes``; where
        there are trees of skeletons, ``junctions``: their number, at how many the branches are
        together thicker than their bearer, and the greatest and mean ratio of sum r_i^2 to r_A^2;
        where there are meshes, ``meshes``: for each its name, triangles, whether it is closed, the
        number of its open edges and the ends of the first ones, and what of its file is left out or
        mended; ``notes`` where there is more that a user should know.
    """
    census = census or take_census(graph, globals_values)
    kinds = Counter(type(node).__name__.lower() for node in graph.nodes)
    return {
        "nodes": {"total": len(graph.nodes), **dict(sorted(kinds.items()))},
        "edges": sum(len(below) for below in graph.successors),
        "parameters": list(graph.parameters),
        "states": census.counts.states,
        "primitives": census.counts.primitives,
        "boxes": census.boxes,
        "bounds": _corners(census.bounds),
        "scene_bounds": _corners(census.scene_bounds),
        "bytes": {**census.nbytes, **(nbytes or {})},
        **_junctions(census.counts.leaves),
        **_meshes(graph),
        **_notes(census.counts.leaves),
    }


def _meshes(graph: Graph) -> dict[str, Any]:
    """Return the meshes by their names; nothing where there is none."""
    models = {
        constant.signature: constant
        for node in graph.nodes
        for constant in (node.constants if isinstance(node, Leaf) else ())
        if isinstance(constant, MeshModel)
    }
    if not models:
        return {}
    described = [
        {
            "name": model.name,
            "triangles": len(model.triangles),
            "closed": model.closed,
            "open_edges": len(model.open_edges),
            "open_at": model.open_edges[:OPEN_EDGES].tolist(),
            "notes": list(model.notes),
        }
        for model in models.values()
    ]
    return {"meshes": described}


def _junctions(leaves: Sequence[tuple[Leaf, tuple[float, ...]]]) -> dict[str, Any]:
    """Return the junctions of all trees; nothing where there is none."""
    ratios: list[float] = []
    for node, args in leaves:
        for constant in node.constants:
            areas = constant.junctions(args) if isinstance(constant, BlobSource) else None
            ratios += areas.ratio.tolist() if areas is not None else []
    if not ratios:
        return {}
    thicker = sum(r > 1.0 + 1e-9 for r in ratios)
    mean = math.fsum(ratios) / len(ratios)
    found = {"total": len(ratios), "thicker": thicker, "greatest": max(ratios), "mean": mean}
    return {"junctions": found}


def _notes(leaves: Sequence[tuple[Leaf, tuple[float, ...]]]) -> dict[str, Any]:
    """Return what users should know of leaves; nothing where that is nothing."""
    told = (n for node, args in leaves for n in node.solid.notes_of(node.constants, args))
    notes = list(dict.fromkeys(told))
    return {"notes": notes} if notes else {}


def _data_leaves(graph: Graph, states: StateGraph) -> list[tuple[Leaf, tuple[float, ...]]]:
    """Return the leaves with data of all states, each with its numbers once."""
    found = {
        (item.node, item.args)
        for state in states.states
        for item in state.content or ()
        if isinstance(item, LeafItem)
    }
    nodes = ((graph.nodes[number], args) for number, args in sorted(found))
    return [(node, args) for node, args in nodes if isinstance(node, Leaf) and node.constants]


def _corners(box: NDArray[np.float64]) -> list[list[float | None]] | None:
    """Return a box's corners; infinities become None, because JSON has none."""
    if (box[0] > box[1]).any():
        return None
    return [[x if math.isfinite(x) else None for x in corner] for corner in box.tolist()]
