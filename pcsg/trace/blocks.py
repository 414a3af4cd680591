"""Groups as small wide bounding volume hierarchies.

Every group is opened: its largest instances are replaced by their references until there are
about 64 (1,000 for the root), and a tree of blocks of sixteen boxes is built over those. Cyclic
interpretation, the graph of states and opened cuts are one design with one knob, and more than
this no longer helps.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.bvh import FARTHEST, LEAST_SINGLE
from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS
from pcsg.graph.code import compose_affine, invert_affine
from pcsg.graph.graph import Graph
from pcsg.graph.hulls import Hulls, Part
from pcsg.graph.nodes import Leaf
from pcsg.graph.states import StateGraph
from pcsg.simd import SINGLE, WIDTH
from pcsg.trace.binary import BinaryTree, area_of, hull_of
from pcsg.trace.groups import (
    BLOCK,
    EMPTY,
    INSTANCE,
    LEAF,
    OPERATION,
    SMALL,
    SUSPENDED,
    Groups,
    Reference,
    gather,
)
from pcsg.trace.pool import ModelPool, make_pool
from pcsg.trace.small import SmallOperation, flatten_operation
from pcsg.vec import IDENTITY, Affine

OPEN_ROOT, OPEN_GROUP = 1_000, 64
"""References up to which the root and the other groups are opened."""

OPEN_WHOLE = 5_000
"""A root that has no more than this of leaves and operations is opened until no instance is left:
rays then never change their frame."""

OPEN_TOTAL = 20_000
"""References of all groups, about, so that many groups are opened less."""

CUT_TOLERANCE = 0.01
"""Of the boxes of opened references, relative to their size; exact ones would not pay."""


def find_nodes(leaves: NDArray[np.int32], records: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the node numbers of leaf records, -1 for -1; `leaves` as in `Blocks`."""
    return np.where(records < 0, -1, leaves[3::4][records]).astype(np.int64)


class Blocks(NamedTuple):
    """Blocks and what they refer to, as flat arrays.

    Attributes
    ----------
    boxes : float32 (6 W B,)
        Lower x of the W boxes of a block, lower y, lower z, upper x, upper y, upper z.
    refs : int32 (W B,)
        ``index << 3 | kind`` of what is in the boxes.
    inverses : float64 (12 R,)
        target_from_group of references.
    targets : int32 (R,)
        LEAF: record; INSTANCE: first block; OPERATION: index into `operations`; SMALL: into
        `smalls`.
    leaves : int32 (4 L,)
        Kind, first argument, whether it is a sheet, and node number of leaf records.
    args : float64
        Arguments of leaves.
    attributes : float64 (7 (L + 1),)
        Attribute values of leaf records, and those of nothing.
    operations : int32
        Operator, number of operands, whether there are sheets below; then the operands' first
        blocks. The target of a reference is the index of the first of these.
    smalls : int32
        Records of small operations, see `small.HEADER`.
    tables : uint64
        Their truth tables.
    ref_boxes : float32 (6 R,)
        Boxes of references, in the frame of their group; empty where there are no instances.
    root : int
        First block of the axiom.
    box : (2, 3) float64
        About the axiom.
    """

    boxes: NDArray[np.float32]
    refs: NDArray[np.int32]
    inverses: NDArray[np.float64]
    targets: NDArray[np.int32]
    leaves: NDArray[np.int32]
    args: NDArray[np.float64]
    attributes: NDArray[np.float64]
    operations: NDArray[np.int32]
    smalls: NDArray[np.int32]
    tables: NDArray[np.uint64]
    ref_boxes: NDArray[np.float32]
    root: int
    box: NDArray[np.float64]

    @property
    def n_blocks(self) -> int:
        """Number of blocks."""
        return len(self.refs) // WIDTH

    @property
    def contents(self) -> dict[str, int]:
        """What the blocks consist of, by numbers.

        ``blocks``; ``clusters``, which instances share; ``instances``, references to them;
        ``flattened_leaves``, primitives that stand where they are; ``suspended``, references to
        states that are expanded where rays come by.
        """
        kinds = self.refs & 7
        instances = self.refs[kinds == INSTANCE] >> 3
        smalls = self.smalls[self.targets[self.refs[kinds == SMALL] >> 3]]
        return {
            "blocks": self.n_blocks,
            "clusters": int(np.count_nonzero(np.bincount(self.targets[instances]))),
            "instances": len(instances),
            "flattened_leaves": int(np.count_nonzero(kinds == LEAF) + smalls.sum()),
            "suspended": int(np.count_nonzero(kinds == SUSPENDED)),
        }

    def find_nodes(self, records: NDArray[np.int32]) -> NDArray[np.int64]:
        """Return the node numbers of leaf records, -1 for -1."""
        return find_nodes(self.leaves, records)

    @property
    def nbytes(self) -> int:
        """Memory of all arrays in bytes."""
        return sum(a.nbytes for a in self if isinstance(a, np.ndarray))


class _Cut(NamedTuple):
    """A reference in an opened group.

    Attributes
    ----------
    path
        Its place in the text: positions in the groups that were opened on the way.
    """

    path: tuple[int, ...]
    reference: Reference


def build_blocks(graph: Graph, states: StateGraph, models: ModelPool | None = None) -> Blocks:
    """Return the blocks of a finite acyclic state graph; models of its leaves go into a pool."""
    hulls = Hulls(states)
    hulls.tolerance = CUT_TOLERANCE
    return _Builder(graph, gather(states, hulls), hulls, models or make_pool(graph)).build()


class _Builder:
    def __init__(self, graph: Graph, groups: Groups, hulls: Hulls, models: ModelPool) -> None:
        self.graph = graph
        self.models = models
        self.groups = groups
        self.hulls = hulls
        self.boxes: list[NDArray[np.float32]] = []
        self.refs: list[list[int]] = []
        self.inverses: list[Affine] = []
        self.targets: list[int] = []
        self.ref_boxes: dict[int, NDArray[np.float64]] = {}
        self.pending: list[tuple[int, int]] = []  # reference, group: its first block comes later
        self.of_operations: list[int] = []
        self.first_block: dict[int, int] = {}
        self.smalls: list[int] = []
        self.tables: list[int] = []
        self.sheets = self._sheets()
        self.small_at: dict[int, int | None] = {}
        self.wanted: list[int] = []  # groups that references lead to
        self.limit = min(OPEN_GROUP, OPEN_TOTAL // max(1, len(groups.groups)))

    def build(self) -> Blocks:
        root = self.groups.root
        if root < 0:
            self._emit_block([], {})
        else:
            self.wanted.append(root)
        while self.wanted:
            g = self.wanted.pop()
            if g not in self.first_block:
                self.first_block[g] = self._build_group(g)
        for reference, g in self.pending:
            self.targets[reference] = self.first_block[g]
        return self._arrays()

    def _build_group(self, g: int) -> int:
        cuts = self._open(g)
        boxes = np.array([self.hulls.box(cut.reference.hull) for cut in cuts])
        numbers = [
            self._emit_reference(cut.reference, box) for cut, box in zip(cuts, boxes, strict=True)
        ]
        pad = 1e-9 * np.abs(np.where(np.isfinite(boxes), boxes, 0.0)).max(axis=1)
        # Sides at zero of what has no size, such as a half-space, would have no room for rounding.
        pad[(pad == 0.0) & ~np.isfinite(boxes).all(axis=1)] = np.inf
        boxes[:, :3] -= pad[:, None]
        boxes[:, 3:] += pad[:, None]
        return self._build_tree(boxes, numbers)

    def _open(self, g: int) -> list[_Cut]:
        """Return the references of a group, its largest instances opened, in the text's order."""
        limit = self.limit
        if g == self.groups.root:
            whole = self._counts()[g]
            limit = max(OPEN_ROOT, whole if whole <= OPEN_WHOLE else 0)
        cuts: dict[tuple[int, ...], _Cut] = {
            (k,): _Cut((k,), r) for k, r in enumerate(self.groups.groups[g])
        }
        heap: list[tuple[float, tuple[int, ...]]] = []

        def offer(cut: _Cut) -> None:
            if cut.reference.kind == INSTANCE:
                area = area_of(self.hulls.loose_box(cut.reference.hull))
                heappush(heap, (-area, cut.path))

        for cut in cuts.values():
            offer(cut)
        while heap:
            _, path = heappop(heap)
            outer = cuts[path].reference
            inner = self.groups.groups[outer.target]
            if len(cuts) + len(inner) - 1 > limit:
                continue
            del cuts[path]
            for k, r in enumerate(inner):
                m = outer.group_from_target
                moved = Reference(
                    r.kind,
                    r.target,
                    compose_affine(m, r.group_from_target),
                    Part(compose_affine(m, r.hull.outer_from_inner), r.hull.hull),
                )
                cut = _Cut((*path, k), moved)
                cuts[cut.path] = cut
                offer(cut)
        return [cuts[path] for path in sorted(cuts)]

    def _counts(self) -> list[int]:
        """Return how many references every group has, up to a bound, when no instance is left."""
        counts: list[int] = []
        # The references of a group were found before it.
        for refs in self.groups.groups:
            parts = (counts[r.target] if r.kind == INSTANCE else 1 for r in refs)
            counts.append(min(sum(parts), OPEN_WHOLE + 1))
        return counts

    def _emit_reference(self, r: Reference, box: NDArray[np.float64]) -> int:
        """Append a reference and return its code."""
        n = len(self.targets)
        self.ref_boxes[n] = box
        self.inverses.append(invert_affine(r.group_from_target)[0])
        self.targets.append(r.target)
        if r.kind == INSTANCE:
            self.pending.append((n, r.target))
            self.wanted.append(r.target)
        elif r.kind == OPERATION:
            small_at = self._place_small(r.target)
            if small_at is not None:
                self.targets[n] = small_at
                return n << 3 | SMALL
            self.of_operations.append(n)
            self.wanted += self.groups.operations[r.target].operands
        return n << 3 | r.kind

    def _place_small(self, operation: int) -> int | None:
        """Return where an operation's record as a small one begins, None if it is not small."""
        if operation not in self.small_at:
            small = None if self.sheets[operation] else flatten_operation(self.groups, operation)
            self.small_at[operation] = None if small is None else self._emit_small(small)
        return self.small_at[operation]

    def _emit_small(self, small: SmallOperation) -> int:
        """Append a small operation and return where its record begins."""
        begin = len(self.smalls)
        self.smalls += [len(small.primitives), len(self.tables), small.required]
        self.tables.append(small.table)
        for p in small.primitives:
            self.smalls += [len(self.targets), p.record, int(p.flipped)]
            self.inverses.append(invert_affine(p.operation_from_leaf)[0])
            self.targets.append(p.record)
        self.smalls += [len(small.program), *small.program]
        return begin

    def _build_tree(self, boxes: NDArray[np.float64], codes: list[int]) -> int:
        """Append blocks over boxes; return the first."""
        tree = BinaryTree(boxes)
        first = self._emit_block([], {})
        stack = [(first, 0)]
        while stack:
            block, node = stack.pop()
            parts = tree.parts(node)
            content: dict[int, int] = {}
            for k, part in enumerate(parts):
                if part in tree.items:
                    content[k] = codes[tree.items[part]]
                else:
                    below = self._emit_block([], {})
                    content[k] = below << 3 | BLOCK
                    stack.append((below, part))
            self._fill_block(block, [tree.hulls[part] for part in parts], content)
        return first

    def _emit_block(self, boxes: list[NDArray[np.float64]], content: dict[int, int]) -> int:
        self.boxes.append(np.zeros(0, np.float32))
        self.refs.append([])
        self._fill_block(len(self.boxes) - 1, boxes, content)
        return len(self.boxes) - 1

    def _fill_block(
        self, block: int, boxes: list[NDArray[np.float64]], content: dict[int, int]
    ) -> None:
        planes = np.empty((6, WIDTH))
        planes[:3], planes[3:] = np.inf, -np.inf
        for k, box in enumerate(boxes):
            planes[:, k] = box
        self.boxes[block] = _round_outwards(planes).ravel()
        self.refs[block] = [content.get(k, EMPTY) for k in range(WIDTH)]

    def _arrays(self) -> Blocks:
        leaves: list[tuple[int, int, int, int]] = []
        args: list[float] = []
        attributes: list[float] = []
        for record in self.groups.leaves:
            leaf = self._leaf(record.node)
            leaves.append((leaf.solid.kind, len(args), int(leaf.is_sheet), record.node))
            if leaf.constants:
                args.extend(self.models.place(leaf.model(record.args)))
            else:
                args.extend(record.args)
            # What no attribute node assigns is not live, so states do not know it.
            attributes.extend(
                default if math.isnan(value) else value
                for value, default in zip(record.attributes, ATTRIBUTE_DEFAULTS, strict=True)
            )
        operations: list[int] = []
        begins: dict[int, int] = {}
        for reference in self.of_operations:
            k = self.targets[reference]
            if k not in begins:
                begins[k] = len(operations)
                op = self.groups.operations[k]
                operations += [op.operator.kind, len(op.operands), int(self.sheets[k])]
                operations += [self.first_block[g] for g in op.operands]
            self.targets[reference] = begins[k]
        return Blocks(
            boxes=np.concatenate(self.boxes),
            refs=np.array(self.refs, np.int32).ravel(),
            inverses=np.array(self.inverses or [IDENTITY]).ravel(),
            targets=np.array(self.targets or [0], np.int32),
            leaves=np.array(leaves or [(0, 0, 0, 0)], np.int32).ravel(),
            args=np.array(args or [0.0]),
            attributes=np.array([*attributes, *ATTRIBUTE_DEFAULTS]),
            operations=np.array(operations or [0], np.int32),
            smalls=np.array(self.smalls or [0], np.int32),
            tables=np.array(self.tables or [0], np.uint64),
            ref_boxes=self._ref_boxes(),
            root=self.first_block.get(self.groups.root, 0),
            box=self._box(),
        )

    def _ref_boxes(self) -> NDArray[np.float32]:
        boxes = np.zeros((max(1, len(self.targets)), 6), np.float32)
        for n, box in self.ref_boxes.items():
            boxes[n] = as_single(box)
        return boxes.ravel()

    def _box(self) -> NDArray[np.float64]:
        root = self.groups.root
        boxes = [self.hulls.box(r.hull) for r in self.groups.groups[root]] if root >= 0 else []
        return hull_of(np.array(boxes or [(0.0,) * 6])).reshape(2, 3)

    def _leaf(self, number: int) -> Leaf:
        node = self.graph.nodes[number]
        assert isinstance(node, Leaf)
        return node

    def _sheets(self) -> list[bool]:
        """Return for every operation whether there are sheets below it."""
        groups = self.groups
        has: dict[tuple[int, int], bool] = {}
        for k, record in enumerate(groups.leaves):
            has[LEAF, k] = self._leaf(record.node).is_sheet
        # Groups and operations refer to what was found before them, or nearly: repeat until still.
        changed = True
        while changed:
            changed = False
            for g, refs in enumerate(groups.groups):
                value = any(has.get((r.kind, r.target), False) for r in refs)
                changed |= value != has.get((INSTANCE, g), False)
                has[INSTANCE, g] = value
            for k, op in enumerate(groups.operations):
                value = any(has.get((INSTANCE, g), False) for g in op.operands)
                changed |= value != has.get((OPERATION, k), False)
                has[OPERATION, k] = value
        return [has[OPERATION, k] for k in range(len(groups.operations))]


def as_single(boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return boxes in single precision; what lies farther out ends where that does."""
    most = float(np.finfo(np.float32).max)
    return np.clip(boxes, -most, most).astype(np.float32)


def _round_outwards(planes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return lower and upper planes (6, W) in single precision, with room for its errors.

    See `simd.prepare_ray`: the ray gives way for errors from its origin, boxes for those from their
    own coordinates.
    """
    with np.errstate(invalid="ignore"):
        room = np.abs(planes) * SINGLE
        # Where single precision runs out of digits, its errors are no longer relative.
        room[(np.abs(planes) < LEAST_SINGLE) & (planes != 0.0)] += 1e-44
        lower, upper = planes[:3] - room[:3], planes[3:] + room[3:]
    # Boxes of nothing, from infinity to minus infinity, stay what they are.
    lower = np.where(planes[:3] == np.inf, np.inf, np.where(lower < -FARTHEST, -np.inf, lower))
    upper = np.where(planes[3:] == -np.inf, -np.inf, np.where(upper > FARTHEST, np.inf, upper))
    return np.concatenate([lower, upper]).astype(np.float32)
