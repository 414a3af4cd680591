"""The table of states: every module with every set of values of its live parameters, once.

An open-addressing hash table over (module's program, bits of the live values). `fill_table` runs
rule programs until no state waits, time is up, or an array is full; Python then makes the arrays
larger and calls it again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.transforms import evaluate_transform
from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.trace.expand.arithmetic import compute
from pcsg.trace.expand.programs import (
    BEGIN,
    CHECK_FIELDS,
    COMPOSE,
    COMPUTE,
    END,
    FRAME,
    IN_PLACE,
    L_ARGS,
    L_CHECKS,
    LEAF_FIELDS,
    LEAF_STEP,
    MODULE_FIELDS,
    PLACED,
    POP,
    STATE_STEP,
    STEP_FIELDS,
    STOP,
    TRANSFORM,
    Programs,
)
from pcsg.vec import IDENTITY, compose, invert, load_affine, store_affine

# Kinds of items.
LEAF, STATE, OPERATION = range(3)

# What `fill_table` returns.
DONE, GO_ON, FULL, FAULT = range(4)

N_ATTRIBUTES = 7
"""Attributes of a leaf."""

# Counters of a table.
N_STATES, N_ITEMS, N_MATRICES, N_NUMBERS, N_VALUES, N_WAITING = range(6)
F_STATE = 6
"""Counter of the fault that was met: its state."""

COUNTERS = 7


class Table(NamedTuple):
    """States and what they are made of.

    Attributes
    ----------
    program, module, parent : int32 (N,)
        Program and module of every state (-1 for the axiom, which is state 0), and the state that
        met it first.
    first, last : int32 (N,)
        Its items; -1 while it waits.
    values_at : int32 (N + 1,)
        Where its live values begin in `values`.
    values : float64
    slots : int32 (H,)
        The hash table: numbers of states, -1 where free. H is a power of two; with 1, states are
        not told apart.
    kind, target, matrix, numbers_at, end : int32 (M,)
        Items in the order of the text, an operation before its operands. Target of a LEAF: its
        number; of a STATE: its number; of an OPERATION: the operator's kind. Then where
        state_from_item stands in `matrices` (-1: the identity), where the numbers of a leaf begin,
        and the item behind the last one below.
    matrices : float64 (12,)
        Constants first.
    numbers : float64
        Arguments of leaves, and behind them the attributes that are assigned somewhere.
    waiting : int32
        Stack of states whose program has not run.
    counters : int64 (7,)
        How many there are of each, and what went wrong.
    """

    program: NDArray[np.int32]
    module: NDArray[np.int32]
    parent: NDArray[np.int32]
    first: NDArray[np.int32]
    last: NDArray[np.int32]
    values_at: NDArray[np.int32]
    values: NDArray[np.float64]
    slots: NDArray[np.int32]
    kind: NDArray[np.int32]
    target: NDArray[np.int32]
    matrix: NDArray[np.int32]
    numbers_at: NDArray[np.int32]
    end: NDArray[np.int32]
    matrices: NDArray[np.float64]
    numbers: NDArray[np.float64]
    waiting: NDArray[np.int32]
    counters: NDArray[np.int64]


class Work(NamedTuple):
    """Working space of the interpreter.

    Attributes
    ----------
    params : float64 (R + L,)
        Value of every register, and literals.
    initial : float64 (P,)
        Values as the axiom sees them.
    matrices : float64 (12 D,)
        Nested matrices.
    stack : float64
        Arguments of a function.
    open : int32
        Items of operations whose operands are not complete.
    """

    params: NDArray[np.float64]
    initial: NDArray[np.float64]
    matrices: NDArray[np.float64]
    stack: NDArray[np.float64]
    open: NDArray[np.int32]


_MIX = np.uint64(0x9E3779B97F4A7C15)
_MIX_2 = np.uint64(0xBF58476D1CE4E5B9)
_31, _27, _NONE = np.uint64(31), np.uint64(27), np.uint64(0)


@njit
def hash_values(program: int, bits: NDArray[np.uint64], at: int, n: int) -> np.uint64:
    """Hash a program's number and the bits of n values."""
    h = np.uint64(program) * _MIX
    for k in range(n):
        h = (h ^ bits[at + k]) * _MIX_2
        h ^= h >> _31
    h *= _MIX
    return h ^ (h >> _27)


@njit
def _intern(
    programs: Programs,
    table: Table,
    bits: NDArray[np.uint64],
    module: int,
    program: int,
    parent: int,
) -> int:
    """Return the number of the state whose values stand behind all others; a new one waits."""
    counters = table.counters
    at = counters[N_VALUES]
    n = programs.live_at[program + 1] - programs.live_at[program]
    mask = np.uint64(len(table.slots) - 1)
    place = hash_values(program, bits, at, n) & mask if mask > _NONE else _NONE
    while mask > _NONE:
        found = table.slots[place]
        if found < 0:
            break
        if table.program[found] == program and table.module[found] == module:
            same = table.values_at[found]
            k = 0
            while k < n and bits[same + k] == bits[at + k]:
                k += 1
            if k == n:
                return int(found)
        place = (place + np.uint64(1)) & mask
    s = counters[N_STATES]
    table.slots[place] = s
    table.program[s], table.module[s], table.parent[s] = program, module, parent
    table.first[s] = table.last[s] = -1
    table.values_at[s] = at
    table.values_at[s + 1] = at + n
    counters[N_VALUES] = at + n
    counters[N_STATES] = s + 1
    table.waiting[counters[N_WAITING]] = s
    counters[N_WAITING] += 1
    return int(s)


@njit(entry=True)
def rehash(programs: Programs, table: Table, bits: NDArray[np.uint64]) -> None:
    """Enter all states into an empty hash table."""
    mask = np.uint64(len(table.slots) - 1)
    for s in range(1, table.counters[N_STATES]):
        at = table.values_at[s]
        n = table.values_at[s + 1] - at
        place = hash_values(table.program[s], bits, at, n) & mask
        while table.slots[place] >= 0:
            place = (place + np.uint64(1)) & mask
        table.slots[place] = s


@njit
def has_room(programs: Programs, table: Table) -> bool:
    """Return whether a table has room for what any program makes."""
    counters = table.counters
    items = programs.n_items
    return bool(
        counters[N_STATES] + items < len(table.program)
        and counters[N_ITEMS] + items < len(table.kind)
        and 12 * (counters[N_MATRICES] + items) < len(table.matrices)
        and counters[N_NUMBERS] + items * (16 + N_ATTRIBUTES) < len(table.numbers)
        and counters[N_VALUES] + (items + 1) * programs.n_slots < len(table.values)
        and (len(table.slots) == 1 or 2 * (counters[N_STATES] + items) < len(table.slots))
    )


@njit(entry=True)
def fill_table(
    programs: Programs, table: Table, bits: NDArray[np.uint64], work: Work, most: int
) -> int:
    """Run the programs of states that wait.

    Parameters
    ----------
    bits : uint64
        `Table.values` as bits.
    most
        States until it returns.

    Returns
    -------
    int
        DONE where no state waits, GO_ON, FULL where an array is, FAULT.
    """
    counters = table.counters
    for _ in range(most):
        if counters[N_WAITING] == 0:
            return DONE
        if not has_room(programs, table):
            return FULL
        counters[N_WAITING] -= 1
        s = table.waiting[counters[N_WAITING]]
        before = counters[N_WAITING]
        if not run_program(programs, table, bits, work, s):
            return FAULT
        # Depth first, in the order of the text.
        low, high = before, counters[N_WAITING] - 1
        while low < high:
            a, b = table.waiting[low], table.waiting[high]
            table.waiting[low], table.waiting[high] = b, a
            low += 1
            high -= 1
    return GO_ON


@njit(inline=True)
def run_program(
    programs: Programs, table: Table, bits: NDArray[np.uint64], work: Work, s: int
) -> bool:
    """Run the program of a state and write its items; return False where that cannot be."""
    counters, params, steps = table.counters, work.params, programs.steps
    sources, stack, values = programs.sources, work.stack, table.values
    program = wide(table.program[s])
    begin = wide(programs.live_at[program])
    n = wide(programs.live_at[program + 1]) - begin
    if s == 0:
        for k in range(n):
            params[k] = work.initial[programs.live[begin + k]]
    else:
        at = wide(table.values_at[s])
        for k in range(n):
            params[k] = values[at + k]
    deep = n_open = 0
    table.first[s] = counters[N_ITEMS]
    at = STEP_FIELDS * wide(programs.starts[program])
    while True:
        op, a, b = wide(steps[at]), wide(steps[at + 1]), wide(steps[at + 2])
        c, d = wide(steps[at + 3]), wide(steps[at + 4])
        if op == STOP:
            table.last[s] = counters[N_ITEMS]
            return True
        if op == COMPUTE:
            if not compute(programs.code, sources, programs.columns, params, stack, a):
                return _fail(counters, s)
        elif op == TRANSFORM:
            for k in range(c):
                x = params[sources[b + k]]
                if x != x:
                    return _fail(counters, s)
                stack[k] = x
            m = evaluate_transform(a, stack)
            _, regular = invert(m)
            if not regular:
                return _fail(counters, s)
            outer = IDENTITY
            if d >= 0:
                outer = load_affine(programs.maps, 12 * d)
            elif d == PLACED:
                outer = load_affine(work.matrices, 12 * deep)
            m = compose(outer, m)
            deep += 1
            store_affine(work.matrices, 12 * deep, m)
        elif op == COMPOSE:
            m = compose(load_affine(work.matrices, 12 * deep), load_affine(programs.maps, 12 * a))
            deep += 1
            store_affine(work.matrices, 12 * deep, m)
        elif op == FRAME:
            # The transformation's own matrix is computed again: it is rarely needed.
            before = at - STEP_FIELDS
            for k in range(steps[before + 3]):
                stack[k] = params[sources[steps[before + 2] + k]]
            m = evaluate_transform(steps[before + 1], stack)
            store_affine(params, b, compose(load_affine(params, a), m))
        elif op == POP:
            deep -= 1
        elif op == LEAF_STEP:
            leaf = LEAF_FIELDS * a
            n = wide(programs.leaves[leaf + L_ARGS])
            numbers = counters[N_NUMBERS]
            for k in range(n):
                x = params[sources[b + k]]
                check = CHECK_FIELDS * (programs.leaves[leaf + L_CHECKS] + k)
                low = programs.checks[check]
                above = x > low if programs.checks[check + 2] != 0.0 else x >= low
                if not (above and x <= programs.checks[check + 1]):
                    return _fail(counters, s)
                table.numbers[numbers + k] = x
            for k in range(N_ATTRIBUTES):
                if programs.attributes[k] >= 0:
                    table.numbers[numbers + n] = params[sources[b + n]]
                    n += 1
            counters[N_NUMBERS] = numbers + n
            _add_item(table, LEAF, a, work.matrices, c, deep, numbers)
        elif op == STATE_STEP:
            module = MODULE_FIELDS * a
            chosen = np.rint(params[sources[c]])
            if not (chosen >= 0.0 and chosen <= programs.modules[module + 1]):
                return _fail(counters, s)
            rule = int(chosen)
            inner = wide(programs.rules[programs.modules[module] + rule])
            if inner < 0:
                return _fail(counters, s)
            source, to = wide(programs.calls[b + rule]), counters[N_VALUES]
            for k in range(programs.live_at[inner + 1] - programs.live_at[inner]):
                values[to + k] = params[sources[source + k]]
            child = _intern(programs, table, bits, a, inner, s)
            _add_item(table, STATE, child, work.matrices, d, deep, -1)
        elif op == BEGIN:
            work.open[n_open] = counters[N_ITEMS]
            n_open += 1
            _add_item(table, OPERATION, a, work.matrices, IN_PLACE, 0, -1)
        elif op == END:
            n_open -= 1
            table.end[work.open[n_open]] = counters[N_ITEMS]
        at += STEP_FIELDS


@njit
def _fail(counters: NDArray[np.int64], state: int) -> bool:
    counters[F_STATE] = state
    return False


@njit
def _add_item(
    table: Table,
    kind: int,
    target: int,
    matrices: NDArray[np.float64],
    matrix: int,
    deep: int,
    numbers: int,
) -> None:
    """Write an item whose matrix is a constant, none, or the one that was placed last."""
    counters = table.counters
    i = counters[N_ITEMS]
    table.kind[i], table.target[i], table.numbers_at[i] = kind, target, numbers
    table.end[i] = i + 1
    if matrix == PLACED:
        matrix = counters[N_MATRICES]
        for k in range(12):
            table.matrices[12 * matrix + k] = matrices[12 * deep + k]
        counters[N_MATRICES] = matrix + 1
    table.matrix[i] = matrix
    counters[N_ITEMS] = i + 1
