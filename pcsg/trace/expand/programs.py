"""Rule programs: the right-hand side of every rule as straight code for one small interpreter.

A program visits the nodes of a right-hand side in the order of the text. It runs their arithmetic
on the tape (`pcsg.graph.tape`), composes matrices, and writes an item for every leaf, module and
operation that it meets. What a branch assigns stays in the branch: slots that are assigned below
an operand are saved before it and restored behind it.

`GraphCode` and `enumerate_states` are the reference in Python, with the same bits.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.code import GraphCode
from pcsg.graph.expr import Number
from pcsg.graph.graph import Graph
from pcsg.graph.liveness import Liveness, successors_first
from pcsg.graph.nodes import Leaf, Operation, Selection, Transformation
from pcsg.graph.operators import UNION
from pcsg.graph.unroll import cuts
from pcsg.leaf.registry import Model, Solid
from pcsg.trace.bounding import BALL, CORNERS, SUPPORT
from pcsg.trace.pool import ModelPool
from pcsg.trace.rulebook import ball_of

# Operations of a program's steps.
STOP, RUN, SAVE, RESTORE, TRANSFORM, POP, FRAME, LEAF_STEP, STATE_STEP, BEGIN, END = range(11)

STEP_FIELDS, MODULE_FIELDS, LEAF_FIELDS = 5, 4, 8

# Fields of a leaf.
L_NODE, L_CODE, L_ARGS, L_CHECKS, L_SOLID, L_SHAPE, L_SHAPE_AT, L_FLAGS = range(LEAF_FIELDS)

IS_EMPTY, IS_SHEET, HAS_DATA = 1, 2, 4
"""Flags of a leaf."""

CHECK_FIELDS = 3


class Programs(NamedTuple):
    """The programs of all rules of a graph.

    Attributes
    ----------
    steps : int32 (5 S,)
        Operation and up to four operands of every step.
    starts : int32 (K,)
        First step of every program; the axiom's is number 0.
    live_at, live : int32 (K + 1,), int32
        Where the numbers of the slots begin that are live at the start of a program.
    modules : int32 (4 M,)
        Code of the selection function (-1 for none), where its rules begin in `rules`, the
        largest number of a rule, node.
    rules : int32
        Program of every rule by its number, -1 where there is none. Without a selection function
        the one program stands at number 0.
    slots : int32
        Lists of slots that are saved.
    leaves : int32 (8 L,)
        Node, code of the arguments (-1 for none), their number, where their checks begin in
        `checks`, kind of the solid, kind and offset of its bounding shape, flags.
    checks : float64 (3,)
        For every argument: least and largest legal value, and whether the least is excluded.
    shapes : float64
        Bounding shapes, see `bounding`.
    fixed : float64 (3 L,)
        Kernel arguments of leaves with data.
    attributes : int32 (7,)
        Slots of the attributes, -1 for those that no node assigns.
    code, constants
        The tape.
    frame_slot : int
        First of the 12 slots of world_from_local, -1 without world queries.
    n_slots, n_stack, n_saved, n_matrices, n_operations, n_items : int
        Sizes of working space: slots, the tape's stack, saved slots, nested matrices, nested
        operations, and items of the longest program.
    """

    steps: NDArray[np.int32]
    starts: NDArray[np.int32]
    live_at: NDArray[np.int32]
    live: NDArray[np.int32]
    modules: NDArray[np.int32]
    rules: NDArray[np.int32]
    slots: NDArray[np.int32]
    leaves: NDArray[np.int32]
    checks: NDArray[np.float64]
    shapes: NDArray[np.float64]
    fixed: NDArray[np.float64]
    attributes: NDArray[np.int32]
    code: NDArray[np.int32]
    constants: NDArray[np.float64]
    frame_slot: int
    n_slots: int
    n_stack: int
    n_saved: int
    n_matrices: int
    n_operations: int
    n_items: int


class ProgramWriter:
    """Writes the programs of a graph.

    Parameters
    ----------
    graph
        The graph.
    models
        Receives the models of leaves with data.
    without
        Nodes that are taken to be empty.

    Attributes
    ----------
    code
        The nodes' arithmetic, whose tape the programs run.
    module_nodes, leaf_nodes
        The node of every module, and of every leaf.
    varying
        Leaves with data whose models depend on the place.
    """

    def __init__(
        self, graph: Graph, models: ModelPool, without: Collection[int] = frozenset()
    ) -> None:
        self.graph = graph
        self.without = without
        self.models = models
        self.liveness = Liveness(graph)
        self.code = GraphCode(graph, self.liveness)
        self.module_nodes = sorted(cuts(graph))
        self.leaf_nodes: list[int] = []
        self.varying: list[int] = []
        self._module_of = {n: k for k, n in enumerate(self.module_nodes)}
        self._leaf_of: dict[int, int] = {}
        # A program begins at a node; one that begins at a module's own node looks into it. Rules of
        # a module that are alike have programs of their own, so that states know their rule.
        self._programs: dict[tuple[int, bool, int], int] = {(0, False, 0): 0}
        self._steps: list[int] = []
        self._slots: list[int] = []
        self._leaves: list[int] = []
        self._checks: list[float] = []
        self._shapes: list[float] = []
        self._fixed: list[float] = []
        # Of solids without data: where their checks begin, kind and offset of their shape.
        self._shared: dict[type[Solid], tuple[int, int, int]] = {}
        self._slot_lists: dict[int, tuple[int, int]] = {}
        self._saved = self._matrices = self._operations = self._items = 1
        frame = self.code.frame_slot
        self._frame_mask = 0xFFF << frame if frame >= 0 else 0
        self._assigned = self._find_assigned()

    def write(self) -> Programs:
        """Return the programs."""
        modules, rules = self._write_modules()
        starts: list[int] = []
        live_at, live = [0], list[int]()
        for n, opened, _ in self._programs:
            starts.append(len(self._steps) // STEP_FIELDS)
            self._write_program(n, opened)
            live += self.liveness.slots[n]
            live_at.append(len(live))
        tape, constants = self.code.program.arrays()
        return Programs(
            steps=np.array(self._steps, np.int32),
            starts=np.array(starts, np.int32),
            live_at=np.array(live_at, np.int32),
            live=np.array(live or [0], np.int32),
            modules=np.array(modules or [0], np.int32),
            rules=np.array(rules or [0], np.int32),
            slots=np.array(self._slots or [0], np.int32),
            leaves=np.array(self._leaves or [0], np.int32),
            checks=np.array(self._checks or [0.0]),
            shapes=np.array(self._shapes or [0.0]),
            fixed=np.array(self._fixed or [0.0]),
            attributes=np.array(self._attribute_slots(), np.int32),
            code=tape,
            constants=constants,
            frame_slot=self.code.frame_slot,
            n_slots=len(self.code.slots),
            n_stack=max(self.code.program.stack_size, 16),
            n_saved=self._saved,
            n_matrices=self._matrices,
            n_operations=self._operations,
            n_items=self._items,
        )

    def _attribute_slots(self) -> list[int]:
        """Return the slots of the attributes, -1 for those that no node assigns."""
        assigned = {s for k in range(len(self.graph.nodes)) for s in self.code.stores(k)}
        slots = (self.code.slots[name] for name in ATTRIBUTE_SLOTS)
        return [slot if slot in assigned else -1 for slot in slots]

    def _write_modules(self) -> tuple[list[int], list[int]]:
        """Return the modules and their rules; the programs they need are numbered."""
        modules: list[int] = []
        rules: list[int] = []
        for n in self.module_nodes:
            node = self.graph.nodes[n]
            modules += [-1, len(rules)]
            if not isinstance(node, Selection):
                modules += [0, n]
                rules.append(self._program(n, opened=True))
                continue
            alike = Counter[int]()
            numbers: dict[int, int] = {}
            for k, r in node.rules.items():
                start = self.graph.number[r]
                numbers[k] = self._program(start, alike=alike[start])
                alike[start] += 1
            if node.select is None:
                modules += [0, n]
                rules.append(next(iter(numbers.values())))
                continue
            modules[-2] = self.code.code_at(n)
            modules += [max(numbers), n]
            rules += [numbers.get(k, -1) for k in range(max(numbers) + 1)]
        return modules, rules

    def _program(self, n: int, opened: bool = False, alike: int = 0) -> int:
        """Return the number of the program that begins at a node."""
        return self._programs.setdefault((n, opened, alike), len(self._programs))

    def _write_program(self, start: int, opened: bool) -> None:
        """Write the steps of a right-hand side."""
        graph, live = self.graph, self.liveness
        saved = matrices = operations = items = 0
        # What is still to do: nodes, and steps that follow what is below a node.
        todo: list[int | tuple[int, ...]] = [start]
        deep = [0, 1, 0]  # saved slots, matrices, operations at present
        while todo:
            entry = todo.pop()
            if isinstance(entry, tuple):
                self._emit(*entry)
                op = entry[0]
                deep[0] += {SAVE: 1, RESTORE: -1}.get(op, 0) * (entry[2] if len(entry) > 2 else 0)
                deep[1] -= op == POP
                deep[2] -= op == END
                saved = max(saved, deep[0])
                continue
            n = entry
            node = graph.nodes[n]
            if n in self.without:
                self._emit(BEGIN, UNION.kind, 0)
                self._emit(END)
                items += 1
                operations = max(operations, deep[2] + 1)
                continue
            if n in self._module_of and not (opened and n == start):
                self._emit(STATE_STEP, self._module_of[n])
                items += 1
                continue
            opened = opened and n != start
            if isinstance(node, Leaf):
                self._emit(LEAF_STEP, self._leaf(n, node))
                items += 1
            elif isinstance(node, Operation):
                below = graph.successors[n]
                self._emit(BEGIN, node.operator.kind, len(below))
                items += 1
                deep[2] += 1
                todo.append((END,))
                for s in reversed(below):
                    stored = self._slot_list(self._assigned[s])
                    todo += [(RESTORE, *stored), s, (SAVE, *stored)] if stored[1] else [s]
            elif isinstance(node, Transformation):
                (s,) = graph.successors[n]
                self._emit(TRANSFORM, node.transform.kind, self.code.code_at(n), len(node.args), n)
                deep[1] += 1
                if live.masks[s] & self._frame_mask:
                    self._emit(FRAME)
                todo += [(POP,), s]
            else:
                (s,) = graph.successors[n]
                if self.code.code_at(n) >= 0:
                    self._emit(RUN, self.code.code_at(n), 0, 0, n)
                todo.append(s)
            matrices, operations = max(matrices, deep[1]), max(operations, deep[2])
        self._emit(STOP)
        self._saved = max(self._saved, saved)
        self._matrices = max(self._matrices, matrices)
        self._operations = max(self._operations, operations)
        self._items = max(self._items, items)

    def _find_assigned(self) -> list[int]:
        """Return the slots that are assigned at a node and below it up to modules, as bits."""
        graph = self.graph
        masks = [0] * len(graph.nodes)
        module_of = self._module_of
        within = [() if k in module_of else below for k, below in enumerate(graph.successors)]
        for k in successors_first(within):
            mask = 0
            for s in within[k]:
                mask |= masks[s]
            for slot in self.code.stores(k):
                mask |= 1 << slot
            if isinstance(graph.nodes[k], Transformation):
                (s,) = graph.successors[k]
                mask |= self.liveness.masks[s] & self._frame_mask and self._frame_mask
            masks[k] = mask
        return masks

    def _slot_list(self, mask: int) -> tuple[int, int]:
        """Return where a list of slots begins, and its length."""
        if mask not in self._slot_lists:
            slots = [k for k in range(mask.bit_length()) if mask >> k & 1]
            self._slot_lists[mask] = len(self._slots), len(slots)
            self._slots += slots
        return self._slot_lists[mask]

    def _emit(self, *step: int) -> None:
        self._steps += [*step, *[0] * (STEP_FIELDS - len(step))]

    def _leaf(self, n: int, node: Leaf) -> int:
        """Return the number of a leaf."""
        if n not in self._leaf_of:
            self._leaf_of[n] = len(self.leaf_nodes)
            self.leaf_nodes.append(n)
            model = self._constant_model(node)
            if node.constants and model is None:
                self.varying.append(self._leaf_of[n])
            self._write_leaf(n, node, model)
        return self._leaf_of[n]

    def _constant_model(self, node: Leaf) -> Model | None:
        """Return the model of a leaf with data whose numbers are constants, where it has one."""
        if not node.constants or not all(isinstance(arg, Number) for arg in node.args):
            return None
        try:
            return node.model(tuple(a.value for a in node.args if isinstance(a, Number)))
        except UsageError:
            # It is told where the leaf is met.
            return None

    def _write_leaf(self, n: int, node: Leaf, model: Model | None) -> None:
        """Write a leaf; one with data whose model is not known yet is bounded by nothing."""
        flags = IS_EMPTY if node.solid.primitives == 0 else 0
        flags |= (IS_SHEET if node.is_sheet else 0) | (HAS_DATA if node.constants else 0)
        known = None if node.constants else self._shared.get(node.solid)
        if known is None:
            known = self._write_checks(node), *self._write_shape(node, model)
            if not node.constants:
                self._shared[node.solid] = known
        checks, shape, at = known
        code = self.code.code_at(n)
        self._leaves += [n, code, len(node.args), checks, node.solid.kind, shape, at, flags]
        self._fixed += self.models.place(model) if model else (0.0, 0.0, 0.0)

    def _write_checks(self, node: Leaf) -> int:
        """Return where the checks of a leaf's arguments begin."""
        at = len(self._checks) // CHECK_FIELDS
        for parameter in node.parameters:
            self._checks += [parameter.low, parameter.high, float(parameter.open_low)]
        return at

    def _write_shape(self, node: Leaf, model: Model | None) -> tuple[int, int]:
        """Return kind and offset of the shape that bounds a leaf."""
        solid, has_data = node.solid, bool(node.constants)
        at = len(self._shapes)
        if solid.corners:
            self._shapes += [float(len(solid.corners)), *(x for c in solid.corners for x in c)]
            return CORNERS, at
        if solid.support is not Solid.support and not has_data:
            return SUPPORT, 0
        box = model.bounds if model else solid.bounds
        sides = (*box.lower, *box.upper)
        center, radius = (None if has_data else solid.ball) or ball_of(sides)
        self._shapes += [*sides, *center, radius]
        return BALL, at

    def add_model(self, leaf: int, args: tuple[float, ...]) -> int:
        """Write a leaf of its own for values of a leaf's numbers, and return its number.

        Raises
        ------
        UsageError
            There is no model for these values.
        """
        n = self.leaf_nodes[leaf]
        node = self.graph.nodes[n]
        assert isinstance(node, Leaf)
        self._write_leaf(n, node, node.model(args))
        self.leaf_nodes.append(n)
        return len(self.leaf_nodes) - 1

    def with_leaves(self, programs: Programs) -> Programs:
        """Return programs with the leaves that have been written since."""
        return programs._replace(
            leaves=np.array(self._leaves, np.int32),
            checks=np.array(self._checks or [0.0]),
            shapes=np.array(self._shapes or [0.0]),
            fixed=np.array(self._fixed),
        )

    def link_of(self, module: int, program: int) -> tuple[int, int, int]:
        """Return the node of a module, the rule that leads to a program, and its first node."""
        n = self.module_nodes[module]
        node = self.graph.nodes[n]
        start, _, alike = list(self._programs)[program]
        if not isinstance(node, Selection):
            return n, 0, start
        return n, [k for k, r in node.rules.items() if self.graph.number[r] == start][alike], start
