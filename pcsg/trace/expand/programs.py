"""Rule programs: the right-hand side of every rule as straight code for one small interpreter.

A program follows a right-hand side in the order of the text, as `straight` has it. It runs
arithmetic on the tape (`pcsg.graph.tape`), composes matrices, and writes an item for every leaf,
module and operation that it meets.

`GraphCode` and `enumerate_states` are the reference in Python, with the same bits.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.code import GraphCode, code_of
from pcsg.graph.expr import Expr, Number, Parameter, as_expr
from pcsg.graph.graph import Graph
from pcsg.graph.liveness import Liveness
from pcsg.graph.nodes import Attribute, Leaf, Selection, Transformation
from pcsg.graph.sharing import register, substitute
from pcsg.graph.tape import Program
from pcsg.graph.unroll import cuts
from pcsg.leaf.registry import Model, Solid
from pcsg.trace.bounding import BALL, CORNERS, SUPPORT
from pcsg.trace.expand.straight import (
    Begin,
    Check,
    Compute,
    Frame,
    Place,
    PlaceConstant,
    Pop,
    PushLeaf,
    PushState,
    Step,
    Straight,
)
from pcsg.trace.pool import ModelPool
from pcsg.trace.rulebook import ball_of

# Operations of a program's steps.
STOP, RUN, CHECK, TRANSFORM, CONSTANT, COMPOSE, POP, FRAME, LEAF_STEP, STATE_STEP, BEGIN, END = (
    range(12)
)

STEP_FIELDS, MODULE_FIELDS, LEAF_FIELDS = 5, 4, 7

# Fields of a leaf.
L_NODE, L_ARGS, L_CHECKS, L_SOLID, L_SHAPE, L_SHAPE_AT, L_FLAGS = range(LEAF_FIELDS)

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
    sources : int32
        Where values come from: registers, or -1 - k for a literal. For a module, each after the
        slot that it goes to.
    literals : float64
    maps : float64 (12,)
        Constant matrices.
    leaves : int32 (7 L,)
        Node, number of the arguments, where their checks begin in
        `checks`, kind of the solid, kind and offset of its bounding shape, flags.
    checks : float64 (3,)
        For every argument: least and largest legal value, and whether the least is excluded.
    shapes : float64
        Bounding shapes, see `bounding`.
    fixed : float64 (3 L,)
        Kernel arguments of leaves with data.
    attributes : int32 (7,)
        Slots of the attributes, -1 for those that no node assigns.
    below : int32 (K,)
        Flags of the leaves that a program may lead to: IS_SHEET where one is a sheet.
    code, constants
        The tape.
    frame_slot : int
        First of the 12 slots of world_from_local, -1 without world queries.
    n_slots, n_registers, n_stack, n_matrices, n_operations, n_items : int
        Sizes of working space: slots, registers, the tape's stack, nested matrices, nested
        operations, and items of the longest program. The first registers are the slots as they
        are given, the next ones as they are passed on.
    """

    steps: NDArray[np.int32]
    starts: NDArray[np.int32]
    live_at: NDArray[np.int32]
    live: NDArray[np.int32]
    modules: NDArray[np.int32]
    rules: NDArray[np.int32]
    sources: NDArray[np.int32]
    literals: NDArray[np.float64]
    maps: NDArray[np.float64]
    leaves: NDArray[np.int32]
    checks: NDArray[np.float64]
    shapes: NDArray[np.float64]
    fixed: NDArray[np.float64]
    attributes: NDArray[np.int32]
    below: NDArray[np.int32]
    code: NDArray[np.int32]
    constants: NDArray[np.float64]
    frame_slot: int
    n_slots: int
    n_registers: int
    n_stack: int
    n_matrices: int
    n_operations: int
    n_items: int


class _Registers(dict[str, int]):
    """The numbers of registers, by their names."""

    def __missing__(self, name: str) -> int:
        return int(name[1:])


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
        self.without = frozenset(without)
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
        self._sources: list[int] = []
        self._literals: list[float] = []
        self._literal_of: dict[str, int] = {}
        self._maps: list[float] = []
        self._leaves: list[int] = []
        self._checks: list[float] = []
        self._shapes: list[float] = []
        self._fixed: list[float] = []
        # Of solids without data: where their checks begin, kind and offset of their shape.
        self._shared: dict[type[Solid], tuple[int, int, int]] = {}
        self._registers = self._matrices = self._operations = self._items = 1
        self._tape = Program(_Registers(), self.code.frame_slot)
        slots = zip(ATTRIBUTE_SLOTS, self._attribute_slots(), strict=True)
        self._attribute_names = [name for name, slot in slots if slot >= 0]

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
        tape, constants = self._tape.arrays()
        sheets = self._find_sheets()
        return Programs(
            steps=np.array(self._steps, np.int32),
            starts=np.array(starts, np.int32),
            live_at=np.array(live_at, np.int32),
            live=np.array(live or [0], np.int32),
            modules=np.array(modules or [0], np.int32),
            rules=np.array(rules or [0], np.int32),
            sources=np.array(self._sources or [0], np.int32),
            literals=np.array(self._literals or [0.0]),
            maps=np.array(self._maps or [0.0]),
            leaves=np.array(self._leaves or [0], np.int32),
            checks=np.array(self._checks or [0.0]),
            shapes=np.array(self._shapes or [0.0]),
            fixed=np.array(self._fixed or [0.0]),
            attributes=np.array(self._attribute_slots(), np.int32),
            below=np.array([IS_SHEET * (n in sheets) for n, _, _ in self._programs], np.int32),
            code=tape,
            constants=constants,
            frame_slot=self.code.frame_slot,
            n_slots=len(self.code.slots),
            n_registers=self._registers,
            n_stack=max(self._tape.stack_size, 16),
            n_matrices=self._matrices,
            n_operations=self._operations,
            n_items=self._items,
        )

    def _find_sheets(self) -> set[int]:
        """Return the nodes that are sheets or may lead to one."""
        above: list[list[int]] = [[] for _ in self.graph.nodes]
        for n, successors in enumerate(self.graph.successors):
            for s in successors:
                above[s].append(n)
        nodes = enumerate(self.graph.nodes)
        todo = [n for n, node in nodes if isinstance(node, Leaf) and node.is_sheet]
        found = set(todo)
        while todo:
            for n in above[todo.pop()]:
                if n not in found:
                    found.add(n)
                    todo.append(n)
        return found

    def _attribute_slots(self) -> list[int]:
        """Return the slots of the attributes, -1 for those that no node assigns."""
        assigned: set[str] = set()
        for k, node in enumerate(self.graph.nodes):
            if isinstance(node, Attribute):
                assigned.update(code_of(self.graph, k, node, self.liveness)[1])
        slots = self.code.slots
        return [slots[name] if name in assigned else -1 for name in ATTRIBUTE_SLOTS]

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
            # It is asked about what is passed on.
            values = {name: register(k) for name, k in self.code.slots.items()}
            modules[-2] = self._tape.add([substitute(as_expr(node.select), values)])
            modules += [max(numbers), n]
            rules += [numbers.get(k, -1) for k in range(max(numbers) + 1)]
        return modules, rules

    def _program(self, n: int, opened: bool = False, alike: int = 0) -> int:
        """Return the number of the program that begins at a node."""
        return self._programs.setdefault((n, opened, alike), len(self._programs))

    def _write_program(self, start: int, opened: bool) -> None:
        """Write the steps of a right-hand side."""
        straight = Straight(
            self.code, self.liveness, self._module_of, self.without, self._attribute_names
        )
        straight.follow(start, opened)
        pending: list[Compute] = []
        for step in straight.steps:
            if pending and not (isinstance(step, Compute) and step.frame == pending[0].frame):
                self._write_code(pending)
                pending = []
            if isinstance(step, Compute):
                pending.append(step)
            else:
                self._write_step(step)
        self._write_code(pending)
        self._emit(STOP)
        self._registers = max(self._registers, straight.registers)
        self._matrices = max(self._matrices, straight.matrices)
        self._operations = max(self._operations, straight.operations)
        self._items = max(self._items, straight.items)

    def _write_code(self, steps: list[Compute]) -> None:
        """Write assignments that see one frame."""
        if steps:
            exprs = [step.assign.expr for step in steps]
            names = [f"r{step.assign.register}" for step in steps]
            self._emit(RUN, self._tape.add(exprs, names), steps[0].frame)

    def _write_step(self, step: Step) -> None:
        graph = self.graph
        if isinstance(step, PushLeaf):
            node = graph.nodes[step.node]
            assert isinstance(node, Leaf)
            leaf = self._leaf(step.node, node)
            self._emit(LEAF_STEP, leaf, self._write_sources(step.values), 0, step.node)
        elif isinstance(step, PushState):
            at = self._write_sources(step.values, step.slots)
            self._emit(STATE_STEP, self._module_of[step.node], at, len(step.values))
        elif isinstance(step, Place):
            node = graph.nodes[step.node]
            assert isinstance(node, Transformation)
            at, n = self._write_sources(step.values), len(step.values)
            self._emit(TRANSFORM, node.transform.kind, at, n, step.node)
        elif isinstance(step, PlaceConstant):
            self._emit(CONSTANT if step.is_whole else COMPOSE, len(self._maps) // 12)
            self._maps += step.matrix
        elif isinstance(step, Frame):
            self._emit(FRAME, step.source, step.target)
        elif isinstance(step, Check):
            self._emit(CHECK, step.register)
        elif isinstance(step, Begin):
            self._emit(BEGIN, step.operator)
        else:
            self._emit(POP if isinstance(step, Pop) else END)

    def _write_sources(self, values: Sequence[Expr], slots: Sequence[int] = ()) -> int:
        """Write where values come from, each after the slot that it goes to; return where."""
        at = len(self._sources)
        for k, value in enumerate(values):
            if slots:
                self._sources.append(slots[k])
            if isinstance(value, Number):
                self._sources.append(-1 - self._literal(float(value.value)))
            else:
                assert isinstance(value, Parameter)
                self._sources.append(int(value.name[1:]))
        return at

    def _literal(self, value: float) -> int:
        key = value.hex()
        if key not in self._literal_of:
            self._literal_of[key] = len(self._literals)
            self._literals.append(value)
        return self._literal_of[key]

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
        self._leaves += [n, len(node.args), checks, node.solid.kind, shape, at, flags]
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
