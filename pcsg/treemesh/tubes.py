"""Tubes: parts that are rings of vertices one after the other, as tree generators write them.

Their axis needs no contraction: it runs through the centres of the rings, exactly, however few
corners the rings have.
"""

from __future__ import annotations

import numpy as np

from pcsg.treemesh.parts import Part
from pcsg.treemesh.skeleton import Floats, Ints, Skeleton

_FLAT = 0.999
"""Cosine between the normals of faces of one flat cap."""


def tube_skeleton(part: Part) -> Skeleton | None:
    """Return the axis of a part that is a tube, None if it is none.

    A tube begins at a rim, at the tip of a cone, or with a flat cap, and every further layer of
    neighbouring vertices is one closed ring of as many, or the tip at its end.

    Returns
    -------
    Skeleton
        A chain from the thicker end, with the vertices of every ring as its mapping.
    """
    faces = part.faces[: part.n_open]
    n = int(faces.max()) + 1
    around = _neighbours(faces, n)
    for start in _starts(part, faces):
        layers = _layers(start, around, n)
        if layers is None or len(layers) < 2:
            continue
        chain = _chain(part.verts, layers)
        if chain is not None:
            return chain
    return None


def _neighbours(faces: Ints, n: int) -> list[set[int]]:
    found: list[set[int]] = [set() for _ in range(n)]
    for a, b, c in faces.tolist():
        found[a] |= {b, c}
        found[b] |= {a, c}
        found[c] |= {a, b}
    return found


def _starts(part: Part, faces: Ints) -> list[list[int]]:
    """Return sets of vertices that a tube may begin with."""
    if part.loops:
        return [part.loops[0].tolist()]
    verts = part.verts
    axis = np.linalg.svd(verts - verts.mean(axis=0), full_matrices=False)[2][0]
    along = verts @ axis
    found = []
    for sign in (1.0, -1.0):
        tip = int(np.argmax(sign * along))
        found.append([tip])
        cap = _flat_cap(verts, faces, tip, sign * axis)
        if cap:
            found.append(cap)
    return found


def _flat_cap(verts: Floats, faces: Ints, vertex: int, outward: Floats) -> list[int]:
    """Return the vertices of the flat cap that a vertex belongs to."""
    normal = np.cross(
        verts[faces[:, 1]] - verts[faces[:, 0]], verts[faces[:, 2]] - verts[faces[:, 0]]
    )
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    at = np.flatnonzero((faces == vertex).any(axis=1))
    seed = at[np.argmax(normal[at] @ outward)]
    plane = normal @ normal[seed] > _FLAT
    level = verts @ normal[seed]
    size = float(np.linalg.norm(np.ptp(verts, axis=0)))
    plane &= (np.abs(level[faces] - level[vertex]) < 1e-4 * size).all(axis=1)
    found: list[int] = np.unique(faces[plane]).tolist()
    return found


def _layers(start: list[int], around: list[set[int]], n: int) -> list[list[int]] | None:
    """Return layers of neighbours from a start; None unless every one is a ring or a tip."""
    seen = set(start)
    layers = [start]
    while True:
        layer = sorted({b for a in layers[-1] for b in around[a]} - seen)
        if not layer:
            break
        if len(layer) > 1 and not _is_ring(layer, around):
            return None
        if len(layers[-1]) == 1 and len(layers) > 1:
            return None
        seen |= set(layer)
        layers.append(layer)
    sizes = {len(layer) for layer in layers[1:-1]}
    sizes |= {len(layer) for layer in (layers[0], layers[-1]) if len(layer) > 1}
    return layers if len(seen) == n and len(sizes) == 1 else None


def _is_ring(layer: list[int], around: list[set[int]]) -> bool:
    """Return whether vertices are connected and could be one ring, possibly with a flat cap."""
    members = set(layer)
    if len(layer) < 3 or any(len(around[a] & members) < 2 for a in layer):
        return False
    reached = {layer[0]}
    todo = [layer[0]]
    while todo:
        fresh = (around[todo.pop()] & members) - reached
        reached |= fresh
        todo += fresh
    links = sum(len(around[a] & members) for a in layer) // 2
    return len(reached) == len(layer) and links <= 2 * len(layer) - 3


def _chain(verts: Floats, layers: list[list[int]]) -> Skeleton | None:
    """Return the chain of the centres of layers."""
    centre = np.array([_ring_centre(verts[layer]) for layer in layers])
    radius = np.array(
        [
            float(np.linalg.norm(verts[layer] - c, axis=1).mean()) if len(layer) > 1 else 0.0
            for layer, c in zip(layers, centre, strict=True)
        ]
    )
    step = np.linalg.norm(np.diff(centre, axis=0), axis=1)
    big = float(radius.max())
    # A cap's own ring stands at the place of the rim it closes.
    keep = np.concatenate([[True], step > 1e-6 * big])
    if keep.sum() < 2:
        return None
    centre, radius = centre[keep], radius[keep]
    mapping = [np.array(layer) for layer, k in zip(layers, keep, strict=True) if k]
    positive = radius[radius > 0.0]
    if not len(positive):
        return None
    radius = np.where(radius > 0.0, radius, 0.3 * _beside(radius))
    if radius.mean() > 4.0 * float(step.sum()):
        return None  # a disc
    if radius[-1] > radius[0]:
        centre, radius, mapping = centre[::-1], radius[::-1], mapping[::-1]
    n = len(centre)
    edges = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    return Skeleton(centre.copy(), radius.copy(), edges, 0, tuple(mapping))


def _ring_centre(points: Floats) -> Floats:
    return np.asarray(points.mean(axis=0))


def _beside(radius: Floats) -> Floats:
    """Return the larger of the neighbours' radii."""
    padded = np.concatenate([[0.0], radius, [0.0]])
    return np.asarray(np.maximum(padded[:-2], padded[2:]))
