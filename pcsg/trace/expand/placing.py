"""The primitives of a table of states, placed in the world, in the order of the text.

The table is walked from the axiom down with a stack of its own. Of every visit to a state only
where it came from is kept, and only as long as a primitive's path may ask for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.leaves import Leaves, Path
from pcsg.graph.nodes import Leaf, Selection
from pcsg.graph.operators import UNION
from pcsg.jit import njit
from pcsg.trace.expand.expansion import Expansion
from pcsg.trace.expand.programs import L_ARGS, LEAF_FIELDS
from pcsg.trace.expand.table import LEAF, OPERATION, Table
from pcsg.vec import IDENTITY, compose, load_affine, store_affine

_UNION = UNION.kind
_LABEL = ATTRIBUTE_SLOTS.index("@label")

FRAME = 5
"""Entries of a run of items: the next one, the last one's end, where the operands end that are
carved, whether all are, and the visit to their state."""

# Counters of a walk.
N_FRAMES, N_VISITS, N_FOUND = range(3)

STEPS = 200_000
"""Items that are looked at before control returns to Python, where Ctrl-C is seen."""


class Walk(NamedTuple):
    """Where a walk through a table is, and what it has found.

    Attributes
    ----------
    frames, matrices : int32 (FRAME D,), float64 (12 D,)
        Stack of runs of items that wait, and world_from_state of each.
    visit_above, visit_state : int32 (V,)
        The visits to states: the one that it was met in, and the state.
    item, visit : int32 (B,)
        Of every primitive that was found.
    carved : bool (B,)
    places : float64 (12 B,)
        world_from_leaf.
    counters : int64 (3,)
    """

    frames: NDArray[np.int32]
    matrices: NDArray[np.float64]
    visit_above: NDArray[np.int32]
    visit_state: NDArray[np.int32]
    item: NDArray[np.int32]
    visit: NDArray[np.int32]
    carved: NDArray[np.bool_]
    places: NDArray[np.float64]
    counters: NDArray[np.int64]


@njit(entry=True)
def place_leaves(table: Table, walk: Walk, most: int) -> int:
    """Go on with a walk until the batch or another array is full, or it ends.

    Parameters
    ----------
    most
        Items that are looked at.

    Returns
    -------
    int
        The items that were left to look at: some where it stopped for another reason.
    """
    frames, matrices, c = walk.frames, walk.matrices, walk.counters
    while most > 0 and c[N_FRAMES] > 0:
        full = (
            c[N_FOUND] == len(walk.item)
            or FRAME * (c[N_FRAMES] + 1) > len(frames)
            or c[N_VISITS] == len(walk.visit_state)
        )
        if full:
            return most
        most -= 1
        top = c[N_FRAMES] - 1
        f = FRAME * top
        i = frames[f]
        if i == frames[f + 1]:
            c[N_FRAMES] = top
            continue
        frames[f] = i + 1
        kind = table.kind[i]
        if kind == OPERATION:
            if table.target[i] != _UNION:
                frames[f + 2] = max(frames[f + 2], table.end[i])
            continue
        outer = load_affine(matrices, 12 * top)
        m = table.matrix[i]
        inner = compose(outer, IDENTITY if m < 0 else load_affine(table.matrices, 12 * m))
        carved = frames[f + 3] == 1 or i < frames[f + 2]
        visit = frames[f + 4]
        if kind == LEAF:
            k = c[N_FOUND]
            walk.item[k], walk.visit[k], walk.carved[k] = i, visit, carved
            store_affine(walk.places, 12 * k, inner)
            c[N_FOUND] = k + 1
            continue
        # What is done with does not stay on the stack.
        if i + 1 == frames[f + 1]:
            top -= 1
            f -= FRAME
        state = table.target[i]
        v = c[N_VISITS]
        walk.visit_above[v], walk.visit_state[v] = visit, state
        c[N_VISITS] = v + 1
        f += FRAME
        frames[f], frames[f + 1] = table.first[state], table.last[state]
        frames[f + 2], frames[f + 3], frames[f + 4] = 0, 1 if carved else 0, v
        store_affine(matrices, 12 * (top + 1), inner)
        c[N_FRAMES] = top + 2
    return most


@njit(entry=True)
def drop_visits(walk: Walk, numbers: NDArray[np.int32]) -> None:
    """Forget the visits that nothing on the stack leads back to.

    Parameters
    ----------
    numbers : int32
        Room for the new number of every visit.
    """
    c = walk.counters
    n = c[N_VISITS]
    for v in range(n):
        numbers[v] = 0
    for k in range(c[N_FRAMES]):
        v = walk.frames[FRAME * k + 4]
        while v >= 0 and numbers[v] == 0:
            numbers[v] = 1
            v = walk.visit_above[v]
    kept = 0
    for v in range(n):
        if numbers[v] == 1:
            above = walk.visit_above[v]
            walk.visit_above[kept] = numbers[above] if above >= 0 else -1
            walk.visit_state[kept] = walk.visit_state[v]
            numbers[v] = kept
            kept += 1
    for k in range(c[N_FRAMES]):
        at = FRAME * k + 4
        if walk.frames[at] >= 0:
            walk.frames[at] = numbers[walk.frames[at]]
    c[N_VISITS] = kept


class Paths(Sequence[Path]):
    """The paths of some primitives, each made when it is asked for.

    Parameters
    ----------
    ends : int32 (N,)
        The visit to a state that every primitive stands in, -1 for the axiom.
    above, state : int32 (V,)
        The visits: where each was met, and its state.
    links
        Module and rule by state; None for what is no module in the text.
    """

    def __init__(
        self,
        ends: NDArray[np.int32],
        above: NDArray[np.int32],
        state: NDArray[np.int32],
        links: _Links,
    ) -> None:
        self._ends = ends
        self._above = above
        self._state = state
        self._links = links

    def __len__(self) -> int:
        return len(self._ends)

    @overload
    def __getitem__(self, index: int) -> Path: ...

    @overload
    def __getitem__(self, index: slice) -> Paths: ...

    def __getitem__(self, index: int | slice) -> Path | Paths:
        if isinstance(index, slice):
            return Paths(self._ends[index], self._above, self._state, self._links)
        path = []
        visit = int(self._ends[index])
        while visit >= 0:
            link = self._links.of(int(self._state[visit]))
            if link is not None:
                path.append(link)
            visit = int(self._above[visit])
        return tuple(reversed(path))


class _Links:
    """Modules and rules of states."""

    def __init__(self, expansion: Expansion) -> None:
        self._of_program: dict[tuple[int, int], tuple[str, int] | None] = {}
        self._expansion = expansion
        self._modules = expansion.table.module
        self._programs = expansion.table.program

    def of(self, state: int) -> tuple[str, int] | None:
        """Return module and rule of a state."""
        key = int(self._modules[state]), int(self._programs[state])
        if key not in self._of_program:
            n, rule, _ = self._expansion.link_of(*key)
            node = self._expansion.graph.nodes[n]
            self._of_program[key] = (node.name, rule) if isinstance(node, Selection) else None
        return self._of_program[key]


def batches_of_leaves(expansion: Expansion, size: int) -> Iterator[Leaves]:
    """Yield the primitives of an expansion in the order of the text, some at a time.

    They are those of `pcsg.graph.leaves.batches_of_leaves`, bit for bit. Memory is that of the
    table, whatever the number of primitives.
    """
    table = expansion.table
    reader = _Reader(expansion)
    walk = _begin(table, size)
    while walk.counters[N_FRAMES] > 0:
        walk.counters[N_FOUND] = 0
        drop_visits(walk, np.empty(len(walk.visit_state), np.int32))
        walk = _fill(table, walk, size)
        if walk.counters[N_FOUND] > 0:
            yield reader.read(walk)


def _begin(table: Table, size: int) -> Walk:
    walk = Walk(
        frames=np.zeros(FRAME * 64, np.int32),
        matrices=np.zeros(12 * 64),
        visit_above=np.zeros(1_024, np.int32),
        visit_state=np.zeros(1_024, np.int32),
        # A batch may have any size; most scenes have fewer primitives.
        item=np.zeros(min(size, 1_024), np.int32),
        visit=np.zeros(min(size, 1_024), np.int32),
        carved=np.zeros(min(size, 1_024), np.bool_),
        places=np.zeros(12 * min(size, 1_024)),
        counters=np.array([1, 0, 0]),
    )
    walk.frames[:FRAME] = table.first[0], table.last[0], 0, 0, -1
    walk.matrices[:12] = IDENTITY
    return walk


def _fill(table: Table, walk: Walk, size: int) -> Walk:
    """Go on until a batch is complete or the walk ends; return it, grown where that is needed."""
    while walk.counters[N_FRAMES] > 0 and walk.counters[N_FOUND] < size:
        if place_leaves(table, walk, STEPS):
            walk = _grow(walk, size)
    return walk


def _grow(walk: Walk, size: int) -> Walk:
    """Return a walk with twice the room where there is none left."""
    frames, visits, found = (int(n) for n in walk.counters)
    arrays: dict[str, Any] = {}
    if FRAME * (frames + 1) > len(walk.frames):
        arrays |= {name: _doubled(getattr(walk, name)) for name in ("frames", "matrices")}
    if visits == len(walk.visit_state):
        arrays |= {name: _doubled(getattr(walk, name)) for name in ("visit_above", "visit_state")}
    if found == len(walk.item) < size:
        for name, each in (("item", 1), ("visit", 1), ("carved", 1), ("places", 12)):
            arrays[name] = _doubled(getattr(walk, name))[: each * size]
    return walk._replace(**arrays)


def _doubled(array: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([array, np.zeros_like(array)])


class _Reader:
    """Turns what a walk has found into `Leaves`."""

    def __init__(self, expansion: Expansion) -> None:
        self.table = expansion.table
        self.links = _Links(expansion)
        self.nodes = np.array(expansion.leaf_nodes or [0], np.int64)
        programs = expansion.programs
        self.counts = programs.leaves[L_ARGS::LEAF_FIELDS]
        nodes = (expansion.graph.nodes[n] for n in expansion.leaf_nodes)
        self.names = [node.solid.name for node in nodes if isinstance(node, Leaf)]
        # Attributes that are assigned somewhere stand behind the arguments.
        assigned = programs.attributes >= 0
        self.label = int(np.count_nonzero(assigned[:_LABEL])) if assigned[_LABEL] else -1

    def read(self, walk: Walk) -> Leaves:
        """Return a batch."""
        _, n_visits, n = (int(k) for k in walk.counters)
        items = walk.item[:n]
        leaves = self.table.target[items]
        label = np.full(n, -1, np.int64)
        if self.label >= 0:
            at = self.table.numbers_at[items] + self.counts[leaves] + self.label
            values = self.table.numbers[at]
            known = ~np.isnan(values)
            label[known] = values[known].astype(np.int64)
        return Leaves(
            leaf=self.nodes[leaves],
            name=tuple([self.names[k] for k in leaves.tolist()]),
            matrix=walk.places[: 12 * n].reshape(-1, 3, 4).copy(),
            label=label,
            arguments=self._arguments(items, leaves),
            carved=walk.carved[:n].copy(),
            path=Paths(
                walk.visit[:n].copy(),
                walk.visit_above[:n_visits].copy(),
                walk.visit_state[:n_visits].copy(),
                self.links,
            ),
        )

    def _arguments(
        self, items: NDArray[np.int32], leaves: NDArray[np.int32]
    ) -> tuple[tuple[float, ...], ...]:
        found: list[tuple[float, ...]] = [()] * len(items)
        counts = self.counts[leaves]
        for count in set(counts.tolist()) - {0}:
            here = np.flatnonzero(counts == count)
            at = self.table.numbers_at[items[here]]
            rows = self.table.numbers[at[:, None] + np.arange(count)].tolist()
            for k, row in zip(here.tolist(), rows, strict=True):
                found[k] = tuple(row)
        return tuple(found)
