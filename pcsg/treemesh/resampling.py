"""Fewer nodes along the limbs, where these are straight enough.

After Zhu, Jin, You 2015, section 3.1. The angle printed there would delete bends and keep straight
runs; what is meant is the turning angle.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from pcsg.errors import UsageError
from pcsg.treemesh.pruning import distance_to_chain
from pcsg.treemesh.skeleton import Floats, Ints, Skeleton

OFFSET = 0.25
"""Farthest that a removed node may lie from the new segment, in radii."""

THICKNESS = 0.1
"""Most that its radius may differ from the new segment's, as a share."""


def resample(skel: Skeleton, eps_deg: float = 8.0, c: float = 1.5) -> Skeleton:
    """Remove nodes of degree 2 that hardly turn, or that stand closer than c radii.

    The candidate that turns least goes first. None goes that would lie farther than a quarter of
    its radius from the new segment, or whose radius would differ by more than 10 %, counting all
    nodes removed before. Joints, tips and the root stay.

    Parameters
    ----------
    eps_deg
        Turning angle, in degrees, below which a node may go; 0 for none.
    c
        Distance to a neighbour, in radii, below which a node may go; 0 for none.

    Returns
    -------
    Skeleton
        With the mapping of removed nodes handed to the nearer neighbour, and tags of the longer of
        two edges that became one.
    """
    if not (0.0 <= eps_deg <= 180.0 and c >= 0.0):
        raise UsageError("eps_deg must lie between 0 and 180, c must not be negative")
    return _Resampler(skel, eps_deg, c).run()


class _Resampler:
    """Edges and neighbours of nodes while some are removed."""

    def __init__(self, skel: Skeleton, eps_deg: float, c: float) -> None:
        self.skel, self.c = skel, c
        self.epsilon = math.radians(eps_deg)
        self.places = [tuple(p) for p in skel.pos.tolist()]
        ptr, others, edge_of = (a.tolist() for a in skel.incidence)
        self.around: list[list[tuple[int, int]]] = [
            [(others[k], edge_of[k]) for k in range(ptr[a], ptr[a + 1])]
            for a in range(skel.n_nodes)
        ]
        self.ends: dict[int, tuple[int, int]] = {
            e: (a, b) for e, (a, b) in enumerate(skel.edges.tolist())
        }
        self.removed_on: dict[int, list[int]] = {e: [] for e in self.ends}
        self.heir: dict[int, int] = {}
        self.source: dict[int, int] = {e: e for e in self.ends}
        self.version = [0] * skel.n_nodes
        self.heap: list[tuple[float, int, int]] = []

    def run(self) -> Skeleton:
        """Remove what may go."""
        skel = self.skel
        for a in range(skel.n_nodes):
            self._offer(a)
        while self.heap:
            _, a, version = heapq.heappop(self.heap)
            if version == self.version[a] and a not in self.heir:
                self._remove(a)
        if not self.heir:
            return skel
        kept = np.array([a for a in range(skel.n_nodes) if a not in self.heir])
        number = np.full(skel.n_nodes, -1)
        number[kept] = np.arange(len(kept))
        edge_ids = sorted(self.ends)
        source = np.array([self.source[e] for e in edge_ids])
        return Skeleton(
            skel.pos[kept],
            skel.radius[kept],
            number[np.array([self.ends[e] for e in edge_ids])],
            int(number[skel.root]),
            self._mapping(kept),
            {name: t[source] for name, t in skel.tags.items()},
        )

    def _offer(self, a: int) -> None:
        """Put a node into the heap if it is a candidate."""
        self.version[a] += 1
        if len(self.around[a]) != 2 or a == self.skel.root:
            return
        (p, _), (q, _) = self.around[a]
        if p == q:
            return
        before, after = (
            math.dist(self.places[p], self.places[a]),
            math.dist(self.places[a], self.places[q]),
        )
        if before == 0.0 or after == 0.0:
            turn = 0.0
        else:
            cosine = sum(
                (y - x) * (z - y)
                for x, y, z in zip(self.places[p], self.places[a], self.places[q], strict=True)
            ) / (before * after)
            turn = math.acos(max(-1.0, min(1.0, cosine)))
        if turn < self.epsilon or min(before, after) < self.c * self.skel.radius[a]:
            heapq.heappush(self.heap, (turn, a, self.version[a]))

    def _remove(self, a: int) -> None:
        """Replace the two edges of a node by one, if the guards allow it."""
        (p, e), (q, f) = self.around[a]
        if any(other == q for other, _ in self.around[p]):
            return  # a triangle would become an edge that is there already
        gone = [*self.removed_on[e], a, *self.removed_on[f]]
        if not self._fits(p, q, gone):
            return
        longer = e if self._length(e) >= self._length(f) else f
        near = (
            p
            if math.dist(self.places[p], self.places[a])
            <= math.dist(self.places[q], self.places[a])
            else q
        )
        self.source[e] = self.source[longer]
        self.heir[a] = near
        self.ends[e] = (p, q) if self.ends[e][0] == p else (q, p)
        self.removed_on[e] = gone
        del self.ends[f], self.removed_on[f]
        self.around[a] = []
        self.around[p] = [(q, e) if edge == e else (o, edge) for o, edge in self.around[p]]
        self.around[q] = [(p, e) if edge == f else (o, edge) for o, edge in self.around[q]]
        self._offer(p)
        self._offer(q)

    def _length(self, e: int) -> float:
        a, b = self.ends[e]
        return math.dist(self.places[a], self.places[b])

    def _fits(self, p: int, q: int, gone: list[int]) -> bool:
        """Return whether removed nodes lie near enough to the segment p q, in place and radius."""
        skel = self.skel
        ends = np.array([p, q])
        for a in gone:
            away, radius = distance_to_chain(skel.pos[ends], skel.radius[ends], skel.pos[a])
            own = skel.radius[a]
            if away[0] > OFFSET * own or abs(radius[0] - own) > THICKNESS * own:
                return False
        return True

    def _mapping(self, kept: Ints) -> tuple[Ints, ...] | None:
        """Hand the original vertices of removed nodes to those that stayed."""
        if self.skel.mapping is None:
            return None
        parts: dict[int, list[Ints]] = {int(a): [self.skel.mapping[a]] for a in kept}
        for a in self.heir:
            b = a
            while b in self.heir:
                b = self.heir[b]
            parts[b].append(self.skel.mapping[a])
        return tuple(np.sort(np.concatenate(parts[int(a)])) for a in kept)


def smooth_radii(skel: Skeleton) -> Floats:
    """Return radii averaged over three neighbours along limbs, one pass."""
    ptr, others, _ = skel.incidence
    radius = skel.radius.copy()
    inner = np.flatnonzero(skel.degree == 2)
    a, b = others[ptr[inner]], others[ptr[inner] + 1]
    radius[inner] = (skel.radius[a] + skel.radius[inner] + skel.radius[b]) / 3.0
    return radius
