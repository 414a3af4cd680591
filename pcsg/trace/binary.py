"""Binary trees of boxes, cut by surface areas: what blocks are collapsed from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.hulls import Bounds
from pcsg.simd import WIDTH


def area_of(box: Bounds | NDArray[np.float64]) -> float:
    """Return half the surface of a box, infinite where the box is."""
    x, y, z = (max(0.0, box[k + 3] - box[k]) for k in range(3))
    if max(x, y, z) == float("inf"):
        return float("inf")
    return x * y + y * z + z * x


def hull_of(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the box about boxes (N, 6)."""
    return np.concatenate([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])


# Pairs of numbers of slots from 1 to WIDTH - 1 for two children, in the order of their sums.
_PAIRS = sorted((i + j, i, j) for i in range(1, WIDTH) for j in range(1, WIDTH + 1 - i))
_LEFT, _RIGHT = (np.array([pair[k] - 1 for pair in _PAIRS]) for k in (1, 2))
_SUMS = np.array(
    [next(n for n, pair in enumerate(_PAIRS) if pair[0] == k) for k in range(2, WIDTH + 1)]
)


class BinaryTree:
    """A binary tree over boxes, and the best way to make wide blocks of it.

    The expected number of blocks that a ray visits is the sum of the blocks' areas over that of
    the first one. What a node costs with at most k slots of the block above is found from the
    leaves up (Wald, Benthin & Boulos 2008, Getting rid of packets).

    Attributes
    ----------
    hulls
        The box of every node; the root is node 0.
    items
        Which of the boxes a node is, for leaves.
    """

    def __init__(self, boxes: NDArray[np.float64]) -> None:
        self.hulls: list[NDArray[np.float64]] = []
        self.items: dict[int, int] = {}
        self._children: dict[int, tuple[int, int]] = {}
        stack = [(self._add(boxes), np.arange(len(boxes)))]
        while stack:
            node, members = stack.pop()
            if len(members) == 1:
                self.items[node] = int(members[0])
                continue
            halves = _split(boxes, members)
            left, right = (self._add(boxes[half]) for half in halves)
            self._children[node] = left, right
            stack += [(left, halves[0]), (right, halves[1])]
        self._costs = np.zeros((len(self.hulls), WIDTH))
        for node in reversed(self._children):
            self._weigh(node)

    def _add(self, boxes: NDArray[np.float64]) -> int:
        self.hulls.append(hull_of(boxes))
        return len(self.hulls) - 1

    def _weigh(self, node: int) -> None:
        """Find what a node costs with 1 to WIDTH slots."""
        left, right = self._children[node]
        pairs = self._costs[left][_LEFT] + self._costs[right][_RIGHT]
        spread = np.minimum.reduceat(pairs, _SUMS)
        # Unbounded boxes are always visited.
        own = min(area_of(self.hulls[node]), 1e300) + spread[-1]
        self._costs[node, 0] = own
        self._costs[node, 1:] = np.minimum(spread, own)

    def parts(self, node: int) -> list[int]:
        """Return the nodes that become the slots of a node's block, in order."""
        if node in self.items:
            return [node]
        parts = []
        stack = [(node, WIDTH, True)]
        while stack:
            node, slots, opened = stack.pop()
            cost = self._costs[node]
            if node in self.items or (not opened and (slots == 1 or cost[slots - 1] == cost[0])):
                parts.append(node)
                continue
            left, right = self._children[node]
            both = self._costs[left][: slots - 1] + self._costs[right][slots - 2 :: -1]
            k = int(np.argmin(both)) + 1
            stack += [(right, slots - k, False), (left, k, False)]
        return parts


def _split(
    boxes: NDArray[np.float64], members: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Split members in two where the surface area heuristic is least, over all three axes."""
    own = boxes[members]
    unbounded = ~np.isfinite(own).all(axis=1)
    if unbounded.any() and not unbounded.all():
        return members[unbounded], members[~unbounded]
    best = np.inf
    n = len(members)
    cut, order = n // 2, np.arange(n)
    if not unbounded.any():
        for axis in range(3):
            by = np.argsort(own[:, axis] + own[:, axis + 3], kind="stable")
            left = _running_areas(own[by])[:-1]
            right = _running_areas(own[by[::-1]])[-2::-1]
            cost = left * np.arange(1, n) + right * np.arange(n - 1, 0, -1)
            k = int(np.argmin(cost))
            if cost[k] < best:
                best, cut, order = cost[k], k + 1, by
    return members[order[:cut]], members[order[cut:]]


def _running_areas(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    lower = np.minimum.accumulate(boxes[:, :3])
    size = np.maximum.accumulate(boxes[:, 3:]) - lower
    x, y, z = size.T
    areas: NDArray[np.float64] = x * y + y * z + z * x
    return areas
