"""Twigs that nobody would see: those that end inside a thicker limb."""

from __future__ import annotations

import numpy as np

from pcsg.errors import UsageError
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


def branch_orders(skel: Skeleton) -> Ints:
    """Return the order of every edge: 0 for the trunk, one more for every side branch, (m,).

    At a joint the axis goes on in the thickest child, of equal ones in the straightest.
    """
    parent, up, order = skel.parents
    a, b = skel.edges.T
    children: dict[int, list[int]] = {}
    for node in order[1:].tolist():
        children.setdefault(int(parent[node]), []).append(node)
    found = np.zeros(skel.n_edges, dtype=np.int64)
    level = np.zeros(skel.n_nodes, dtype=np.int64)
    for node in order.tolist():
        below = children.get(node, [])
        if not below:
            continue
        came = skel.pos[node] - skel.pos[parent[node]] if parent[node] >= 0 else None

        def rank(child: int, node: int = node, came: Floats | None = came) -> tuple[float, float]:
            way = skel.pos[child] - skel.pos[node]
            straight = 0.0
            if came is not None:
                straight = float(way @ came / np.linalg.norm(way) / np.linalg.norm(came))
            return round(float(skel.radius[child]), 9), straight

        best = max(below, key=rank)
        for child in below:
            level[child] = level[node] + (child != best)
            found[up[child]] = level[child]
    # Edges that close loops belong to the higher of their ends.
    closing = np.setdiff1d(np.arange(skel.n_edges), up[up >= 0])
    found[closing] = np.maximum(level[a[closing]], level[b[closing]])
    return found


def thin_out(
    skel: Skeleton, min_radius: float = 0.0, max_order: int | None = None
) -> tuple[Skeleton, int]:
    """Remove twigs with all that they bear.

    Parameters
    ----------
    min_radius
        Least radius of a node that stays.
    max_order
        Highest order of an edge that stays; see `branch_orders`.

    Returns
    -------
    Skeleton, int
        What is left, and the number of edges that were removed.
    """
    parent, up, order = skel.parents
    orders = branch_orders(skel)
    keep = np.zeros(skel.n_nodes, dtype=bool)
    keep[skel.root] = True
    for node in order[1:].tolist():
        thick = skel.radius[node] >= min_radius
        low = max_order is None or orders[up[node]] <= max_order
        keep[node] = keep[parent[node]] and thick and low
    edges = np.flatnonzero(keep[skel.edges].all(axis=1))
    if not len(edges):
        raise UsageError("nothing is left of the skeleton: lower --min-radius or raise --max-order")
    return skel.subset(np.flatnonzero(keep), edges, skel.root), skel.n_edges - len(edges)


def extend_foot(skel: Skeleton) -> Skeleton:
    """Return the skeleton with its root moved back by one radius.

    The surface closes in a dome about half a radius beyond the root; so the trunk has its full
    thickness where it leaves the ground.
    """
    ptr, others, _ = skel.incidence
    root = skel.root
    if skel.degree[root] != 1:
        return skel
    way = skel.pos[root] - skel.pos[others[ptr[root]]]
    pos = skel.pos.copy()
    pos[root] += skel.radius[root] * way / np.linalg.norm(way)
    return skel.replaced(pos=pos)
