"""Scenes as triangles and as lists of primitives, which is what peers take."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.functions import randedge
from pcsg.graph.nodes import Leaf
from pcsg.graph.operators import UNION
from pcsg.graph.states import Combine, LeafItem, StateGraph
from pcsg.jit import plain
from pcsg.scene import Scene

Floats = NDArray[np.float64]


class Triangles(NamedTuple):
    """Corners float64 (V, 3), and three of them for every triangle, int32 (N, 3)."""

    corners: Floats
    faces: NDArray[np.int32]


class Placed(NamedTuple):
    """Primitives of one kind: matrices float64 (N, 3, 4) from their own frames to the world."""

    kind: str
    matrices: Floats


def expand(states: StateGraph) -> list[Placed]:
    """Return all primitives of a graph of unions, by kind."""
    done: dict[int, dict[str, Floats]] = {}
    for k in states.children_first:
        parts: dict[str, list[Floats]] = {}
        for item in states.states[k].content or ():
            if isinstance(item, Combine):
                assert item.operator is UNION, "operations have no list of primitives"
            elif isinstance(item, LeafItem):
                node = states.graph.nodes[item.node]
                assert isinstance(node, Leaf)
                m = np.array(item.state_from_leaf).reshape(1, 3, 4)
                parts.setdefault(node.solid.__name__.lower(), []).append(m)
            else:
                outer = np.vstack([np.array(item.state_from_child).reshape(3, 4), [0, 0, 0, 1]])
                for kind, inner in done[item.state].items():
                    moved = outer[:3, :3] @ inner
                    moved[:, :, 3] += outer[:3, 3]
                    parts.setdefault(kind, []).append(moved)
        done[k] = {kind: np.concatenate(found) for kind, found in parts.items()}
    return [Placed(kind, matrices) for kind, matrices in done[0].items()]


def _cylinder(sides: int = 16) -> Triangles:
    """Return a prism about the cylinder, with a fan on each cap: 4 triangles a side."""
    angle = 2 * math.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    corners = np.concatenate([ring, ring + np.array([0, 0, 1]), [[0, 0, 0], [0, 0, 1]]])
    faces = []
    for a in range(sides):
        b = (a + 1) % sides
        faces += [(a, b, sides + a), (b, sides + b, sides + a)]
        faces += [(b, a, 2 * sides), (sides + a, sides + b, 2 * sides + 1)]
    return Triangles(corners, np.array(faces, np.int32))


SHAPES = {
    "tetrahedron": Triangles(
        np.array([[1, 1, 1], [-1, -1, 1], [1, -1, -1], [-1, 1, -1]], float),
        np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]], np.int32),
    ),
    "cylinder": _cylinder(),
}


def solids(scene: Scene) -> Triangles:
    """Return the triangles of a union of tetrahedra and cylinders."""
    corners: list[Floats] = []
    faces: list[NDArray[np.int32]] = []
    used = 0
    for kind, matrices in expand(scene.states):
        shape = SHAPES[kind]
        points = np.einsum("nij,vj->nvi", matrices[:, :, :3], shape.corners)
        points += matrices[:, None, :, 3]
        first = used + len(shape.corners) * np.arange(len(matrices), dtype=np.int32)
        corners.append(points.reshape(-1, 3))
        faces.append((first[:, None, None] + shape.faces).reshape(-1, 3))
        used += points.shape[0] * points.shape[1]
    return Triangles(np.concatenate(corners), np.concatenate(faces).astype(np.int32))


def terrain(scene: Scene) -> Triangles:
    """Return the triangles of ``grammars/terrain.pcsg``, level by level.

    Edges are halved as the grammar does; an edge's midpoint is made once.
    """
    p = scene.parameters
    ox, kl, delta = p["ox"], p["kl"], p["delta"]
    random = plain(randedge)
    corners = [(ox, 0.0, 0.0), (ox + kl, 0.0, 0.0), (ox, kl, 0.0), (ox + kl, kl, 0.0)]
    faces = [(0, 1, 2), (3, 2, 1)]
    for _ in range(int(p["cnt"])):
        delta *= p["frc"]
        between: dict[tuple[int, int], int] = {}

        def middle(a: int, b: int, between: dict[tuple[int, int], int], delta: float) -> int:
            key = (min(a, b), max(a, b))
            if key not in between:
                (x1, y1, z1), (x2, y2, z2) = corners[a], corners[b]
                with np.errstate(over="ignore"):  # hashes are made of overflows
                    chance = random([x1, y1, x2, y2], 0, 4, 0)
                z = (z1 + z2) / 2.0 + ((-math.log(chance * p["ex"] + 1.0)) + p["add"]) * delta
                between[key] = len(corners)
                corners.append(((x1 + x2) / 2, (y1 + y2) / 2, z))
            return between[key]

        finer = []
        for a, b, c in faces:
            ab, ac, bc = (middle(*e, between, delta) for e in ((a, b), (a, c), (b, c)))
            finer += [(a, ab, ac), (ab, b, bc), (ac, bc, c), (bc, ac, ab)]
        faces = finer
    return Triangles(np.array(corners) - [ox, 0.0, 0.0], np.array(faces, np.int32))
