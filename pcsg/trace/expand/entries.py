"""Boxes of states that have not been expanded, from their values.

An entry of the ranges is a module with what is known of its values. Which entry an item of a state
is follows from the state's own entry and rule, so nothing is looked up.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Leaf, Operation, Selection
from pcsg.graph.operators import UNION
from pcsg.graph.parametric_bounds import bound_rules
from pcsg.graph.ranges import Ranges
from pcsg.indices import wide
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
    sides_at, groups_at, below_at : int32 (E K,)
        Where in `sides`, `groups` and `below` the numbers of an entry begin whose state has a
        program; -1 where that cannot be.
    sides : float64
        The reach; then shift and floor of each side.
    groups : int32
        For each side the number of values and which of the state's own they are.
    below : int32
        Entries of the states that a program leads to, in the order of the text.
    stand_in : int32 (E K,)
        The program that shows what a state looks like from afar, -1 where there is none: a rule of
        the same module that is a few sheets.
    shown_at, shown : int32 (E K,), int32
        Where in `shown` the numbers begin of the state's values that this program is given.
    programs : int
        K.
    """

    sides_at: NDArray[np.int32]
    groups_at: NDArray[np.int32]
    below_at: NDArray[np.int32]
    sides: NDArray[np.float64]
    groups: NDArray[np.int32]
    below: NDArray[np.int32]
    stand_in: NDArray[np.int32]
    shown_at: NDArray[np.int32]
    shown: NDArray[np.int32]
    programs: int


def pack_entries(ranges: Ranges, programs: Programs) -> Entries:
    """Return the entries of a graph; the axiom's is number 0."""
    found = bound_rules(ranges)
    order = [ranges.root, *(key for key in ranges.entries if key != ranges.root)]
    number = {key: k for k, key in enumerate(order)}
    count = len(programs.starts)
    # Where the rules of every module begin, by its node.
    rules_at = dict(zip(programs.modules[2::3].tolist(), programs.modules[::3], strict=True))
    sides_at, groups_at = np.full((2, len(order) * count), -1, np.int32)
    below_at = np.full(len(order) * count, -1, np.int32)
    stand_in = np.full(len(order) * count, -1, np.int32)
    shown_at = np.zeros(len(order) * count, np.int32)
    sides: list[float] = []
    groups: list[int] = []
    below: list[int] = []
    shown: list[int] = []
    ends = programs.live_at.tolist()
    live = [programs.live[a:b].tolist() for a, b in pairwise(ends)]
    for (key, rule), bounds in found.items():
        program = 0
        if key != ranges.root:
            node = ranges.graph.nodes[key[0]]
            # A rule that is not chosen stands first.
            chosen = isinstance(node, Selection) and node.select is not None
            program = int(programs.rules[rules_at[key[0]] + (rule if chosen else 0)])
        at = number[key] * count + program
        sides_at[at], groups_at[at], below_at[at] = len(sides), len(groups), len(below)
        sides.append(bounds.sides.reach)
        for side in bounds.sides.sides:
            sides += side.shift, side.floor
            groups += len(side.group), *(live[program].index(slot) for slot in side.group)
        below += [number[k] for k in bounds.below]
        if key != ranges.root and isinstance(node, Selection) and node.select is not None:
            surface = _find_surface(ranges.graph, node)
            if surface > 0:
                other = int(programs.rules[rules_at[key[0]] + surface])
                if other != program and set(live[other]) <= set(live[program]):
                    stand_in[at], shown_at[at] = other, len(shown)
                    shown += [live[program].index(slot) for slot in live[other]]
    return Entries(
        sides_at,
        groups_at,
        below_at,
        np.array(sides),
        np.array(groups, np.int32),
        np.array(below or [0], np.int32),
        stand_in,
        shown_at,
        np.array(shown or [0], np.int32),
        count,
    )


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


@njit
def enter_state(
    entries: Entries,
    table: Table,
    state: int,
    at: int,
    entry: NDArray[np.int32],
    bounds: NDArray[np.float64],
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

    Returns
    -------
    bool
        Whether it had none.
    """
    if entry[state] >= 0:
        return False
    entry[state] = entries.below[at]
    bound_state(entries, table, state, entry[state], bounds)
    return True


@njit
def bound_state(
    entries: Entries, table: Table, state: int, entry: int, bounds: NDArray[np.float64]
) -> None:
    """Write the bounds of a state, from its values."""
    sides, groups, values = entries.sides, entries.groups, table.values
    begin, to = wide(table.values_at[state]), BOUNDS * state
    own = entry * entries.programs + wide(table.program[state])
    at, group = wide(entries.sides_at[own]), wide(entries.groups_at[own])
    if at < 0:
        # The ranges know better than the selection: it will be told when its program runs.
        for i in range(3):
            bounds[to + i], bounds[to + i + 3] = -math.inf, math.inf
        bounds[to + 6] = math.inf
        return
    bounds[to + 6] = sides[at]
    for i in range(6):
        sign = -1.0 if i < 3 else 1.0
        most = -math.inf
        n = wide(groups[group])
        for k in range(group + 1, group + 1 + n):
            most = max(most, sign * values[begin + groups[k]])
        group += 1 + n
        bounds[to + i] = sign * max(most + sides[at + 1], sides[at + 2])
        at += 2
