"""From a binary tree of boxes to the wide blocks of which rays visit fewest.

The expected number of blocks that a ray visits is the sum of their areas over that of the first
one. What a node costs with at most k slots of the block above is found from the leaves up (Wald,
Benthin & Boulos, "Getting Rid of Packets", 2008).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.simd import WIDTH

Floats = NDArray[np.float64]
Indices = NDArray[np.int32]

MOST_TOGETHER = 4_096
"""Items of a binary tree."""

LEVELS_OF_HALVES = 13
MOST_LEVELS = 18 + LEVELS_OF_HALVES
"""Levels of a binary tree: so many, and those of halves of what has most items."""

_MOST_AREA = 1e300
"""Unbounded boxes are always visited."""


class BinaryTree(NamedTuple):
    """A binary tree over a run of items; the root is node 0, children come behind their parents.

    Attributes
    ----------
    hulls : float64 (6 N,)
        Boxes of the nodes.
    begins, ends, levels, children : int32 (N,)
        Items below a node, how far it is from the root, and the first of its two children, -1 for
        a leaf.
    leaves : int32 (N,)
        Leaves below a node.
    costs : float64 (W N,)
        What a node costs with 1 to W slots.
    slots, wait : int32 (W,), int32 (6 W,)
        Nodes that have been chosen as the slots of a block; working space.
    """

    hulls: Floats
    begins: Indices
    ends: Indices
    levels: Indices
    children: Indices
    leaves: Indices
    costs: Floats
    slots: Indices
    wait: Indices


def make_binary_tree(items: int) -> BinaryTree:
    """Return room for the tree over so many items."""
    nodes = max(1, 2 * items - 1)
    return BinaryTree(
        hulls=np.empty(6 * nodes),
        begins=np.empty(nodes, np.int32),
        ends=np.empty(nodes, np.int32),
        levels=np.empty(nodes, np.int32),
        children=np.empty(nodes, np.int32),
        leaves=np.empty(nodes, np.int32),
        costs=np.empty(WIDTH * nodes),
        slots=np.empty(WIDTH, np.int32),
        wait=np.empty(6 * WIDTH, np.int32),
    )


@njit
def half_area(boxes: Floats, at: int) -> float:
    """Return half the surface of a box, 0 for an empty one."""
    x, y, z = (
        boxes[at + 3] - boxes[at],
        boxes[at + 4] - boxes[at + 1],
        boxes[at + 5] - boxes[at + 2],
    )
    if not (x >= 0.0 and y >= 0.0 and z >= 0.0):
        return 0.0
    area: float = x * y + y * z + z * x
    return area


@njit
def weigh_nodes(tree: BinaryTree, nodes: int, price: float) -> None:
    """Find what nodes cost with 1 to W slots.

    Parameters
    ----------
    price
        What a block costs besides visits, in areas of the root over the number of nodes.
    """
    costs = tree.costs
    memory = 0.0
    if nodes > 0 and price > 0.0:
        memory = min(price * half_area(tree.hulls, 0) / nodes, _MOST_AREA)
    for node in range(nodes - 1, -1, -1):
        at, child = WIDTH * node, tree.children[node]
        # What has a slot for every leaf needs no block of its own.
        leaves = 1 if child < 0 else tree.leaves[child] + tree.leaves[child + 1]
        tree.leaves[node] = leaves
        for slots in range(min(leaves, WIDTH + 1), WIDTH + 1):
            costs[at + slots - 1] = 0.0
        if leaves == 1:
            continue
        left = WIDTH * child
        area = half_area(tree.hulls, 6 * node)
        own = (area if area < _MOST_AREA else _MOST_AREA) + memory
        if leaves > WIDTH:
            own += _split_slots(costs, left, WIDTH)[0]
        costs[at] = own
        for slots in range(2, min(leaves, WIDTH + 1)):
            costs[at + slots - 1] = min(own, _split_slots(costs, left, slots)[0])


@njit
def _split_slots(costs: Floats, left: int, slots: int) -> tuple[float, int]:
    """Return the least cost of two children that share slots, and how many the first one has."""
    right = left + WIDTH
    best, first = costs[left] + costs[right + slots - 2], 1
    for k in range(2, slots):
        cost = costs[left + k - 1] + costs[right + slots - k - 1]
        if cost < best:
            best, first = cost, k
    return best, first


@njit
def choose_slots(tree: BinaryTree, node: int) -> int:
    """Write the nodes that become the slots of a node's block; return their number."""
    wait, costs = tree.wait, tree.costs
    n = 0
    wait[0], wait[1] = node, WIDTH
    top = 2
    while top > 0:
        top -= 2
        part, slots = wait[top], wait[top + 1]
        at = WIDTH * part
        whole = part != node and (slots == 1 or costs[at + slots - 1] == costs[at])
        if tree.children[part] < 0 or whole:
            tree.slots[n] = part
            n += 1
            continue
        left = tree.children[part]
        _, first = _split_slots(costs, WIDTH * left, slots)
        wait[top], wait[top + 1] = left + 1, slots - first
        wait[top + 2], wait[top + 3] = left, first
        top += 4
    return n
