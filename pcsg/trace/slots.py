"""Slots: states made on demand from recipes.

A *slot* holds one state: its parts as blocks of four boxes, with the parts' inverse matrices and
values. Slots of the *store* are made once and shared by all threads, the largest boxes first, as
many as memory allows. What hangs below it is made when a ray comes by, in the slots of the
thread's own *cache*, which are used again for other states (the CLOCK algorithm, Corbato 1968).
Slots on the present path are pinned. What a ray finds does not depend on which slots are there:
parts are known by their place in the text, and values are computed alike wherever they are.

An *item* is one part in one slot: slot times width plus part. Items of the cache follow those of
the store.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.tape import OK, run
from pcsg.graph.transforms import evaluate_transform
from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.slabs import WIDTH
from pcsg.trace.bounding import bound_part
from pcsg.trace.groups import EMPTY, LAZY_LEAF, SUSPENDED
from pcsg.trace.rulebook import (
    ENTRY_FIELDS,
    P_COUNT,
    P_KIND,
    P_LOOKS,
    P_MATRIX,
    P_N_LOOKS,
    P_SHAPE,
    P_SHAPE_AT,
    P_STEPS,
    P_STEPS_END,
    P_TARGET,
    P_VALUES,
    PART_FIELDS,
    PLACE_CONSTANT,
    PRIMITIVE,
    R_PARTS,
    R_PARTS_END,
    R_STEPS,
    R_STEPS_END,
    RECIPE_FIELDS,
    RUN,
    STEP_FIELDS,
    Rulebook,
)
from pcsg.vec import compose, invert, load_affine, store_affine

H_PARTS, H_GENERATION, H_PIN, H_USED = range(4)
HEAD = 4

FAULT = -1
"""A state that cannot be made; the walker tells why."""


class Slots(NamedTuple):
    """States that have been made; N slots of W parts.

    Attributes
    ----------
    boxes : float64 (6 W N,)
        As in `Blocks`.
    refs : int32 (W N,)
        Codes: item and kind.
    parts : int32 (W N,)
        Numbers of the parts in the rulebook.
    children : int32 (2 W N,)
        In the store: the slot of an entry's state, or -2 - its number among what hangs below; and
        nothing. In the cache: a slot of the cache and its generation.
    inverses : float64 (12 W N,)
        target_from_slot of the parts.
    values : float64 (V W N,)
        Inputs of entries, arguments of primitives. Attributes are worked out when they are seen.
    heads : int32 (4 N,)
        Number of parts, generation, level of the pin, whether it was used lately.
    """

    boxes: NDArray[np.float64]
    refs: NDArray[np.int32]
    parts: NDArray[np.int32]
    children: NDArray[np.int32]
    inverses: NDArray[np.float64]
    values: NDArray[np.float64]
    heads: NDArray[np.int32]


class Work(NamedTuple):
    """Registers and matrices of a recipe, the tape's stack, a box, attributes of a part."""

    registers: NDArray[np.float64]
    matrices: NDArray[np.float64]
    stack: NDArray[np.float64]
    box: NDArray[np.float64]
    looks: NDArray[np.float64]


def make_work(book: Rulebook) -> Work:
    """Return working space for the recipes of a rulebook."""
    return Work(
        registers=np.zeros(book.n_registers),
        matrices=np.zeros(12 * book.n_matrices),
        stack=np.zeros(book.stack_size),
        box=np.zeros(6),
        looks=np.zeros(book.n_looks),
    )


class Lazy(NamedTuple):
    """What the kernels need to make states: one for each thread.

    Attributes
    ----------
    book
        The recipes.
    store, cache
        The shared slots and the thread's own.
    hanging : int32 (2 F,)
        For what hangs below the store: a slot of the cache and its generation.
    level_slots : int32
        The cache's slot at every level of the path.
    work
        Working space.
    counts : int64 (2,)
        The hand of the clock, and the number of states made.
    """

    book: Rulebook
    store: Slots
    cache: Slots
    hanging: NDArray[np.int32]
    level_slots: NDArray[np.int32]
    work: Work
    counts: NDArray[np.int64]


def make_slots(n: int, width: int, n_values: int) -> Slots:
    """Return n empty slots."""
    return Slots(
        boxes=np.zeros(6 * width * n),
        refs=np.full(width * n, EMPTY, np.int32),
        parts=np.zeros(width * n, np.int32),
        children=np.full(2 * width * n, -1, np.int32),
        inverses=np.zeros(12 * width * n),
        values=np.zeros(n_values * width * n),
        heads=np.zeros(HEAD * n, np.int32),
    )


def slot_bytes(width: int, n_values: int) -> int:
    """Return the memory of one slot."""
    return width * (6 * 8 + 4 + 4 + 8 + 12 * 8 + 8 * n_values) + 4 * HEAD


@njit
def _run_steps(book: Rulebook, work: Work, begin: int, end: int) -> int:
    """Run steps of a recipe; return OK or what went wrong."""
    registers, matrices, stack = work.registers, work.matrices, work.stack
    steps, sources, constants = book.steps, book.sources, book.constants
    for step in range(begin, end):
        at = STEP_FIELDS * step
        if steps[at] == RUN:
            status, _ = run(book.code, book.code_constants, steps[at + 3], 0, registers, 0, stack)
            if status != OK:
                return status
            continue
        if steps[at] == PLACE_CONSTANT:
            m = load_affine(book.maps, 24 * steps[at + 3])
        else:
            for k in range(steps[at + 5]):
                source = sources[steps[at + 4] + k]
                stack[k] = registers[source] if source >= 0 else constants[-1 - source]
            m = evaluate_transform(steps[at + 3], stack)
        if steps[at + 2] >= 0:
            m = compose(load_affine(matrices, 12 * steps[at + 2]), m)
        store_affine(matrices, 12 * steps[at + 1], m)
    return OK


@njit
def choose_recipe(book: Rulebook, work: Work, entry: int) -> int:
    """Return the recipe of an entry whose inputs are in the registers, or FAULT."""
    at = ENTRY_FIELDS * entry
    rule = 0
    if book.entries[at] >= 0:
        code, constants, stack = book.code, book.code_constants, work.stack
        status, _ = run(code, constants, book.entries[at], 0, work.registers, 0, stack)
        if status != OK:
            return FAULT
        chosen = np.rint(stack[0])
        if not (chosen >= 1.0 and chosen <= book.entries[at + 2]):
            return FAULT
        rule = int(chosen)
    recipe: int = book.rules[book.entries[at + 1] + rule]
    return recipe if recipe >= 0 else FAULT


@njit
def make_parts(
    book: Rulebook, work: Work, recipe: int, out: Slots, slot: int, first_item: int
) -> int:
    """Make the parts of a recipe, whose inputs are in the registers, in a slot.

    Parameters
    ----------
    first_item
        Number of the slot's first item.

    Returns
    -------
    int
        The number of parts, or FAULT.
    """
    registers, matrices, stack, box = work.registers, work.matrices, work.stack, work.box
    width, n_values = book.width, book.n_values
    if recipe == FAULT:
        return FAULT
    recipe *= RECIPE_FIELDS
    begin, end = book.recipes[recipe + R_STEPS], book.recipes[recipe + R_STEPS_END]
    if _run_steps(book, work, begin, end) != OK:
        return FAULT
    n = 0
    for part in range(book.recipes[recipe + R_PARTS], book.recipes[recipe + R_PARTS_END]):
        p = PART_FIELDS * part
        item = slot * width + n
        matrix = book.parts[p + P_MATRIX]
        if matrix < 0:
            forward = load_affine(book.maps, 24 * (-1 - matrix))
            inverse = load_affine(book.maps, 24 * (-1 - matrix) + 12)
        else:
            forward = load_affine(matrices, 12 * matrix)
            inverse, regular = invert(forward)
            if not regular:
                return FAULT
        store_affine(out.inverses, 12 * item, inverse)
        for k in range(book.parts[p + P_COUNT]):
            source = book.sources[book.parts[p + P_VALUES] + k]
            value = registers[source] if source >= 0 else book.constants[-1 - source]
            out.values[n_values * item + k] = value
        bound_part(
            book.parts[p + P_SHAPE],
            forward,
            book.shapes,
            book.parts[p + P_SHAPE_AT],
            out.values,
            n_values * item,
            stack,
            box,
        )
        block = 6 * (slot * width + n // WIDTH * WIDTH) + n % WIDTH
        for k in range(6):
            out.boxes[block + WIDTH * k] = box[k]
        kind = LAZY_LEAF if book.parts[p + P_KIND] == PRIMITIVE else SUSPENDED
        out.refs[item] = (first_item + n) << 3 | kind
        out.parts[item] = part
        out.children[2 * item] = -1
        n += 1
    end = (n + WIDTH - 1) // WIDTH * WIDTH
    for k in range(n, end):
        out.refs[slot * width + k] = EMPTY
        block = 6 * (slot * width + k // WIDTH * WIDTH) + k % WIDTH
        for j in range(3):
            out.boxes[block + WIDTH * j] = math.inf
            out.boxes[block + WIDTH * (j + 3)] = -math.inf
    out.heads[HEAD * slot + H_PARTS] = n
    return n


@njit
def _fill_cache(lazy: Lazy, item: int, level: int) -> int:
    """Make the state of an item in a slot of the cache; return the slot or FAULT."""
    book, cache, heads = lazy.book, lazy.cache, lazy.cache.heads
    shared = len(lazy.store.refs)
    n_slots = len(heads) // HEAD - 1  # the last one is for stand-ins
    hand: int = lazy.counts[0]
    while True:
        hand = hand + 1 if hand + 1 < n_slots else 0
        pin = heads[HEAD * hand + H_PIN]
        if pin < level and lazy.level_slots[pin] == hand:
            continue
        if heads[HEAD * hand + H_USED] == 0:
            break
        heads[HEAD * hand + H_USED] = 0
    lazy.counts[0] = hand
    lazy.counts[1] += 1
    heads[HEAD * hand + H_GENERATION] += 1
    entry = load_inputs(lazy, item)
    recipe = choose_recipe(book, lazy.work, entry)
    first_item = shared + hand * book.width
    n = make_parts(book, lazy.work, recipe, cache, hand, first_item)
    return FAULT if n == FAULT else hand


@njit
def load_inputs(lazy: Lazy, item: int) -> int:
    """Write the inputs of an entry's item to the registers and return the entry."""
    book = lazy.book
    shared = len(lazy.store.refs)
    source = lazy.store if item < shared else lazy.cache
    own = item if item < shared else item - shared
    part = PART_FIELDS * source.parts[own]
    for k in range(book.parts[part + P_COUNT]):
        lazy.work.registers[k] = source.values[book.n_values * own + k]
    entry: int = book.parts[part + P_TARGET]
    return entry


@njit
def make_looks(lazy: Lazy, item: int, recipe: int, part: int) -> int:
    """Write the attributes of a part to ``lazy.work.looks``.

    Parameters
    ----------
    item
        The item of the state that the part belongs to.
    recipe
        The recipe that the state was made by, -1 for that which its inputs choose.

    Returns
    -------
    int
        OK or FAULT.
    """
    book, work = lazy.book, lazy.work
    entry = load_inputs(lazy, item)
    if recipe < 0:
        recipe = choose_recipe(book, work, entry)
    recipe *= RECIPE_FIELDS
    begin, end = book.recipes[recipe + R_STEPS], book.recipes[recipe + R_STEPS_END]
    if _run_steps(book, work, begin, end) != OK:
        return FAULT
    p = PART_FIELDS * part
    if _run_steps(book, work, book.parts[p + P_STEPS], book.parts[p + P_STEPS_END]) != OK:
        return FAULT
    for k in range(book.parts[p + P_N_LOOKS]):
        source = book.sources[book.parts[p + P_LOOKS] + k]
        work.looks[k] = work.registers[source] if source >= 0 else book.constants[-1 - source]
    return OK


@njit
def make_stand_in(lazy: Lazy, item: int, recipe: int) -> int:
    """Make what stands for the state of an item in the cache's last slot; return its first item."""
    slot = len(lazy.cache.heads) // HEAD - 1
    first_item = len(lazy.store.refs) + slot * lazy.book.width
    load_inputs(lazy, item)
    n = make_parts(lazy.book, lazy.work, recipe, lazy.cache, slot, first_item)
    return FAULT if n == FAULT else first_item


@njit(inline=True)
def open_state(lazy: Lazy, item: int, level: int) -> int:
    """Return the slot of the state that an item stands for, made if it is not there.

    Parameters
    ----------
    item
        An entry's item.
    level
        Level of the path that the slot belongs to; it stays until another one takes the level.

    Returns
    -------
    int
        Slots of the cache follow those of the store; FAULT if the state cannot be made.
    """
    shared = len(lazy.store.refs)
    n_shared = len(lazy.store.heads) // HEAD
    heads = lazy.cache.heads
    known, at = lazy.cache.children, 2 * (item - shared)
    if item < shared:
        child = wide(lazy.store.children[2 * item])
        if child >= 0:
            return child
        known, at = lazy.hanging, 2 * (-2 - child)
    slot = wide(known[at])
    if slot < 0 or heads[HEAD * slot + H_GENERATION] != known[at + 1]:
        slot = wide(_fill_cache(lazy, item, level))
        if slot == FAULT:
            return FAULT
        known[at] = slot
        known[at + 1] = heads[HEAD * slot + H_GENERATION]
    heads[HEAD * slot + H_USED] = 1
    heads[HEAD * slot + H_PIN] = level
    lazy.level_slots[level] = slot
    return n_shared + slot
