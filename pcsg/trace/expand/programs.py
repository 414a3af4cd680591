"""Rule programs: the right-hand side of every rule as straight code for one small interpreter.

A program follows a right-hand side in the order of the text, as `straight` has it. It runs
`arithmetic`, composes matrices, and writes an item for every leaf, module and operation that it
meets.

`GraphCode` and `enumerate_states` are the reference in Python, with the same bits.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.code import GraphCode, code_of, invert_affine
from pcsg.graph.expr import Expr, Number
from pcsg.graph.graph import Graph
from pcsg.graph.liveness import Liveness
from pcsg.graph.nodes import Attribute, Leaf, Selection, Transformation
from pcsg.graph.unroll import cuts
from pcsg.leaf.registry import Model, Solid
from pcsg.trace.bounding import BALL, CORNERS, SUPPORT
from pcsg.trace.expand.arithmetic import Arithmetic
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
from pcsg.vec import IDENTITY, Affine

# Operations of a program's steps.
STOP, COMPUTE, TRANSFORM, COMPOSE, POP, FRAME, LEAF_STEP, STATE_STEP, BEGIN, END = range(10)

IN_PLACE, PLACED = -1, -2
"""Matrices of steps that are not constants: none, and the one that was placed last."""

STEP_FIELDS, MODULE_FIELDS, LEAF_FIELDS = 5, 3, 7

# Fields of a leaf.
L_NODE, L_ARGS, L_CHECKS, L_SOLID, L_SHAPE, L_SHAPE_AT, L_FLAGS = range(LEAF_FIELDS)

IS_EMPTY, IS_SHEET, HAS_DATA = 1, 2, 4
"""Flags of a leaf."""

CHECK_FIELDS = 3

_PADDING = tuple((0,) * (STEP_FIELDS - k) for k in range(STEP_FIELDS + 1))
"""What follows a step of so many numbers."""


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
    modules : int32 (3 M,)
        Where its rules begin in `rules`, the largest number of a rule, node.
    rules : int32
        Program of every rule by its number, -1 where there is none. Without a selection function
        the one program stands at number 0.
    sources : int32
        Registers that values come from: of a leaf, its arguments and attributes; of a module, for
        every rule, the live values of its program.
    calls : int32
        For every step that leads to a module, and every rule of it, where in `sources` it begins.
    literals : float64
        What stands behind the registers.
    maps, inverses : float64 (12 C,)
        Constant matrices, and their inverses.
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
    code, columns
        See `arithmetic`.
    n_slots, n_registers, n_stack, n_matrices, n_operations, n_items : int
        Sizes of working space: slots, registers, arguments of a function, nested matrices, nested
        operations, and items of the longest program. The first registers are the values that are
        live at its start.
    """

    steps: NDArray[np.int32]
    starts: NDArray[np.int32]
    live_at: NDArray[np.int32]
    live: NDArray[np.int32]
    modules: NDArray[np.int32]
    rules: NDArray[np.int32]
    sources: NDArray[np.int32]
    calls: NDArray[np.int32]
    literals: NDArray[np.float64]
    maps: NDArray[np.float64]
    inverses: NDArray[np.float64]
    leaves: NDArray[np.int32]
    checks: NDArray[np.float64]
    shapes: NDArray[np.float64]
    fixed: NDArray[np.float64]
    attributes: NDArray[np.int32]
    below: NDArray[np.int32]
    code: NDArray[np.int32]
    columns: NDArray[np.float64]
    n_slots: int
    n_registers: int
    n_stack: int
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
        self._arithmetic = Arithmetic()
        self._sources = self._arithmetic.sources
        self._calls: list[int] = []
        self._programs_of: list[list[int]] = []
        self._maps: dict[bytes, int] = {}
        self._leaves: list[int] = []
        self._checks: list[float] = []
        self._shapes: list[float] = []
        self._fixed: list[float] = []
        # Of solids without data: where their checks begin, kind and offset of their shape.
        self._shared: dict[type[Solid], tuple[int, int, int]] = {}
        self._registers = self._matrices = self._operations = self._items = 1
        # Slots of the attributes, -1 for those that no node assigns.
        self._attributes = self._attribute_slots()
        slots = zip(ATTRIBUTE_SLOTS, self._attributes, strict=True)
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
        sheets = self._find_sheets()
        maps = np.frombuffer(b"".join(self._maps)).reshape(-1, 12)
        inverses = [invert_affine(Affine(*m.tolist()))[0] for m in maps]
        return Programs(
            steps=np.array(self._steps, np.int32),
            starts=np.array(starts, np.int32),
            live_at=np.array(live_at, np.int32),
            live=np.array(live or [0], np.int32),
            modules=np.array(modules, np.int32),
            rules=np.array(rules or [0], np.int32),
            sources=self._with_literals(self._sources or [0]),
            calls=np.array(self._calls or [0], np.int32),
            literals=np.array(self._arithmetic.literals or [0.0]),
            maps=maps.ravel(),
            inverses=np.array(inverses).ravel(),
            leaves=np.array(self._leaves or [0], np.int32),
            checks=np.array(self._checks or [0.0]),
            shapes=np.array(self._shapes or [0.0]),
            fixed=np.array(self._fixed or [0.0]),
            attributes=np.array(self._attributes, np.int32),
            below=np.array([IS_SHEET * (n in sheets) for n, _, _ in self._programs], np.int32),
            code=self._with_literals(self._arithmetic.code),
            columns=np.concatenate([np.zeros(0), *(c.values for c in self._arithmetic.columns)]),
            n_slots=len(self.code.slots),
            n_registers=self._registers,
            n_stack=max(self._arithmetic.most_arguments, 16),
            n_matrices=self._matrices,
            n_operations=self._operations,
            n_items=self._items,
        )

    def _with_literals(self, registers: list[int]) -> NDArray[np.int32]:
        """Return numbers of registers; of literals, those behind the registers."""
        numbers = np.array(registers, np.int32)
        return np.where(numbers < 0, self._registers - 1 - numbers, numbers).astype(np.int32)

    def _find_sheets(self) -> set[int]:
        """Return the nodes that are sheets or may lead to one."""
        nodes = enumerate(self.graph.nodes)
        todo = [n for n, node in nodes if isinstance(node, Leaf) and node.is_sheet]
        found = set(todo)
        if not found:
            return found
        above: list[list[int]] = [[] for _ in self.graph.nodes]
        for n, successors in enumerate(self.graph.successors):
            for s in successors:
                above[s].append(n)
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
            modules.append(len(rules))
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
            modules += [max(numbers), n]
            rules += [numbers.get(k, -1) for k in range(max(numbers) + 1)]
        ends = [*modules[::MODULE_FIELDS], len(rules)]
        self._programs_of = [rules[a:b] for a, b in pairwise(ends)]
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
        arithmetic = self._arithmetic
        arithmetic.begin(len(self.liveness.slots[start]), straight.registers)
        at = arithmetic.position
        checks: list[Check] = []
        for step in straight.steps:
            if isinstance(step, Pop):
                self._emit(POP)
            elif isinstance(step, Check):
                checks.append(step)
            elif isinstance(step, Compute):
                arithmetic.assign(step.assign.register, step.assign.expr, step.frame)
            else:
                if isinstance(step, (Place, PushState, PushLeaf)):
                    at = self._write_code(at, checks)
                self._write_step(step)
        # What is assigned on without being used is looked at last.
        self._write_code(at, checks)
        self._emit(STOP)
        self._registers = max(self._registers, arithmetic.registers)
        self._matrices = max(self._matrices, straight.matrices)
        self._operations = max(self._operations, straight.operations)
        self._items = max(self._items, straight.items)

    def _write_code(self, begin: int, checks: list[Check]) -> int:
        """Have arithmetic run that was written since, and checks; return where more begins."""
        for check in checks:
            self._arithmetic.check(check.register)
        checks.clear()
        if self._arithmetic.position > begin:
            self._arithmetic.end()
            self._emit(COMPUTE, begin)
        return self._arithmetic.position

    def _write_step(self, step: Step) -> None:
        graph = self.graph
        if isinstance(step, PushLeaf):
            node = graph.nodes[step.node]
            assert isinstance(node, Leaf)
            leaf = self._leaf(step.node, node)
            at, matrix = self._write_sources(step.values), self._matrix(step.matrix)
            self._emit(LEAF_STEP, leaf, at, matrix)
        elif isinstance(step, PushState):
            module = self._module_of[step.node]
            at, matrix = self._write_call(step), self._matrix(step.matrix)
            self._emit(STATE_STEP, module, at, self._write_sources([step.rule]), matrix)
        elif isinstance(step, Place):
            node = graph.nodes[step.node]
            assert isinstance(node, Transformation)
            at, n = self._write_sources(step.values), len(step.values)
            self._emit(TRANSFORM, node.transform.kind, at, n, self._matrix(step.matrix))
        elif isinstance(step, PlaceConstant):
            self._emit(COMPOSE, self._constant(step.constant))
        elif isinstance(step, Frame):
            self._emit(FRAME, step.source, step.target)
        elif isinstance(step, Begin):
            self._emit(BEGIN, step.operator)
        else:
            self._emit(END)

    def _write_call(self, step: PushState) -> int:
        """Write what every program of a module is given; return where in `calls`."""
        values = dict(zip(step.slots, step.values, strict=True))
        starts = [n for n, _, _ in self._programs]
        begin = len(self._calls)
        written: dict[tuple[int, ...], int] = {}
        for program in self._programs_of[self._module_of[step.node]]:
            live = tuple(self.liveness.slots[starts[program]]) if program >= 0 else ()
            if live not in written:
                written[live] = self._write_sources([values[slot] for slot in live])
            self._calls.append(written[live])
        return begin

    def _matrix(self, matrix: Affine | None) -> int:
        """Return what a step says of a matrix."""
        if matrix is None:
            return PLACED
        return IN_PLACE if matrix == IDENTITY else self._constant(matrix)

    def _constant(self, matrix: Affine) -> int:
        """Return the number of a constant matrix."""
        return self._maps.setdefault(np.array(matrix).tobytes(), len(self._maps))

    def _write_sources(self, values: Sequence[Expr]) -> int:
        """Write where values come from; return where that stands."""
        at = len(self._sources)
        self._sources += [self._arithmetic.operand(value) for value in values]
        return at

    def _emit(self, *step: int) -> None:
        self._steps += step
        self._steps += _PADDING[len(step)]

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
        center, radius = (None if has_data else solid.ball) or _ball_of(sides)
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


def _ball_of(box: Sequence[float]) -> tuple[tuple[float, float, float], float]:
    """Return centre and radius of the ball around a box."""
    if not np.isfinite(box).all():
        return (0.0, 0.0, 0.0), math.inf
    lower, upper = np.array(box[:3]), np.array(box[3:])
    x, y, z = (lower + upper) / 2.0
    return (float(x), float(y), float(z)), float(np.linalg.norm(upper - lower)) / 2.0 * (1 + 1e-15)
