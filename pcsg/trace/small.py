"""Small operations as truth tables.

An operation over at most six primitives needs no questions: the crossings of all of them are
sorted, and a table of 64 bits tells for every set of primitives that a point is in whether it is
in the result. Leaves of trees are of this kind.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.code import compose_affine
from pcsg.graph.operators import DIFFERENCE, UNION
from pcsg.indices import place, wide
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_crossings
from pcsg.leaf.registry import ALL, Pool
from pcsg.simd import stay_apart
from pcsg.trace.groups import INSTANCE, LEAF, Groups
from pcsg.trace.merge import TABLES, truth
from pcsg.trace.precision import is_touch, load_precision, tolerance
from pcsg.vec import IDENTITY, Affine, Ray, load_affine, transform_ray

MAX_PRIMITIVES = 6

HEADER, ENTRY = 3, 3
"""Entries of a small operation's record: number of primitives, number of its table, and which
primitives every point of it is in; then for each primitive its reference, its leaf record and
whether it is flipped; then the length of its program, and the program."""

_ONE, _TWO = np.uint64(1), np.uint64(2)

_WORK = 40
"""Where working space begins in the array that receives the primitives of crossings."""


class Primitive(NamedTuple):
    """A primitive of a small operation, in the operation's frame."""

    record: int
    operation_from_leaf: Affine
    flipped: bool


class SmallOperation(NamedTuple):
    """An operation over a few primitives.

    Attributes
    ----------
    primitives
        In the order of the text.
    table
        Bit m tells whether a point is in the result that is in the primitives of set m.
    required
        The primitives that every point of the result is in, as bits.
    program
        The expression in postfix order: a primitive's number, or ``-1 - kind`` of an operator.
    """

    primitives: tuple[Primitive, ...]
    table: int
    required: int
    program: tuple[int, ...]


def flatten_operation(groups: Groups, operation: int) -> SmallOperation | None:
    """Return an operation as a truth table, None where it is too large or has instances."""
    primitives: list[Primitive] = []
    program: list[int] = []
    table = _flatten(groups, operation, IDENTITY, False, primitives, program)
    if table is None:
        return None
    sets = 1 << len(primitives)
    bits = sum(1 << m for m in range(sets) if table[m])
    required = sum(
        1 << j
        for j in range(len(primitives))
        if not any(table[m] for m in range(sets) if not m >> j & 1)
    )
    return SmallOperation(tuple(primitives), bits, required, tuple(program))


_ALL_SETS = np.arange(1 << MAX_PRIMITIVES)


def _flatten(
    groups: Groups,
    operation: int,
    frame: Affine,
    flipped: bool,
    primitives: list[Primitive],
    program: list[int],
) -> NDArray[np.bool_] | None:
    """Append the primitives and the code of an operation; return its truth over all sets."""
    record = groups.operations[operation]
    result: NDArray[np.bool_] | None = None
    for k, operand in enumerate(record.operands):
        flips = flipped != (record.operator is DIFFERENCE and k > 0)
        union = np.zeros(len(_ALL_SETS), np.bool_)
        for n, r in enumerate(groups.groups[operand]):
            m = compose_affine(frame, r.group_from_target)
            if r.kind == INSTANCE or len(primitives) == MAX_PRIMITIVES:
                return None
            if r.kind == LEAF and groups.leaves[r.target].has_data:
                return None
            if r.kind == LEAF:
                union |= (_ALL_SETS >> len(primitives) & 1).astype(np.bool_)
                program.append(len(primitives))
                primitives.append(Primitive(r.target, m, flips))
            else:
                # Depth is bounded by the number of primitives: every operation has two operands.
                inner = _flatten(groups, r.target, m, flips, primitives, program)
                if inner is None:
                    return None
                union |= inner
            if n > 0:
                program.append(-1 - UNION.kind)
        if result is None:
            result = union
        else:
            program.append(-1 - record.operator.kind)
            sets = 2 * result.astype(int) + union
            result = (record.operator.table >> sets & 1).astype(np.bool_)
    return result


@njit
def _find_owner(
    smalls: NDArray[np.int32],
    at: int,
    before: np.uint64,
    behind: np.uint64,
    slots: NDArray[np.int32],
) -> int:
    """Return the primitive that an end belongs to, of those that coincide.

    From the leaves up: of two operands it is the first one's, if that one changes there.
    """
    program = at + HEADER + ENTRY * smalls[at]
    one = np.uint64(1)
    top = _WORK
    for k in range(program + 1, program + 1 + smalls[program]):
        step = smalls[k]
        if step >= 0:
            a = int((before >> np.uint64(step)) & one)
            b = int((behind >> np.uint64(step)) & one)
            owner = step
        else:
            table = TABLES[-1 - step]
            top -= 6
            a = truth(table, slots[top], slots[top + 3])
            b = truth(table, slots[top + 1], slots[top + 4])
            owner = slots[top + 2] if slots[top + 2] >= 0 else slots[top + 5]
        slots[top], slots[top + 1], slots[top + 2] = a, b, owner if a != b else -1
        top += 3
    return int(slots[_WORK + 2])


@njit(contract=True)
def small_crossings(
    smalls: NDArray[np.int32],
    tables: NDArray[np.uint64],
    inverses: NDArray[np.float64],
    leaves: NDArray[np.int32],
    args: NDArray[np.float64],
    pool: Pool,
    at: int,
    ray: Ray,
    low: float,
    high: float,
    ends: NDArray[np.float64],
    begin: int,
    slots: NDArray[np.int32],
) -> int:
    """Write where a ray enters and leaves a small operation.

    Parameters
    ----------
    at
        Where its record begins in `smalls`.
    low, high
        Nobody asks for what lies before or beyond all of this.
    ends, begin
        Receives the crossings from `begin` on; used beyond them as working space. Before them stand
        two numbers, the ray's precision.
    slots
        Receives the primitive that every crossing belongs to.

    Returns
    -------
    int
        End of the crossings in `ends`.
    """
    stay_apart()
    precision = load_precision(ends, begin - 2)
    header = place(at)
    count = wide(smalls[header])
    table = tables[place(smalls[header + _ONE])]
    required = wide(smalls[header + _TWO])
    events = begin
    scratch = len(ends) - 8
    for j in range(count):
        entry = header + place(HEADER + ENTRY * j)
        local = transform_ray(load_affine(inverses, 12 * wide(smalls[entry])), ray)
        leaf = place(4 * wide(smalls[entry + _ONE]))
        solid, args_at = leaves[leaf], leaves[leaf + _ONE]
        n = leaf_crossings(solid, local, ALL, args, args_at, pool, ends, scratch)
        if (required >> j) & 1:
            # The result lies in all of these.
            if n == scratch:
                return begin
            low = max(low, ends[place(scratch)])
            high = min(high, ends[place(n - 1)])
            if low > high:
                return begin
        for k in range(scratch, n):
            first_of_two = scratch + (k - scratch) // 2 * 2
            if is_touch(ends[place(first_of_two)], ends[place(first_of_two + 1)]):
                continue
            # Insertion by t; equal ends keep the order of the text.
            t = ends[place(k)]
            p = place(events)
            first = place(begin)
            while p > first and ends[p - _ONE] > t:
                ends[p] = ends[p - _ONE]
                slots[p - first] = slots[p - first - _ONE]
                p -= _ONE
            ends[p] = t
            slots[p - first] = j
            events += 1
    inside = np.uint64(0)
    was = np.uint64(0)
    one = np.uint64(1)
    out = begin
    k = begin
    while k < events:
        # What coincides is one event, but for the ends of one primitive alone.
        group = k
        reach = ends[k] + tolerance(ends[k], precision)
        alone = True
        while k < events and ends[k] <= reach:
            alone = alone and slots[k - begin] == slots[group - begin]
            inside ^= one << np.uint64(slots[k - begin])
            k += 1
        if alone:
            while k > group + 1:
                k -= 1
                inside ^= one << np.uint64(slots[k - begin])
        now = (table >> inside) & one
        if now != was:
            before = inside
            for e in range(group, k):
                before ^= one << np.uint64(slots[e - begin])
            owner = _find_owner(smalls, at, before, inside, slots)
            for e in range(group, k):
                if slots[e - begin] == owner:
                    ends[out], slots[out - begin] = ends[e], owner
                    break
            out += 1
            was = now
    return out
