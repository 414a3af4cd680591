"""The working space of a walk: frames, the chain, records of surfaces, and how a walk ends."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.trace.merge import SHEET
from pcsg.trace.tables import (
    CONSTANT_MATRIX,
    MATRIX,
    MAX_LEAF_ARGS,
)
from pcsg.vec import (
    IDENTITY,
    Affine,
    Ray,
    Vec3,
    compose,
    load_affine,
)

# How a walk ends. The first two are the tape's; those from FRAMES_FULL on ask for larger arrays.
OK, NOT_FINITE, UNASSIGNED = 0, 1, 2
SELECTION_RANGE, SINGULAR, BAD_ARGUMENT, TOO_DEEP, TOO_LONG = 3, 4, 5, 6, 7
FRAMES_FULL, CHAIN_FULL, EVENTS_FULL, RECORDS_FULL, CROSSINGS_FULL = 8, 9, 10, 11, 12

SHRUNK_ORIGIN, SHRUNK_DIRECTION = 2.0**52, 1e150
"""Sizes of a ray's origin and direction at which a frame has shrunk to nothing."""

# Fields of a frame, a chain entry and a record.
F_NODE, F_NEXT, F_CHAIN, F_FLIP, F_DEPTH = 0, 1, 2, 3, 4
F_CHAIN_TOP, F_RECORD_TOP, F_START, F_MIDDLE, F_LISTS = 5, 6, 7, 8, 9
FRAME, STATE = 10, 9
ATTRIBUTES_AT, N_ATTRIBUTES = 6, 7
ARGUMENTS_AT = ATTRIBUTES_AT + N_ATTRIBUTES
RECORD = ARGUMENTS_AT + MAX_LEAF_ARGS

PRECISION = 13
"""Where the precision of the ray stands in `Scratch.best`."""


class Scratch(NamedTuple):
    """Working space of one thread.

    Attributes
    ----------
    frames : int32 (F * 10,)
        Operations that wait for further operands: what `F_NODE`... name.
    states : float64 (F * (9 + P),)
        Ray (6), the world origin in the local frame (3) and parameters of the frames.
    chain : int32 (C * 3,)
        Parent, node and rule of the selections and transformations on the way.
    chain_matrices : float64 (C * 12,)
        local_from_parent of transformations.
    event_t, event_about : float64 (E,), int32 (2 E,)
        Lists of events: t; record and kind.
    merged_t, merged_about
        The same for results of merging.
    records : float64 (R * RECORD,)
        What is known of a surface: local ray (6), attributes (7), arguments of the leaf.
    record_about : int32 (R * 3,)
        Its leaf node, end of its chain, whether it is flipped.
    params : float64 (P,)
        Present values.
    stack : float64
        The tape's stack.
    t : float64 (T,)
        Crossings of one leaf.
    best : float64 (PRECISION + 2,)
        t and local_from_world of the first hit; the ray's precision.
    fault : int32 (3,)
        Node, instruction and end of the chain where a fault was found.
    """

    frames: NDArray[np.int32]
    states: NDArray[np.float64]
    chain: NDArray[np.int32]
    chain_matrices: NDArray[np.float64]
    event_t: NDArray[np.float64]
    event_about: NDArray[np.int32]
    merged_t: NDArray[np.float64]
    merged_about: NDArray[np.int32]
    records: NDArray[np.float64]
    record_about: NDArray[np.int32]
    params: NDArray[np.float64]
    stack: NDArray[np.float64]
    t: NDArray[np.float64]
    best: NDArray[np.float64]
    fault: NDArray[np.int32]


@njit
def misses_box(boxes: NDArray[np.float64], at: int, ray: Ray, low: float, high: float) -> bool:
    """Return whether a ray passes a box by between two parameters, allowing for rounding."""
    t0 = low
    t1 = high
    for k in range(3):
        o = ray[k]
        d = ray[3 + k]
        lower = boxes[at + k]
        upper = boxes[at + 3 + k]
        if d == 0.0:
            if o < lower or o > upper:
                return True
            continue
        i = 1.0 / d
        near = (lower - o) * i
        far = (upper - o) * i
        if near > far:
            near, far = far, near
        if near > t0:
            t0 = near
        if far < t1:
            t1 = far
    return t0 - t1 > 1e-14 * max(abs(t0), abs(t1)) or lower > upper


@njit
def chain_map(
    kind_of: NDArray[np.int32],
    detail_of: NDArray[np.int32],
    matrices: NDArray[np.float64],
    chain_of: NDArray[np.int32],
    chain_matrices: NDArray[np.float64],
    end: int,
) -> Affine:
    """Return local_from_world of a chain of transformations (fig 4 of the paper)."""
    m = IDENTITY
    while end >= 0:
        node = chain_of[3 * end + 1]
        if kind_of[node] == CONSTANT_MATRIX:
            m = compose(m, load_affine(matrices, detail_of[node]))
        elif kind_of[node] == MATRIX:
            m = compose(m, load_affine(chain_matrices, 12 * end))
        end = chain_of[3 * end]
    return m


@njit
def write_record(
    records: NDArray[np.float64],
    at: int,
    ray: Ray,
    params: NDArray[np.float64],
    attribute_slot: int,
    args: NDArray[np.float64],
    args_at: int,
    arity: int,
) -> None:
    """Keep what the shading of a leaf's surface needs."""
    for k in range(6):
        records[at + k] = ray[k]
    for k in range(N_ATTRIBUTES):
        records[at + ATTRIBUTES_AT + k] = params[attribute_slot + k]
    for k in range(arity):
        records[at + ARGUMENTS_AT + k] = args[args_at + k]


@njit
def describe_record(
    record_about: NDArray[np.int32], record: int, node: int, chain: int, flip: int
) -> None:
    """Write which leaf a record is of, the end of its chain, and whether it is flipped."""
    record_about[3 * record] = node
    record_about[3 * record + 1] = chain
    record_about[3 * record + 2] = flip


@njit
def copy_record(records: NDArray[np.float64], record_about: NDArray[np.int32], record: int) -> None:
    """Make a record the one of the first hit."""
    for j in range(RECORD):
        records[j] = records[record * RECORD + j]
    for j in range(3):
        record_about[j] = record_about[3 * record + j]


@njit
def args_are_legal(
    low: NDArray[np.float64], high: NDArray[np.float64], at: int, args: NDArray[np.float64], n: int
) -> bool:
    """Return whether n arguments of a leaf are in their ranges."""
    for k in range(n):
        if args[k] < low[at + k] or args[k] > high[at + k]:
            return False
    return True


@njit
def find_model(models: NDArray[np.float64], at: int, values: NDArray[np.float64]) -> int:
    """Return where the kernel arguments of the model for these values are, -1 if there is none."""
    rows, width = int(models[at]), int(models[at + 1])
    row = at + 2
    for _ in range(rows):
        same = True
        for k in range(width):
            # The values come from the same arithmetic, but from another library of functions.
            if not abs(values[k] - models[row + k]) <= 1e-12 * max(1.0, abs(models[row + k])):
                same = False
        if same:
            return int(models[row + width])
        row += width + 1
    return -1


@njit
def leave_events(event_about: NDArray[np.int32], k: int) -> int:
    """Return the event that leaves what event k enters."""
    k += 1
    while event_about[2 * k + 1] == SHEET:
        k += 1
    return k


@njit(entry=True)
def follow_chain(chain: NDArray[np.int32], end: int, path: NDArray[np.int32]) -> int:
    """Write the entries of a chain from its end up to `path`; return how many there are."""
    n = 0
    while end >= 0:
        path[n] = end
        n += 1
        end = chain[3 * end]
    return n


@njit
def note_fault(fault: NDArray[np.int32], node: int, instruction: int, chain: int) -> None:
    """Write where a fault was found."""
    fault[0] = node
    fault[1] = instruction
    fault[2] = chain


@njit
def save_state(
    states: NDArray[np.float64],
    at: int,
    ray: Ray,
    origin: Vec3,
    params: NDArray[np.float64],
    n_params: int,
) -> None:
    """Write a ray, the world's origin, and parameters to a frame's state."""
    for k in range(6):
        states[at + k] = ray[k]
    for k in range(3):
        states[at + 6 + k] = origin[k]
    for k in range(n_params):
        states[at + STATE + k] = params[k]


@njit
def restore_state(
    states: NDArray[np.float64],
    at: int,
    world: Ray,
    params: NDArray[np.float64],
    n_params: int,
) -> tuple[Ray, Vec3]:
    """Read what `save_state` has written."""
    for k in range(n_params):
        params[k] = states[at + STATE + k]
    ray = Ray(
        states[at],
        states[at + 1],
        states[at + 2],
        states[at + 3],
        states[at + 4],
        states[at + 5],
        world.tmin,
        world.tmax,
    )
    return ray, Vec3(states[at + 6], states[at + 7], states[at + 8])
