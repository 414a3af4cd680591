"""Horizontal places of the vertices of a layered graph, with long edges kept straight.

Brandes and Koepf 2001, "Fast and simple horizontal coordinate assignment": four layouts, each of
which aligns vertices with a median neighbour as far left or right, from above or below, as it
goes; the place of a vertex is the mean of its two middle ones. Blocks of aligned vertices are
compacted by longest paths in the graph of blocks, which is free of the original's error with
shifted classes (Brandes, Walter and Zink 2020).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

Layers = Sequence[Sequence[int]]
Neighbours = Sequence[Sequence[int]]


def place(
    layers: Layers,
    up: Neighbours,
    down: Neighbours,
    bend: Sequence[bool],
    distance: Callable[[int, int], float],
) -> list[float]:
    """Return the x of every vertex.

    Parameters
    ----------
    layers
        Vertices from top to bottom, each layer from left to right.
    up, down
        Neighbours of every vertex in the layers above and below.
    bend
        Whether a vertex is an inner point of a long edge; edges between two are kept straight.
    distance
        Least distance of the centres of two vertices that stand side by side in this order.
    """
    position = [0] * len(up)
    for layer in layers:
        for k, v in enumerate(layer):
            position[v] = k
    conflicts = _conflicts(layers, up, bend, position)
    candidates: list[list[float]] = []
    for rows, neighbours in ((layers, up), (layers[::-1], down)):
        for mirrored in (False, True):
            sign = -1 if mirrored else 1
            order = [row[::sign] for row in rows]
            places = [sign * p for p in position]
            root, align = _align(order, neighbours, places, conflicts)
            gap = (lambda a, b: distance(b, a)) if mirrored else distance
            xs = _compact(order, root, align, gap)
            candidates.append([sign * x for x in xs])
    return _balance(candidates)


def _conflicts(
    layers: Layers, up: Neighbours, bend: Sequence[bool], position: Sequence[int]
) -> set[tuple[int, int]]:
    """Return the edges (lower, upper) that cross a segment between two bends."""
    found: set[tuple[int, int]] = set()
    for above, layer in pairwise(layers):
        left = 0
        scanned = 0
        for k, v in enumerate(layer):
            inner = next((u for u in up[v] if bend[u]), None) if bend[v] else None
            if inner is None and k < len(layer) - 1:
                continue
            right = position[inner] if inner is not None else len(above)
            for w in layer[scanned : k + 1]:
                for u in up[w]:
                    p = position[u]
                    if (p < left or p > right) and not (bend[u] and bend[w]):
                        found.add((w, u))
            scanned = k + 1
            left = right
    return found


def _align(
    layers: Layers,
    neighbours: Neighbours,
    position: Sequence[int],
    conflicts: set[tuple[int, int]],
) -> tuple[list[int], list[int]]:
    """Chain every vertex to a median neighbour where that crosses no chain; return the chains.

    Returns
    -------
    root, align
        Of every vertex the first of its block, and the next one (the last points to the first).
    """
    root = list(range(len(neighbours)))
    align = list(range(len(neighbours)))
    for layer in layers:
        last: float = -float("inf")
        for v in layer:
            near = sorted(neighbours[v], key=position.__getitem__)
            middle = (len(near) - 1) / 2
            for u in near[int(middle) : int(middle + 0.5) + 1]:
                blocked = (v, u) in conflicts or (u, v) in conflicts
                if align[v] == v and last < position[u] and not blocked:
                    align[u] = v
                    align[v] = root[v] = root[u]
                    last = position[u]
    return root, align


def _compact(
    layers: Layers,
    root: Sequence[int],
    align: Sequence[int],
    distance: Callable[[int, int], float],
) -> list[float]:
    """Return the x of every vertex, blocks as far left as their neighbours allow, then drawn in."""
    after: dict[int, dict[int, float]] = {}
    before: dict[int, dict[int, float]] = {}
    for layer in layers:
        for u, v in pairwise(layer):
            a, b = root[u], root[v]
            gap = max(distance(u, v), after.get(a, {}).get(b, 0.0))
            after.setdefault(a, {})[b] = gap
            before.setdefault(b, {})[a] = gap
    blocks = sorted({root[v] for layer in layers for v in layer})
    waiting = {b: len(before.get(b, {})) for b in blocks}
    order = [b for b in blocks if not waiting[b]]
    for b in order:
        for c in after.get(b, {}):
            waiting[c] -= 1
            if not waiting[c]:
                order.append(c)
    x = dict.fromkeys(blocks, 0.0)
    for b in order:
        x[b] = max((x[a] + gap for a, gap in before.get(b, {}).items()), default=0.0)
    for b in reversed(order):
        x[b] = max(x[b], min((x[c] - gap for c, gap in after.get(b, {}).items()), default=x[b]))
    return [x[r] for r in root]


def _balance(candidates: Sequence[list[float]]) -> list[float]:
    """Shift the four layouts to the narrowest one and return the means of the middle places."""
    widths = [max(xs) - min(xs) for xs in candidates]
    narrowest = candidates[widths.index(min(widths))]
    shifted = []
    for k, xs in enumerate(candidates):
        # Odd layouts are flush right, even ones flush left.
        shift = max(narrowest) - max(xs) if k % 2 else min(narrowest) - min(xs)
        shifted.append([x + shift for x in xs])
    places = []
    for four in zip(*shifted, strict=True):
        ordered = sorted(four)
        places.append((ordered[1] + ordered[2]) / 2)
    return places
