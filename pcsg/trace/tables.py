"""A graph packed into flat arrays, as the walker reads it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS, ATTRIBUTE_SLOTS
from pcsg.graph.depth import MOST_SELECTIONS
from pcsg.graph.expr import Number, as_expr, functions_of, parameters_of
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.graph import FRAME_SLOTS, GLOBALS, Graph
from pcsg.graph.liveness import attribute_values
from pcsg.graph.nodes import (
    Attribute,
    Calculation,
    Leaf,
    Node,
    Operation,
    Selection,
    Transformation,
)
from pcsg.graph.tape import Fault, Program
from pcsg.jit import plain
from pcsg.leaf.registry import LEAVES, MODEL_ARGS, Model
from pcsg.vec import IDENTITY, Affine, invert

# Kinds of packed nodes. Attributes are calculations; constant matrices are inverted beforehand.
SELECTION, CALCULATION, CONSTANT_MATRIX, MATRIX, OPERATION, LEAF = range(6)

MAX_LEAF_ARGS = max(MODEL_ARGS, *(len(solid.parameters) for solid in LEAVES.values()))
"""Most kernel arguments of a leaf."""


MOST_VISITS = 10_000_000
"""Selections that one ray may look at: some seconds."""


class Tables(NamedTuple):
    """The arrays of a packed graph; N nodes in the graph's order.

    Attributes
    ----------
    kind : int32 (N,)
        SELECTION, CALCULATION...
    code_at : int32 (N,)
        First instruction of the node's code, -1 if it has none.
    detail : int32 (N,)
        CONSTANT_MATRIX: offset into `matrices`; MATRIX, OPERATION, LEAF: kind of the
        transformation, operator, leaf.
    args_at : int32 (N,)
        LEAF: offset of constant arguments in `args`.
    first, degree : int32 (N,)
        The node's edges are ``edges[first:first + degree]``; a selection's by rule number - 1.
    edges : int32
        Numbers of successors, -1 where a rule is missing.
    boxed : uint8 (N,)
        Whether the walker tests the node's box.
    boxes : float64 (6 N,)
        Hyper-bounding boxes: lower x y z, upper x y z.
    code, constants
        See `tape.Program`.
    matrices, forwards : float64
        Constant maps, 12 numbers each: local_from_parent and parent_from_local.
    args : float64
        Constant arguments of leaves, and kernel arguments of models.
    models_at : int32 (N,)
        LEAF with data whose numbers vary: offset into `models`; -1 for others.
    models : float64
        The number of models, the number of values, then for each model these values and the
        offset of its kernel arguments in `args`.
    sheet : uint8 (N,)
        LEAF: whether it is a sheet.
    arity : int32
        By kind of leaf, the number of its kernel arguments.
    low, high : float64
        Legal range of every argument, MAX_LEAF_ARGS for each kind of leaf; open lower ends are
        moved up by one ulp.
    initial : float64 (P,)
        Parameters at the axiom; NaN where nothing is assigned yet.
    attribute_slot, frame_slot : int
        First slot of the attributes, and of world_from_local (-1 if nobody asks for it).
    stack_size : int
        Height that the code's stack needs.
    visit_limit : int
        Most selections that one ray may look at.
    depth_limit : int
        Most selections on a path.
    """

    kind: NDArray[np.int32]
    code_at: NDArray[np.int32]
    detail: NDArray[np.int32]
    args_at: NDArray[np.int32]
    first: NDArray[np.int32]
    degree: NDArray[np.int32]
    edges: NDArray[np.int32]
    boxed: NDArray[np.uint8]
    boxes: NDArray[np.float64]
    code: NDArray[np.int32]
    constants: NDArray[np.float64]
    matrices: NDArray[np.float64]
    forwards: NDArray[np.float64]
    args: NDArray[np.float64]
    models_at: NDArray[np.int32]
    models: NDArray[np.float64]
    sheet: NDArray[np.uint8]
    arity: NDArray[np.int32]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    initial: NDArray[np.float64]
    attribute_slot: int
    frame_slot: int
    stack_size: int
    visit_limit: int
    depth_limit: int

    @property
    def nbytes(self) -> int:
        """Memory of all arrays in bytes."""
        return sum(a.nbytes for a in self if isinstance(a, np.ndarray))


class Models(NamedTuple):
    """What the tables need to know of leaves with data.

    Attributes
    ----------
    values
        By node, the values that the numbers of a leaf take, in a fixed order.
    place
        Returns the kernel arguments of a model.
    """

    values: Mapping[int, Collection[tuple[float, ...]]]
    place: Callable[[Model], Sequence[float]]


NO_MODELS = Models({}, lambda model: (0.0,) * MODEL_ARGS)


class _Packer:
    """Collects the arrays of one graph."""

    def __init__(self, graph: Graph, models: Models) -> None:
        self.graph = graph
        self.models_of = models
        slots = graph.slots
        frame_slot = slots[FRAME_SLOTS[0]] if graph.uses_frame else -1
        self.program = Program(slots, frame_slot)
        n = len(graph.nodes)
        self.kind, self.code_at, self.detail, self.args_at = (
            np.full(n, value, np.int32) for value in (0, -1, 0, 0)
        )
        self.first, self.degree = np.zeros(n, np.int32), np.zeros(n, np.int32)
        self.edges: list[int] = []
        self.matrices: list[float] = []
        self.forwards: list[float] = []
        self.args: list[float] = []
        self.models_at = np.full(n, -1, np.int32)
        self.models: list[float] = []
        self.sheet = np.zeros(n, np.uint8)

    def pack(self, k: int, node: Node) -> None:
        """Pack one node."""
        number = self.graph.number
        targets = [number[s] for s in node.successors]
        if isinstance(node, Selection):
            self.kind[k] = SELECTION
            rules = range(1, max(node.rules, default=0) + 1)
            targets = [number[node.rules[r]] if r in node.rules else -1 for r in rules]
            # Without a selection function there is one rule, whatever its number.
            select = node.select if node.select is not None else as_expr(max(node.rules))
            self.code_at[k] = self.program.add([select])
        elif isinstance(node, Calculation):
            self.kind[k] = CALCULATION
            names = [name for name, _ in node.assignments]
            exprs = [expr for _, expr in node.assignments]
            add = self.program.add_parallel if node.call else self.program.add
            self.code_at[k] = add(exprs, names)
        elif isinstance(node, Attribute):
            self.kind[k] = CALCULATION
            exprs = attribute_values(self.graph, node)
            stores = node.kind.slots[: len(exprs)]
            self.code_at[k] = self.program.add_parallel(exprs, stores)
        elif isinstance(node, Transformation):
            self._pack_transformation(k, node)
        elif isinstance(node, Operation):
            self.kind[k] = OPERATION
            self.detail[k] = node.operator.kind
        elif isinstance(node, Leaf):
            self.kind[k] = LEAF
            self.detail[k] = node.solid.kind
            self.sheet[k] = node.is_sheet
            if node.constants:
                self._pack_models(k, node)
            elif all(isinstance(a, Number) for a in node.args) and _legal(node):
                self.args_at[k] = len(self.args)
                self.args.extend(a.value for a in node.args if isinstance(a, Number))
            else:
                self.code_at[k] = self.program.add(node.args)
        self.first[k], self.degree[k] = len(self.edges), len(targets)
        self.edges.extend(targets)

    def _pack_models(self, k: int, node: Leaf) -> None:
        """Pack a leaf with data: one model, or a table from the values of its numbers to models."""
        varies = not all(isinstance(a, Number) for a in node.args)
        values = self.models_of.values.get(k, ()) if varies else [_constants(node)]
        if varies:
            self.code_at[k] = self.program.add(node.args)
            self.models_at[k] = len(self.models)
            self.models += [len(values), len(node.args)]
        self.args_at[k] = len(self.args)
        for args in values:
            if varies:
                self.models += [*args, len(self.args)]
            self.args += self.models_of.place(node.model(args))

    def _pack_transformation(self, k: int, node: Transformation) -> None:
        forward = _constant_matrix(node)
        inverse, regular = plain(invert)(forward) if forward else (IDENTITY, False)
        if forward and regular:
            self.kind[k] = CONSTANT_MATRIX
            self.detail[k] = len(self.matrices)
            self.matrices.extend(inverse)
            self.forwards.extend(forward)
        else:
            self.kind[k] = MATRIX
            self.detail[k] = node.transform.kind
            self.code_at[k] = self.program.add(node.args)


def _constant_matrix(node: Transformation) -> Affine | None:
    """Return the matrix if it is the same everywhere; the walker tells of faults in it."""
    world = any(FUNCTIONS[f].form is Form.WORLD for f in functions_of(*node.args))
    if world or parameters_of(*node.args):
        return None
    program = Program({})
    try:
        values = program.evaluate(program.add(node.args), [])
    except Fault:
        return None
    return plain(node.transform.kernel)(*values)  # type: ignore[no-any-return]


def _constants(node: Leaf) -> tuple[float, ...]:
    return tuple(a.value for a in node.args if isinstance(a, Number))


def _legal(node: Leaf) -> bool:
    """Return whether constant arguments are in their ranges; the walker reports them if not."""
    for parameter, arg in zip(node.parameters, node.args, strict=True):
        value = arg.value if isinstance(arg, Number) else 0.0
        low = parameter.low < value if parameter.open_low else parameter.low <= value
        if not (low and value <= parameter.high):
            return False
    return True


def pack(
    graph: Graph,
    boxes: NDArray[np.float64],
    values: Mapping[str, float] = GLOBALS,
    depth_limit: int = MOST_SELECTIONS,
    models: Models = NO_MODELS,
) -> tuple[Tables, Program]:
    """Pack a graph.

    Parameters
    ----------
    boxes : float64 (N, 6)
        Hyper-bounding boxes of the nodes.
    values
        Values of the global parameters.
    depth_limit
        Most selections on a path.
    models
        What is known of leaves with data.

    Returns
    -------
    Tables, Program
        The arrays, and the program that knows where its instructions come from.
    """
    packer = _Packer(graph, models)
    for k, node in enumerate(graph.nodes):
        packer.pack(k, node)
    slots = graph.slots
    initial = np.full(len(slots), np.nan)
    for name, value in {**GLOBALS, **values}.items():
        initial[slots[name]] = value
    for name, value in zip(ATTRIBUTE_SLOTS, ATTRIBUTE_DEFAULTS, strict=True):
        initial[slots[name]] = value
    if graph.uses_frame:
        frame = slots[FRAME_SLOTS[0]]
        initial[frame : frame + 12] = IDENTITY
    bounded = np.isfinite(boxes).any(axis=1) | (boxes[:, 0] > boxes[:, 3])
    union = packer.detail == 0
    tested = (packer.kind == SELECTION) | ((packer.kind == OPERATION) & ~union)
    low, high = _ranges()
    code, constants = packer.program.arrays()
    tables = Tables(
        kind=packer.kind,
        code_at=packer.code_at,
        detail=packer.detail,
        args_at=packer.args_at,
        first=packer.first,
        degree=packer.degree,
        edges=np.array(packer.edges or [0], np.int32),
        boxed=(bounded & tested).astype(np.uint8),
        boxes=np.ascontiguousarray(boxes).ravel(),
        code=code,
        constants=constants,
        matrices=np.array(packer.matrices or [0.0]),
        forwards=np.array(packer.forwards or [0.0]),
        args=np.array(packer.args or [0.0]),
        models_at=packer.models_at,
        models=np.array(packer.models or [0.0]),
        sheet=packer.sheet,
        arity=np.array(
            [MODEL_ARGS if s.constants else len(s.parameters) for s in LEAVES.values()], np.int32
        ),
        low=low,
        high=high,
        initial=initial,
        attribute_slot=slots[ATTRIBUTE_SLOTS[0]],
        frame_slot=packer.program.frame_slot,
        stack_size=max(packer.program.stack_size, 16),
        visit_limit=MOST_VISITS,
        depth_limit=depth_limit,
    )
    return tables, packer.program


def _ranges() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low = np.full((len(LEAVES), MAX_LEAF_ARGS), -np.inf)
    high = np.full((len(LEAVES), MAX_LEAF_ARGS), np.inf)
    for kind, solid in enumerate(LEAVES.values()):
        for j, p in enumerate(() if solid.constants else solid.parameters):
            low[kind, j] = np.nextafter(p.low, np.inf) if p.open_low else p.low
            high[kind, j] = p.high
    return low.ravel(), high.ravel()
