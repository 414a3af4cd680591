"""The table of states: every module with every set of values of its live parameters, once.

An open-addressing hash table over (module's program, bits of the live values). `fill_table` runs
rule programs until no state waits, time is up, or an array is full; Python then makes the arrays
larger and calls it again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.tape import OK, UNASSIGNED, run
from pcsg.graph.transforms import evaluate_transform
from pcsg.jit import njit
from pcsg.trace.expand.programs import (
    BEGIN,
    CHECK,
    CHECK_FIELDS,
    COMPOSE,
    CONSTANT,
    END,
    FRAME,
    L_ARGS,
    L_CHECKS,
    LEAF_FIELDS,
    LEAF_STEP,
    MODULE_FIELDS,
    POP,
    RUN,
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
    params : float64 (R,)
        Value of every register.
    initial : float64 (P,)
        Values as the axiom sees them.
    matrices : float64 (12 D,)
        Nested matrices.
    stack : float64
        Of the tape.
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
    params: NDArray[np.float64],
    parent: int,
) -> int:
    """Return the number of a state; a new one waits for its program to run."""
    counters, values = table.counters, table.values
    at = counters[N_VALUES]
    begin = programs.live_at[program]
    n = programs.live_at[program + 1] - begin
    for k in range(n):
        values[at + k] = params[programs.n_slots + programs.live[begin + k]]
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
        if run_program(programs, table, bits, work, s) != OK:
            return FAULT
        # Depth first, in the order of the text.
        low, high = before, counters[N_WAITING] - 1
        while low < high:
            a, b = table.waiting[low], table.waiting[high]
            table.waiting[low], table.waiting[high] = b, a
            low += 1
            high -= 1
    return GO_ON


@njit
def run_program(
    programs: Programs, table: Table, bits: NDArray[np.uint64], work: Work, s: int
) -> int:
    """Run the program of a state and write its items; return OK or what went wrong."""
    counters, params, steps = table.counters, work.params, programs.steps
    sources, stack = programs.sources, work.stack
    code, constants, offset = programs.code, programs.constants, programs.n_slots
    program = table.program[s]
    for k in range(programs.n_slots):
        params[k] = work.initial[k] if s == 0 else np.nan
    if s > 0:
        begin = programs.live_at[program]
        for k in range(programs.live_at[program + 1] - begin):
            params[programs.live[begin + k]] = table.values[table.values_at[s] + k]
    store_affine(work.matrices, 0, IDENTITY)
    deep = n_open = 0
    table.first[s] = counters[N_ITEMS]
    at = STEP_FIELDS * programs.starts[program]
    while True:
        op, a, b, c = steps[at], steps[at + 1], steps[at + 2], steps[at + 3]
        if op == STOP:
            table.last[s] = counters[N_ITEMS]
            return OK
        if op == RUN:
            status, _ = run(code, constants, a, b, params, 0, stack)
            if status != OK:
                return _fail(counters, s, status)
        elif op == CHECK:
            if params[a] != params[a]:
                return _fail(counters, s, UNASSIGNED)
        elif op == TRANSFORM:
            for k in range(c):
                x = _load(programs, params, sources[b + k])
                if x != x:
                    return _fail(counters, s, UNASSIGNED)
                stack[k] = x
            m = evaluate_transform(a, stack)
            _, regular = invert(m)
            if not regular:
                return _fail(counters, s, FAULT)
            deep += 1
            store_affine(
                work.matrices, 12 * deep, compose(load_affine(work.matrices, 12 * (deep - 1)), m)
            )
        elif op == CONSTANT:
            deep += 1
            for k in range(12):
                work.matrices[12 * deep + k] = programs.maps[12 * a + k]
        elif op == COMPOSE:
            m = load_affine(programs.maps, 12 * a)
            deep += 1
            store_affine(
                work.matrices, 12 * deep, compose(load_affine(work.matrices, 12 * (deep - 1)), m)
            )
        elif op == FRAME:
            # The transformation's own matrix is computed again: it is rarely needed.
            before = at - STEP_FIELDS
            for k in range(steps[before + 3]):
                stack[k] = _load(programs, params, sources[steps[before + 2] + k])
            m = evaluate_transform(steps[before + 1], stack)
            store_affine(params, b, compose(load_affine(params, a), m))
        elif op == POP:
            deep -= 1
        elif op == LEAF_STEP:
            leaf = LEAF_FIELDS * a
            n = programs.leaves[leaf + L_ARGS]
            numbers = counters[N_NUMBERS]
            for k in range(n):
                x = _load(programs, params, sources[b + k])
                check = CHECK_FIELDS * (programs.leaves[leaf + L_CHECKS] + k)
                low = programs.checks[check]
                above = x > low if programs.checks[check + 2] != 0.0 else x >= low
                if not (above and x <= programs.checks[check + 1]):
                    return _fail(counters, s, FAULT)
                table.numbers[numbers + k] = x
            for k in range(N_ATTRIBUTES):
                if programs.attributes[k] >= 0:
                    table.numbers[numbers + n] = _load(programs, params, sources[b + n])
                    n += 1
            counters[N_NUMBERS] = numbers + n
            _add_item(table, LEAF, a, work.matrices, deep, numbers)
        elif op == STATE_STEP:
            for k in range(b, b + 2 * c, 2):
                params[offset + sources[k]] = _load(programs, params, sources[k + 1])
            module = MODULE_FIELDS * a
            rule = 0
            if programs.modules[module] >= 0:
                selection, frame = programs.modules[module], programs.frame_slot
                status, _ = run(code, constants, selection, frame, params, offset, stack)
                if status != OK:
                    return _fail(counters, s, status)
                chosen = np.rint(stack[0])
                if not (chosen >= 0.0 and chosen <= programs.modules[module + 2]):
                    return _fail(counters, s, FAULT)
                rule = int(chosen)
            inner = programs.rules[programs.modules[module + 1] + rule]
            if inner < 0:
                return _fail(counters, s, FAULT)
            child = _intern(programs, table, bits, a, inner, params, s)
            _add_item(table, STATE, child, work.matrices, deep, -1)
        elif op == BEGIN:
            work.open[n_open] = counters[N_ITEMS]
            n_open += 1
            _add_item(table, OPERATION, a, work.matrices, 0, -1)
        elif op == END:
            n_open -= 1
            table.end[work.open[n_open]] = counters[N_ITEMS]
        at += STEP_FIELDS


@njit(inline=True)
def _load(programs: Programs, params: NDArray[np.float64], source: int) -> float:
    """Return the value of a register, or a literal."""
    x: float = params[source] if source >= 0 else programs.literals[-1 - source]
    return x


@njit
def _fail(counters: NDArray[np.int64], state: int, status: int) -> int:
    counters[F_STATE] = state
    return status


@njit
def _add_item(
    table: Table, kind: int, target: int, matrices: NDArray[np.float64], deep: int, numbers: int
) -> None:
    counters = table.counters
    i = counters[N_ITEMS]
    table.kind[i], table.target[i], table.numbers_at[i] = kind, target, numbers
    table.end[i] = i + 1
    table.matrix[i] = -1
    if deep > 0:
        m = counters[N_MATRICES]
        table.matrix[i] = m
        for k in range(12):
            table.matrices[12 * m + k] = matrices[12 * deep + k]
        counters[N_MATRICES] = m + 1
    counters[N_ITEMS] = i + 1
