"""Line skeletons with radii, and how they divide into limbs, joints and tips."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.errors import UsageError, missing_extra

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FLARE = 1.5
"""A limb leaves a thicker joint at most this many times as thick as its next node is."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A connected graph of nodes with radii.

    Skeletons are never changed in place: every operation returns a new one.

    Attributes
    ----------
    pos : float64 (n, 3)
        Places of the nodes.
    radius : float64 (n,)
        Thickness at the nodes, > 0.
    edges : int64 (m, 2)
        Pairs of nodes. A tree has n - 1; a graph with loops gives a surface with handles.
    root : int
        The node that the tree grows from.
    mapping : tuple of int64 arrays or None
        For every node, the vertices of the original mesh that were contracted into it.
    tags : mapping of str to int64 (m,)
        Numbers for every edge, such as `order`, `branch` or `label`.
    """

    pos: Floats
    radius: Floats
    edges: Ints
    root: int = 0
    mapping: tuple[Ints, ...] | None = None
    tags: Mapping[str, Ints] = field(default_factory=dict)

    @classmethod
    def make(
        cls,
        pos: ArrayLike,
        radius: ArrayLike,
        edges: ArrayLike,
        root: int = 0,
        mapping: tuple[Ints, ...] | None = None,
        tags: Mapping[str, ArrayLike] | None = None,
    ) -> Skeleton:
        """Return a checked skeleton of arrays or lists.

        Raises
        ------
        UsageError
            What is wrong with it, and at which node or edge.
        """
        try:
            skel = cls(
                np.array(pos, dtype=np.float64).reshape(-1, 3),
                np.array(radius, dtype=np.float64).reshape(-1),
                np.array(edges, dtype=np.int64).reshape(-1, 2),
                int(root),
                mapping,
                {name: np.array(t, dtype=np.int64) for name, t in (tags or {}).items()},
            )
        except (TypeError, ValueError) as error:
            raise UsageError(f"a skeleton's arrays have the wrong form: {error}") from None
        skel.check()
        return skel

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.pos)

    @property
    def n_edges(self) -> int:
        """Number of segments."""
        return len(self.edges)

    @property
    def loops(self) -> int:
        """Number of independent loops, 0 for a tree."""
        return self.n_edges - self.n_nodes + 1

    @cached_property
    def degree(self) -> Ints:
        """Number of edges at every node, int64 (n,)."""
        return np.bincount(self.edges.ravel(), minlength=self.n_nodes)

    @cached_property
    def lengths(self) -> Floats:
        """Lengths of the edges, float64 (m,)."""
        a, b = self.edges.T
        return np.asarray(np.linalg.norm(self.pos[b] - self.pos[a], axis=1))

    @property
    def joints(self) -> Ints:
        """Nodes where three or more edges meet."""
        return np.flatnonzero(self.degree >= 3)

    @property
    def tips(self) -> Ints:
        """Nodes where one edge ends; the foot of a trunk is one too."""
        return np.flatnonzero(self.degree == 1)

    @cached_property
    def incidence(self) -> tuple[Ints, Ints, Ints]:
        """Edges by nodes: offsets (n + 1,), neighbouring nodes and edges (2m,)."""
        ends = self.edges.T.ravel()
        order = np.argsort(ends, kind="stable")
        ptr = np.concatenate([[0], np.cumsum(self.degree)])
        others = self.edges.T[::-1].ravel()[order]
        return ptr, others, order % max(1, self.n_edges)

    @cached_property
    def parents(self) -> tuple[Ints, Ints, Ints]:
        """Node and edge towards the root (-1 at the root), and nodes in order of distance."""
        ptr, others, edge_of = self.incidence
        parent, up = np.full(self.n_nodes, -1), np.full(self.n_nodes, -1)
        order = [self.root]
        seen = np.zeros(self.n_nodes, dtype=bool)
        seen[self.root] = True
        for a in order:
            for k in range(ptr[a], ptr[a + 1]):
                b = int(others[k])
                if not seen[b]:
                    seen[b] = True
                    parent[b], up[b] = a, edge_of[k]
                    order.append(b)
        return parent, up, np.array(order, dtype=np.int64)

    def check(self) -> None:
        """Refuse what no surface can be built on.

        Raises
        ------
        UsageError
            Not connected, an edge without length, a radius that is not positive, ...
        """
        n = self.n_nodes
        if n < 2 or self.n_edges < 1:
            raise UsageError("a skeleton needs at least two nodes and one edge")
        if len(self.radius) != n:
            raise UsageError(f"a skeleton of {n} nodes has {len(self.radius)} radii")
        if not np.isfinite(self.pos).all():
            raise UsageError(f"node {_first(~np.isfinite(self.pos.sum(axis=1)))} is not finite")
        bad: Bools = ~((self.radius > 0) & (self.radius < math.inf))
        if bad.any():
            k = _first(bad)
            raise UsageError(f"node {k} has the radius {self.radius[k]:g}; it must be positive")
        bad = np.asarray(((self.edges < 0) | (self.edges >= n)).any(axis=1))
        if bad.any():
            raise UsageError(f"edge {_first(bad)} names a node that does not exist")
        if not 0 <= self.root < n:
            raise UsageError(f"the root is node {self.root}, but there are {n} nodes")
        bad = self.edges[:, 0] == self.edges[:, 1]
        if bad.any():
            raise UsageError(
                f"edge {_first(bad)} joins node {self.edges[_first(bad), 0]} to itself"
            )
        if len(np.unique(np.sort(self.edges, axis=1), axis=0)) != self.n_edges:
            raise UsageError("two edges join the same nodes")
        extent = float(np.abs(self.pos - self.pos[0]).max())
        bad = self.lengths <= 1e-12 * extent
        if bad.any():
            raise UsageError(f"edge {_first(bad)} has no length: its nodes are at one place")
        reached = len(self.parents[2])
        if reached != n:
            raise UsageError(
                f"the skeleton is not connected: {reached} of {n} nodes hang together with the "
                "root; join the parts with `merge`"
            )
        if self.mapping is not None and len(self.mapping) != n:
            raise UsageError(f"the mapping names {len(self.mapping)} nodes, not {n}")
        for name, values in self.tags.items():
            if len(values) != self.n_edges:
                raise UsageError(f"the tag `{name}` has {len(values)} values, not {self.n_edges}")

    def replaced(self, **changes: Any) -> Skeleton:
        """Return a copy with other arrays, not checked."""
        return replace(self, **changes)

    def subset(self, nodes: ArrayLike, edges: ArrayLike, root: int) -> Skeleton:
        """Return the part with these nodes and edges (indices); root is a node of the whole."""
        keep = np.asarray(nodes, dtype=np.int64)
        kept = np.asarray(edges, dtype=np.int64)
        number = np.full(self.n_nodes, -1)
        number[keep] = np.arange(len(keep))
        mapping = None if self.mapping is None else tuple(self.mapping[k] for k in keep)
        return Skeleton(
            self.pos[keep],
            self.radius[keep],
            number[self.edges[kept]],
            int(number[root]),
            mapping,
            {name: t[kept] for name, t in self.tags.items()},
        )

    @cached_property
    def limbs(self) -> Limbs:
        """The division into limbs."""
        return find_limbs(self)

    def __repr__(self) -> str:
        return (
            f"<pcsg.treemesh.Skeleton of {self.n_edges} segments, {len(self.joints)} joints, "
            f"{len(self.tips)} tips>"
        )


def _first(wrong: Bools) -> int:
    return int(np.flatnonzero(wrong)[0])


def connected_groups(n: int, i: Ints, j: Ints) -> Ints:
    """Return the number of the connected group of every one of n things, linked in pairs (i, j)."""
    try:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
    except ImportError:
        raise UsageError(missing_extra("tree meshes need", "scipy", "mesh")) from None

    graph = coo_array((np.ones(len(i), dtype=bool), (i, j)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Limbs:
    """Maximal chains of segments whose inner nodes have degree 2, away from the root.

    Attributes
    ----------
    nodes, ptr : int64
        Limb k runs through ``nodes[ptr[k] : ptr[k + 1]]``.
    edges : int64
        The edge after every node of `nodes`; -1 after a limb's last.
    joints : int64 (j,)
        Nodes of the joints. A skeleton that is one ring has a joint of degree 2.
    ends : int64 (n_limbs, 2)
        The joint where every limb starts and ends, -1 for a tip.
    radius : float64
        Radius at every entry of `nodes`: the node's own, but at a joint at most `FLARE` times that
        of the limb's next node, so that a twig does not swell to the trunk that bears it.
    arc : float64
        Length along the limb, 0 at its start.
    """

    nodes: Ints
    ptr: Ints
    edges: Ints
    joints: Ints
    ends: Ints
    radius: Floats
    arc: Floats

    def __len__(self) -> int:
        return len(self.ptr) - 1

    @cached_property
    def limb_of(self) -> Ints:
        """The limb of every entry of `nodes`."""
        return np.repeat(np.arange(len(self)), np.diff(self.ptr))

    @cached_property
    def lengths(self) -> Floats:
        """Lengths of the limbs."""
        return self.arc[self.ptr[1:] - 1]

    @cached_property
    def joint_ends(self) -> tuple[Ints, Ints]:
        """Limb ends by joints: offsets (j + 1,), and ends as ``2 limb + (0 start, 1 end)``."""
        flat = self.ends.ravel()
        at_joint = np.flatnonzero(flat >= 0)
        order = at_joint[np.argsort(flat[at_joint], kind="stable")]
        counts = np.bincount(flat[at_joint], minlength=len(self.joints))
        return np.concatenate([[0], np.cumsum(counts)]), order


def find_limbs(skel: Skeleton) -> Limbs:
    """Divide a skeleton into limbs."""
    ptr, others, edge_of = (a.tolist() for a in skel.incidence)
    degree = skel.degree.tolist()
    used = [False] * skel.n_edges
    nodes: list[int] = []
    edges: list[int] = []
    starts = [0]
    if all(d == 2 for d in degree):
        keys = [skel.root]  # a ring has no joint but the one we choose
    else:
        keys = [int(a) for a in skel.parents[2] if degree[a] != 2]
    is_key = [d != 2 for d in degree]
    is_key[keys[0]] = True
    for a in keys:
        for k in range(ptr[a], ptr[a + 1]):
            if used[edge_of[k]]:
                continue
            node, at = a, k
            while True:
                used[edge_of[at]] = True
                nodes.append(node)
                edges.append(edge_of[at])
                before, node = edge_of[at], others[at]
                if is_key[node]:
                    break
                at = ptr[node] if edge_of[ptr[node]] != before else ptr[node] + 1
            nodes.append(node)
            edges.append(-1)
            starts.append(len(nodes))
    joints = np.array([a for a in keys if degree[a] != 1], dtype=np.int64)
    number = np.full(skel.n_nodes, -1)
    number[joints] = np.arange(len(joints))
    chain, first = np.array(nodes, dtype=np.int64), np.array(starts)
    ends = np.stack([number[chain[first[:-1]]], number[chain[first[1:] - 1]]], axis=1)
    return Limbs(
        chain,
        first,
        np.array(edges, dtype=np.int64),
        joints,
        ends,
        *limb_shapes(skel, chain, first, ends),
    )


def limb_shapes(skel: Skeleton, nodes: Ints, ptr: Ints, ends: Ints) -> tuple[Floats, Floats]:
    """Return the radii along limbs and the arc lengths; see `Limbs`."""
    radius = skel.radius[nodes]
    for side, at, after in ((0, ptr[:-1], ptr[:-1] + 1), (1, ptr[1:] - 1, ptr[1:] - 2)):
        free = ends[:, side] >= 0
        own, following = skel.radius[nodes[at]], skel.radius[nodes[after]]
        radius[at] = np.where(free, np.minimum(own, FLARE * following), own)
    places = skel.pos[nodes]
    step = np.zeros(len(nodes))
    step[1:] = np.linalg.norm(places[1:] - places[:-1], axis=1)
    step[ptr[:-1]] = 0.0
    total = np.cumsum(step)
    return radius, total - np.repeat(total[ptr[:-1]], np.diff(ptr))
