"""The hierarchy over supports: a sequence is cut in two where that costs least, again and again.

Primitives keep their order, depth first, so that what a ray meets comes in the order in which
operators are evaluated. Branches of a tree are consecutive, and near each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.layout import LEAF_BITS, MAX_LEAF
from pcsg.jit import njit

LEAF = 8
"""Primitives that are not parted any more."""


@njit
def _grow(box: NDArray[np.float64], boxes: NDArray[np.float64], i: int) -> float:
    """Enlarge a box by the i-th and return half its surface."""
    for k in range(3):
        box[k] = min(box[k], boxes[i, k])
        box[3 + k] = max(box[3 + k], boxes[i, 3 + k])
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    area: float = x * y + y * z + z * x
    return area


@njit
def _clear(box: NDArray[np.float64]) -> None:
    for k in range(3):
        box[k], box[3 + k] = np.inf, -np.inf


@njit(entry=True)
def build_nodes(
    boxes: NDArray[np.float64],
    areas: NDArray[np.float64],
    box: NDArray[np.float64],
    stack: NDArray[np.int64],
    out_boxes: NDArray[np.float64],
    codes: NDArray[np.int32],
) -> int:
    """Write boxes and codes of all nodes and return their number.

    Parameters
    ----------
    boxes : (N, 6)
        Lower and upper corners.
    areas, box, stack
        Workspace: (N,), (6,), (3, 256).
    out_boxes, codes : (2 N, 6), (2 N,)
        Nodes, depth first.
    """
    n = 0
    stack[0, 0], stack[1, 0], stack[2, 0] = 0, len(boxes), -1
    top = 1
    while top > 0:
        top -= 1
        begin, end, waits = stack[0, top], stack[1, top], stack[2, top]
        if waits >= 0:
            # All of a node before is done: that is where to go after a miss.
            codes[waits] = -n
        if begin == end:
            continue
        _clear(box)
        count = end - begin
        for i in range(begin, end):
            areas[i] = _grow(box, boxes, i)
        for k in range(6):
            out_boxes[n, k] = box[k]
        if count <= LEAF:
            codes[n] = begin * LEAF_BITS + count
            n += 1
            continue
        total = areas[end - 1]
        _clear(box)
        # Cuts near the ends are left out, so that the hierarchy stays shallow.
        margin = max(1, count // 16)
        best, cut = np.inf, begin + count // 2
        for i in range(end - 1, begin + margin - 1, -1):
            area = _grow(box, boxes, i)
            if i <= end - margin:
                cost = area * (end - i) + areas[i - 1] * (i - begin)
                if cost < best:
                    best, cut = cost, i
        if count <= MAX_LEAF and best >= (count - 1) * total:
            codes[n] = begin * LEAF_BITS + count
            n += 1
            continue
        # Popped in turn: the first half, the second, and the note that this node is done.
        stack[0, top], stack[1, top], stack[2, top] = 0, 0, n
        stack[0, top + 1], stack[1, top + 1], stack[2, top + 1] = cut, end, -1
        stack[0, top + 2], stack[1, top + 2], stack[2, top + 2] = begin, cut, -1
        top += 3
        n += 1
    return n


def build_hierarchy(boxes: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return boxes (M, 6), rounded outwards, and codes (M,) of the nodes over N boxes (N, 6)."""
    n = len(boxes)
    out_boxes = np.empty((2 * n + 1, 6))
    codes = np.empty(2 * n + 1, np.int32)
    m = build_nodes(
        np.ascontiguousarray(boxes), np.empty(n), np.empty(6), np.empty((3, 256), np.int64),
        out_boxes, codes,
    )  # fmt: skip
    margin = 1e-6 * np.abs(out_boxes[:m]).max(initial=0.0)
    single = np.empty((m, 6), np.float32)
    single[:, :3] = np.nextafter(
        (out_boxes[:m, :3] - margin).astype(np.float32), np.float32("-inf")
    )
    single[:, 3:] = np.nextafter((out_boxes[:m, 3:] + margin).astype(np.float32), np.float32("inf"))
    return single, codes[:m].copy()
