"""Internodes from line skeletons with radii, as files hold them: nodes, edges and a root."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.turtle import Skeleton
from pcsg.errors import UsageError
from pcsg.skeletonfile import SkeletonRows, load_rows

FLARE = 1.2
"""A branch leaves a fork at most this many times as thick as its next node is.

A file has one radius for a node, which is the bearer's; as thick as that, the foot of a thin branch
would be a trumpet."""


def read_skeleton(path: str | Path) -> Skeleton:
    """Read internodes from a file, .swc or .json.

    Raises
    ------
    UsageError
        The file is not there, not a skeleton, or not a tree.
    """
    path = Path(path)
    try:
        return internodes(load_rows(path))
    except UsageError as error:
        text = str(error)
        raise UsageError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def internodes(rows: SkeletonRows) -> Skeleton:
    """Return an internode for every edge, from the root outwards.

    At a fork the axis goes on with the edge of the same ``branch`` tag, if there is one, else with
    the thickest child, the straightest of equals; the others are laterals.

    Raises
    ------
    UsageError
        It is no tree, or a number makes no sense.
    """
    _check(rows)
    neighbours: list[list[tuple[int, int]]] = [[] for _ in rows.pos]
    for number, (a, b) in enumerate(rows.edges.tolist()):
        neighbours[a].append((b, number))
        neighbours[b].append((a, number))
    branch = rows.tags.get("branch")
    # Per internode: its two nodes, the internode below, whether it is a lateral.
    found: list[tuple[int, int, int, bool]] = []
    seen = np.zeros(len(rows.pos), np.bool_)
    seen[rows.root] = True
    todo = [(rows.root, -1, -1)]
    for node, below, edge in todo:
        above = [(b, number) for b, number in neighbours[node] if not seen[b]]
        leader = _leader(rows, node, below, edge, above, found, branch)
        for b, number in above:
            seen[b] = True
            lateral = b != leader or below < 0
            todo.append((b, len(found), number))
            found.append((node, b, below, lateral))
    if not seen.all():
        raise UsageError(f"node {int(np.argmin(seen))} does not hang together with the root")
    a, b, parent = np.array([row[:3] for row in found], np.int64).T
    base = rows.radius[a].copy()
    forks = np.bincount(a, minlength=len(rows.pos))[a] > 1
    base[forks] = np.minimum(base[forks], FLARE * rows.radius[b][forks])
    return Skeleton(
        rows.pos[a],
        rows.pos[b],
        base,
        rows.radius[b].copy(),
        parent.copy(),
        np.array([row[3] for row in found], np.bool_),
        np.zeros(len(a), np.int64),
    )


def _check(rows: SkeletonRows) -> None:
    n = len(rows.pos)
    if n < 2 or not len(rows.edges):
        raise UsageError("a skeleton needs at least two nodes and one edge")
    if not (np.isfinite(rows.pos).all() and np.isfinite(rows.radius).all()):
        raise UsageError("a place or a radius is not finite")
    if rows.radius.min() <= 0.0:
        k = int(np.argmin(rows.radius))
        raise UsageError(f"node {k} has the radius {rows.radius[k]:g}; it must be positive")
    if rows.edges.min() < 0 or rows.edges.max() >= n or not 0 <= rows.root < n:
        raise UsageError("an edge, or the root, names a node that does not exist")
    if len(rows.edges) != n - 1:
        raise UsageError(f"{len(rows.edges)} edges between {n} nodes are no tree")
    ends = rows.pos[rows.edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    if length.min() <= 1e-12 * np.abs(rows.pos - rows.pos[0]).max():
        raise UsageError(f"edge {int(np.argmin(length))} has no length")


def _leader(
    rows: SkeletonRows,
    node: int,
    below: int,
    edge: int,
    above: list[tuple[int, int]],
    found: list[tuple[int, int, int, bool]],
    branch: NDArray[np.int64] | None,
) -> int:
    """Return the node that the axis goes on to, -1 at its end."""
    if not above:
        return -1
    if branch is not None and len(branch) == len(rows.edges) and edge >= 0:
        same = [b for b, number in above if branch[number] == branch[edge]]
        if len(same) == 1:
            return same[0]
    heading = np.zeros(3)
    if below >= 0:
        heading = rows.pos[node] - rows.pos[found[below][0]]

    def rank(b: int) -> tuple[float, float]:
        way = rows.pos[b] - rows.pos[node]
        return float(rows.radius[b]), float(way @ heading) / float(np.linalg.norm(way))

    return max((b for b, _ in above), key=rank)
