"""The right-hand side of a rule as straight code: what is computed twice is computed once.

A right-hand side is followed with an expression over *registers* for every parameter. What a
program is given, the slots that are live at its start, stands in the first registers, and stays
there; every value that is computed has a register of its own. So nothing is saved and restored
between operands, and equal terms, which macros write into the text time and again, have one
register (`graph.sharing`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, cast

from pcsg.graph.code import GraphCode, code_of, compose_affine, invert_affine
from pcsg.graph.expr import Apply, Expr, Number, Parameter, as_expr, signature
from pcsg.graph.graph import FRAME_SLOTS
from pcsg.graph.liveness import Liveness
from pcsg.graph.nodes import Calculation, Leaf, Operation, Selection, Transformation
from pcsg.graph.operators import UNION
from pcsg.graph.sharing import Assign, register, share_terms, substitute
from pcsg.jit import plain
from pcsg.vec import IDENTITY, Affine

SMALL = 400
"""Nodes of a right-hand side up to which constant matrices are worked out beforehand."""


class PushLeaf(NamedTuple):
    """A primitive: its node; its arguments, and behind them its attributes; its matrix.

    The matrix of this and of the other steps is None where it is the one that was placed last.
    """

    node: int
    values: tuple[Expr, ...]
    matrix: Affine | None


class PushState(NamedTuple):
    """A module: its node, the slots that matter there with their values, which rule; its matrix."""

    node: int
    slots: tuple[int, ...]
    values: tuple[Expr, ...]
    rule: Expr
    matrix: Affine | None


class Place(NamedTuple):
    """The matrix becomes what it was times a transformation's."""

    node: int
    values: tuple[Expr, ...]
    matrix: Affine | None


class PlaceConstant(NamedTuple):
    """The matrix becomes what was placed last times a constant."""

    constant: Affine


class Frame(NamedTuple):
    """The frame at a register, times the matrix that was placed last, goes to other registers."""

    source: int
    target: int


class Check(NamedTuple):
    """What is assigned on must have a value."""

    register: int


class Begin(NamedTuple):
    """An operation begins."""

    operator: int


class Pop(NamedTuple):
    """The matrix is again what it was before the last place."""


class End(NamedTuple):
    """An operation ends."""


_POP, _END = Pop(), End()


class Compute(NamedTuple):
    """An assignment in a frame, whose registers begin here; -1 where nobody asks for it."""

    assign: Assign
    frame: int


Step = PushLeaf | PushState | Place | PlaceConstant | Frame | Check | Begin | Pop | End | Compute


class _Scope(NamedTuple):
    """What is known at a node: values, the matrix if it is constant, and where the frame stands."""

    values: Mapping[str, Expr]
    matrix: Affine | None
    frame: int


class Straight:
    """The steps of a right-hand side.

    Parameters
    ----------
    code, liveness
        Of the graph.
    modules
        Nodes of modules.
    without
        Nodes that are taken to be empty.
    attributes
        Names of the attributes that are assigned somewhere.

    Attributes
    ----------
    steps
        In the order of execution.
    registers
        How many there are.
    matrices, operations, items
        How many matrices and operations are nested at most, and the number of items.
    """

    def __init__(
        self,
        code: GraphCode,
        liveness: Liveness,
        modules: Mapping[int, int],
        without: frozenset[int],
        attributes: Sequence[str],
    ) -> None:
        self.graph = code.graph
        self.slots = code.slots
        self.frame_slot = code.frame_slot
        self.liveness = liveness
        self.modules = modules
        self.without = without
        self.attributes = attributes
        self.steps: list[Step] = []
        self.registers = 0
        self.matrices, self.operations, self.items = 1, 0, 0
        self._known: dict[tuple[object, ...], Parameter] = {}
        self._given = 0
        self._checked: set[int] = set()
        self._small = True
        self._names = tuple(self.slots)

    def follow(self, start: int, opened: bool) -> None:
        """Follow a right-hand side.

        Parameters
        ----------
        opened
            Whether to look into the module that it begins with.
        """
        graph = self.graph
        given = {slot: k for k, slot in enumerate(self.liveness.slots[start])}
        self.registers = self._given = len(given)
        # Of the others nobody asks for the value.
        nothing = Number(math.nan)
        values = {n: register(given[k]) if k in given else nothing for n, k in self.slots.items()}
        todo: list[tuple[int, _Scope] | Pop | End] = [
            (start, _Scope(values, IDENTITY, given.get(self.frame_slot, -1)))
        ]
        matrices, operations = 1, 0
        while todo:
            entry = todo.pop()
            if entry is _POP:
                matrices -= 1
                self.steps.append(_POP)
                continue
            if entry is _END:
                operations -= 1
                self.steps.append(_END)
                continue
            n, scope = entry  # type: ignore[misc]  # neither of the two
            node = graph.nodes[n]
            self._small = self._small and len(self.steps) < SMALL
            if n in self.without:
                self.steps += [Begin(UNION.kind), _END]
                self.operations = max(self.operations, operations + 1)
                self.items += 1
            elif n in self.modules and not (opened and n == start):
                self._enter(n, scope)
            elif isinstance(node, Leaf):
                args = tuple([self._simple(e, scope) for e in node.args])
                looks = tuple([scope.values[name] for name in self.attributes])
                self.steps.append(PushLeaf(n, args + looks, scope.matrix))
                self.items += 1
            elif isinstance(node, Operation):
                self.steps.append(Begin(node.operator.kind))
                self.items += 1
                operations += 1
                todo.append(_END)
                todo.extend((s, scope) for s in reversed(graph.successors[n]))
            elif isinstance(node, Transformation):
                (s,) = graph.successors[n]
                below = self._place(n, s, node, scope)
                if below.matrix is None:
                    matrices += 1
                    todo.append(_POP)
                todo.append((s, below))
            else:
                todo.append((graph.successors[n][0], self._assign(n, scope)))
            opened = opened and n != start
            self.matrices = max(self.matrices, matrices)
            self.operations = max(self.operations, operations)
        if self.frame_slot < 0 and self._known:
            self._share()

    def _enter(self, n: int, scope: _Scope) -> None:
        live = self.liveness.slots[n]
        values = tuple(scope.values[self._names[k]] for k in live)
        node, rule = self.graph.nodes[n], cast(Expr, Number(0.0))
        if isinstance(node, Selection) and node.select is not None:
            rule = self._simple(as_expr(node.select), scope)
        self.steps.append(PushState(n, tuple(live), values, rule, scope.matrix))
        self.items += 1

    def _assign(self, n: int, scope: _Scope) -> _Scope:
        """Return the scope below a calculation or an attribute."""
        node = self.graph.nodes[n]
        exprs, stores = code_of(self.graph, n, node, self.liveness)
        if not stores:
            return scope
        parallel = isinstance(node, Calculation) and node.call
        below = dict(scope.values)
        seen = scope if parallel else scope._replace(values=below)
        for name, expr in zip(stores, exprs, strict=True):
            value = self._simple(expr, seen)
            if isinstance(value, Parameter):
                self._check(int(value.name[1:]))
            below[name] = value
        return _Scope(below, scope.matrix, scope.frame)

    def _check(self, k: int) -> None:
        """Have it checked that a slot has a value; what is computed has one."""
        if k < self._given and k not in self._checked:
            self._checked.add(k)
            self.steps.append(Check(k))

    def _simple(self, expr: Expr, scope: _Scope) -> Expr:
        """Return a number or a register for an expression, which is evaluated once."""
        if isinstance(expr, Number):
            return expr
        expr = substitute(expr, scope.values)
        if not isinstance(expr, Apply):
            return expr
        # Whatever asks for the frame is told apart by it.
        key = (scope.frame, *signature(expr))
        if key not in self._known:
            self._known[key] = register(self.registers)
            self.steps.append(Compute(Assign(self.registers, expr), scope.frame))
            self.registers += 1
        return self._known[key]

    def _place(self, n: int, below: int, node: Transformation, scope: _Scope) -> _Scope:
        """Return the scope below a transformation."""
        args = tuple([self._simple(e, scope) for e in node.args])
        numbers = [a.value for a in args if isinstance(a, Number)] if self._small else ()
        asked = scope.frame >= 0 and FRAME_SLOTS[0] in self.liveness.live[below]
        if self._small and self.frame_slot < 0 and len(numbers) == len(args):
            constant: Affine = plain(node.transform.kernel)(*numbers)
            if all(map(math.isfinite, constant)) and invert_affine(constant)[1]:
                if scope.matrix is None:
                    self.steps.append(PlaceConstant(constant))
                    return scope
                whole: Affine = compose_affine(scope.matrix, constant)
                return scope._replace(matrix=whole)
        self.steps.append(Place(n, args, scope.matrix))
        if scope.matrix is not None:
            scope = scope._replace(matrix=None)
        if not asked:
            return scope
        frame = self.registers
        self.registers += 12
        self.steps.append(Frame(scope.frame, frame))
        own = {name: register(frame + k) for k, name in enumerate(FRAME_SLOTS)}
        return scope._replace(values={**scope.values, **own}, frame=frame)

    def _share(self) -> None:
        """Let registers stand for terms that are evaluated more than once."""
        assigns = [step.assign if isinstance(step, Compute) else None for step in self.steps]
        shared, self.registers = share_terms(assigns, self.registers)
        # Nothing stands in the way of arithmetic, so all of it comes first, in one piece.
        found = [own for before, after in shared for own in (*before, after) if own is not None]
        checks = [step for step in self.steps if isinstance(step, Check)]
        rest = [step for step in self.steps if not isinstance(step, (Compute, Check))]
        self.steps = [*checks, *(Compute(own, -1) for own in found), *rest]
