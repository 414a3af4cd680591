"""Skeletons of cylinders and cones, such as a grammar or a turtle draws."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pcsg.errors import UsageError
from pcsg.graph.leaves import Leaves
from pcsg.treemesh.merging import merge_all
from pcsg.treemesh.skeleton import FLARE, Floats, Ints, Skeleton, connected_groups

TOGETHER = 0.1
"""Ends closer than this, in radii, are one node."""


class Segments(NamedTuple):
    """Cylinders and cones one by one.

    Attributes
    ----------
    start, end : float64 (n, 3)
        Of their axes.
    radius : float64 (n, 2)
        At the start and at the end.
    label : int64 (n,)
        -1 for none.
    """

    start: Floats
    end: Floats
    radius: Floats
    label: Ints


class Assembled(NamedTuple):
    """A skeleton, and what was done to the segments."""

    skeleton: Skeleton
    notes: tuple[str, ...]


def segments_of(leaves: Leaves) -> tuple[Segments, int]:
    """Return the cylinders and cones among primitives, and how many others there are.

    What a difference or an intersection carves is none.
    """
    names = np.array(leaves.name)
    cones = names == "cone"
    here = np.flatnonzero(((names == "cylinder") | cones) & ~leaves.carved)
    top = np.array([leaves.arguments[k][0] if cones[k] else 1.0 for k in here.tolist()])
    m = leaves.matrix[here]
    x, y, z, foot = (m[:, :, k] for k in range(4))
    # The section of a cylinder may be an ellipse: the circle of the same area counts.
    length = np.maximum(np.sqrt((z * z).sum(axis=1)), 1e-300)
    radius = np.sqrt(np.abs((np.cross(x, y) * z).sum(axis=1)) / length)
    ends = np.stack([radius, radius * top], axis=1)
    others = len(names) - len(here) - int(np.count_nonzero(names == "empty"))
    return Segments(foot, foot + z, ends, leaves.label[here]), others


def join_segments(parts: Sequence[Segments]) -> Segments:
    """Return segments one after the other."""
    none = Segments(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2)), np.empty(0, np.int64))
    return Segments(*(np.concatenate(some) for some in zip(none, *parts, strict=True)))


def skeleton_of_segments(segments: Segments, reach: float | None = None) -> Assembled:
    """Join cylinders and cones to one skeleton.

    Ends that coincide become one node. What begins on the axis of another segment, or inside it,
    is joined to a node that is inserted there. A branch that is thinner than its bearer gets a node
    where it leaves it, so that it keeps its thickness.

    Parameters
    ----------
    reach
        Widest gap that is bridged; a twentieth of the diagonal of the box by default.

    Raises
    ------
    UsageError
        There is no segment, or a part floats free.
    """
    start, end = segments.start, segments.end
    if not len(start):
        raise UsageError("there is no cylinder or cone to make a skeleton of")
    if not (np.isfinite(start).all() and np.isfinite(end).all()):
        raise UsageError("a cylinder is not finite")
    diagonal = float(np.linalg.norm(np.ptp(np.concatenate([start, end]), axis=0)))
    length = np.linalg.norm(end - start, axis=1)
    thick = segments.radius.max(axis=1)
    keep = (length > 1e-9 * diagonal) & (thick > 0.0)
    if not keep.any():
        raise UsageError("no cylinder or cone has a length and a radius")
    start, end, label = start[keep], end[keep], segments.label[keep]
    radius = np.maximum(segments.radius[keep], 0.05 * thick[keep, None])
    notes = []
    if not keep.all():
        notes.append(f"{int((~keep).sum())} cylinders without length or radius were left out")

    node = _join_ends(np.concatenate([start, end]), radius.T.ravel())
    n = len(start)
    edges = np.stack([node[:n], node[n:]], axis=1)
    edges, ends, radius, label = _split_at_nodes(
        edges, np.stack([start, end], axis=1), radius, label
    )
    n = len(edges)
    whole = edges[:, 0] != edges[:, 1]
    # Of cylinders about one axis the thickest counts.
    order = np.argsort(-radius.max(axis=1), kind="stable")
    first = order[np.unique(np.sort(edges[order], axis=1), axis=0, return_index=True)[1]]
    single = np.zeros(n, dtype=bool)
    single[first] = True
    used = np.flatnonzero(whole & single)
    if not len(used):
        raise UsageError("all cylinders are shorter than a tenth of their radius")
    parts, loops = _parts(edges[used], ends[used], radius[used], label[used])
    if loops:
        notes.append(f"{loops} cylinders that would close a loop were left out")
    skel, bridged = merge_all(parts, 0.05 * diagonal if reach is None else reach)
    if len(parts) > 1:
        notes.append(f"{len(parts)} parts were joined")
    if bridged:
        notes.append(f"{bridged} gaps between parts were bridged")
    return Assembled(skel, tuple(notes))


def _join_ends(points: Floats, radius: Floats) -> Ints:
    """Return the number of the node of every end."""
    from scipy.spatial import cKDTree

    near = cKDTree(points).query_ball_point(points, TOGETHER * radius)
    counts = np.array([len(k) for k in near])
    i = np.repeat(np.arange(len(points)), counts)
    j = np.concatenate([np.array(k, dtype=np.int64) for k in near])
    # Both must be near in the thinner one's measure.
    distance = np.linalg.norm(points[i] - points[j], axis=1)
    close = distance <= TOGETHER * np.minimum(radius[i], radius[j])
    return connected_groups(len(points), i[close], j[close])


def _split_at_nodes(
    edges: Ints, ends: Floats, radius: Floats, label: Ints
) -> tuple[Ints, Floats, Floats, Ints]:
    """Cut segments at the nodes of others that lie on their axes.

    Parameters
    ----------
    edges (n, 2), ends (n, 2, 3), radius (n, 2), label (n,)
    """
    from scipy.spatial import cKDTree

    number, first = np.unique(edges.ravel(), return_index=True)
    places = ends.reshape(-1, 3)[first]
    thick = np.full(int(number.max()) + 1, np.inf)
    np.minimum.at(thick, edges.ravel(), radius.ravel())
    start, way = ends[:, 0], ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(way, axis=1)
    near = cKDTree(places).query_ball_point(0.5 * ends.sum(axis=1), 0.5 * length)
    rows: list[tuple[int, int, int, float, float]] = []
    for e, found in enumerate(near):
        a, b = edges[e].tolist()
        cuts = []
        for k in found:
            node = int(number[k])
            if node in (a, b):
                continue
            t = float((places[k] - start[e]) @ way[e]) / float(length[e]) ** 2
            away = float(np.linalg.norm(places[k] - start[e] - t * way[e]))
            own = (1.0 - t) * radius[e, 0] + t * radius[e, 1]
            if 0.0 < t < 1.0 and away <= TOGETHER * min(own, thick[node]):
                cuts.append((t, node))
        chain = [(0.0, a), *sorted(cuts), (1.0, b)]
        rows += [(e, p, q, s, t) for (s, p), (t, q) in itertools.pairwise(chain)]
    table = np.array(rows)
    source = table[:, 0].astype(np.int64)
    span = table[:, 3:5]
    return (
        table[:, 1:3].astype(np.int64),
        start[source][:, None] + span[:, :, None] * way[source][:, None],
        radius[source, :1] + span * (radius[source, 1:] - radius[source, :1]),
        label[source],
    )


def _parts(
    edges: Ints, ends: Floats, radius: Floats, label: Ints
) -> tuple[Sequence[Skeleton], int]:
    """Return connected skeletons, trees all of them, and how many edges would close loops."""
    number, flat = np.unique(edges.ravel(), return_inverse=True)
    edges = flat.reshape(-1, 2)
    n = len(number)
    count = np.bincount(edges.ravel(), minlength=n)
    pos = np.stack(
        [np.bincount(edges.ravel(), ends[:, :, k].ravel(), minlength=n) / count for k in range(3)],
        axis=1,
    )
    thick = np.zeros(n)
    np.maximum.at(thick, edges.ravel(), radius.ravel())

    group = np.arange(n)

    def find(a: int) -> int:
        while group[a] != a:
            group[a] = group[group[a]]
            a = int(group[a])
        return a

    kept = []
    # Thick ones first, so that a loop is opened at its thinnest.
    for e in np.argsort(-radius.min(axis=1), kind="stable").tolist():
        a, b = (find(int(v)) for v in edges[e])
        if a != b:
            group[b] = a
            kept.append(e)
    loops = len(edges) - len(kept)
    chosen = np.array(sorted(kept))
    whole = _add_shoulders(
        Skeleton(pos, thick, edges[chosen], 0, None, {"label": label[chosen]}), radius[chosen]
    )
    return _separate(whole), loops


def _separate(whole: Skeleton) -> list[Skeleton]:
    """Return the connected parts; each grows from the first node of its first edge."""
    part = connected_groups(whole.n_nodes, *whole.edges.T)
    edge_part = part[whole.edges[:, 0]]
    node_order, edge_order = (np.argsort(p, kind="stable") for p in (part, edge_part))
    count = int(part.max()) + 1
    node_at, edge_at = (
        np.searchsorted(p[order], np.arange(count + 1))
        for p, order in ((part, node_order), (edge_part, edge_order))
    )
    found = []
    for k in range(count):
        nodes = node_order[node_at[k] : node_at[k + 1]]
        own = edge_order[edge_at[k] : edge_at[k + 1]]
        found.append(whole.subset(nodes, own, int(whole.edges[own[0], 0])))
    return found


def _add_shoulders(skel: Skeleton, radius: Floats) -> Skeleton:
    """Insert nodes where thin segments leave thick nodes; radius (m, 2) is the segments' own."""
    thin = FLARE * radius < skel.radius[skel.edges]
    if not thin.any():
        return skel
    pos, thick = list(skel.pos), skel.radius.tolist()
    edges: list[tuple[int, int]] = []
    source: list[int] = []
    for e, (a, b) in enumerate(skel.edges.tolist()):
        chain = [a, b]
        for side in (0, 1):
            if not thin[e, side]:
                continue
            t = min(skel.radius[(a, b)[side]] / float(skel.lengths[e]), 0.45)
            t = t if side == 0 else 1.0 - t
            chain.insert(len(chain) - 1, len(pos))
            pos.append((1.0 - t) * skel.pos[a] + t * skel.pos[b])
            thick.append((1.0 - t) * radius[e, 0] + t * radius[e, 1])
        edges += itertools.pairwise(chain)
        source += [e] * (len(chain) - 1)
    tags = {name: t[np.array(source)] for name, t in skel.tags.items()}
    return Skeleton(np.array(pos), np.array(thick), np.array(edges), skel.root, None, tags)
