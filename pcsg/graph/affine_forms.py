"""Affine forms: what depends linearly on inputs, and an interval for the rest.

Values are followed as forms (Comba and Stolfi 1993, "Affine arithmetic and its applications to
computer graphics"): a linear part and an interval. What is not linear is bounded by the ranges of
the inputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pcsg.graph.expr import Apply, Expr, Number, Parameter, operands, postorder
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.hulls import Bounds
from pcsg.graph.intervals import ALL, Interval, add, evaluate, multiply, transform_matrix
from pcsg.graph.transforms import Transform

Inputs = Mapping[int, Interval]
"""The ranges of inputs, by their numbers."""


class Linear(NamedTuple):
    """A linear part by number of input, and what is added to it."""

    linear: Mapping[int, float]
    rest: Interval


ANYTHING = Linear({}, ALL)


def range_of(form: Linear, inputs: Inputs) -> Interval:
    """Return what values a form can take."""
    total = form.rest
    for k, x in form.linear.items():
        total = add(total, multiply((x, x), inputs[k]))
    return total


def form_of(expr: Expr, forms: Mapping[str, Linear], inputs: Inputs) -> Linear:
    """Return the affine form of an expression, from those of the parameters in it."""
    stack: list[Linear] = []
    for e in postorder(expr, operands):
        if isinstance(e, Number):
            stack.append(Linear({}, (e.value, e.value)))
        elif isinstance(e, Parameter):
            stack.append(forms.get(e.name, ANYTHING))
        elif isinstance(e, Apply):
            at = len(stack) - len(e.args)
            args = stack[at:]
            del stack[at:]
            stack.append(_applied(e, args, inputs))
    return stack[0]


def _applied(e: Apply, args: list[Linear], inputs: Inputs) -> Linear:
    if e.function in ("+", "-") and len(args) == 2:
        return add_forms(args[0], args[1] if e.function == "+" else scale_form(args[1], -1.0))
    if e.function == "neg":
        return scale_form(args[0], -1.0)
    if e.function in ("*", "/") and len(args) == 2:
        product = _times(args[0], args[1], e.function == "/")
        if product is not None:
            return product
    if FUNCTIONS[e.function].form is Form.WORLD:
        return Linear({}, ALL)
    names = {f"a{k}": range_of(a, inputs) for k, a in enumerate(args)}
    call = e.with_args(tuple(Parameter(name) for name in names))
    return Linear({}, evaluate(call, names))


def _times(a: Linear, b: Linear, divides: bool) -> Linear | None:
    """Return a product or a quotient where one factor is a number."""
    if not b.linear and b.rest[0] == b.rest[1] and not (divides and b.rest[0] == 0.0):
        return scale_form(a, 1.0 / b.rest[0] if divides else b.rest[0])
    if not divides and not a.linear and a.rest[0] == a.rest[1]:
        return scale_form(b, a.rest[0])
    return None


def add_forms(a: Linear, b: Linear) -> Linear:
    """Return the sum of two forms."""
    linear = dict(a.linear)
    for k, x in b.linear.items():
        linear[k] = linear.get(k, 0.0) + x
        if abs(linear[k]) < 1e-15:
            del linear[k]
    return Linear(linear, add(a.rest, b.rest))


def scale_form(a: Linear, by: float) -> Linear:
    """Return a multiple of a form."""
    if by == 0.0:
        return Linear({}, (0.0, 0.0))
    return Linear({k: x * by for k, x in a.linear.items()}, multiply(a.rest, (by, by)))


def transform_forms(transform: Transform, args: list[Linear], inputs: Inputs) -> tuple[Linear, ...]:
    """Return the entries of a transformation's matrix."""
    intervals = transform_matrix(transform, [range_of(a, inputs) for a in args])
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


def multiply_matrices(
    a: tuple[Linear, ...], b: tuple[Linear, ...], inputs: Inputs
) -> tuple[Linear, ...]:
    """Return the product of two matrices of forms."""
    entries = []
    for i in range(0, 12, 4):
        for j in range(4):
            total = a[i + 3] if j == 3 else Linear({}, (0.0, 0.0))
            for k in range(3):
                total = add_forms(total, multiply_forms(a[i + k], b[4 * k + j], inputs))
            entries.append(total)
    return tuple(entries)


def multiply_forms(a: Linear, b: Linear, inputs: Inputs) -> Linear:
    """Return the product of two forms; the linear part is kept where one is a number."""
    product = _times(a, b, False)
    if product is not None:
        return product
    return Linear({}, multiply(range_of(a, inputs), range_of(b, inputs)))


def along_point(row: Sequence[Linear], p: Sequence[float]) -> Linear:
    """Return where a row of a matrix takes a point."""
    total = row[3]
    for x, a in zip(p, row, strict=False):
        total = add_forms(total, scale_form(a, x))
    return total


def along_box(row: Sequence[Linear], box: Bounds, inputs: Inputs) -> list[Linear]:
    """Return the largest that a row of a matrix makes of a box; nothing of an empty one."""
    if any(box[k] > box[k + 3] for k in range(3)):
        return []
    total = row[3]
    for k in range(3):
        slope = range_of(row[k], inputs)
        if slope != (0.0, 0.0):
            total = add_forms(total, Linear({}, multiply(slope, (box[k], box[k + 3]))))
    return [total]
