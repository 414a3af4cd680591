"""Several skeletons made one: the surface of the result is one closed manifold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pcsg.errors import UsageError
from pcsg.treemesh.skeleton import Floats, Ints, Skeleton

SAME = 0.5
"""Nodes closer than this, in radii, become one when skeletons are merged."""


class Place(NamedTuple):
    """A point of a skeleton: an edge, how far along it, and how far another point is from it."""

    edge: int
    part: float
    distance: float
    gap: float


def closest_place(skel: Skeleton, point: Floats) -> Place:
    """Return the place of a skeleton whose surface is closest to a point (3,)."""
    edge, part, distance, gap = _closest(skel, np.asarray(point)[None])
    return Place(int(edge[0]), float(part[0]), float(distance[0]), float(gap[0]))


def _closest(skel: Skeleton, points: Floats) -> tuple[Ints, Floats, Floats, Floats]:
    a, b = skel.edges.T
    start, way = skel.pos[a], skel.pos[b] - skel.pos[a]
    squared = np.einsum("ij,ij->i", way, way)
    offset = points[:, None] - start
    part = np.clip(np.einsum("pij,ij->pi", offset, way) / squared, 0.0, 1.0)
    distance = np.linalg.norm(offset - part[:, :, None] * way, axis=2)
    gap = distance - (skel.radius[a] + part * (skel.radius[b] - skel.radius[a]))
    best = gap.argmin(axis=1)
    at = (np.arange(len(points)), best)
    return best, part[at], distance[at], gap[at]


def split_edge(skel: Skeleton, edge: int, part: float) -> tuple[Skeleton, int]:
    """Insert a node in an edge; return the skeleton and the node's number.

    Parameters
    ----------
    part
        Where, from 0 to 1, both excluded; the radius is interpolated.
    """
    if not 0 <= edge < skel.n_edges:
        raise UsageError(f"there is no edge {edge}: the last is {skel.n_edges - 1}")
    if not 0.0 < part < 1.0:
        raise UsageError(f"an edge is split between 0 and 1, not at {part:g}")
    a, b = skel.edges[edge]
    node = skel.n_nodes
    edges = np.concatenate([skel.edges, [[node, b]]])
    edges[edge] = a, node
    mapping = None if skel.mapping is None else (*skel.mapping, np.zeros(0, dtype=np.int64))
    split = Skeleton(
        np.concatenate([skel.pos, [(1.0 - part) * skel.pos[a] + part * skel.pos[b]]]),
        np.append(skel.radius, (1.0 - part) * skel.radius[a] + part * skel.radius[b]),
        edges,
        skel.root,
        mapping,
        {name: np.append(t, t[edge]) for name, t in skel.tags.items()},
    )
    return split, node


def node_at(skel: Skeleton, place: Place) -> tuple[Skeleton, int]:
    """Return a skeleton with a node at a place, an old one if it is near enough."""
    a, b = skel.edges[place.edge].tolist()
    length = float(skel.lengths[place.edge])
    radius = (1.0 - place.part) * skel.radius[a] + place.part * skel.radius[b]
    margin = min(SAME * radius, 0.5 * length)
    if place.part * length <= margin:
        return skel, a
    if (1.0 - place.part) * length <= margin:
        return skel, b
    return split_edge(skel, place.edge, place.part)


def merge(skel: Skeleton, other: Skeleton, node: int | None = None) -> Skeleton:
    """Join a skeleton to another, which keeps its numbers.

    Parameters
    ----------
    skel
        The one that bears.
    other
        The one that is attached.
    node
        The node of `other` that is joined; its root by default.

    Returns
    -------
    Skeleton
        The closest edge of `skel` is split there, and an edge leads to the node; if the two are
        closer than half a radius, they become one node.
    """
    own = other.root if node is None else node
    if not 0 <= own < other.n_nodes:
        raise UsageError(f"there is no node {own}: the last is {other.n_nodes - 1}")
    place = closest_place(skel, other.pos[own])
    base, at = node_at(skel, place)
    away = float(np.linalg.norm(base.pos[at] - other.pos[own]))
    same = away < SAME * float(other.radius[own])
    number = base.n_nodes + np.arange(other.n_nodes)
    keep = np.ones(other.n_nodes, dtype=bool)
    link = np.zeros((0, 2), dtype=np.int64)
    if same:
        number = base.n_nodes + np.arange(other.n_nodes) - (np.arange(other.n_nodes) > own)
        number[own] = at
        keep[own] = False
    else:
        link = np.array([[at, base.n_nodes + own]])
    tags = {}
    for name in sorted({*base.tags, *other.tags}):
        mine = base.tags.get(name, np.full(base.n_edges, -1))
        theirs = other.tags.get(name, np.full(other.n_edges, -1))
        beside = theirs[(other.edges == own).any(axis=1)][: len(link)]
        tags[name] = np.concatenate([mine, beside, theirs])
    mapping = None
    if base.mapping is not None and other.mapping is not None:
        mapping = (*base.mapping, *(m for m, k in zip(other.mapping, keep, strict=True) if k))
    return Skeleton(
        np.concatenate([base.pos, other.pos[keep]]),
        np.concatenate([base.radius, other.radius[keep]]),
        np.concatenate([base.edges, link, number[other.edges]]),
        base.root,
        mapping,
        tags,
    )


def merge_all(parts: Sequence[Skeleton], reach: float) -> tuple[Skeleton, int]:
    """Join skeletons that belong to one tree.

    The thickest part comes first. Then, again and again, the thickest of those whose end lies in
    what is joined already; if there is none, the one whose surface is nearest.

    Parameters
    ----------
    reach
        Widest gap that is bridged.

    Returns
    -------
    Skeleton, int
        The whole, and how many gaps were bridged.

    Raises
    ------
    UsageError
        A part lies farther away.
    """
    size = [float((p.radius[p.edges].mean(axis=1) ** 2 * p.lengths).sum()) for p in parts]
    first = int(np.argmax(size))
    whole = parts[first]
    waiting = [k for k in range(len(parts)) if k != first]
    probes = {k: _Probe(parts[k]) for k in waiting}
    thick = {k: float(parts[k].radius.max()) for k in waiting}
    bridged = 0
    for k in waiting:
        probes[k].look_at(parts[first])
    while waiting:
        inside = [k for k in waiting if probes[k].end_gap <= 0.0]
        if inside:
            chosen = max(inside, key=lambda k: (thick[k], -k))
        else:
            chosen = min(waiting, key=lambda k: (probes[k].least_gap, k))
            gap = probes[chosen].least_gap
            if gap > reach:
                raise UsageError(
                    f"{len(waiting)} of {len(parts)} parts float free: the nearest lies {gap:.3g} "
                    f"from the rest, more than {reach:.3g}; allow wider gaps with --reach, or take "
                    "the largest part with --largest-only"
                )
            bridged += gap > 0.0
        waiting.remove(chosen)
        part, node = probes[chosen].attachment()
        whole = merge(whole, part, node)
        for k in waiting:
            probes[k].look_at(parts[chosen])
    whole.check()
    return whole, bridged


class _Probe:
    """How a waiting part lies to what is joined already."""

    def __init__(self, part: Skeleton) -> None:
        self.part = part
        ends = part.tips if len(part.tips) else np.array([part.root])
        places = [np.zeros(len(ends))]
        edges = [np.full(len(ends), -1)]
        points = [part.pos[ends]]
        a, b = part.edges.T
        for e, n in enumerate(np.ceil(part.lengths / part.radius[part.edges].mean(axis=1))):
            t = (np.arange(min(n, 64.0)) + 0.5) / min(n, 64.0)
            places.append(t)
            edges.append(np.full(len(t), e))
            points.append(part.pos[a[e]] + t[:, None] * (part.pos[b[e]] - part.pos[a[e]]))
        self.ends = ends
        self.part_of, self.edge = np.concatenate(places), np.concatenate(edges)
        self.points = np.concatenate(points)
        self.gap = np.full(len(self.points), np.inf)

    def look_at(self, other: Skeleton) -> None:
        """Take a part into account that has just been joined."""
        self.gap = np.minimum(self.gap, _closest(other, self.points)[3])

    @property
    def end_gap(self) -> float:
        """Distance of the nearest end from the surface, negative inside."""
        return float(self.gap[: len(self.ends)].min())

    @property
    def least_gap(self) -> float:
        """Distance of the nearest point of the part's surface."""
        radius = self.part.radius
        a, b = self.part.edges[self.edge].T
        own = radius[a] + self.part_of * (radius[b] - radius[a])
        own[: len(self.ends)] = radius[self.ends]
        return float((self.gap - own).min())

    def attachment(self) -> tuple[Skeleton, int]:
        """Return the part and the node to join: an end, or a point where it runs through.

        Of ends that lie inside, the thickest is taken.
        """
        ends = self.gap[: len(self.ends)]
        inside = np.flatnonzero(ends <= 0.0)
        if len(inside):
            best = inside[np.argmax(self.part.radius[self.ends[inside]])]
            return self.part, int(self.ends[best])
        k = int(np.argmin(self.gap))
        near_end = float(ends.min()) <= float(self.gap[k]) + float(self.part.radius.max())
        if near_end or k < len(self.ends):
            return self.part, int(self.ends[int(np.argmin(ends))])
        return split_edge(self.part, int(self.edge[k]), float(self.part_of[k]))
