"""The code of all nodes of a graph, evaluated in plain Python with its results remembered.

What a node computes depends on the slots that it reads. Results are kept by the bits of those, so
that constants are computed once, and so is what many states have in common.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from struct import Struct

from pcsg.errors import SourceSpan, UsageError
from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS, ATTRIBUTE_SLOTS
from pcsg.graph.expr import Expr
from pcsg.graph.faults import (
    BAD_ARGUMENT,
    NOT_FINITE,
    SELECTION_RANGE,
    SINGULAR_MATRIX,
    UNASSIGNED_PARAMETER,
)
from pcsg.graph.graph import FRAME_SLOTS, GLOBALS, Graph
from pcsg.graph.liveness import Liveness, attribute_stores, attribute_values, reads
from pcsg.graph.nodes import Attribute, Calculation, Leaf, Node, Selection, Transformation
from pcsg.graph.tape import UNASSIGNED, Fault, Program
from pcsg.jit import plain
from pcsg.vec import IDENTITY, Affine, compose, invert

compose_affine = plain(compose)
invert_affine = plain(invert)

_REMEMBERED = 100_000
"""Results kept before all are forgotten; continuous parameters never repeat."""


@dataclass
class NodeFault(Exception):
    """A node cannot be evaluated; see `faults` for the kinds."""

    kind: str
    node: int
    span: SourceSpan | None
    detail: str = ""
    params: list[float] | None = None
    """The slots at that moment, where they are others than before the node."""


class GraphCode:
    """Evaluates the nodes of a graph.

    Parameters
    ----------
    graph
        The graph.
    liveness
        Assignments whose values are not live are left out: states do not keep what they read.
    """

    def __init__(self, graph: Graph, liveness: Liveness) -> None:
        self.graph = graph
        frame = graph.slots[FRAME_SLOTS[0]] if graph.uses_frame else -1
        # Slots of names that nothing assigns: reading them is a fault of its own.
        names = dict.fromkeys([*graph.slots, *sorted(_unknown(graph))])
        self.slots: Mapping[str, int] = {name: k for k, name in enumerate(names)}
        self.frame_slot = frame
        self.program = Program(self.slots, frame)
        self.liveness = liveness
        self._at: dict[int, int] = {}
        self._stores: dict[int, tuple[int, ...]] = {}
        self._reads: dict[int, tuple[int, ...]] = {}
        self._memory: dict[tuple[int, bytes], object] = {}

    def _add(self, k: int) -> None:
        """Write the code of a node, when it is first needed."""
        node = self.graph.nodes[k]
        exprs, stores = code_of(self.graph, k, node, self.liveness)
        if isinstance(node, Calculation) and node.call:
            at = self.program.add_parallel(exprs, stores)
        else:
            at = self.program.add(exprs, stores) if exprs else -1
        self._at[k] = at
        self._stores[k] = tuple(dict.fromkeys([self.slots[s] for s in stores]))

    def _reads_of(self, k: int) -> tuple[int, ...]:
        """Return the slots that a node reads, found when it is first evaluated."""
        if k not in self._reads:
            node = self.graph.nodes[k]
            exprs, stores = code_of(self.graph, k, node, self.liveness)
            names: set[str] = set()
            assigned: set[str] = set()
            for i, expr in enumerate(exprs):
                names |= reads(expr) - assigned
                if stores and not (isinstance(node, Calculation) and node.call):
                    assigned.add(stores[i])
            self._reads[k] = tuple(sorted(self.slots[n] for n in names))
        return self._reads[k]

    def code_at(self, k: int) -> int:
        """Return where the code of a node begins on the tape, -1 where it computes nothing."""
        if k not in self._at:
            self._add(k)
        return self._at[k]

    def stores(self, k: int) -> tuple[int, ...]:
        """Return the slots that a node assigns."""
        if k not in self._at:
            self._add(k)
        return self._stores[k]

    def initial(self, values: Mapping[str, float] | None = None) -> list[float]:
        """Return the slots as the axiom sees them: NaN where nothing is assigned.

        Raises
        ------
        UsageError
            A value is given for something that is not a global parameter.
        """
        params = [math.nan] * len(self.slots)
        for name, value in (GLOBALS | dict(values or {})).items():
            if name not in GLOBALS:
                raise UsageError(f"`{name}` is not a global parameter")
            params[self.slots[name]] = float(value)
        for name, value in zip(ATTRIBUTE_SLOTS, ATTRIBUTE_DEFAULTS, strict=True):
            params[self.slots[name]] = value
        if self.frame_slot >= 0:
            params[self.frame_slot : self.frame_slot + 12] = IDENTITY
        return params

    def _key(self, k: int, params: list[float]) -> tuple[int, bytes]:
        read = self._reads_of(k)
        return k, _packer(len(read))(*[params[i] for i in read])

    def _remember(self, key: tuple[int, bytes], value: object) -> None:
        if len(self._memory) >= _REMEMBERED:
            self._memory.clear()
        self._memory[key] = value

    def _run(self, k: int, params: list[float]) -> list[float]:
        try:
            return self.program.evaluate(self.code_at(k), params)
        except Fault as fault:
            expr = self.program.exprs[fault.instruction]
            kind, detail = NOT_FINITE, ""
            if fault.status == UNASSIGNED:
                kind, detail = UNASSIGNED_PARAMETER, f"`{getattr(expr, 'name', '')}`"
            else:
                detail = f"`{getattr(expr, 'function', '')}`"
            raise NodeFault(kind, k, self.program.span(fault.instruction), detail) from None

    def assign(self, k: int, params: list[float]) -> list[float]:
        """Return the slots below a calculation or an attribute."""
        stores = self.stores(k)
        if not stores:
            return params
        key = self._key(k, params)
        below = params.copy()
        values = self._memory.get(key)
        if values is None:
            try:
                self._run(k, below)
            except NodeFault as fault:
                fault.params = below  # with what the block has assigned so far
                raise
            self._remember(key, [below[i] for i in stores])
        else:
            for i, value in zip(stores, values, strict=True):  # type: ignore[call-overload]
                below[i] = value
        return below

    def select(self, k: int, params: list[float]) -> int:
        """Return the number of the rule that a selection takes."""
        node = self.graph.nodes[k]
        assert isinstance(node, Selection)
        if node.select is None:
            return next(iter(node.rules))
        key = self._key(k, params)
        rule = self._memory.get(key)
        if rule is None:
            value = self._run(k, params)[0]
            rule = round(value)  # halves to even
            if rule not in node.rules:
                known = ", ".join(str(r) for r in sorted(node.rules))
                raise NodeFault(
                    SELECTION_RANGE,
                    k,
                    getattr(node.select, "span", None),
                    f"its value is {value:.17g}, the rules are {known}",
                )
            self._remember(key, rule)
        assert isinstance(rule, int)
        return rule

    def matrix(self, k: int, params: list[float]) -> Affine:
        """Return the matrix of a transformation: outer coordinates from inner ones."""
        node = self.graph.nodes[k]
        assert isinstance(node, Transformation)
        key = self._key(k, params)
        matrix = self._memory.get(key)
        if matrix is None:
            args = self._run(k, params) if node.args else []
            matrix = plain(node.transform.kernel)(*args)
            if not invert_affine(matrix)[1]:
                shown = ", ".join(f"{a:.17g}" for a in args)
                raise NodeFault(SINGULAR_MATRIX, k, None, f"{node.transform.name}({shown})")
            self._remember(key, matrix)
        assert isinstance(matrix, Affine)
        return matrix

    def frame_below(self, params: list[float], matrix: Affine) -> list[float]:
        """Return the slots below a transformation where somebody asks for the frame."""
        at = self.frame_slot
        below = params.copy()
        below[at : at + 12] = compose_affine(Affine(*params[at : at + 12]), matrix)
        return below

    def leaf_arguments(self, k: int, params: list[float]) -> tuple[float, ...]:
        """Return the checked arguments of a leaf."""
        node = self.graph.nodes[k]
        assert isinstance(node, Leaf)
        if not node.args:
            return ()
        key = self._key(k, params)
        args = self._memory.get(key)
        if args is None:
            args = tuple(self._run(k, params))
            for parameter, expr, x in zip(node.parameters, node.args, args, strict=True):
                low_ok = x > parameter.low if parameter.open_low else x >= parameter.low
                if not (low_ok and x <= parameter.high):
                    raise NodeFault(
                        BAD_ARGUMENT,
                        k,
                        getattr(expr, "span", None),
                        f"{parameter.name} = {x:.17g}, legal is {parameter.condition}",
                    )
            self._remember(key, args)
        assert isinstance(args, tuple)
        return args


@cache
def _packer(n: int) -> Callable[..., bytes]:
    """Return what turns so many numbers into their bits."""
    return Struct(f"{n}d").pack


def code_of(
    graph: Graph, k: int, node: Node, liveness: Liveness
) -> tuple[Sequence[Expr], Sequence[str]]:
    """Return the expressions of a node and the names that they are assigned to."""
    if isinstance(node, (Transformation, Leaf)):
        return node.args, ()
    if isinstance(node, Selection):
        return () if node.select is None else (node.select,), ()
    if isinstance(node, Calculation):
        used = [node.assignments[i] for i in liveness.used_assignments(k)]
        return [expr for _, expr in used], [name for name, _ in used]
    if isinstance(node, Attribute):
        if not liveness.reaches(k, node):
            return (), ()
        return attribute_values(graph, node), attribute_stores(node)
    return (), ()


def _unknown(graph: Graph) -> set[str]:
    """Return the names that are read but have no slot."""
    names: set[str] = set()
    for exprs in graph.formulas.values():
        names |= reads(*exprs)
    return names - set(graph.slots)
