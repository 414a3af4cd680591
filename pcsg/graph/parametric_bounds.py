"""Boxes of states as functions of their values.

A side of a state's box is ``max(p_1, ..., p_n) + c`` over some of its values, or a constant,
whichever is larger: for a terrain the height of a triangle's corners and what displacements can add
below it. Every entry of `ranges` is walked once, those that it leads to first, with an affine form
for every parameter; a side that fits is one whose linear part is a convex combination of values.
What does not fit is bounded by the ranges of the values, and everything by the boxes of `ranges`.
Rounding is left to whoever uses the boxes: what is added here is of their size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

from pcsg.graph.affine_forms import (
    ANYTHING,
    Inputs,
    Linear,
    add_forms,
    along_box,
    along_point,
    form_of,
    multiply_matrices,
    range_of,
    scale_form,
    transform_forms,
)
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.extents import leaf_extent
from pcsg.graph.graph import FRAME_SLOTS
from pcsg.graph.hulls import INF
from pcsg.graph.intervals import evaluate, is_point, multiply, transform_matrix
from pcsg.graph.liveness import attribute_stores
from pcsg.graph.nodes import Attribute, Calculation, Leaf, Operation, Selection, Transformation
from pcsg.graph.operators import DIFFERENCE, INTERSECTION, Operator
from pcsg.graph.ordering import successors_first
from pcsg.graph.ranges import Key, Ranges, Values
from pcsg.vec import IDENTITY

_CONVEX = 1e-12
_SLIGHT = 1e-9

_UNIT = tuple(Linear({}, (x, x)) for x in IDENTITY)


class Side(NamedTuple):
    """One side of a box: ``max(max of the values in `group` + shift, floor)``.

    Lower sides are kept negated, so that all six are upper bounds.

    Attributes
    ----------
    group
        Slots of parameters; lower sides take their negative values.
    shift, floor
        Minus infinity where there is no such term.
    """

    group: tuple[int, ...]
    shift: float
    floor: float


class Sides(NamedTuple):
    """A box: lower x, y, z, then upper x, y, z; and its reach from the origin."""

    sides: tuple[Side, ...]
    reach: float


class RuleBounds(NamedTuple):
    """The box of a state that takes a rule, and the entries that the rule leads to, in order."""

    sides: Sides
    below: tuple[Key, ...]


class _Scope(NamedTuple):
    """What is known at a node: intervals, forms, and the matrix so far."""

    values: Values
    forms: Mapping[str, Linear]
    matrix: tuple[Linear, ...]


class _Join(NamedTuple):
    """Solids below an operation are to be combined."""

    operator: Operator
    arity: int


_ATTRIBUTES = frozenset(ATTRIBUTE_SLOTS)

Bound = Callable[[Sequence[Linear]], list[Linear]]

Candidates = list[list[Linear]]
"""For each side, upper bounds of which the largest holds."""


def bound_rules(ranges: Ranges) -> dict[tuple[Key, int], RuleBounds]:
    """Return the boxes of all entries, for every rule that they may take, by its number.

    What is no selection has one, number 0.
    """
    return _Measure(ranges).run()


class _Measure:
    def __init__(self, ranges: Ranges) -> None:
        self.ranges = ranges
        self.graph = ranges.graph
        self.slots = ranges.graph.slots
        self.names = {k: name for name, k in self.slots.items()}
        self.extents = ranges.extents()
        self.of_entries: dict[Key, Sides] = {}
        self.of_rules: dict[tuple[Key, int], RuleBounds] = {}
        self.inputs: Inputs = {}

    def run(self) -> dict[tuple[Key, int], RuleBounds]:
        """Measure the entries, each after those that it leads to where there is no cycle."""
        keys = list(self.ranges.entries)
        number = {key: k for k, key in enumerate(keys)}
        below = [
            list(dict.fromkeys(number[key] for key, _ in self.ranges.entries[k].below))
            for k in keys
        ]
        for k in successors_first(below):
            self._measure_entry(keys[k])
        return self.of_rules

    def _measure_entry(self, key: Key) -> None:
        values = self.ranges.entries[key].values
        start = max(key[0], 0)
        node = self.graph.nodes[start]
        shaping = self.ranges.live[start] - _ATTRIBUTES
        self.inputs = {self.slots[n]: x for n, x in values.items() if n in self.slots}
        forms = {
            name: Linear({self.slots[name]: 1.0}, (0.0, 0.0))
            if name in shaping and name in self.slots and not is_point(x)
            else Linear({}, x)
            for name, x in values.items()
        }
        scope = _Scope(values, forms, _UNIT)
        starts = [(0, start, key[0])]
        if key[0] >= 0 and isinstance(node, Selection):
            rules = self.ranges.rules(key, values)
            starts = [(k, self.graph.number[node.rules[k]], -1) for k in rules]
        every: Candidates = [[] for _ in range(6)]
        for rule, first, opened in starts:
            candidates, below = self._walk(first, opened, scope)
            for side, forms_of_side in zip(every, candidates, strict=True):
                side += forms_of_side
            self.of_rules[key, rule] = RuleBounds(self._sides(key, candidates), tuple(below))
        self.of_entries[key] = self._sides(key, every)

    def _sides(self, key: Key, candidates: Candidates) -> Sides:
        extent = self.extents[key]
        sides = []
        for i, forms in enumerate(candidates):
            sign = -1.0 if i < 3 else 1.0
            sides.append(_fit_side(forms, self.inputs, sign * extent.box[i], sign))
        return Sides(tuple(sides), extent.reach)

    def _walk(self, start: int, opened: int, scope: _Scope) -> tuple[Candidates, list[Key]]:
        """Return upper bounds of the solid at a node, and the entries that it leads to."""
        graph = self.graph
        below: list[Key] = []
        made: list[Candidates] = []
        todo: list[tuple[int, _Scope] | _Join] = [(start, scope)]
        while todo:
            entry = todo.pop()
            if isinstance(entry, _Join):
                parts = made[len(made) - entry.arity :]
                del made[len(made) - entry.arity :]
                made.append(self._combine(entry.operator, parts))
                continue
            n, scope = entry
            node = graph.nodes[n]
            if n in self.ranges.cuts and n != opened:
                key = self.ranges.key(n, scope.values)
                below.append(key)
                made.append(self._bound_rows(scope, partial(self._enter, key, scope.forms)))
                continue
            opened = -1
            if isinstance(node, Leaf):
                made.append(self._bound_leaf(node, scope))
            elif isinstance(node, Operation):
                operands = graph.successors[n]
                todo.append(_Join(node.operator, len(operands)))
                todo.extend((s, scope) for s in reversed(operands))
            else:
                todo.append((graph.successors[n][0], self._below(n, scope)))
        return made[0], below

    def _below(self, n: int, scope: _Scope) -> _Scope:
        """Return the scope below a calculation, an attribute, a transformation."""
        node = self.graph.nodes[n]
        values, forms, matrix = scope
        if isinstance(node, Calculation):
            now, found = dict(values), dict(forms)
            for name, expr in node.assignments:
                seen = (values, forms) if node.call else (now, found)
                interval = evaluate(expr, seen[0])
                form = form_of(expr, seen[1], self.inputs)
                now[name] = interval
                found[name] = Linear({}, interval) if is_point(interval) else form
            return _Scope(now, found, matrix)
        if isinstance(node, Attribute):
            now = self.ranges.attributed(node, values)
            own = {name: Linear({}, now[name]) for name in attribute_stores(node)}
            return _Scope(now, {**forms, **own}, matrix)
        if not isinstance(node, Transformation):
            return scope
        args = [form_of(e, forms, self.inputs) for e in node.args]
        inner = transform_forms(node.transform, args, self.inputs)
        below = self.graph.successors[n][0]
        if FRAME_SLOTS[0] in self.ranges.live[below]:
            intervals = [evaluate(e, values) for e in node.args]
            values = self.ranges.framed(transform_matrix(node.transform, intervals), values)
            forms = {**forms, **{name: Linear({}, values[name]) for name in FRAME_SLOTS}}
        product = inner if matrix is _UNIT else multiply_matrices(matrix, inner, self.inputs)
        return _Scope(values, forms, product)

    def _bound_rows(self, scope: _Scope, bound: Bound) -> Candidates:
        """Return upper bounds along the rows of a matrix, lower sides first."""
        found: Candidates = []
        for i in range(6):
            row = scope.matrix[4 * (i % 3) : 4 * (i % 3) + 4]
            found.append(bound(tuple(scale_form(x, -1.0) for x in row) if i < 3 else row))
        return found

    def _bound_leaf(self, node: Leaf, scope: _Scope) -> Candidates:
        if node.solid.primitives == 0:
            return [[] for _ in range(6)]
        if node.solid.corners:
            corners = node.solid.corners
            return self._bound_rows(scope, lambda row: [along_point(row, c) for c in corners])
        extent = leaf_extent(node, [evaluate(e, scope.values) for e in node.args])
        return self._bound_rows(scope, lambda row: along_box(row, extent.box, self.inputs))

    def _enter(self, key: Key, forms: Mapping[str, Linear], row: Sequence[Linear]) -> list[Linear]:
        """Return upper bounds of an entry along a row."""
        if key not in self.of_entries:  # around a cycle
            return along_box(row, self.extents[key].box, self.inputs)
        return _along_sides(
            row,
            self.of_entries[key],
            lambda k: forms.get(self.names[k], ANYTHING),
            self.inputs,
        )

    def _combine(self, operator: Operator, parts: list[Candidates]) -> Candidates:
        """Return upper bounds of what an operator makes of solids."""
        if operator is DIFFERENCE:
            return parts[0]
        if operator is INTERSECTION:
            # No intersection reaches farther than any one of its operands.
            if not all(all(part) for part in parts):
                return [[] for _ in range(6)]
            return [min((part[i] for part in parts), key=self._reach) for i in range(6)]
        return [[form for part in parts for form in part[i]] for i in range(6)]

    def _reach(self, forms: list[Linear]) -> float:
        return max(range_of(form, self.inputs)[1] for form in forms)


def _fit_side(forms: list[Linear], inputs: Inputs, limit: float, sign: float) -> Side:
    """Return a side that is nowhere below any of some upper bounds.

    Parameters
    ----------
    limit
        An upper bound from elsewhere.
    sign
        -1 for lower sides, whose groups take the negative values.
    """
    group: dict[int, None] = {}
    shift, floor = -INF, -INF
    for form in forms:
        slopes = {k: sign * x for k, x in form.linear.items()}
        if (
            slopes
            and abs(sum(slopes.values()) - 1.0) <= _CONVEX
            and min(slopes.values()) > -_SLIGHT
        ):
            # A slope slightly below zero: what it adds against another value of the group.
            spread = max(b - a for a, b in (inputs[k] for k in slopes))
            excess = spread * -sum(x for x in slopes.values() if x < 0.0)
            group |= dict.fromkeys(k for k, x in slopes.items() if x > 0.0)
            shift = max(shift, form.rest[1] + (excess if excess > 0.0 else 0.0))
        else:
            floor = max(floor, range_of(form, inputs)[1])
    if group and math.isfinite(shift) and not limit <= floor:
        return Side(tuple(sorted(group)), shift, floor)
    most = shift + max(
        (range_of(Linear({k: sign}, (0.0, 0.0)), inputs)[1] for k in group), default=0
    )
    return Side((), -INF, min(max(most, floor), limit))


def _along_sides(
    row: Sequence[Linear], sides: Sides, form_at: Callable[[int], Linear], inputs: Inputs
) -> list[Linear]:
    """Return the bounds of a box along a row; one of its sides may depend on inputs.

    Parameters
    ----------
    form_at
        The form, over the inputs, of each value that the sides depend on.
    """
    total = row[3]
    chosen: list[Linear] | None = None
    for k in range(3):
        slope = row[k]
        interval = range_of(slope, inputs)
        if interval == (0.0, 0.0):
            continue
        upper = _side_forms(sides.sides[k + 3], form_at, 1.0)
        lower = _side_forms(sides.sides[k], form_at, -1.0)
        if not upper or not lower:
            return []
        if not slope.linear and interval[0] == interval[1]:
            c = interval[0]
            options = [scale_form(f, abs(c)) for f in (upper if c > 0.0 else lower)]
            if chosen is None and any(f.linear for f in options):
                chosen = options
                continue
            most = max(range_of(f, inputs)[1] for f in options)
            total = add_forms(total, Linear({}, (-INF, most)))
            continue
        extent = (
            -max(range_of(f, inputs)[1] for f in lower),
            max(range_of(f, inputs)[1] for f in upper),
        )
        total = add_forms(total, Linear({}, multiply(interval, extent)))
    return [total] if chosen is None else [add_forms(total, f) for f in chosen]


def _side_forms(side: Side, form_at: Callable[[int], Linear], sign: float) -> list[Linear]:
    """Return the terms of a side (lower sides negated) as forms over the inputs."""
    found = [
        add_forms(scale_form(form_at(k), sign), Linear({}, (side.shift, side.shift)))
        for k in side.group
    ]
    if side.floor > -INF:
        found.append(Linear({}, (side.floor, side.floor)))
    return found
