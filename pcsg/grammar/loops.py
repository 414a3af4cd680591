"""Loops as modules of their own: `for(i, a, b, step)` and `repeat(n, ...)`.

A `for` halves its range until one value is left, so its depth is logarithmic. Each copy of a
`repeat` stands in the frame of the one before it and sees its parameters, so its depth is its
number of copies.
"""

from __future__ import annotations

from collections.abc import Callable

from pcsg.errors import SourceSpan
from pcsg.grammar import syntax
from pcsg.graph.expr import Apply, Expr, Number, Parameter
from pcsg.graph.nodes import Calculation, Node, Selection, combine
from pcsg.graph.nodes import leaf_node as make_leaf
from pcsg.graph.operators import UNION
from pcsg.leaf import LEAF_NAMES

FIRST, STEP, INDEX, COUNT = "for_first", "for_step", "for_index", "for_count"
"""Parameters of a `for`: first value, step, index of the first value left, how many are left."""

COPIES = "repeat_count"
"""Parameter of a `repeat`: how many copies are left."""

_ROUNDING = 1e-9
"""By what part of a step the last value may be missed."""


def lower_for(loop: syntax.For, name: str, body: Node) -> Node:
    """Return the union of copies of a node, one for each value of a parameter.

    Parameters
    ----------
    name
        Of the module.
    """
    first, last, *more = loop.arguments.values
    step = more[0] if more else Number(1.0)
    span = loop.span
    steps = _apply("/", _apply("-", last, Parameter(FIRST)), Parameter(STEP), span=span)
    count = _apply("+", _apply("floor", _apply("+", steps, Number(_ROUNDING))), Number(1.0))
    module = _module(name, COUNT, span)
    value = _apply("+", Parameter(FIRST), _apply("*", Parameter(INDEX), Parameter(STEP)))
    half = _apply("floor", _apply("/", Parameter(COUNT), Number(2.0)))
    rest = (
        (INDEX, _apply("+", Parameter(INDEX), half)),
        (COUNT, _apply("-", Parameter(COUNT), half)),
    )
    module.rules[2] = Calculation(((loop.name.text, value),), body, span=span)
    halves = Calculation(((COUNT, half),), module, span=span), Calculation(rest, module, span=span)
    module.rules[3] = combine(UNION, halves, span)
    begin = ((FIRST, first), (STEP, step), (INDEX, Number(0.0)), (COUNT, count))
    return Calculation(begin, module, span=span)


def lower_repeat(loop: syntax.Repeat, name: str, body: Node, apply: Callable[[Node], Node]) -> Node:
    """Return the union of copies of a node, each in the frame of the one before it.

    Parameters
    ----------
    name
        Of the module.
    apply
        Puts the loop's unary operators on a node.
    """
    span = loop.span
    module = _module(name, COPIES, span)
    left = ((COPIES, _apply("-", Parameter(COPIES), Number(1.0))),)
    module.rules[2] = body
    others = Calculation(left, apply(module), span=span)
    module.rules[3] = combine(UNION, (body, others), span)
    return Calculation(((COPIES, loop.count),), module, span=span)


def _module(name: str, count: str, span: SourceSpan) -> Selection:
    """Return a module with rule 1 for no copies; 2 is for one, and 3 for more."""
    one = _apply("if", _apply("<", Parameter(count), Number(1.5)), Number(2.0), Number(3.0))
    select = _apply("if", _apply("<", Parameter(count), Number(0.5)), Number(1.0), one, span=span)
    module = Selection(name, select, span=span)
    module.rules[1] = make_leaf(LEAF_NAMES["empty"], ())
    return module


def _apply(function: str, *args: Expr, span: SourceSpan | None = None) -> Expr:
    return Apply(function, args, 0, span)
