"""Twigs that nobody would see: those that end inside a thicker limb."""

from __future__ import annotations

import numpy as np

from pcsg.treemesh.skeleton import Floats, Ints, Skeleton


def drop_hidden_twigs(skel: Skeleton) -> tuple[Skeleton, Ints]:
    """Remove limbs that end inside a thicker limb of the joint they hang on.

    Returns
    -------
    Skeleton, int64 (k,)
        What is left, and the edges that were removed. A joint of degree 2 becomes a normal node.
    """
    dropped: list[int] = []
    edge_ids = np.arange(skel.n_edges)
    while True:
        hidden = _hidden_limbs(skel)
        if not hidden:
            return skel, edge_ids[:0] if not dropped else np.array(sorted(dropped))
        limbs = skel.limbs
        lost_edges = np.concatenate(
            [limbs.edges[limbs.ptr[k] : limbs.ptr[k + 1] - 1] for k in hidden]
        )
        lost_nodes = np.concatenate(
            [
                np.setdiff1d(
                    limbs.nodes[limbs.ptr[k] : limbs.ptr[k + 1]], limbs.joints, assume_unique=True
                )
                for k in hidden
            ]
        )
        dropped += edge_ids[lost_edges].tolist()
        keep_edges = np.setdiff1d(np.arange(skel.n_edges), lost_edges)
        keep_nodes = np.setdiff1d(np.arange(skel.n_nodes), lost_nodes)
        edge_ids = edge_ids[keep_edges]
        skel = skel.subset(keep_nodes, keep_edges, skel.root)


def _hidden_limbs(skel: Skeleton) -> list[int]:
    """Return limbs whose tip lies inside a thicker limb of their joint, one for each joint."""
    limbs = skel.limbs
    ptr, ends = limbs.joint_ends
    found = []
    for j in range(len(limbs.joints)):
        own = ends[ptr[j] : ptr[j + 1]]
        if len(own) < 3:
            continue
        for e in own.tolist():
            k, side = e // 2, e % 2
            if limbs.ends[k, 1 - side] >= 0 or skel.root in (
                limbs.nodes[limbs.ptr[k]],
                limbs.nodes[limbs.ptr[k + 1] - 1],
            ):
                continue
            tip = limbs.ptr[k + 1] - 1 if side == 0 else limbs.ptr[k]
            if any(_covers(skel, f // 2, tip) for f in own.tolist() if f // 2 != k):
                found.append(k)
                break
    return found


def _covers(skel: Skeleton, limb: int, tip: int) -> bool:
    """Return whether a limb contains a tip (an entry of `Limbs.nodes`) and is thicker there."""
    limbs = skel.limbs
    at = slice(limbs.ptr[limb], limbs.ptr[limb + 1])
    places, radii = skel.pos[limbs.nodes[at]], limbs.radius[at]
    point = skel.pos[limbs.nodes[tip]]
    distance, radius = distance_to_chain(places, radii, point)
    own = limbs.radius[tip]
    return bool(((radius > own) & (distance + 0.5 * own < radius)).any())


def distance_to_chain(places: Floats, radii: Floats, point: Floats) -> tuple[Floats, Floats]:
    """Return the distance of a point from every segment of a chain, and the radius there."""
    a, b = places[:-1], places[1:]
    d = b - a
    t = np.einsum("ij,ij->i", point - a, d) / np.maximum(np.einsum("ij,ij->i", d, d), 1e-300)
    t = np.clip(t, 0.0, 1.0)
    away = np.linalg.norm(point - a - t[:, None] * d, axis=1)
    return away, radii[:-1] + t * (radii[1:] - radii[:-1])
