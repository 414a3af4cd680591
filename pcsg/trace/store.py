"""The store of states that all threads share: made once, the largest boxes first."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.slabs import WIDTH
from pcsg.trace.bounding import bound_box, pad_box
from pcsg.trace.groups import SUSPENDED
from pcsg.trace.rulebook import ENTRY, P_COUNT, P_KIND, P_TARGET, PART_FIELDS, Rulebook
from pcsg.trace.slots import (
    FAULT,
    H_PARTS,
    HEAD,
    Lazy,
    Slots,
    Work,
    choose_recipe,
    make_parts,
    make_slots,
    make_work,
    slot_bytes,
)
from pcsg.vec import IDENTITY, Affine, compose, invert, load_affine, store_affine

BLOCK_MEMORY = 16 << 20
"""Bytes of the store, unless the caller says otherwise."""

CACHE_SLOTS, CACHE_LEAST, CACHE_BYTES = 256, 160, 4 << 20
"""Slots of a thread's cache, if they fit into so many bytes; more than a path has levels."""

_WAVE = 64

_OPENED = 18
"""How often a search for a tighter box opens what reaches farthest."""


class Store(NamedTuple):
    """The rulebook, the shared slots, and how many states hang below them."""

    book: Rulebook
    slots: Slots
    n_hanging: int

    @property
    def nbytes(self) -> int:
        """Memory of all arrays in bytes."""
        return self.book.nbytes + sum(a.nbytes for a in self.slots)

    def make_lazy(self) -> Lazy:
        """Return the working space of one thread."""
        book = self.book
        fitting = CACHE_BYTES // slot_bytes(book.width, book.n_values)
        n = max(CACHE_LEAST, min(CACHE_SLOTS, fitting))
        return Lazy(
            book=book,
            store=self.slots,
            cache=make_slots(n, book.width, book.n_values),
            hanging=np.full(2 * max(1, self.n_hanging), -1, np.int32),
            level_slots=np.full(CACHE_LEAST, -1, np.int32),
            work=make_work(book),
            counts=np.zeros(2, np.int64),
        )


def build_store(book: Rulebook, memory: int = BLOCK_MEMORY) -> Store:
    """Make states until memory is used up or none is left.

    Parameters
    ----------
    memory
        Bytes.
    """
    width = book.width
    limit = max(2, memory // slot_bytes(width, book.n_values))
    work = make_work(book)
    slots = make_slots(_WAVE, width, book.n_values)
    _put_axiom(book, slots)
    parents = [0]
    items, areas = np.array([0]), np.array([np.inf])
    scale = np.ones(1)
    n = 1
    while len(items) and n < limit:
        # Waves grow with the store, so that they are few, and the order is nearly that of areas.
        count = min(len(items), limit - n, max(_WAVE, n // 4))
        chosen = np.argpartition(-areas, count - 1)[:count]
        chosen = chosen[np.argsort(-areas[chosen], kind="stable")]
        while n + count > len(slots.heads) // 4:
            slots = _grown(slots)
        made = np.full(count, FAULT, np.int32)
        _make_children(book, slots, items[chosen].astype(np.int32), n, made, work)
        good = made != FAULT
        parents += items[chosen][good].tolist()
        scale = np.concatenate([scale, _scales(slots, scale, items[chosen][good], width)])
        rest = np.ones(len(items), np.bool_)
        rest[chosen] = False
        new = _entries(book, slots, n, int(good.sum()))
        items = np.concatenate([items[rest], new])
        areas = np.concatenate([areas[rest], _areas(slots, new, width) * scale[new // width] ** 2])
        n += int(good.sum())
    slots = _cut(slots, n, width, book.n_values)
    _refit(slots, np.array(parents, np.int32), width, _make_search(width))
    hanging = _entries(book, slots, 0, n)
    hanging = hanging[slots.children[2 * hanging] < 0]
    slots.children[2 * hanging] = -2 - np.arange(len(hanging))
    return Store(book, slots, len(hanging))


def _put_axiom(book: Rulebook, slots: Slots) -> None:
    """Make the first slot, whose only part is the axiom."""
    slots.refs[0] = SUSPENDED
    slots.parts[0] = len(book.parts) // PART_FIELDS - 1
    slots.inverses[:12] = IDENTITY
    slots.heads[0] = 1


def _grown(slots: Slots) -> Slots:
    """Return the slots in arrays twice as long."""
    return Slots(*(np.concatenate([a, np.zeros_like(a)]) for a in slots))


def _cut(slots: Slots, n: int, width: int, n_values: int) -> Slots:
    """Return the first n slots."""
    sizes = make_slots(1, width, n_values)
    cut = {k: a[: len(getattr(sizes, k)) * n].copy() for k, a in slots._asdict().items()}
    return Slots(**cut)


def _entries(book: Rulebook, slots: Slots, begin: int, count: int) -> NDArray[np.int64]:
    """Return the items of entries in slots [begin, begin + count)."""
    width = book.width
    items = np.arange(begin * width, (begin + count) * width)
    suspended = (slots.refs[items] & 7) == SUSPENDED
    kinds = book.parts[PART_FIELDS * slots.parts[items] + P_KIND]
    filled = items % width < slots.heads[4 * (items // width)]
    found: NDArray[np.int64] = items[suspended & filled & (kinds == ENTRY)]
    return found


def _boxes(slots: Slots, items: NDArray[np.int64], width: int) -> NDArray[np.float64]:
    block, k = np.divmod(items, WIDTH)
    return slots.boxes[(6 * WIDTH * block + k)[:, None] + WIDTH * np.arange(6)]


def _areas(slots: Slots, items: NDArray[np.int64], width: int) -> NDArray[np.float64]:
    boxes = _boxes(slots, items, width)
    x, y, z = np.maximum(boxes[:, 3:] - boxes[:, :3], 0.0).T
    with np.errstate(invalid="ignore"):
        areas: NDArray[np.float64] = np.nan_to_num(x * y + y * z + z * x, nan=np.inf)
    return areas


def _scales(
    slots: Slots, scale: NDArray[np.float64], items: NDArray[np.int64], width: int
) -> NDArray[np.float64]:
    """Return how much larger than the world the frames of the items' states are, about."""
    inverses = slots.inverses.reshape(-1, 3, 4)[items][:, :, :3]
    found: NDArray[np.float64] = scale[items // width] / np.cbrt(np.abs(np.linalg.det(inverses)))
    return found


@njit(entry=True)
def _make_children(
    book: Rulebook,
    slots: Slots,
    items: NDArray[np.int32],
    first: int,
    made: NDArray[np.int32],
    work: Work,
) -> None:
    """Make the states of items in slots from `first` on; `made` receives their numbers of parts."""
    slot = first
    for k in range(len(items)):
        item = items[k]
        part = PART_FIELDS * slots.parts[item]
        for j in range(book.parts[part + P_COUNT]):
            work.registers[j] = slots.values[book.n_values * item + j]
        recipe = choose_recipe(book, work, book.parts[part + P_TARGET])
        n = make_parts(book, work, recipe, slots, slot, slot * book.width)
        if n != FAULT:
            made[k] = n
            slots.children[2 * item] = slot
            slot += 1


class _Search(NamedTuple):
    """Items whose boxes together contain a state, with matrices to the frame asked for."""

    matrices: NDArray[np.float64]
    items: NDArray[np.int32]
    boxes: NDArray[np.float64]
    own: NDArray[np.float64]


def _make_search(width: int) -> _Search:
    n = width * (_OPENED + 1)
    return _Search(np.zeros(12 * n), np.zeros(n, np.int32), np.zeros(6 * n), np.zeros(6))


@njit
def _offer(
    slots: Slots, width: int, search: _Search, n: int, slot: int, part: int, m: Affine
) -> None:
    """Write a part of a slot at place n of a search; the matrix leads from the slot's frame."""
    item = slot * width + part
    store_affine(search.matrices, 12 * n, m)
    search.items[n] = item
    at = 6 * (item // WIDTH * WIDTH) + item % WIDTH
    for i in range(6):
        search.own[i] = slots.boxes[at + WIDTH * i]
    bound_box(m, search.own, 0, 0.0, 0.0, 0.0, math.inf, search.boxes, 6 * n)


@njit(entry=True)
def _refit(slots: Slots, parents: NDArray[np.int32], width: int, search: _Search) -> None:
    """Shrink the boxes of items to what their states contain, from the last slot to the first.

    A box around a turned box is larger than what is in it, level by level; so what reaches
    farthest is opened some times, and boxes far below are turned but once.

    Parameters
    ----------
    parents
        The item that every slot's state belongs to.
    """
    boxes, own = search.boxes, search.own
    for slot in range(len(parents) - 1, 0, -1):
        item = parents[slot]
        forward, regular = invert(load_affine(slots.inverses, 12 * item))
        if not regular:
            continue
        n = slots.heads[HEAD * slot + H_PARTS]
        for part in range(n):
            _offer(slots, width, search, part, slot, part, forward)
        straight = (
            forward.m01 == forward.m02 == forward.m10 == forward.m12 == forward.m20 == forward.m21
        )
        opened = _OPENED if straight and forward.m01 == 0.0 else 0
        for turn in range(_OPENED - opened):
            side = turn % 6
            farthest = 0
            for k in range(1, n):
                a, b = boxes[6 * k + side], boxes[6 * farthest + side]
                if (a < b) if side < 3 else (a > b):
                    farthest = k
            below = search.items[farthest]
            child = slots.children[2 * below]
            if n == 0 or child < 0:
                continue
            inner, regular = invert(load_affine(slots.inverses, 12 * below))
            if not regular:
                continue
            m = compose(load_affine(search.matrices, 12 * farthest), inner)
            count = slots.heads[HEAD * child + H_PARTS]
            for part in range(count):
                _offer(slots, width, search, farthest if part == 0 else n, child, part, m)
                n += part > 0
            if count == 0:
                for i in range(6):
                    boxes[6 * farthest + i] = math.inf if i < 3 else -math.inf
        for i in range(3):
            own[i], own[i + 3] = math.inf, -math.inf
            for k in range(n):
                own[i] = min(own[i], boxes[6 * k + i])
                own[i + 3] = max(own[i + 3], boxes[6 * k + i + 3])
        pad_box(own)
        at = 6 * (item // WIDTH * WIDTH) + item % WIDTH
        for i in range(3):
            lower, upper = at + WIDTH * i, at + WIDTH * (i + 3)
            slots.boxes[lower] = max(slots.boxes[lower], own[i])
            slots.boxes[upper] = min(slots.boxes[upper], own[i + 3])
