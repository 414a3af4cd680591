"""Which triangles bound a volume, and what makes them do so: joining corners, turning facets.

Programs write a corner once for every facet, rounded each time anew, or facets as they were drawn,
some of them inside out. Where joining corners that differ by rounding and turning facets round
closes a mesh, it is a solid; where it does not, it stays as it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.meshfile.mesh import Floats, Integers, Notes

TOLERANCE = 1e-6
"""Corners that are nearer, relative to the longest side of the box, differ by rounding."""

MAJORITY = 0.9
"""Where fewer facets than this share turn alike, their part is turned outwards."""

FLAT = 1e-13
"""Thickness, relative to the size, of what has no volume."""


class Closing(NamedTuple):
    """What was found out about a mesh.

    Attributes
    ----------
    closed
        Whether the triangles bound a volume once they are turned and joined.
    twin : int64 (V,)
        The vertex that stands for each vertex.
    turned : bool (T,)
        Which triangles are turned round.
    dropped : bool (T,)
        Which triangles are left out, since another one says the same, or they have shrunk.
    open_edges : int64 (E, 2)
        Vertices of the edges where it is open, as the file has them.
    notes
        What was done, a sentence for each kind.
    """

    closed: bool
    twin: Integers
    turned: NDArray[np.bool_]
    dropped: NDArray[np.bool_]
    open_edges: Integers
    notes: tuple[str, ...]

    @classmethod
    def of(cls, vertices: Floats, triangles: Integers) -> Closing:
        """Return what holds for triangles that stay as they are and bound no volume."""
        none = np.zeros(len(triangles), np.bool_)
        edges = np.zeros((0, 2), np.int64)
        return cls(False, np.arange(len(vertices)), none, none.copy(), edges, ())


class _Edges(NamedTuple):
    """The sides of triangles, sorted so that equal ones stand together.

    Attributes
    ----------
    ends : int64 (3 T, 2)
        The lower vertex and the higher.
    way : int64 (3 T,)
        1 if it is passed from the lower one, -1 if from the higher.
    owner : int64 (3 T,)
        The triangle.
    apex : int64 (3 T,)
        The triangle's other vertex.
    begins : int64 (E,)
        Where the different edges begin.
    counts : int64 (E,)
        How often they stand there.
    """

    ends: Integers
    way: Integers
    owner: Integers
    apex: Integers
    begins: Integers
    counts: Integers

    @property
    def balance(self) -> Integers:
        """How much more often each edge is passed forwards than backwards."""
        if not len(self.begins):
            return np.zeros(0, np.int64)
        return np.add.reduceat(self.way, self.begins)

    @property
    def odd(self) -> NDArray[np.bool_]:
        """Which edges belong to an odd number of triangles: no turning balances them."""
        found: NDArray[np.bool_] = self.counts % 2 == 1
        return found


def close(vertices: Floats, triangles: Integers) -> Closing:
    """Find out whether triangles bound a volume, and what makes them do so.

    Parameters
    ----------
    vertices : float64 (V, 3)
    triangles : int64 (T, 3)
        Without triangles that have a vertex twice.
    """
    twin = np.arange(len(vertices))
    edges = _find_edges(triangles)
    if not edges.balance.any():
        return _judge(vertices, triangles, Closing.of(vertices, triangles))
    found = _mend(vertices, triangles, twin)
    if found is None:
        return Closing.of(vertices, triangles)._replace(open_edges=_open_edges(triangles))
    return _judge(vertices, triangles, found)


def _judge(vertices: Floats, triangles: Integers, found: Closing) -> Closing:
    """Return what was found, as a sheet where balanced triangles bound no volume."""
    kept = np.flatnonzero(~found.dropped)
    final = found.twin[triangles[kept]]
    final = np.where(found.turned[kept, None], final[:, ::-1], final)
    sheet = Closing.of(vertices, triangles)
    if not len(final):
        return sheet
    doubled = _find_doubled(final)
    if doubled is None:
        flat = _is_flat(vertices[different_numbers(final)])
        return sheet if flat else found._replace(closed=True)
    # Each face stands both ways: a sheet, of which one side is enough.
    sheet.dropped[:] = True
    sheet.dropped[kept[~doubled]] = False
    return sheet


def _mend(vertices: Floats, triangles: Integers, twin: Integers) -> Closing | None:
    """Join corners and turn facets; None where that does not close the mesh."""
    notes = Notes()
    joined, dropped = triangles, _find_repeated(triangles)
    edges = _find_edges(joined[~dropped])
    if edges.odd.any():
        twin = _join_corners(vertices, triangles[~dropped], edges)
        joined = twin[triangles]
        shrunk = _has_twins(joined)
        dropped = shrunk.copy()
        dropped[~shrunk] = _find_repeated(joined[~shrunk])
        edges = _find_edges(joined[~dropped])
        if edges.odd.any() or _lost_a_part(triangles, dropped):
            return None
        moved = int((twin != np.arange(len(twin))).sum())
        notes.add("joined: corners that differ by rounding", f"{moved:,} of {len(vertices):,}")
    if dropped.any():
        count = f"{int(dropped.sum()):,} of {len(triangles):,}"
        notes.add("left out: facets that stand there twice or have no area", count)
    turned = np.zeros(len(triangles), np.bool_)
    if edges.balance.any():
        kept = np.flatnonzero(~dropped)
        final = joined[kept]
        for outwards in (False, True):
            turn = _turn_facets(vertices, final, edges, outwards)
            if not _find_edges(np.where(turn[:, None], final[:, ::-1], final)).balance.any():
                break
        else:
            return None
        turned[kept] = turn
        notes.add("turned round: facets", f"{int(turn.sum()):,} of {len(triangles):,}")
    return Closing.of(vertices, triangles)._replace(
        twin=twin, turned=turned, dropped=dropped, notes=notes.texts()
    )


def _find_edges(triangles: Integers) -> _Edges:
    """Return the sides of triangles, sorted."""
    a, b, c = triangles.T
    first, second = np.concatenate([a, b, c]), np.concatenate([b, c, a])
    apex = np.concatenate([c, a, b])
    forward = first < second
    low, high = np.minimum(first, second), np.maximum(first, second)
    size = int(high.max(initial=0)) + 1
    keys = low * size + high
    order = order_of(keys, size * size)
    keys = keys[order]
    begins = np.flatnonzero(np.diff(keys, prepend=-1))
    counts = np.diff(begins, append=len(keys))
    way = np.where(forward, 1, -1)[order]
    owner = np.tile(np.arange(len(triangles)), 3)[order]
    ends = np.stack([low[order], high[order]], axis=1)
    return _Edges(ends, way, owner, apex[order], begins, counts)


def order_of(keys: Integers, most: int) -> Integers:
    """Return the order that sorts keys below a number, equal ones as they stand."""
    if most * len(keys) >= 2**63:
        return np.argsort(keys, kind="stable")
    # Together with where they stand they are all different, and sorted several times as fast.
    return np.sort(keys * len(keys) + np.arange(len(keys))) % max(len(keys), 1)


def different_numbers(numbers: Integers) -> Integers:
    """Return which small numbers there are, as `numpy.unique`, which is slow for many."""
    return np.flatnonzero(np.bincount(numbers.ravel()))


def _has_twins(triangles: Integers) -> NDArray[np.bool_]:
    """Return which triangles have a vertex twice."""
    a, b, c = triangles.T
    found: NDArray[np.bool_] = (a == b) | (b == c) | (c == a)
    return found


def _open_edges(triangles: Integers) -> Integers:
    """Return the edges that are not balanced; where there are open ones, only these."""
    edges = _find_edges(triangles)
    wrong = edges.odd if edges.odd.any() else edges.balance != 0
    return edges.ends[edges.begins[wrong]]


def _is_flat(points: Floats) -> bool:
    """Return whether points lie in a plane, so that nothing can be between them."""
    away = points - points[:1]
    size = float(np.abs(away).max(initial=0.0))
    if size == 0.0:
        return True
    away /= size
    u = away[np.einsum("ij,ij->i", away, away).argmax()]
    across = np.cross(away, u)
    n = across[np.einsum("ij,ij->i", across, across).argmax()]
    return float(np.abs(away @ n).max()) <= FLAT * float(np.sqrt(n @ n))


def _rank(triangles: Integers) -> tuple[Integers, Integers, Integers]:
    """Return an order that keeps triangles of the same corners together.

    Also where the different ones begin in it, and which way each triangle turns, 1 or -1.
    """
    corners = np.sort(triangles, axis=1)
    # Seen from its least corner, a triangle turns one way if the middle one comes next.
    least = triangles.argmin(axis=1)
    following = triangles[np.arange(len(triangles)), (least + 1) % 3]
    way = np.where(following == corners[:, 1], 1, -1)
    order = np.lexsort((way, corners[:, 2], corners[:, 1], corners[:, 0]))
    ranked = corners[order]
    begins = np.flatnonzero(np.r_[True, (ranked[1:] != ranked[:-1]).any(axis=1)][: len(order)])
    return order, begins, way


def _find_repeated(triangles: Integers) -> NDArray[np.bool_]:
    """Return which triangles stand there before, with the same corners and turned the same way."""
    order, _, way = _rank(triangles)
    corners = np.sort(triangles, axis=1)[order]
    repeated = np.zeros(len(triangles), np.bool_)
    same = (corners[1:] == corners[:-1]).all(axis=1) & (way[order][1:] == way[order][:-1])
    repeated[order[1:][same]] = True
    return repeated


def _find_doubled(triangles: Integers) -> NDArray[np.bool_] | None:
    """Return which triangles repeat another one if each stands as often both ways; else None."""
    edges = _find_edges(triangles)
    # An edge of such a pair belongs to more than two triangles, or to two of the same corners.
    two = edges.begins[edges.counts == 2]
    if len(two) == len(edges.begins) and (edges.apex[two] != edges.apex[two + 1]).all():
        return None
    order, begins, way = _rank(triangles)
    if np.add.reduceat(way[order], begins).any():
        return None
    doubled = np.ones(len(triangles), np.bool_)
    doubled[order[begins]] = False
    return doubled


def _lost_a_part(triangles: Integers, dropped: NDArray[np.bool_]) -> bool:
    """Return whether one of the connected parts has no triangle left."""
    if not dropped.any():
        return False
    edges = _find_edges(triangles)
    first = np.repeat(edges.owner[edges.begins], edges.counts)
    part = _parts(first, edges.owner, np.zeros(len(first), np.int64), len(triangles))[0]
    left = np.bincount(part[~dropped], minlength=len(triangles))
    return bool((left[part] == 0).any())


def _join_corners(vertices: Floats, triangles: Integers, edges: _Edges) -> Integers:
    """Return for every vertex the one that stands for it: ends of open edges that are near."""
    used = vertices[different_numbers(triangles)]
    sides = used.max(axis=0) - used.min(axis=0)
    tolerance = TOLERANCE * float(sides.max())
    ends = different_numbers(edges.ends[edges.begins[edges.odd]])
    twin = np.arange(len(vertices))
    if not tolerance > 0.0:
        return twin
    points = (vertices[ends] - vertices[ends].min(axis=0)) / tolerance
    cells = np.floor(points).astype(np.int64)
    shape = int(cells.max()) + 3
    keys = ((cells[:, 0] + 1) * shape + cells[:, 1] + 1) * shape + cells[:, 2] + 1
    order = np.argsort(keys, kind="stable")
    steps = np.array([-1, 0, 1])
    beside = (steps[:, None, None] * shape + steps[:, None]) * shape + steps
    points = points[order]
    pairs = np.zeros(len(ends), np.int64)
    _join_near(np.ascontiguousarray(points).ravel(), keys[order], beside.ravel(), pairs)
    # The first in the file stands for the others.
    group = ends[order]
    lowest = np.full(len(ends), len(vertices))
    np.minimum.at(lowest, pairs, group)
    twin[group] = lowest[pairs]
    return twin


def _turn_facets(
    vertices: Floats, triangles: Integers, edges: _Edges, outwards: bool
) -> NDArray[np.bool_]:
    """Return which triangles to turn so that neighbours agree over edges of two.

    Parameters
    ----------
    outwards
        Whether every part is turned outwards, or only those of which not even `MAJORITY` agree.
    """
    two = edges.begins[edges.counts == 2]
    differ = (edges.way[two] == edges.way[two + 1]).astype(np.int64)
    part, turned = _parts(edges.owner[two], edges.owner[two + 1], differ, len(triangles))
    number = len(triangles)
    size = np.bincount(part, minlength=number)
    share = np.bincount(part, turned, minlength=number) / np.maximum(size, 1)
    p = vertices[triangles]
    scale = float(np.abs(p - p[0, 0]).max())
    p = (p - p[0, 0]) / (scale or 1.0)
    volumes = np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2]))
    volume = np.bincount(part, np.where(turned, -volumes, volumes), minlength=number)
    flip = share > 0.5
    unclear = (share > 1.0 - MAJORITY) & (share < MAJORITY)
    by_volume = np.full(number, True) if outwards else unclear
    flip = np.where(by_volume & (volume != 0.0), volume < 0.0, flip)
    found: NDArray[np.bool_] = turned ^ flip[part]
    return found


def _parts(
    a: Integers, b: Integers, differ: Integers, number: int
) -> tuple[Integers, NDArray[np.bool_]]:
    """Return the part of each of `number` things, and which differ from the first of theirs.

    Parameters
    ----------
    a, b
        Pairs that belong together.
    differ
        1 where the two of a pair differ, else 0.
    """
    above = np.arange(number)
    parity = np.zeros(number, np.int64)
    _unite(np.ascontiguousarray(a), np.ascontiguousarray(b), differ, above, parity)
    return above, parity == 1


@njit
def _find(above: Integers, parity: Integers, k: int) -> tuple[int, int]:
    """Return the root of a thing, and whether they differ; halve the way."""
    odd = 0
    while above[k] != k:
        up = above[k]
        odd ^= parity[k]
        if above[up] != up:
            parity[k] ^= parity[up]
            above[k] = above[up]
            odd ^= parity[up]
        k = above[k]
    return k, odd


@njit(entry=True)
def _unite(a: Integers, b: Integers, differ: Integers, above: Integers, parity: Integers) -> None:
    """Join pairs; at the end `above` is the root of everything, `parity` the difference to it.

    Union by the lower number with halved ways (Tarjan and van Leeuwen, 1984). A pair that
    contradicts the others is passed over.
    """
    for i in range(len(a)):
        p, odd_p = _find(above, parity, a[i])
        q, odd_q = _find(above, parity, b[i])
        if p != q:
            low, high = min(p, q), max(p, q)
            above[high] = low
            parity[high] = odd_p ^ odd_q ^ differ[i]
    for k in range(len(above)):
        root, odd = _find(above, parity, k)
        above[k], parity[k] = root, odd


@njit(entry=True)
def _join_near(points: Floats, keys: Integers, beside: Integers, group: Integers) -> None:
    """Write the group of every point: those nearer than 1 to each other, step by step.

    Parameters
    ----------
    points : float64 (3 n,)
        Sorted by their cells.
    keys : int64 (n,)
        Their cells of side 1.
    beside
        What leads from a cell to itself and its neighbours.
    """
    n = len(keys)
    for k in range(n):
        group[k] = k
    for k in range(n):
        for step in beside:
            wanted = keys[k] + step
            # The first point of that cell.
            low, high = 0, n
            while low < high:
                middle = (low + high) // 2
                if keys[middle] < wanted:
                    low = middle + 1
                else:
                    high = middle
            # Points of one cell are mostly one corner: the first few are enough.
            for i in range(low, min(n, low + 16)):
                if keys[i] != wanted:
                    break
                x = points[3 * i] - points[3 * k]
                y = points[3 * i + 1] - points[3 * k + 1]
                z = points[3 * i + 2] - points[3 * k + 2]
                if x * x + y * y + z * z <= 1.0:
                    p, q = _root(group, i), _root(group, k)
                    group[max(p, q)] = min(p, q)
    for k in range(n):
        group[k] = _root(group, k)


@njit
def _root(group: Integers, k: int) -> int:
    while group[k] != k:
        group[k] = group[group[k]]
        k = group[k]
    return k
