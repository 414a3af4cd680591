"""Boxes of states that have not been expanded, from their values.

An entry of the ranges is a module with what is known of its values. Which entry an item of a state
is follows from the state's own entry and rule, so nothing is looked up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Leaf, Operation, Selection
from pcsg.graph.operators import UNION
from pcsg.graph.parametric_bounds import Sides, bound_rules
from pcsg.graph.ranges import Ranges
from pcsg.jit import njit
from pcsg.trace.expand.clusters import BOUNDS
from pcsg.trace.expand.programs import Programs
from pcsg.trace.expand.table import Table

_FEW = 4
"""Most sheets that stand for a state."""


class Entries(NamedTuple):
    """Entries packed into arrays; E entries, K programs.

    Attributes
    ----------
    sides_at, below_at : int32 (E K,)
        Where in `sides` and `below` the numbers of an entry begin whose state has a program; -1
        where that cannot be.
    sides : float64
        The reach; then for each side the shift, the floor, the number of slots and their numbers.
    below : int32
        Entries of the states that a program leads to, in the order of the text.
    stand_in : int32 (E K,)
        The program that shows what a state looks like from afar, -1 where there is none: a rule of
        the same module that is a few sheets.
    programs : int
        K.
    """

    sides_at: NDArray[np.int32]
    below_at: NDArray[np.int32]
    sides: NDArray[np.float64]
    below: NDArray[np.int32]
    stand_in: NDArray[np.int32]
    programs: int


def pack_entries(ranges: Ranges, programs: Programs) -> Entries:
    """Return the entries of a graph; the axiom's is number 0."""
    found = bound_rules(ranges)
    order = [ranges.root, *(key for key in ranges.entries if key != ranges.root)]
    number = {key: k for k, key in enumerate(order)}
    count = len(programs.starts)
    # Where the rules of every module begin, by its node.
    rules_at = dict(zip(programs.modules[3::4].tolist(), programs.modules[1::4], strict=True))
    sides_at = np.full(len(order) * count, -1, np.int32)
    below_at = np.full(len(order) * count, -1, np.int32)
    stand_in = np.full(len(order) * count, -1, np.int32)
    sides: list[float] = []
    below: list[int] = []
    for (key, rule), bounds in found.items():
        program = 0
        if key != ranges.root:
            node = ranges.graph.nodes[key[0]]
            # A rule that is not chosen stands first.
            chosen = isinstance(node, Selection) and node.select is not None
            program = int(programs.rules[rules_at[key[0]] + (rule if chosen else 0)])
        at = number[key] * count + program
        sides_at[at], below_at[at] = len(sides), len(below)
        sides += _flat(bounds.sides)
        below += [number[k] for k in bounds.below]
        if key != ranges.root and isinstance(node, Selection) and node.select is not None:
            shown = _find_surface(ranges.graph, node)
            if shown > 0:
                other = int(programs.rules[rules_at[key[0]] + shown])
                if other != program and _knows(programs, program, other):
                    stand_in[at] = other
    inner = np.array(below or [0], np.int32)
    return Entries(sides_at, below_at, np.array(sides), inner, stand_in, count)


def _find_surface(graph: Graph, node: Selection) -> int:
    """Return the number of the first rule that is a union of few sheets, 0 if there is none."""
    for number in sorted(node.rules):
        below = [graph.number[node.rules[number]]]
        leaves: list[Leaf] = []
        for n in below:
            inner = graph.nodes[n]
            if isinstance(inner, Leaf):
                leaves.append(inner)
            elif (
                (isinstance(inner, Operation) and inner.operator is not UNION)
                or isinstance(inner, Selection)
                or len(leaves) > _FEW
            ):
                break
            below += graph.successors[n]
        else:
            if 0 < len(leaves) <= _FEW and all(x.is_sheet and not x.constants for x in leaves):
                return number
    return 0


def _knows(programs: Programs, program: int, other: int) -> bool:
    """Return whether the states of a program know all values that another one needs."""
    own, needed = (
        set(programs.live[programs.live_at[k] : programs.live_at[k + 1]].tolist())
        for k in (program, other)
    )
    return needed <= own


def _flat(sides: Sides) -> list[float]:
    numbers = [sides.reach]
    for side in sides.sides:
        numbers += [side.shift, side.floor, float(len(side.group)), *map(float, side.group)]
    return numbers


@njit
def enter_state(
    programs: Programs,
    entries: Entries,
    table: Table,
    state: int,
    at: int,
    entry: NDArray[np.int32],
    bounds: NDArray[np.float64],
    params: NDArray[np.float64],
) -> bool:
    """Find the entry of a state that has none yet, and its bounds.

    Parameters
    ----------
    at
        The item that leads to it, in `Entries.below`.
    entry : int32 (N,)
        Entries of states, -1 where there is none.
    bounds : float64 (7 N,)
        Of states: box and reach.
    params : float64 (P,)
        Working space.

    Returns
    -------
    bool
        Whether it had none.
    """
    if entry[state] >= 0:
        return False
    entry[state] = entries.below[at]
    bound_state(programs, entries, table, state, entry[state], bounds, params)
    return True


@njit
def bound_state(
    programs: Programs,
    entries: Entries,
    table: Table,
    state: int,
    entry: int,
    bounds: NDArray[np.float64],
    params: NDArray[np.float64],
) -> None:
    """Write the bounds of a state, from its values."""
    program = table.program[state]
    begin, end = programs.live_at[program], programs.live_at[program + 1]
    values = table.values_at[state] - begin
    for k in range(begin, end):
        params[programs.live[k]] = table.values[values + k]
    to = BOUNDS * state
    at = entries.sides_at[entry * entries.programs + program]
    if at < 0:
        # The ranges know better than the selection: it will be told when its program runs.
        for i in range(3):
            bounds[to + i], bounds[to + i + 3] = -math.inf, math.inf
        bounds[to + 6] = math.inf
        return
    bounds[to + 6] = entries.sides[at]
    at += 1
    for i in range(6):
        most = -math.inf
        n = int(entries.sides[at + 2])
        for k in range(n):
            x = params[int(entries.sides[at + 3 + k])]
            most = max(most, -x if i < 3 else x)
        side = max(most + entries.sides[at], entries.sides[at + 1])
        bounds[to + i] = -side if i < 3 else side
        at += 3 + n
