"""Operations on skeletons, and an editor that can undo them and keeps the surface up to date."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pcsg.errors import UsageError
from pcsg.treemesh.merging import merge, split_edge
from pcsg.treemesh.skeleton import Floats, Ints, Skeleton
from pcsg.treemesh.surface import QuadMesh, SurfaceOptions, make_options, tree_surface


def subtree(skel: Skeleton, edge: int) -> tuple[Ints, Ints]:
    """Return the nodes and the edges behind an edge, seen from the root.

    Raises
    ------
    UsageError
        There is no such edge, or it lies on a loop, so that nothing is behind it.
    """
    _check_edge(skel, edge)
    ptr, others, edge_of = skel.incidence
    parent, up, _ = skel.parents
    a, b = skel.edges[edge].tolist()
    start = b if up[b] == edge else a
    if up[start] != edge:
        raise UsageError(f"edge {edge} closes a loop: nothing is behind it")
    seen = {start}
    edges = []
    todo = [start]
    while todo:
        node = todo.pop()
        for k in range(ptr[node], ptr[node + 1]):
            e, other = int(edge_of[k]), int(others[k])
            if e == edge:
                continue
            edges.append(e)
            if other not in seen:
                seen.add(other)
                todo.append(other)
    if int(parent[start]) in seen:
        raise UsageError(f"edge {edge} lies on a loop: nothing is behind it")
    return np.array(sorted(seen)), np.unique(np.array(edges, dtype=np.int64))


def rotation(axis: ArrayLike, degrees: float) -> Floats:
    """Return the matrix of a rotation about an axis (3,)."""
    a = np.asarray(axis, dtype=np.float64)
    size = float(np.linalg.norm(a))
    if a.shape != (3,) or not size > 0.0 or not math.isfinite(degrees):
        raise UsageError("a rotation needs an axis of three numbers and an angle")
    x, y, z = a / size
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.radians(degrees)
    return np.asarray(np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * (k @ k))


def split(skel: Skeleton, edge: int, part: float = 0.5) -> Skeleton:
    """Insert a node in an edge; its radius is interpolated."""
    return split_edge(skel, edge, part)[0]


def rotate(skel: Skeleton, edge: int, axis: ArrayLike, degrees: float) -> Skeleton:
    """Turn all that is behind an edge about the edge's first node, as seen from the root."""
    nodes, _ = subtree(skel, edge)
    pivot = skel.pos[_near_end(skel, edge)]
    pos = skel.pos.copy()
    pos[nodes] = pivot + (pos[nodes] - pivot) @ rotation(axis, degrees).T
    return skel.replaced(pos=pos)


def translate_node(skel: Skeleton, node: int, vector: ArrayLike) -> Skeleton:
    """Move a node; the edges to it stretch."""
    _check_node(skel, node)
    pos = skel.pos.copy()
    pos[node] += _vector(vector)
    return skel.replaced(pos=pos)


def translate_subtree(skel: Skeleton, edge: int, vector: ArrayLike) -> Skeleton:
    """Move all that is behind an edge; the edge stretches."""
    nodes, _ = subtree(skel, edge)
    pos = skel.pos.copy()
    pos[nodes] += _vector(vector)
    return skel.replaced(pos=pos)


def append(skel: Skeleton, node: int, position: ArrayLike, radius: float) -> Skeleton:
    """Add a node with an edge to it from a given node; tags are those of the edge below."""
    _check_node(skel, node)
    _, up, _ = skel.parents
    ptr, _, edge_of = skel.incidence
    like = int(up[node]) if up[node] >= 0 else int(edge_of[ptr[node]])
    mapping = None if skel.mapping is None else (*skel.mapping, np.zeros(0, dtype=np.int64))
    return Skeleton(
        np.concatenate([skel.pos, _vector(position)[None]]),
        np.append(skel.radius, float(radius)),
        np.concatenate([skel.edges, [[node, skel.n_nodes]]]),
        skel.root,
        mapping,
        {name: np.append(t, t[like]) for name, t in skel.tags.items()},
    )


def delete(skel: Skeleton, edge: int) -> Skeleton:
    """Remove an edge with all that is behind it; a joint that has two edges left is none."""
    return detach(skel, edge)[0]


def detach(skel: Skeleton, edge: int) -> tuple[Skeleton, Skeleton]:
    """Cut an edge; return what stays and what was behind, with a tip at the cut.

    The cut-off part keeps the edge. What stays is as if it had never been there.
    """
    nodes, edges = subtree(skel, edge)
    stay_nodes = np.setdiff1d(np.arange(skel.n_nodes), nodes)
    stay_edges = np.setdiff1d(np.arange(skel.n_edges), np.append(edges, edge))
    if not len(stay_edges):
        raise UsageError("nothing would be left: the edge bears the whole skeleton")
    near = _near_end(skel, edge)
    off = skel.subset(np.append(nodes, near), np.append(edges, edge), near)
    if off.mapping is not None:
        off = off.replaced(mapping=(*off.mapping[:-1], np.zeros(0, dtype=np.int64)))
    # The foot of a twig is as thick as the twig, not as what bore it.
    radius = off.radius.copy()
    ptr, others, _ = off.incidence
    radius[-1] = min(radius[-1], 1.5 * radius[others[ptr[off.n_nodes - 1]]])
    return skel.subset(stay_nodes, stay_edges, skel.root), off.replaced(radius=radius)


def _near_end(skel: Skeleton, edge: int) -> int:
    """Return the end of an edge towards the root."""
    a, b = skel.edges[edge].tolist()
    return int(a) if skel.parents[1][b] == edge else int(b)


def _check_edge(skel: Skeleton, edge: int) -> None:
    if not 0 <= edge < skel.n_edges:
        raise UsageError(f"there is no edge {edge}: the last is {skel.n_edges - 1}")


def _check_node(skel: Skeleton, node: int) -> None:
    if not 0 <= node < skel.n_nodes:
        raise UsageError(f"there is no node {node}: the last is {skel.n_nodes - 1}")


def _vector(values: ArrayLike) -> Floats:
    v = np.asarray(values, dtype=np.float64)
    if v.shape != (3,) or not np.isfinite(v).all():
        raise UsageError("a place or a vector is three finite numbers")
    return v


class Editor:
    """A skeleton under edit.

    Every operation is a new skeleton that takes the place of the last; `undo` and `redo` go back
    and forth. The surface is built when it is asked for, and only where something changed.

    Parameters
    ----------
    skel
        To begin with.
    options, **more
        Of the surface; see `SurfaceOptions`.
    """

    def __init__(self, skel: Skeleton, options: SurfaceOptions | None = None, **more: Any) -> None:
        skel.check()
        self._past: list[Skeleton] = []
        self._future: list[Skeleton] = []
        self._skel = skel
        self._options = make_options(options, more)
        self._surface: QuadMesh | None = None
        self._surface_of: Skeleton | None = None

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton as it is now."""
        return self._skel

    @property
    def surface(self) -> QuadMesh:
        """The surface of the skeleton as it is now."""
        if self._surface is None or self._surface_of is not self._skel:
            self._surface = tree_surface(self._skel, self._options, previous=self._surface)
            self._surface_of = self._skel
        return self._surface

    def apply(self, operation: Callable[..., Skeleton], *args: Any, **kwargs: Any) -> Skeleton:
        """Apply an operation that takes a skeleton first and returns one.

        Raises
        ------
        UsageError
            The result would be no skeleton; nothing is changed then.
        """
        found = operation(self._skel, *args, **kwargs)
        found.check()
        self._past.append(self._skel)
        self._future.clear()
        self._skel = found
        return found

    def split(self, edge: int, part: float = 0.5) -> Skeleton:
        """Insert a node in an edge."""
        return self.apply(split, edge, part)

    def rotate(self, edge: int, axis: ArrayLike, degrees: float) -> Skeleton:
        """Turn all that is behind an edge."""
        return self.apply(rotate, edge, axis, degrees)

    def translate_node(self, node: int, vector: ArrayLike) -> Skeleton:
        """Move a node."""
        return self.apply(translate_node, node, vector)

    def translate_subtree(self, edge: int, vector: ArrayLike) -> Skeleton:
        """Move all that is behind an edge."""
        return self.apply(translate_subtree, edge, vector)

    def append(self, node: int, position: ArrayLike, radius: float) -> Skeleton:
        """Add a node with an edge."""
        return self.apply(append, node, position, radius)

    def delete(self, edge: int) -> Skeleton:
        """Remove an edge with all that is behind it."""
        return self.apply(delete, edge)

    def detach(self, edge: int) -> Skeleton:
        """Cut an edge and return what was behind it, a skeleton of its own."""
        stay, off = detach(self._skel, edge)
        self.apply(lambda _: stay)
        return off

    def merge(self, other: Skeleton, node: int | None = None) -> Skeleton:
        """Join another skeleton at the closest place."""
        return self.apply(merge, other, node)

    @property
    def history(self) -> Sequence[Skeleton]:
        """The skeletons before this one."""
        return tuple(self._past)

    def undo(self) -> bool:
        """Take the last operation back; return whether there was one."""
        if not self._past:
            return False
        self._future.append(self._skel)
        self._skel = self._past.pop()
        return True

    def redo(self) -> bool:
        """Do again what was taken back; return whether there was anything."""
        if not self._future:
            return False
        self._past.append(self._skel)
        self._skel = self._future.pop()
        return True
