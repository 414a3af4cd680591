"""Blocks with room: what all threads share, and a region for what each of them expands."""

from __future__ import annotations

from collections.abc import Sequence
from queue import SimpleQueue
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.addresses import write_words
from pcsg.geometry.bvh import Hierarchies, make_build_work, write_block
from pcsg.jit import plain
from pcsg.leaf.registry import MODEL_ARGS
from pcsg.simd import WIDTH
from pcsg.trace.blocks import Blocks
from pcsg.trace.bounding import pad_box
from pcsg.trace.coverage import BINS, EXAMPLES, KEPT, Space, make_space
from pcsg.trace.ends import NEVER, STAND_IN
from pcsg.trace.expand.cache import N_SUSPENDED, Endings, Records, Suspension, address
from pcsg.trace.expand.clusters import BOUNDS, make_sizes
from pcsg.trace.expand.expansion import make_table
from pcsg.trace.expand.layout import (
    AT_PIECES,
    COUNTERS,
    N_ARGS,
    N_BLOCKS,
    N_LISTS,
    N_OPERATIONS,
    N_RECORDS,
    N_ROWS,
    N_SMALLS,
    N_TABLES,
    Layout,
)
from pcsg.trace.expand.pack import make_layout_work, pack_expansion
from pcsg.trace.expand.partial import PartialExpansion, most_values
from pcsg.trace.expand.programs import L_ARGS, LEAF_FIELDS
from pcsg.trace.expand.table import N_ATTRIBUTES, Table
from pcsg.trace.found import Found
from pcsg.trace.groups import SUSPENDED
from pcsg.trace.preparing import UNLIMITED, Preparation
from pcsg.trace.traversal import EXPANDER, IS_FULL, WORDS, Scratch, Trees, make_scratch
from pcsg.vec import IDENTITY

CACHE_ROWS = 8_192
"""References in a region from which on it is emptied between two rays."""

_ROWS = 32_768
"""References that a region has room for, so that a single ray may need them."""

_DEPTH = 8_192
"""Runs of items that wait at most while a state is laid out."""

MOST_ENTRIES = 64
"""Kinds of suspended states that are measured, so that recursion can end there."""

_N_RECORDS_OF_STATES = N_BLOCKS + 1
_KINDS = N_BLOCKS + 2


class Own:
    """What one thread works with: blocks to expand into, scratch, space."""

    def __init__(self, suspension: Suspension, scratch: Scratch) -> None:
        self.suspension = suspension
        self.scratch = scratch
        self.space: Space = make_space()
        words: list[int] = []
        write_words(suspension, words)
        # It must stay where it is.
        self._words = np.array(words, np.int64)
        scratch.frames[EXPANDER] = address()
        scratch.frames[WORDS] = self._words.ctypes.data


class SuspendedBlocks:
    """Blocks of the largest states of a graph, with room for the others.

    Parameters
    ----------
    expansion
        The largest states; it is used up.
    threads
        Most threads that work at the same time.
    preparation
        Is told how far it is, and asked for memory.

    Attributes
    ----------
    packed
        What all threads share.
    trees
        The same with room.
    args
        Most arguments of a leaf.
    """

    def __init__(
        self, expansion: PartialExpansion, threads: int, preparation: Preparation = UNLIMITED
    ) -> None:
        self._expansion = expansion
        self._threads = threads
        table, n_states = expansion.table, expansion.n_states
        self.packed = pack_expansion(expansion, preparation)
        blocks = self.packed.blocks
        references = blocks.refs[(blocks.refs & 7) == SUSPENDED] >> 3
        # Only those count that something refers to.
        states = np.unique(blocks.targets[references])
        record_of = np.full(n_states, -1, np.int32)
        record_of[states] = np.arange(len(states))
        self._rows = np.unique(references)
        blocks.targets[self._rows] = record_of[blocks.targets[self._rows]]
        programs = expansion.programs
        self._bounds = expansion.frontier.bounds.reshape(-1, BOUNDS)[states]
        self.examples = self._choose_examples(table.program[states], states)
        most = sum(map(len, self.examples.values()))
        self._n_values = most_values(programs.live_at)
        self._shared = np.zeros(_KINDS, np.int64)
        self._shared[N_ROWS] = len(blocks.targets)
        self._shared[N_RECORDS] = len(blocks.leaves) // 4
        self._shared[N_ARGS] = len(blocks.args)
        self._shared[N_SMALLS] = len(blocks.smalls)
        self._shared[N_TABLES] = len(blocks.tables)
        self._shared[N_OPERATIONS] = len(blocks.operations)
        self._shared[N_BLOCKS] = blocks.n_blocks
        self._shared[_N_RECORDS_OF_STATES] = len(states)
        # Behind what is shared, room for what the ends of recursion are measured by.
        self._next = self._shared.copy()
        self._shared[N_ROWS] += most
        self._shared[N_BLOCKS] += most
        hits = KEPT * BINS * len(self.examples)
        self._shared[N_RECORDS] += hits
        rows = max(_ROWS, 8 * programs.n_items)
        counts = programs.leaves[L_ARGS::LEAF_FIELDS]
        self.args = int(max(MODEL_ARGS, counts.max(initial=1)))
        self._room = np.full(_KINDS, rows, np.int64)
        self._room[N_ARGS] = 8 * rows
        self._room[N_SMALLS] = self._room[N_OPERATIONS] = 8 * rows
        self._room[N_LISTS] = 0
        self._shared[N_ARGS] += self.args * hits
        self._free: SimpleQueue[Own] = SimpleQueue()
        self._made: list[Own] = []
        self._lock = Lock()
        self._make_arrays(blocks, table, states)
        self.note_endings()

    @property
    def nbytes(self) -> int:
        """Memory of what all threads share."""
        records = self.records
        each = records.program.itemsize + records.entry.itemsize + 8 * records.n_values
        return self.packed.blocks.nbytes + int(self._shared[_N_RECORDS_OF_STATES]) * each

    def _choose_examples(
        self, programs: NDArray[np.int32], states: NDArray[np.int32]
    ) -> dict[int, list[int]]:
        """Return by entry some suspended states that nothing stands for, by their records."""
        entries = self._expansion.entries
        entry = self._expansion.frontier.entry[states]
        bounded = np.isfinite(self._bounds[:, :6]).all(axis=1)
        bounded &= (self._bounds[:, :3] <= self._bounds[:, 3:6]).all(axis=1)
        open_ended = entries.stand_in[entry * entries.programs + programs] < 0
        found: dict[int, list[int]] = {}
        for e in np.unique(entry[bounded & open_ended]).tolist()[:MOST_ENTRIES]:
            records = np.flatnonzero(bounded & open_ended & (entry == e))
            few = min(len(records), EXAMPLES)
            chosen = np.linspace(0, len(records) - 1, few).astype(int)
            found[e] = records[chosen].tolist()
        return found

    def _make_arrays(self, blocks: Blocks, table: Table, states: NDArray[np.int32]) -> None:
        """Copy what is shared into arrays with room; pages that nobody touches take no memory."""
        total = self._shared + self._threads * self._room

        def roomy(kind: int, each: int, content: NDArray[Any]) -> NDArray[Any]:
            array = np.empty(each * int(total[kind]), content.dtype)
            array[: len(content)] = content
            return array

        doubles, integers = np.zeros(0), np.zeros(0, np.int32)
        boxes = roomy(N_BLOCKS, 6 * WIDTH, blocks.boxes)
        refs = roomy(N_BLOCKS, WIDTH, blocks.refs)
        nothing = integers[:0]
        self._layout = Layout(
            matrices=roomy(N_ROWS, 12, blocks.inverses),
            targets=roomy(N_ROWS, 1, blocks.targets),
            codes=roomy(N_ROWS, 1, integers),
            items=roomy(N_ROWS, 1, integers),
            boxes=roomy(N_ROWS, 6, doubles),
            list_first=nothing,
            list_end=nothing,
            list_block=nothing,
            list_item=nothing,
            list_item_end=nothing,
            list_far=nothing,
            list_middle=doubles,
            list_of=nothing,
            record_of=nothing,
            record_slots=np.full(1, -1, np.int32),
            record_item=roomy(N_RECORDS, 1, integers),
            leaves=roomy(N_RECORDS, 4, blocks.leaves),
            args=roomy(N_ARGS, 1, blocks.args),
            attributes=roomy(N_RECORDS, N_ATTRIBUTES, blocks.attributes[:-N_ATTRIBUTES]),
            smalls=roomy(N_SMALLS, 1, blocks.smalls),
            tables=roomy(N_TABLES, 1, blocks.tables),
            operations=roomy(N_OPERATIONS, 1, blocks.operations),
            counters=np.zeros(COUNTERS, np.int64),
        )
        entries = self._expansion.entries
        rows = int(total[N_ROWS])
        self.endings = Endings(
            of_state=np.where(entries.stand_in >= 0, STAND_IN, NEVER).astype(np.int32),
            of_reference=np.empty(rows, np.int32),
            boxes=roomy(N_ROWS, 6, blocks.ref_boxes),
            sizes=np.empty(3 * rows),
        )
        shared = int(self._shared[N_ROWS])
        self.endings.of_reference[:shared] = NEVER
        self.endings.sizes[: 3 * shared] = np.inf
        self.goes_on = np.ones(rows, np.bool_)
        values = np.zeros((len(states), self._n_values))
        for k, s in enumerate(states.tolist()):
            own = table.values[table.values_at[s] : table.values_at[s + 1]]
            values[k, : len(own)] = own
        self.records = Records(
            program=roomy(_N_RECORDS_OF_STATES, 1, table.program[states]),
            entry=roomy(_N_RECORDS_OF_STATES, 1, self._expansion.frontier.entry[states]),
            values=roomy(_N_RECORDS_OF_STATES, self._n_values, values.ravel()),
            n_values=self._n_values,
        )
        self._out = Hierarchies(boxes, refs)
        self.trees = Trees(
            boxes=boxes,
            refs=refs,
            inverses=self._layout.matrices,
            targets=self._layout.targets,
            leaves=self._layout.leaves,
            args=self._layout.args,
            operations=self._layout.operations,
            smalls=self._layout.smalls,
            tables=self._layout.tables,
        )
        self.attributes = self._layout.attributes
        self._total = total

    def note_endings(self) -> None:
        """Have all references know where recursion ends, once `Endings.of_state` does."""
        entries, rows, endings = self._expansion.entries, self._rows, self.endings
        records = self._layout.targets[rows]
        state = self.records.entry[records] * entries.programs + self.records.program[records]
        endings.of_reference[rows] = endings.of_state[state]
        sides = endings.boxes.reshape(-1, 2, 3)[rows].astype(np.float64)
        never = endings.of_reference[rows] == NEVER
        squares = np.square(sides[:, 1] - sides[:, 0])
        endings.sizes.reshape(-1, 3)[rows] = np.where(never[:, None], np.inf, squares)
        with self._lock:
            for own in self._made:
                # References that have been expanded already do not know.
                own.scratch.frames[IS_FULL] = 1

    def name_entry(self, entry: int, number: int) -> None:
        """Have recursion end at the states of an entry, by their number in the coverage."""
        entries, ends = self._expansion.entries, self.endings.of_state
        own = slice(entry * entries.programs, (entry + 1) * entries.programs)
        ends[own] = np.where(ends[own] == NEVER, np.int32(number), ends[own])

    def place_example(self, record: int) -> tuple[int, NDArray[np.float64]]:
        """Return a block with a suspended state in its own frame, and the state's box."""
        row, block = int(self._next[N_ROWS]), int(self._next[N_BLOCKS])
        self._next[N_ROWS] += 1
        self._next[N_BLOCKS] += 1
        layout, box = self._layout, self._bounds[record, :6].copy()
        layout.matrices[12 * row : 12 * row + 12] = IDENTITY
        layout.targets[row] = record
        layout.codes[row] = row << 3 | SUSPENDED
        plain(pad_box)(box)
        layout.boxes[6 * row : 6 * row + 6] = box
        plain(write_block)(layout.boxes, layout.codes, row, 1, self._out, block)
        return block, box

    def keep_records(self, found: Sequence[Found], hits: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return leaf records of hits that stay.

        Parameters
        ----------
        hits
            Numbers of hits, those of one batch behind those of another one.
        """
        n = len(found[0].t)
        leaves = np.concatenate([f.leaves.reshape(-1, 4) for f in found])
        args = np.concatenate([f.args.reshape(n, -1) for f in found])
        attributes = np.concatenate([f.attributes.reshape(n + 1, -1)[:n] for f in found])
        first, at = int(self._next[N_RECORDS]), int(self._next[N_ARGS])
        count = len(hits)
        self._next[N_RECORDS] += count
        self._next[N_ARGS] += count * self.args
        layout = self._layout
        own = leaves[hits]
        own[:, 1] = at + self.args * np.arange(count)
        layout.leaves[4 * first : 4 * (first + count)] = own.ravel()
        layout.args[at : at + self.args * count] = args[hits].ravel()
        end = N_ATTRIBUTES * (first + count)
        layout.attributes[N_ATTRIBUTES * first : end] = attributes[hits].ravel()
        return first + np.arange(count)

    def take(self) -> tuple[Own, bool]:
        """Return what a thread works with until it gives it back, and whether it is new."""
        with self._lock:
            if self._free.empty() and len(self._made) < self._threads:
                self._made.append(self._make_own(len(self._made)))
                return self._made[-1], True
        return self._free.get(), False

    def give_back(self, own: Own) -> None:
        """Take back what a thread has worked with."""
        self._free.put(own)

    def _make_own(self, thread: int) -> Own:
        begins = self._shared + thread * self._room
        begins[N_LISTS] = 0
        ends = begins + self._room
        fills = begins + self._room // 2
        fills[N_ROWS] = begins[N_ROWS] + min(CACHE_ROWS, int(self._room[N_ROWS]) // 2)
        programs = self._expansion.programs
        items = max(4_096, 4 * programs.n_items)
        table = make_table(programs, items)._replace(slots=np.full(1, -1, np.int32))
        states = len(table.program)
        lists = 2 * items
        ends[N_LISTS] = lists
        fills[N_LISTS] = lists
        sizes = make_sizes(states, len(table.kind))
        sizes = sizes._replace(bounds=np.zeros(7 * states))
        counters = np.zeros(COUNTERS, np.int64)
        counters[: N_BLOCKS + 1] = begins[: N_BLOCKS + 1]
        counters[AT_PIECES] = -1
        whole = np.int32
        layout = self._layout._replace(
            list_first=np.zeros(lists, whole),
            list_end=np.zeros(lists, whole),
            list_block=np.zeros(lists, whole),
            list_item=np.zeros(lists, whole),
            list_item_end=np.zeros(lists, whole),
            list_far=np.zeros(lists, whole),
            list_middle=np.zeros(3 * lists),
            list_of=np.zeros(states, whole),
            record_of=np.zeros(len(table.kind), whole),
            counters=counters,
        )
        scratch = make_scratch(int(self._total[_N_RECORDS_OF_STATES]))
        counts = np.zeros(3, np.int64)
        counts[N_SUSPENDED] = begins[_N_RECORDS_OF_STATES]
        suspension = Suspension(
            programs=programs,
            entries=self._expansion.entries,
            records=self.records,
            table=table,
            bits=table.values.view(np.uint64),
            work=self._expansion.make_work(),
            entry=np.full(states, -1, whole),
            sizes=sizes,
            order=np.zeros(states, whole),
            layout=layout,
            layout_work=make_layout_work(_DEPTH, 1, table),
            out=self._out,
            build=make_build_work(len(table.kind)),
            begins=begins,
            ends=ends,
            fills=fills,
            counts=counts,
            frames=scratch.frames,
            endings=self.endings,
        )
        return Own(suspension, scratch)

    def count(self, which: int) -> int:
        """Return a sum over all threads: EXPANSIONS or RUNS of `cache`."""
        with self._lock:
            return sum(int(own.suspension.counts[which]) for own in self._made)

    @property
    def n_suspended(self) -> int:
        """Number of suspended states that all threads share."""
        return int(self._shared[_N_RECORDS_OF_STATES])
