"""From a contracted mesh to a graph: edges collapse until no face is left (Au et al. 2008).

Half-edge collapses i -> j, cheapest first: vertex i vanishes into j, j stays. Only edges that still
bound a face may collapse; an edge without faces is a finished edge of the skeleton. The cost is

    w_a (Fq_i(v_j) + Fq_j(v_j)) + w_b |v_i - v_j| sum over the neighbours k of i of |v_i - v_k|,

where Fq measures squared distances to the lines of the edges that were collapsed, which keeps the
shape, and the second term avoids long edges.

Edges and faces are kept in linked lists by vertices, which are joined at a collapse; dead entries
stay in them and are passed over. The heap is not searched: an entry counts only if its edge has
not changed since, and the heap is filled anew when it overflows.
"""

from __future__ import annotations

import math

import numpy as np

from pcsg.jit import njit
from pcsg.treemesh.skeleton import Floats, Ints

SHAPE_WEIGHT = 1.0
LENGTH_WEIGHT = 0.1


@njit
def _distance(verts: Floats, i: int, j: int) -> float:
    dx, dy, dz = verts[i, 0] - verts[j, 0], verts[i, 1] - verts[j, 1], verts[i, 2] - verts[j, 2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@njit
def _add_line(quadric: Floats, v: int, verts: Floats, i: int, j: int) -> None:
    """Add to quadric v the squared distance to the line through vertices i and j: K^T K."""
    size = _distance(verts, i, j)
    if size == 0.0:
        return
    ax = (verts[j, 0] - verts[i, 0]) / size
    ay = (verts[j, 1] - verts[i, 1]) / size
    az = (verts[j, 2] - verts[i, 2]) / size
    x, y, z = verts[i, 0], verts[i, 1], verts[i, 2]
    bx, by, bz = ay * z - az * y, az * x - ax * z, ax * y - ay * x
    quadric[v, 0] += ay * ay + az * az
    quadric[v, 1] -= ax * ay
    quadric[v, 2] -= ax * az
    quadric[v, 3] += ay * bz - az * by
    quadric[v, 4] += ax * ax + az * az
    quadric[v, 5] -= ay * az
    quadric[v, 6] += az * bx - ax * bz
    quadric[v, 7] += ax * ax + ay * ay
    quadric[v, 8] += ax * by - ay * bx
    quadric[v, 9] += bx * bx + by * by + bz * bz


@njit
def _quadric_at(quadric: Floats, i: int, verts: Floats, j: int) -> float:
    """Return Fq_i(v_j)."""
    x, y, z = verts[j, 0], verts[j, 1], verts[j, 2]
    q = quadric[i]
    inner = q[0] * x * x + q[4] * y * y + q[7] * z * z
    mixed = q[1] * x * y + q[2] * x * z + q[5] * y * z + q[3] * x + q[6] * y + q[8] * z
    value: float = inner + 2.0 * mixed + q[9]
    return max(0.0, value)


@njit
def _spread_of(v: int, verts: Floats, ends: Ints, alive: Ints, head: Ints, after: Ints) -> float:
    """Return the summed distances of the neighbours of a vertex."""
    total = 0.0
    slot = head[v]
    while slot >= 0:
        e = slot // 2
        if alive[e]:
            total += _distance(verts, ends[e, 0], ends[e, 1])
        slot = after[slot]
    return total


@njit
def _cost(
    i: int,
    j: int,
    verts: Floats,
    quadric: Floats,
    ends: Ints,
    alive: Ints,
    head: Ints,
    after: Ints,
) -> float:
    """Return the cost of i -> j."""
    shape = _quadric_at(quadric, i, verts, j) + _quadric_at(quadric, j, verts, j)
    spread = _spread_of(i, verts, ends, alive, head, after)
    return SHAPE_WEIGHT * shape + LENGTH_WEIGHT * _distance(verts, i, j) * spread


@njit
def _push(cost: Floats, item: Ints, size: int, c: float, half: int, version: int) -> None:
    """Put an entry into a heap of a size; the caller counts."""
    k = size
    while k > 0:
        up = (k - 1) // 2
        if cost[up] <= c:
            break
        cost[k] = cost[up]
        item[k, 0], item[k, 1] = item[up, 0], item[up, 1]
        k = up
    cost[k] = c
    item[k, 0], item[k, 1] = half, version


@njit
def _drop_first(cost: Floats, item: Ints, size: int) -> None:
    """Remove the first entry of a heap of a size; the caller counts."""
    c, half, version = cost[size - 1], item[size - 1, 0], item[size - 1, 1]
    k = 0
    while True:
        low = 2 * k + 1
        if low >= size - 1:
            break
        if low + 1 < size - 1 and cost[low + 1] < cost[low]:
            low += 1
        if cost[low] >= c:
            break
        cost[k] = cost[low]
        item[k, 0], item[k, 1] = item[low, 0], item[low, 1]
        k = low
    cost[k] = c
    item[k, 0], item[k, 1] = half, version


@njit
def _push_edge(
    e: int,
    size: int,
    cost: Floats,
    item: Ints,
    version: Ints,
    verts: Floats,
    quadric: Floats,
    ends: Ints,
    alive: Ints,
    head: Ints,
    after: Ints,
) -> int:
    """Push both collapses of an edge, return the new size."""
    for side in range(2):
        i, j = ends[e, side], ends[e, 1 - side]
        c = _cost(i, j, verts, quadric, ends, alive, head, after)
        _push(cost, item, size, c, 2 * e + side, version[e])
        size += 1
    return size


@njit(entry=True)
def collapse_faces(
    verts: Floats,
    faces: Ints,
    ends: Ints,
    count: Ints,
    alive: Ints,
    head: Ints,
    after: Ints,
    face_alive: Ints,
    face_head: Ints,
    face_after: Ints,
    quadric: Floats,
    parent: Ints,
    version: Ints,
    marked: Ints,
    cost: Floats,
    item: Ints,
) -> int:
    """Collapse edges until no face is left; return the number of faces left.

    Parameters
    ----------
    verts (v, 3), faces (f, 3)
        The contracted mesh; corners of faces are relabelled.
    ends (e, 2), count (e,), alive (e,)
        Edges, the faces at each, and whether it is there.
    head (v,), after (2 e,)
        Edges by vertices, as linked lists of ``2 edge + side``; -1 ends a list.
    face_alive (f,), face_head (v,), face_after (3 f,)
        Likewise faces, ``3 face + corner``.
    quadric (v, 10), parent (v,), version (e,), marked (v,)
        Room; `parent` names the vertex that a vertex vanished into, itself if it stays.
    cost (h,), item (h, 2)
        Room of the heap, h >= 4 e.
    """
    n_edges = len(ends)
    left = len(faces)
    for e in range(n_edges):
        for side in range(2):
            _add_line(quadric, ends[e, side], verts, ends[e, side], ends[e, 1 - side])
    size = 0
    while left > 0:
        if size == 0:
            for e in range(n_edges):
                if alive[e] and count[e] > 0:
                    size = _push_edge(
                        e, size, cost, item, version, verts, quadric, ends, alive, head, after
                    )
            if size == 0:
                return left
        c, half, stamp = cost[0], item[0, 0], item[0, 1]
        _drop_first(cost, item, size)
        size -= 1
        e, side = half // 2, half % 2
        if not alive[e] or version[e] != stamp or count[e] <= 0:
            continue
        i, j = ends[e, side], ends[e, 1 - side]
        true_cost = _cost(i, j, verts, quadric, ends, alive, head, after)
        if true_cost > c * (1.0 + 1e-9):
            # Neighbours have changed since.
            _push(cost, item, size, true_cost, half, stamp)
            size += 1
            continue

        alive[e] = 0
        # Mark j's neighbours by the edges that lead there.
        slot = head[j]
        while slot >= 0:
            f = slot // 2
            if alive[f]:
                marked[ends[f, 0] + ends[f, 1] - j] = f
            slot = after[slot]
        # Faces with i and j die, others of i become faces of j.
        last = -1
        slot = face_head[i]
        while slot >= 0:
            f, corner = slot // 3, slot % 3
            if face_alive[f]:
                p, q = faces[f, (corner + 1) % 3], faces[f, (corner + 2) % 3]
                if p == j or q == j:
                    face_alive[f] = 0
                    left -= 1
                    k = q if p == j else p
                    count[marked[k]] -= 1
                    s = head[i]
                    while s >= 0:
                        g = s // 2
                        if alive[g] and ends[g, 0] + ends[g, 1] - i == k:
                            count[g] -= 1
                            break
                        s = after[s]
                else:
                    faces[f, corner] = j
            last = slot
            slot = face_after[slot]
        if last >= 0:
            face_after[last] = face_head[j]
            face_head[j] = face_head[i]
        # Edges of i become edges of j, or one with that which leads to the same vertex.
        last = -1
        slot = head[i]
        while slot >= 0:
            f = slot // 2
            if alive[f]:
                k = ends[f, 0] + ends[f, 1] - i
                if marked[k] >= 0:
                    count[marked[k]] += count[f]
                    alive[f] = 0
                else:
                    ends[f, slot % 2] = j
                    marked[k] = f
            last = slot
            slot = after[slot]
        if last >= 0:
            after[last] = head[j]
            head[j] = head[i]
        for q in range(10):
            quadric[j, q] += quadric[i, q]
        parent[i] = j
        # Clear the marks, drop dead entries of j's list, and offer its edges again.
        before = -1
        slot = head[j]
        while slot >= 0:
            f = slot // 2
            following = after[slot]
            if alive[f]:
                marked[ends[f, 0] + ends[f, 1] - j] = -1
                version[f] += 1
                before = slot
            elif before >= 0:
                after[before] = following
            else:
                head[j] = following
            slot = following
        slot = head[j]
        while slot >= 0:
            f = slot // 2
            if alive[f] and count[f] > 0:
                if size + 2 > len(cost):
                    size = 0  # full: fill it anew
                    break
                size = _push_edge(
                    f, size, cost, item, version, verts, quadric, ends, alive, head, after
                )
            slot = after[slot]
    return left


def _lists(keys: Ints, n: int) -> tuple[Ints, Ints]:
    """Return linked lists of the positions of every key: heads (n,) and successors."""
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    after = np.full(len(keys), -1)
    same = ordered[1:] == ordered[:-1]
    after[order[:-1][same]] = order[1:][same]
    head = np.full(n, -1)
    first = np.flatnonzero(np.concatenate([[True], ~same])) if len(keys) else order
    head[ordered[first]] = order[first]
    return head, after


def collapse(verts: Floats, faces: Ints) -> tuple[Ints, Ints, Ints]:
    """Return the graph that a contracted mesh collapses to.

    Parameters
    ----------
    verts (v, 3), faces (f, 3)
        A closed, contracted mesh.

    Returns
    -------
    nodes : int64 (n,)
        The vertices that stay.
    edges : int64 (m, 2)
        Pairs of indices into `nodes`.
    node_of : int64 (v,)
        The node that every vertex vanished into: the induced map from vertices to the skeleton.
    """
    n = len(verts)
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(a, b) * n + np.maximum(a, b)
    unique, counts = np.unique(key, return_counts=True)
    ends = np.stack([unique // n, unique % n], axis=1)
    e = len(ends)
    head, after = _lists(ends.ravel(), n)
    face_head, face_after = _lists(faces.ravel(), n)
    alive = np.ones(e, dtype=np.int64)
    count = counts.astype(np.int64)
    parent = np.arange(n)
    room = max(64, 8 * e)
    scale = max(float(np.abs(verts - verts.mean(axis=0)).max()), 1e-300)
    left = collapse_faces(
        (verts - verts.mean(axis=0)) / scale,
        faces.copy(),
        ends,
        count,
        alive,
        head,
        after,
        np.ones(len(faces), dtype=np.int64),
        face_head,
        face_after,
        np.zeros((n, 10)),
        parent,
        np.zeros(e, dtype=np.int64),
        np.full(n, -1),
        np.empty(room),
        np.empty((room, 2), dtype=np.int64),
    )
    assert left == 0, "an edge bounds every face"
    while (parent[parent] != parent).any():
        parent = parent[parent]
    nodes = np.flatnonzero(parent == np.arange(n))
    number = np.full(n, -1)
    number[nodes] = np.arange(len(nodes))
    return nodes, number[ends[alive == 1]], number[parent]
