"""Closed polygon meshes, and Catmull-Clark subdivision (Catmull, Clark 1978).

After the first step all faces are quads. The connectivity of a level depends on the faces only, so
it is worked out once and used again while vertices move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pcsg.errors import UsageError
from pcsg.treemesh.limits import check_levels
from pcsg.treemesh.skeleton import Floats, Ints


@dataclass(frozen=True, eq=False)
class PolyMesh:
    """A mesh of polygons.

    Attributes
    ----------
    verts : float64 (v, 3)
    flat : int64 (c,)
        The corners of all faces, one face after the other, counter-clockwise from outside.
    ptr : int64 (f + 1,)
        Where every face begins in `flat`.
    """

    verts: Floats
    flat: Ints
    ptr: Ints

    @classmethod
    def from_quads(cls, verts: Floats, quads: Ints) -> PolyMesh:
        """Return quads (f, 4) as polygons."""
        return cls(verts, quads.ravel(), np.arange(0, quads.size + 1, 4))

    @cached_property
    def sizes(self) -> Ints:
        """Number of corners of every face."""
        return np.diff(self.ptr)


@dataclass(frozen=True, eq=False)
class Topology:
    """How the corners of a closed mesh hang together.

    Attributes
    ----------
    face, following, preceding : int64 (c,)
        For every corner its face, and the next and previous corner of that face.
    edge : int64 (c,)
        For every corner the edge to the next corner.
    pair : int64 (e, 2)
        The two corners where every edge begins, once in each direction.
    n_verts, n_edges, n_faces : int
    """

    face: Ints
    following: Ints
    preceding: Ints
    edge: Ints
    pair: Ints
    n_verts: int
    n_edges: int
    n_faces: int

    @property
    def euler(self) -> int:
        """Euler's characteristic V - E + F."""
        return self.n_verts - self.n_edges + self.n_faces


def corner_steps(ptr: Ints) -> tuple[Ints, Ints, Ints]:
    """Return for every corner its face, the next and the previous corner of the face."""
    sizes = np.diff(ptr)
    face = np.repeat(np.arange(len(sizes)), sizes)
    corner = np.arange(ptr[-1])
    following, preceding = corner + 1, corner - 1
    following[ptr[1:] - 1] = ptr[:-1]
    preceding[ptr[:-1]] = ptr[1:] - 1
    return face, following, preceding


def find_topology(flat: Ints, ptr: Ints, n_verts: int) -> Topology:
    """Work out the edges of a closed, oriented mesh.

    Raises
    ------
    UsageError
        An edge does not have exactly two faces with opposite directions, or a vertex is not used.
    """
    face, following, preceding = corner_steps(ptr)
    a, b = flat, flat[following]
    key = np.minimum(a, b) * n_verts + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    if len(flat) % 2 or (ordered[0::2] != ordered[1::2]).any():
        raise UsageError("the mesh is not closed: an edge does not have two faces")
    if (ordered[1:-1:2] == ordered[2::2]).any():
        raise UsageError("the mesh is not a manifold: an edge has more than two faces")
    pair = order.reshape(-1, 2)
    if (a[pair[:, 0]] == a[pair[:, 1]]).any():
        raise UsageError("the mesh is not oriented: two faces run through an edge the same way")
    used = np.zeros(n_verts, dtype=bool)
    used[flat] = True
    if not used.all():
        raise UsageError("the mesh has a vertex without faces")
    edge = np.empty(len(flat), dtype=np.int64)
    edge[order] = np.repeat(np.arange(len(pair)), 2)
    return Topology(face, following, preceding, edge, pair, n_verts, len(pair), len(ptr) - 1)


@dataclass(frozen=True, eq=False)
class Level:
    """One step of Catmull-Clark: connectivity before, quads after.

    Attributes
    ----------
    flat, ptr, topology
        The mesh before.
    quads : int64 (c, 4)
        The mesh after; quad c belongs to corner c before. Its vertices are the old ones, then one
        for each edge, then one for each face.
    """

    flat: Ints
    ptr: Ints
    topology: Topology
    quads: Ints

    @cached_property
    def _valence(self) -> Floats:
        return np.bincount(self.flat, minlength=self.topology.n_verts).astype(np.float64)

    def apply(self, verts: Floats) -> Floats:
        """Return the vertices after the step, (V + E + F, 3)."""
        t = self.topology
        sizes = np.diff(self.ptr)[:, None]
        fp = np.add.reduceat(verts[self.flat], self.ptr[:-1], axis=0) / sizes
        c0, c1 = t.pair.T
        v0, v1 = self.flat[c0], self.flat[c1]
        middle = 0.5 * (verts[v0] + verts[v1])
        ep = 0.5 * middle + 0.25 * (fp[t.face[c0]] + fp[t.face[c1]])
        n = self._valence[:, None]
        acc = _scatter(fp[t.face], self.flat, t.n_verts)
        acc += 2.0 * (_scatter(middle, v0, t.n_verts) + _scatter(middle, v1, t.n_verts))
        vp = ((n - 3.0) * verts + acc / n) / n
        return np.concatenate([vp, ep, fp])

    def apply_corners(self, values: Floats) -> Floats:
        """Return values at the corners of faces, (c, k), at the corners of the quads, (c, 4, k).

        Linear within each face, so that texture coordinates may jump between faces.
        """
        t = self.topology
        ahead = 0.5 * (values + values[t.following])
        centre = np.add.reduceat(values, self.ptr[:-1], axis=0) / np.diff(self.ptr)[:, None]
        return np.stack([values, ahead, centre[t.face], ahead[t.preceding]], axis=1)


def _scatter(values: Floats, index: Ints, n: int) -> Floats:
    return np.stack([np.bincount(index, v, minlength=n) for v in values.T], axis=1)


def plan_level(flat: Ints, ptr: Ints, n_verts: int) -> Level:
    """Return the step that follows a closed mesh."""
    t = find_topology(flat, ptr, n_verts)
    ahead = n_verts + t.edge
    centre = n_verts + t.n_edges + t.face
    quads = np.stack([flat, ahead, centre, ahead[t.preceding]], axis=1)
    return Level(flat, ptr, t, quads)


def plan_levels(flat: Ints, ptr: Ints, n_verts: int, levels: int) -> list[Level]:
    """Return the steps of a subdivision, at least one."""
    check_levels(levels)
    plans = [plan_level(flat, ptr, n_verts)]
    while len(plans) < levels:
        last = plans[-1]
        t = last.topology
        n = t.n_verts + t.n_edges + t.n_faces
        plans.append(plan_level(last.quads.ravel(), np.arange(0, last.quads.size + 1, 4), n))
    return plans


def subdivide(verts: Floats, levels: Sequence[Level]) -> Floats:
    """Return the vertices after all steps."""
    for level in levels:
        verts = level.apply(verts)
    return verts
