"""Several skeletons made one: the surface of the result is one closed manifold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pcsg.errors import UsageError
from pcsg.treemesh.skeleton import Floats, Ints, Skeleton

SAME = 0.5
"""What is closer to an axis than this, in radii, is joined to the axis itself."""


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


def merge(
    skel: Skeleton, other: Skeleton, node: int | None = None, *, along: bool = False
) -> Skeleton:
    """Join a skeleton to another, which keeps its numbers.

    Parameters
    ----------
    skel
        The one that bears.
    other
        The one that is attached.
    node
        The node of `other` that is joined; its root by default.
    along
        Join where the limb, continued backwards, passes the axis that bears it, if it does so
        within two and a half radii: a tube that ends at a trunk's surface does not bend there.

    Returns
    -------
    Skeleton
        The closest edge of `skel` is split there, and an edge leads to the node; if that lies
        closer to the axis than half the radius there, the two become one node.
    """
    own = other.root if node is None else node
    if not 0 <= own < other.n_nodes:
        raise UsageError(f"there is no node {own}: the last is {other.n_nodes - 1}")
    place = closest_place(skel, other.pos[own])
    if along:
        place = _place_behind(skel, other, own, place)
    base, at = node_at(skel, place)
    away = float(np.linalg.norm(base.pos[at] - other.pos[own]))
    same = away < SAME * float(base.radius[at])
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


def _place_behind(skel: Skeleton, other: Skeleton, node: int, place: Place) -> Place:
    """Return where a limb, continued backwards from its end, comes closest to the bearing axis."""
    ptr, others, _ = other.incidence
    radius = place.distance - place.gap
    if other.degree[node] != 1 or place.distance < 1e-6 * radius:
        return place
    way = other.pos[node] - other.pos[others[ptr[node]]]
    steps = np.linspace(0.0, 2.5 * radius, 26)[:, None] / float(np.linalg.norm(way))
    edge, part, distance, gap = _closest(skel, other.pos[node] + steps * way)
    # The first minimum: a limb that goes on from another's end lies on its axis from there on.
    nearing = distance[1:] < distance[:-1] - 1e-6 * radius
    k = int(np.argmin(nearing)) if not nearing.all() else len(nearing)
    if distance[k] > SAME * radius:
        return place
    return Place(int(edge[k]), float(part[k]), float(distance[k]), float(gap[k]))


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
    first = max(range(len(parts)), key=lambda k: (_bulk(parts[k]), -k))
    whole = parts[first]
    probes = _Probes(parts)
    probes.join(first)
    bridged = 0
    while probes.waiting.any():
        chosen = probes.next_inside()
        if chosen < 0:
            chosen, gap = probes.next_near()
            if gap > reach:
                raise UsageError(
                    f"{int(probes.waiting.sum())} of {len(parts)} parts float free: the nearest "
                    f"lies {gap:.3g} from the rest, more than {reach:.3g}; allow wider gaps with "
                    "--reach, or take the largest part with --largest-only"
                )
            bridged += gap > 0.0
        part, node = probes.attachment(chosen)
        whole = merge(whole, part, node, along=True)
        probes.join(chosen)
    whole.check()
    return whole, bridged


def _bulk(skel: Skeleton) -> float:
    """Return the volume of a skeleton's segments, without pi."""
    return float((skel.radius[skel.edges].mean(axis=1) ** 2 * skel.lengths).sum())


class _Probes:
    """How parts that wait lie to what is joined already: points of them, and their gaps.

    The points of a part are its ends, then samples of its segments, about a radius apart.
    """

    def __init__(self, parts: Sequence[Skeleton]) -> None:
        self.parts = parts
        self.waiting = np.ones(len(parts), dtype=bool)
        self.thick = np.array([float(p.radius.max()) for p in parts])
        found = [_sample(p) for p in parts]
        counts = [len(f.points) for f in found]
        self.ptr = np.concatenate([[0], np.cumsum(counts)])
        self.n_ends = np.array([len(f.ends) for f in found])
        self.ends = [f.ends for f in found]
        self.edge = np.concatenate([f.edge for f in found])
        self.part = np.concatenate([f.part for f in found])
        self.points = np.concatenate([f.points for f in found])
        self.radius = np.concatenate([f.radius for f in found])
        self.gap = np.full(len(self.points), np.inf)
        rank = np.arange(len(self.points)) - np.repeat(self.ptr[:-1], counts)
        self.is_end = rank < np.repeat(self.n_ends, counts)

    def join(self, k: int) -> None:
        """Take part k into account, which has just been joined."""
        self.waiting[k] = False
        alive = np.flatnonzero(np.repeat(self.waiting, np.diff(self.ptr)))
        for at in np.array_split(alive, 1 + len(alive) * self.parts[k].n_edges // 1_000_000):
            gap = _closest(self.parts[k], self.points[at])[3]
            self.gap[at] = np.minimum(self.gap[at], gap)

    def next_inside(self) -> int:
        """Return the thickest part with an end in what is joined, -1 if there is none."""
        end_gap = np.minimum.reduceat(np.where(self.is_end, self.gap, np.inf), self.ptr[:-1])
        inside = self.waiting & (end_gap <= 0.0)
        return int(np.argmax(np.where(inside, self.thick, -1.0))) if inside.any() else -1

    def next_near(self) -> tuple[int, float]:
        """Return the part that runs through what is joined or ends nearest to it, and the gap."""
        own = np.where(self.is_end | (self.gap <= 0.0), self.gap - self.radius, np.inf)
        gap = np.minimum.reduceat(own, self.ptr[:-1])
        gap[~self.waiting] = np.inf
        k = int(np.argmin(gap))
        return k, float(gap[k])

    def attachment(self, k: int) -> tuple[Skeleton, int]:
        """Return part k and the node to join: an end, or a point where it runs through.

        Of ends that lie inside, the thickest is taken.
        """
        part, own = self.parts[k], self.gap[self.ptr[k] : self.ptr[k + 1]]
        ends = own[: self.n_ends[k]]
        inside = np.flatnonzero(ends <= 0.0)
        if len(inside):
            best = inside[np.argmax(part.radius[self.ends[k][inside]])]
            return part, int(self.ends[k][best])
        i = int(np.argmin(own))
        passes = float(own[i]) <= 0.0
        if not passes or float(ends.min()) <= float(own[i]) + self.thick[k]:
            return part, int(self.ends[k][int(np.argmin(ends))])
        at = self.ptr[k] + i
        return split_edge(part, int(self.edge[at]), float(self.part[at]))


class _Sample(NamedTuple):
    """Ends of a part, and points of it with their edges, places along these and radii."""

    ends: Ints
    points: Floats
    edge: Ints
    part: Floats
    radius: Floats


def _sample(skel: Skeleton) -> _Sample:
    ends = skel.tips if len(skel.tips) else np.array([skel.root])
    a, b = skel.edges.T
    n = np.clip(np.ceil(skel.lengths / skel.radius[skel.edges].mean(axis=1)), 1, 64)
    counts = n.astype(np.int64)
    edge = np.repeat(np.arange(skel.n_edges), counts)
    rank = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    part = (rank + 0.5) / counts[edge]
    points = skel.pos[a[edge]] + part[:, None] * (skel.pos[b[edge]] - skel.pos[a[edge]])
    radius = skel.radius[a[edge]] + part * (skel.radius[b[edge]] - skel.radius[a[edge]])
    none = np.full(len(ends), -1)
    return _Sample(
        ends,
        np.concatenate([skel.pos[ends], points]),
        np.concatenate([none, edge]),
        np.concatenate([np.zeros(len(ends)), part]),
        np.concatenate([skel.radius[ends], radius]),
    )
