"""Where cluster frames begin for the sake of single precision.

Boxes are in single precision, as errors of 5e-7 of their coordinates. What is small and far from
the origin of its frame would have boxes that do not tell it from its neighbours. So a state that is
compact, and far away for the size of its leaves, is a cluster of its own, even where it stands in
one place only; and any cluster that is far from its own origin is laid out about its middle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.operators import DIFFERENCE
from pcsg.graph.states import LeafItem, StateGraph, StateItem
from pcsg.jit import njit
from pcsg.simd import WIDTH
from pcsg.trace.bounding import bound_box
from pcsg.trace.expand.programs import HAS_DATA, L_FLAGS, LEAF_FIELDS, Programs
from pcsg.trace.expand.shapes import bound_shape, join_box, start_box
from pcsg.trace.expand.table import LEAF, N_STATES, OPERATION, STATE, Table
from pcsg.vec import IDENTITY, Affine, Vec3, determinant, invert, load_affine, transform_point

_DIFFERENCE = DIFFERENCE.kind

SMALL = 2.0**-16
"""Width of leaves over their distance from a frame's origin below which another frame begins."""

_COMPACT = 8.0
"""How far away a state must be at least, in halves of its diameter."""

_LEAST = 2 * WIDTH
"""Leaves that are worth a frame."""


class Frames(NamedTuple):
    """Where states are; all arrays are empty where all is near enough.

    Attributes
    ----------
    boxes : float64 (6 N,)
        Of states, in their own frames.
    widths : float64 (N,)
        Mean width of their leaves.
    origins : float64 (3 N,)
        Where the origin of the surrounding cluster's frame is; NaN before it is known.
    """

    boxes: NDArray[np.float64]
    widths: NDArray[np.float64]
    origins: NDArray[np.float64]


def find_frames(
    programs: Programs, table: Table, leaves: NDArray[np.float64], order: NDArray[np.int32]
) -> Frames:
    """Return where states are.

    Parameters
    ----------
    leaves : float64 (M,)
        Leaves of items, as in `clusters.Sizes`.
    order : int32 (N,)
        The states, each after those that it contains.
    """
    n = len(order)
    if not find_small(programs, table, leaves, order, np.zeros(n)):
        return Frames(np.zeros(0), np.zeros(0), np.zeros(0))
    frames = Frames(np.zeros(6 * n), np.zeros(n), np.full(3 * n, np.nan))
    skipped = np.zeros(2 * programs.n_operations + 2, np.int32)
    measure_boxes(programs, table, leaves, order, frames, skipped, np.zeros(6))
    return frames


def is_flat_and_small(states: StateGraph, most: int) -> bool:
    """Return whether a scene of few states stands in one frame, too far away for its leaves.

    Parameters
    ----------
    states
        Finite and acyclic.
    most
        Leaves up to which such a scene stands in one frame.
    """
    leaves = [0] * len(states.states)
    outer, inner, matrices = list[int](), list[int](), list[Affine]()
    for s in states.children_first:
        for item in states.states[s].content or ():
            if isinstance(item, StateItem):
                inner.append(item.state)
                matrices.append(item.state_from_child)
                leaves[s] += leaves[item.state]
            elif isinstance(item, LeafItem):
                inner.append(-1)
                matrices.append(item.state_from_leaf)
                leaves[s] += 1
            else:
                continue
            outer.append(s)
    if not _LEAST <= leaves[0] <= most:
        return False
    m = np.array(matrices).reshape(-1, 3, 4)
    try:
        stretch = np.linalg.norm(np.linalg.inv(m[:, :, :3]), 2, axis=(1, 2))
    except np.linalg.LinAlgError:
        # Numbers at the end of their range.
        return False
    away = np.linalg.norm(m[:, :, 3], axis=1)
    frames, place = np.array(outer), np.array(inner)
    within = place >= 0
    reach = np.zeros(len(leaves))
    far = np.zeros(len(place))
    for _ in states.states:
        before, far = reach.copy(), stretch * (reach[frames] + away)
        np.maximum.at(reach, place[within], far[within])
        if np.array_equal(before, reach):
            break
    return bool((far[~within] * SMALL > 1.0).any())


@njit(entry=True)
def find_small(
    programs: Programs,
    table: Table,
    leaves: NDArray[np.float64],
    order: NDArray[np.int32],
    reach: NDArray[np.float64],
) -> int:
    """Return 1 where leaves may be small for where they are in the world, else 0.

    Parameters
    ----------
    reach : float64 (N,)
        Zeros; receives how far the world's origin is at most in a state's frame.
    """
    for k in range(table.counters[N_STATES] - 1, -1, -1):
        s = order[k]
        for i in range(table.first[s], table.last[s]):
            kind, target = table.kind[i], table.target[i]
            if kind == OPERATION or leaves[i] == 0.0:
                continue
            far = reach[s]
            if table.matrix[i] >= 0:
                m = load_affine(table.matrices, 12 * table.matrix[i])
                inverse, _ = invert(m)
                far = _length(inverse) * (far + abs(m.m03) + abs(m.m13) + abs(m.m23))
            if kind == STATE:
                if not far <= reach[target]:
                    reach[target] = far
            elif (
                not far * SMALL <= 1.0 or programs.leaves[LEAF_FIELDS * target + L_FLAGS] & HAS_DATA
            ):
                return 1
    return 0


@njit
def _length(m: Affine) -> float:
    """Return a number that no stretch of a map exceeds."""
    total = 0.0
    for k in range(11):
        if k % 4 != 3:
            total += m[k] * m[k]
    return math.sqrt(total)


@njit(entry=True)
def measure_boxes(
    programs: Programs,
    table: Table,
    leaves: NDArray[np.float64],
    order: NDArray[np.int32],
    frames: Frames,
    skipped: NDArray[np.int32],
    box: NDArray[np.float64],
) -> None:
    """Fill in boxes and widths, from the leaves up; what is subtracted does not count.

    Parameters
    ----------
    skipped, box
        Working space.
    """
    for k in range(table.counters[N_STATES]):
        s = order[k]
        start_box(frames.boxes, 6 * s)
        total, count = 0.0, 0.0
        nested = 0
        i = table.first[s]
        while i < table.last[s]:
            if nested > 0 and i == skipped[2 * nested - 2]:
                i = skipped[2 * nested - 1]
                nested -= 1
                continue
            kind, target = table.kind[i], table.target[i]
            if kind == OPERATION:
                if target == _DIFFERENCE and i + 1 < table.end[i]:
                    skipped[2 * nested], skipped[2 * nested + 1] = table.end[i + 1], table.end[i]
                    nested += 1
            elif leaves[i] > 0.0:
                m = IDENTITY
                if table.matrix[i] >= 0:
                    m = load_affine(table.matrices, 12 * table.matrix[i])
                if kind == LEAF:
                    bound_shape(programs, table, i, m, box)
                    width = max(box[3] - box[0], box[4] - box[1], box[5] - box[2])
                else:
                    at = 6 * target
                    bound_box(m, frames.boxes, at, 0.0, 0.0, 0.0, math.inf, box, 0)
                    width = frames.widths[target] * math.pow(abs(determinant(m)), 1.0 / 3.0)
                join_box(frames.boxes, 6 * s, box, 0)
                total += leaves[i] * width
                count += leaves[i]
            i += 1
        frames.widths[s] = total / count if count > 0.0 else 0.0


@njit
def is_far(frames: Frames, s: int, leaves: float, origin: Vec3) -> bool:
    """Return whether a state is compact, and far from a place for the size of its leaves."""
    middle = middle_of(frames, s)
    b = 6 * s
    boxes = frames.boxes
    x, y, z = boxes[b + 3] - boxes[b], boxes[b + 4] - boxes[b + 1], boxes[b + 5] - boxes[b + 2]
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    x, y, z = middle.x - origin.x, middle.y - origin.y, middle.z - origin.z
    away = math.sqrt(x * x + y * y + z * z)
    # What is not finite is not far.
    return (
        leaves >= _LEAST and away > _COMPACT * half and frames.widths[s] < SMALL * away < math.inf
    )


@njit
def middle_of(frames: Frames, s: int) -> Vec3:
    """Return the middle of a state's box."""
    b, boxes = 6 * s, frames.boxes
    return Vec3(
        0.5 * (boxes[b] + boxes[b + 3]),
        0.5 * (boxes[b + 1] + boxes[b + 4]),
        0.5 * (boxes[b + 2] + boxes[b + 5]),
    )


@njit
def load_origin(frames: Frames, s: int) -> Vec3:
    """Return where the origin of the surrounding cluster's frame is in a state's frame."""
    at = 3 * s
    return Vec3(frames.origins[at], frames.origins[at + 1], frames.origins[at + 2])


@njit
def store_origin(frames: Frames, s: int, origin: Vec3) -> None:
    """Set where the origin of the surrounding cluster's frame is."""
    frames.origins[3 * s], frames.origins[3 * s + 1], frames.origins[3 * s + 2] = origin


@njit
def move_origin(frames: Frames, table: Table, s: int, i: int) -> None:
    """Tell the state that an item is where the cluster's origin is; of several, the farthest."""
    child = table.target[i]
    origin = load_origin(frames, s)
    if table.matrix[i] >= 0:
        inverse, _ = invert(load_affine(table.matrices, 12 * table.matrix[i]))
        origin = transform_point(inverse, origin)
    known, middle = load_origin(frames, child), middle_of(frames, child)
    before = abs(known.x - middle.x) + abs(known.y - middle.y) + abs(known.z - middle.z)
    now = abs(origin.x - middle.x) + abs(origin.y - middle.y) + abs(origin.z - middle.z)
    if not before >= now:
        store_origin(frames, child, origin)
