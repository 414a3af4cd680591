"""The table of states as far as memory allows, the largest states first."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.collapse import half_area
from pcsg.jit import njit
from pcsg.trace.expand.clusters import BOUNDS
from pcsg.trace.expand.entries import Entries, enter_state
from pcsg.trace.expand.programs import Programs
from pcsg.trace.expand.table import (
    DONE,
    FAULT,
    FULL,
    GO_ON,
    N_ITEMS,
    N_MATRICES,
    N_NUMBERS,
    N_STATES,
    N_WAITING,
    STATE,
    Table,
    Work,
    has_room,
    run_program,
)
from pcsg.vec import determinant, load_affine

REFERENCE_BYTES = 224
"""Of a reference and its share of the hierarchy, about."""


class Frontier(NamedTuple):
    """What is known of the states of a table that is filled from the largest on.

    Attributes
    ----------
    entry : int32 (N,)
        Entries of the states, -1 where there is none.
    bounds : float64 (7 N,)
        Their bounds.
    scale : float64 (N,)
        About how large their frames are in the world, where they were met first.
    areas, states : float64 (N,), int32 (N,)
        A heap of states that may be expanded, the largest on top.
    size : int64 (1,)
        Of the heap.
    """

    entry: NDArray[np.int32]
    bounds: NDArray[np.float64]
    scale: NDArray[np.float64]
    areas: NDArray[np.float64]
    states: NDArray[np.int32]
    size: NDArray[np.int64]


@njit(entry=True)
def fill_best_first(
    programs: Programs,
    entries: Entries,
    table: Table,
    bits: NDArray[np.uint64],
    work: Work,
    frontier: Frontier,
    budget: float,
    bytes_suspended: int,
    forced: float,
    most: int,
) -> int:
    """Run programs of the largest states that wait.

    States without bounds are expanded whatever it takes. A state that cannot be made stays as it
    is: rays that meet it will tell.

    Parameters
    ----------
    budget
        Bytes of what is made of the states.
    bytes_suspended
        Of a state that waits.
    forced
        Bytes that states without bounds may take.
    most
        States until it returns.

    Returns
    -------
    int
        DONE where the budget is used up or no state waits, GO_ON, FULL where an array is, FAULT
        where there is no end of states without bounds.
    """
    counters, size = table.counters, frontier.size
    for _ in range(most):
        if size[0] == 0:
            return DONE
        if not has_room(programs, table):
            return FULL
        # What leads to a state that has been expanded goes when that is flattened.
        references = counters[N_ITEMS] + size[0] - counters[N_STATES]
        used = REFERENCE_BYTES * references + 8.0 * counters[N_NUMBERS]
        used += bytes_suspended * size[0]
        if used > budget and frontier.areas[0] < math.inf:
            return DONE
        if used > max(budget, forced):
            return FAULT
        s = _pop(frontier)
        items, matrices, numbers = counters[N_ITEMS], counters[N_MATRICES], counters[N_NUMBERS]
        is_made = run_program(programs, table, bits, work, s)
        counters[N_WAITING] = 0
        if not is_made:
            table.first[s] = table.last[s] = -1
            counters[N_ITEMS], counters[N_MATRICES], counters[N_NUMBERS] = items, matrices, numbers
            continue
        at = entries.below_at[frontier.entry[s] * entries.programs + table.program[s]]
        for i in range(table.first[s], table.last[s]):
            if table.kind[i] != STATE:
                continue
            child = table.target[i]
            entry, bounds = frontier.entry, frontier.bounds
            if enter_state(entries, table, child, at, entry, bounds):
                m = table.matrix[i]
                scale = frontier.scale[s]
                if m >= 0:
                    scale *= np.cbrt(abs(determinant(load_affine(table.matrices, 12 * m))))
                frontier.scale[child] = scale
                _push(frontier, _area(bounds, BOUNDS * child) * scale * scale, child)
            at += 1
    return GO_ON


@njit
def _area(bounds: NDArray[np.float64], at: int) -> float:
    """Return half the surface of a box; infinite where it has no bounds."""
    for k in range(3):
        if bounds[at + k] <= bounds[at + 3 + k] and not (
            abs(bounds[at + k]) < math.inf and abs(bounds[at + 3 + k]) < math.inf
        ):
            return math.inf
    area: float = half_area(bounds, at)
    return area


@njit
def _comes_first(frontier: Frontier, area: float, state: int, k: int) -> bool:
    other = frontier.areas[k]
    return bool(area > other or (area == other and state < frontier.states[k]))


@njit
def _push(frontier: Frontier, area: float, state: int) -> None:
    areas, states = frontier.areas, frontier.states
    k = frontier.size[0]
    frontier.size[0] = k + 1
    while k > 0 and _comes_first(frontier, area, state, (k - 1) // 2):
        above = (k - 1) // 2
        areas[k], states[k] = areas[above], states[above]
        k = above
    areas[k], states[k] = area, state


@njit
def _pop(frontier: Frontier) -> int:
    areas, states = frontier.areas, frontier.states
    found = states[0]
    last = frontier.size[0] - 1
    frontier.size[0] = last
    area, state = areas[last], states[last]
    k = 0
    while True:
        child = 2 * k + 1
        if child >= last:
            break
        if child + 1 < last and _comes_first(frontier, areas[child + 1], states[child + 1], child):
            child += 1
        if _comes_first(frontier, area, state, child):
            break
        areas[k], states[k] = areas[child], states[child]
        k = child
    areas[k], states[k] = area, state
    return int(found)
