"""Boxes of entries as functions of their inputs.

A side of an entry's box is ``max(p_1, ..., p_n) + c`` over some of its inputs, or a constant,
whichever is larger: for a terrain the height of a triangle's corners and what displacements can add
below it. One pass from the leaves up finds it. Values of inputs are followed as affine forms, a
linear part and an interval (Comba and Stolfi 1993); a side that fits is one whose linear part is a
convex combination of inputs. What does not fit is bounded by the ranges of the inputs, and
everything by the boxes of `ranges`. Rounding is left to whoever uses the boxes: what is
added here is of their size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from pcsg.graph.expr import Apply, Expr, Number, Parameter, operands, postorder
from pcsg.graph.extents import leaf_extent
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.hulls import INF, Bounds
from pcsg.graph.intervals import ALL, Interval, add, evaluate, multiply, transform_matrix
from pcsg.graph.liveness import successors_first
from pcsg.graph.nodes import Leaf
from pcsg.graph.recipes import Assign, Entry, FixedPart, LeafPart, Part, Recipe, Recipes
from pcsg.graph.transforms import Transform
from pcsg.vec import Affine

_CONVEX = 1e-12
_SLIGHT = 1e-9


class Side(NamedTuple):
    """One side of a box: ``max(max of the inputs in `group` + shift, floor)``.

    Lower sides are kept negated, so that all six are upper bounds.

    Attributes
    ----------
    group
        Numbers of inputs; lower sides take their negative values.
    shift, floor
        Minus infinity where there is no such term.
    """

    group: tuple[int, ...]
    shift: float
    floor: float


class Sides(NamedTuple):
    """The box of an entry: lower x, y, z, then upper x, y, z; and its reach from the origin."""

    sides: tuple[Side, ...]
    reach: float


class Linear(NamedTuple):
    """A linear part by number of input, and what is added to it."""

    linear: Mapping[int, float]
    rest: Interval


@dataclass
class _Registers:
    """What is known of the registers of a recipe, and of its matrices."""

    forms: dict[str, Linear]
    matrices: list[tuple[Linear, ...]]
    ranges: Sequence[Interval]


def entry_sides(recipes: Recipes, fixture_boxes: Sequence[Bounds]) -> list[Sides]:
    """Return the sides of every entry.

    Parameters
    ----------
    fixture_boxes
        The box of every fixture in its own frame.
    """
    return _Measure(recipes, fixture_boxes).run()


class _Measure:
    def __init__(self, recipes: Recipes, fixture_boxes: Sequence[Bounds]) -> None:
        self.recipes = recipes
        self.fixture_boxes = fixture_boxes
        extents = recipes.ranges.extents()
        self.extents = [extents[entry.key] for entry in recipes.entries]
        self.found: dict[int, Sides] = {}

    def run(self) -> list[Sides]:
        """Measure the entries, each after those that it leads to where there is no cycle."""
        for k in successors_first(self.recipes.successors):
            self.found[k] = self._sides_of(k)
        return [self.found[k] for k in range(len(self.found))]

    def _sides_of(self, number: int) -> Sides:
        entry, extent = self.recipes.entries[number], self.extents[number]
        candidates: list[list[Linear]] = [[] for _ in range(6)]
        for recipe in entry.rules.values():
            known = _run(entry, recipe)
            for part in recipe.parts:
                matrix = _matrix(part, known)
                for i in range(6):
                    row = matrix[4 * (i % 3) : 4 * (i % 3) + 4]
                    if i < 3:
                        row = tuple(_scaled(x, -1.0) for x in row)
                    candidates[i] += self._bounds_of(part, row, known)
        sides = []
        for i, forms in enumerate(candidates):
            sign = -1.0 if i < 3 else 1.0
            sides.append(_fit(forms, entry.ranges, sign * extent.box[i], sign))
        return Sides(tuple(sides), extent.reach)

    def _bounds_of(self, part: Part, row: Sequence[Linear], known: _Registers) -> list[Linear]:
        """Return upper bounds of a part along a row; their largest holds."""
        if isinstance(part, LeafPart):
            node = self.recipes.graph.nodes[part.node]
            assert isinstance(node, Leaf)
            if node.solid.corners:
                return [_along(row, corner) for corner in node.solid.corners]
            return _along_box(row, leaf_extent(node, list(part.ranges)).box, known)
        if isinstance(part, FixedPart):
            return _along_box(row, self.fixture_boxes[part.fixture], known)
        if part.entry not in self.found:  # around a cycle
            return _along_box(row, self.extents[part.entry].box, known)
        values = [_form(v, known) for v in part.values]
        return _along_sides(row, self.found[part.entry], values, known)


def _fit(forms: list[Linear], ranges: Sequence[Interval], limit: float, sign: float) -> Side:
    """Return a side that is nowhere below any of some upper bounds.

    Parameters
    ----------
    limit
        An upper bound from elsewhere.
    sign
        -1 for lower sides, whose groups take the inputs' negative values.
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
            # A slope slightly below zero: what it adds against another input of the group.
            spread = max(b - a for a, b in (ranges[k] for k in slopes))
            excess = spread * -sum(x for x in slopes.values() if x < 0.0)
            group |= dict.fromkeys(k for k, x in slopes.items() if x > 0.0)
            shift = max(shift, form.rest[1] + (excess if excess > 0.0 else 0.0))
        else:
            floor = max(floor, _range(form, ranges)[1])
    if group and math.isfinite(shift) and not limit <= floor:
        return Side(tuple(sorted(group)), shift, floor)
    most = shift + max((_range(Linear({k: sign}, (0.0, 0.0)), ranges)[1] for k in group), default=0)
    return Side((), -INF, min(max(most, floor), limit))


def _range(form: Linear, ranges: Sequence[Interval]) -> Interval:
    total = form.rest
    for k, x in form.linear.items():
        total = add(total, multiply((x, x), ranges[k]))
    return total


def _run(entry: Entry, recipe: Recipe) -> _Registers:
    """Follow a recipe on affine forms."""
    forms = {f"r{k}": Linear({k: 1.0}, (0.0, 0.0)) for k in range(len(entry.inputs))}
    known = _Registers(forms, [], entry.ranges)
    for step in recipe.steps:
        if isinstance(step, Assign):
            forms[f"r{step.register}"] = _form(step.expr, known)
            continue
        if step.constant is not None:
            inner = tuple(Linear({}, (x, x)) for x in step.constant)
        else:
            assert step.transform is not None
            inner = _transform_forms(step.transform, [_form(a, known) for a in step.args], known)
        outer = known.matrices[step.source] if step.source >= 0 else None
        known.matrices.append(inner if outer is None else _product(outer, inner, known))
    return known


def _form(expr: Expr, known: _Registers) -> Linear:
    """Return the affine form of an expression over registers."""
    stack: list[Linear] = []
    for e in postorder(expr, operands):
        if isinstance(e, Number):
            stack.append(Linear({}, (e.value, e.value)))
        elif isinstance(e, Parameter):
            stack.append(known.forms[e.name])
        elif isinstance(e, Apply):
            at = len(stack) - len(e.args)
            args = stack[at:]
            del stack[at:]
            stack.append(_applied(e, args, known))
    return stack[0]


def _applied(e: Apply, args: list[Linear], known: _Registers) -> Linear:
    if e.function in ("+", "-") and len(args) == 2:
        return _sum(args[0], args[1] if e.function == "+" else _scaled(args[1], -1.0))
    if e.function == "neg":
        return _scaled(args[0], -1.0)
    if e.function in ("*", "/") and len(args) == 2:
        product = _times(args[0], args[1], e.function == "/")
        if product is not None:
            return product
    if FUNCTIONS[e.function].form is Form.WORLD:
        return Linear({}, ALL)
    names = {f"a{k}": _range(a, known.ranges) for k, a in enumerate(args)}
    call = Apply(e.function, tuple(Parameter(name) for name in names), e.seeds)
    return Linear({}, evaluate(call, names))


def _times(a: Linear, b: Linear, divides: bool) -> Linear | None:
    """Return a product or a quotient where one factor is a number."""
    if not b.linear and b.rest[0] == b.rest[1] and not (divides and b.rest[0] == 0.0):
        return _scaled(a, 1.0 / b.rest[0] if divides else b.rest[0])
    if not divides and not a.linear and a.rest[0] == a.rest[1]:
        return _scaled(b, a.rest[0])
    return None


def _sum(a: Linear, b: Linear) -> Linear:
    linear = dict(a.linear)
    for k, x in b.linear.items():
        linear[k] = linear.get(k, 0.0) + x
        if abs(linear[k]) < 1e-15:
            del linear[k]
    return Linear(linear, add(a.rest, b.rest))


def _scaled(a: Linear, by: float) -> Linear:
    if by == 0.0:
        return Linear({}, (0.0, 0.0))
    return Linear({k: x * by for k, x in a.linear.items()}, multiply(a.rest, (by, by)))


def _transform_forms(
    transform: Transform, args: list[Linear], known: _Registers
) -> tuple[Linear, ...]:
    """Return the entries of a transformation's matrix."""
    intervals = transform_matrix(transform, [_range(a, known.ranges) for a in args])
    if transform.name.startswith(("rot", "align")):
        return tuple(Linear({}, x) for x in intervals)
    # The others write their arguments into the matrix unchanged.
    marks = [(float(k + 2), float(k + 2)) for k in range(len(args))]
    places = transform_matrix(transform, marks)
    of_mark = dict(zip(marks, args, strict=True))
    return tuple(
        of_mark.get(place, Linear({}, interval))
        for place, interval in zip(places, intervals, strict=True)
    )


def _product(a: tuple[Linear, ...], b: tuple[Linear, ...], known: _Registers) -> tuple[Linear, ...]:
    entries = []
    for i in range(0, 12, 4):
        for j in range(4):
            total = a[i + 3] if j == 3 else Linear({}, (0.0, 0.0))
            for k in range(3):
                total = _sum(total, _multiplied(a[i + k], b[4 * k + j], known))
            entries.append(total)
    return tuple(entries)


def _multiplied(a: Linear, b: Linear, known: _Registers) -> Linear:
    product = _times(a, b, False)
    if product is not None:
        return product
    return Linear({}, multiply(_range(a, known.ranges), _range(b, known.ranges)))


def _matrix(part: Part, known: _Registers) -> tuple[Linear, ...]:
    if isinstance(part.matrix, Affine):
        return tuple(Linear({}, (x, x)) for x in part.matrix)
    return known.matrices[part.matrix]


def _along(row: Sequence[Linear], p: Sequence[float]) -> Linear:
    total = row[3]
    for x, a in zip(p, row, strict=False):
        total = _sum(total, _scaled(a, x))
    return total


def _along_box(row: Sequence[Linear], box: Bounds, known: _Registers) -> list[Linear]:
    if any(box[k] > box[k + 3] for k in range(3)):
        return []
    total = row[3]
    for k in range(3):
        slope = _range(row[k], known.ranges)
        if slope != (0.0, 0.0):
            total = _sum(total, Linear({}, multiply(slope, (box[k], box[k + 3]))))
    return [total]


def _along_sides(
    row: Sequence[Linear], sides: Sides, values: list[Linear], known: _Registers
) -> list[Linear]:
    """Return the bounds of an entry's box along a row; one of its sides may depend on inputs."""
    total = row[3]
    chosen: list[Linear] | None = None
    for k in range(3):
        slope = row[k]
        interval = _range(slope, known.ranges)
        if interval == (0.0, 0.0):
            continue
        upper = _side_forms(sides.sides[k + 3], values, 1.0)
        lower = _side_forms(sides.sides[k], values, -1.0)
        if not upper or not lower:
            return []
        if not slope.linear and interval[0] == interval[1]:
            c = interval[0]
            options = [_scaled(f, abs(c)) for f in (upper if c > 0.0 else lower)]
            if chosen is None and any(f.linear for f in options):
                chosen = options
                continue
            most = max(_range(f, known.ranges)[1] for f in options)
            total = _sum(total, Linear({}, (-INF, most)))
            continue
        extent = (
            -max(_range(f, known.ranges)[1] for f in lower),
            max(_range(f, known.ranges)[1] for f in upper),
        )
        total = _sum(total, Linear({}, multiply(interval, extent)))
    return [total] if chosen is None else [_sum(total, f) for f in chosen]


def _side_forms(side: Side, values: list[Linear], sign: float) -> list[Linear]:
    """Return the terms of a side (lower sides negated) as forms over the inputs outside."""
    forms = [
        _sum(_scaled(values[k], sign), Linear({}, (side.shift, side.shift))) for k in side.group
    ]
    if side.floor > -INF:
        forms.append(Linear({}, (side.floor, side.floor)))
    return forms
