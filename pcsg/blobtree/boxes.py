"""Boxes of fields: where the support is, and where the skeletons are, each in its own frame."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.nodes import Bent, Combination, Cones, Field, Painted, Placed, Primitive, below
from pcsg.blobtree.skeletons import LARGEST
from pcsg.errors import UsageError

Array = NDArray[np.float64]
Corners = tuple[Array, Array]

NOTHING: Corners = (np.full(3, math.inf), np.full(3, -math.inf))


def is_empty(box: Corners) -> bool:
    """Return whether a box contains nothing."""
    return bool((box[0] > box[1]).any())


def unite(a: Corners, b: Corners) -> Corners:
    """Return the box of two."""
    return np.minimum(a[0], b[0]), np.maximum(a[1], b[1])


def intersect(a: Corners, b: Corners) -> Corners:
    """Return what two boxes share."""
    box = np.maximum(a[0], b[0]), np.minimum(a[1], b[1])
    return NOTHING if is_empty(box) else box


def transform(matrix: Array, box: Corners) -> Corners:
    """Return the box of a box behind a map (3, 4)."""
    if is_empty(box):
        return box
    centre, half = 0.5 * (box[0] + box[1]), 0.5 * (box[1] - box[0])
    centre, half = matrix[:, :3] @ centre + matrix[:, 3], np.abs(matrix[:, :3]) @ half
    return centre - half, centre + half


def cone_cores(
    start: Array, axis: Array, foot: Array, flat: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return lower and upper corners (N, 3) of the skeletons of branches; flat ones are discs."""
    length = np.sqrt(np.einsum("ij,ij->i", axis, axis))
    unit = axis / np.where(length > 0.0, length, 1.0)[:, None]
    rim = foot[:, None] * np.sqrt(np.maximum(0.0, 1.0 - unit * unit))
    tip = start + np.where(flat[:, None], 0.0, axis)
    return np.minimum(start - rim, tip), np.maximum(start + rim, tip)


def cone_boxes(start: Array, axis: Array, foot: Array, reach: Array) -> tuple[Array, Array]:
    """Return lower and upper corners (N, 3) of the supports of branches."""
    low, high = cone_cores(start, axis, foot, reach < 0.0)
    r = np.abs(reach)[:, None]
    return low - r, high + r


def find_boxes(root: Field) -> dict[int, tuple[Corners, Corners]]:
    """Return boxes of support and of skeletons by the identity of every node below the root.

    Skeletons are not cut by operators: their top is the range of a warp.

    Raises
    ------
    UsageError
        One reaches farther than `LARGEST`.
    """
    found: dict[int, tuple[Corners, Corners]] = {}
    for node in below(root):
        (low, high), _ = found[id(node)] = _box_of(node, found)
        # Nothing reaches from infinity to minus infinity, and is no matter.
        if not (low.min() > -LARGEST and high.max() < LARGEST):
            raise UsageError(f"a part reaches farther than {LARGEST:g}, or its size is no number")
    return found


def _box_of(node: Field, found: dict[int, tuple[Corners, Corners]]) -> tuple[Corners, Corners]:
    if isinstance(node, Primitive):
        lower, upper = (np.array(c, np.float64) for c in node.skeleton.extent(node.args))
        reach = node.skeleton.reach(node.args)
        return (lower - reach, upper + reach), (lower, upper)
    if isinstance(node, Cones):
        if not len(node.start):
            return NOTHING, NOTHING
        low, high = cone_cores(node.start, node.axis, node.foot, node.reach < 0.0)
        r = np.abs(node.reach)[:, None]
        return ((low - r).min(0), (high + r).max(0)), (low.min(0), high.max(0))
    if isinstance(node, Placed):
        support, core = found[id(node.child)]
        return transform(node.matrix, support), transform(node.matrix, core)
    if isinstance(node, Painted):
        return found[id(node.child)]
    if isinstance(node, Bent):
        support, core = found[id(node.child)]
        if is_empty(support):
            return support, core
        try:
            *_, image = node.warp.constants(node.args, range_of(node, core), support)
        except (OverflowError, ZeroDivisionError):
            image = np.full(3, -math.inf), np.full(3, math.inf)
        if not np.abs(np.stack(image)).max() < LARGEST:
            raise UsageError(f"`{node.warp.name}` over so many warps has no known bounds")
        return image, core
    if isinstance(node, Combination):
        return _combined(node, found)
    raise UsageError(f"not a field: {node!r}")


def range_of(node: Bent, core: Corners) -> float:
    """Return the height up to which a warp changes: as given, or the top of the skeletons."""
    if node.height is not None:
        return node.height
    return max(float(core[1][2]), 0.0) if not is_empty(core) else 0.0


def _combined(
    node: Combination, found: dict[int, tuple[Corners, Corners]]
) -> tuple[Corners, Corners]:
    supports = [found[id(c)][0] for c in node.children]
    core = NOTHING
    for child in node.children:
        core = unite(core, found[id(child)][1])
    name = node.blend.name
    if name in ("intersect", "r_intersect"):
        box = supports[0]
        for other in supports[1:]:
            box = intersect(box, other)
    elif name == "subtract":
        box = supports[0]
    elif name == "gbb":
        box = unite(intersect(supports[0], supports[1]), supports[2])
    else:
        box = NOTHING
        for other in supports:
            box = unite(box, other)
    return box, core


def clip_of(
    node: Combination, slot: int, found: dict[int, tuple[Corners, Corners]]
) -> Corners | None:
    """Return the box outside of which a child does not matter; None for everywhere."""
    name = node.blend.name

    def support(k: int) -> Corners:
        return found[id(node.children[k])][0]

    if name in ("intersect", "r_intersect"):
        return _combined(node, found)[0]
    if name == "subtract" and slot == 1:
        return support(0)
    if name == "gbb" and slot == 1:
        return support(0)
    if name == "gbb" and slot == 0:
        return unite(support(1), support(2))
    if name == "joint" and slot > 0 and slot % 2 == 0:
        return support(slot - 1)
    return None


def along_curve(points: Array) -> NDArray[np.int64]:
    """Return points (n, 3) in the order of a space-filling curve (Morton 1966)."""
    if len(points) == 1:
        return np.zeros(1, np.int64)
    low, span = points.min(axis=0), float(np.ptp(points, axis=0).max())
    cells = ((points - low) / max(span, 1e-300) * 1023.0).astype(np.int64)
    keys = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            keys |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(keys, kind="stable")
