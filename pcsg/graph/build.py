"""Building graphs in Python: ``S``, ``C``, transformations, attributes and primitives.

``|``, ``&``, ``-`` combine solids; ``*`` applies what stands left of it to what stands right.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, overload

from pcsg.arguments import text
from pcsg.errors import UsageError
from pcsg.graph.attributes import ATTRIBUTES, AttributeKind
from pcsg.graph.expr import Expr, as_expr
from pcsg.graph.nodes import (
    Attribute,
    Calculation,
    Combinable,
    Node,
    Selection,
    Transformation,
    as_node,
    leaf_node,
)
from pcsg.graph.scattering import scatter
from pcsg.graph.transforms import TRANSFORMS, Transform
from pcsg.leaf import LEAF_NAMES, Solid

Argument = Expr | float | int


class Prefix:
    """One or more unary operators that wait for their operand.

    Parameters
    ----------
    wraps
        Functions from the node below to the node above, outermost first.
    """

    def __init__(self, wraps: Sequence[Callable[[Node], Node]]) -> None:
        self._wraps = tuple(wraps)

    @overload
    def __mul__(self, other: Prefix) -> Prefix: ...
    @overload
    def __mul__(self, other: Combinable) -> Node: ...
    def __mul__(self, other: Prefix | Combinable) -> Prefix | Node:
        if isinstance(other, Prefix):
            return Prefix(self._wraps + other._wraps)
        node = as_node(other)
        for wrap in reversed(self._wraps):
            node = wrap(node)
        return node


class LeafConstructor(Combinable):
    """A primitive: usable as it is where it needs no argument, else called with them."""

    def __init__(self, solid: type[Solid]) -> None:
        self.solid = solid
        self.__doc__ = solid.__doc__

    def __call__(self, *args: Any) -> Node:
        """Return a leaf with these arguments, or the leaves that a word stands for."""
        constants, numbers = self.solid.take_arguments(args)
        return leaf_node(self.solid, [as_expr(a) for a in numbers], constants=constants)

    def as_node(self) -> Node:
        """Return a leaf without arguments."""
        return self()

    def __repr__(self) -> str:
        return f"<primitive {self.solid.name}>"


def S(  # noqa: N802 -- the paper's name of a selection node
    name: str, select: Argument | None = None
) -> Selection:
    """Return a module with its selection function; add rules with ``.rule(number, solid)``."""
    return Selection(
        text(name, "the name of a module"), None if select is None else as_expr(select)
    )


def C(**assignments: Argument) -> Prefix:  # noqa: N802 -- the paper's name of a calculation node
    """Return a calculation that assigns parameters, one after the other."""
    pairs = tuple((name, as_expr(value)) for name, value in assignments.items())
    return Prefix([partial(Calculation, pairs)])


def define(name: str, solid: Combinable) -> Node:
    """Name an expression, so that text shows it as a definition of that name."""
    node = as_node(solid)
    text(name, "the name of an expression")
    if isinstance(node, Selection):
        raise UsageError(f"`{node.name}` is a module and has its name already")
    node.definition = name
    return node


def _transformation(transform: Transform, *args: Argument) -> Prefix:
    exprs = _numbers(transform.name, args, len(transform.parameters), len(transform.parameters))
    return Prefix([partial(Transformation, transform, exprs)])


def _attribute(kind: AttributeKind, *args: Argument | str) -> Prefix:
    reference: str | None = None
    numbers: Sequence[Argument | str] = args
    if kind.refers_to:
        if not args or not isinstance(args[0], str):
            raise UsageError(f"{kind.name} takes the name of a {kind.refers_to} first")
        reference, numbers = args[0], args[1:]
    exprs = _numbers(kind.name, numbers, *kind.arity)
    return Prefix([partial(Attribute, kind, exprs, reference=reference)])


def _numbers(name: str, args: Sequence[Argument | str], least: int, most: int) -> tuple[Expr, ...]:
    if not least <= len(args) <= most:
        wanted = str(least) if least == most else f"{least} to {most}"
        raise UsageError(f"{name} takes {wanted} number(s), not {len(args)}")
    return tuple(as_expr(a) for a in args)  # type: ignore[arg-type]


CONSTRUCTORS: dict[str, object] = {
    **{name: partial(_transformation, t) for name, t in TRANSFORMS.items()},
    **{name: partial(_attribute, kind) for name, kind in ATTRIBUTES.items()},
    **{name: LeafConstructor(solid) for name, solid in LEAF_NAMES.items()},
    "scatter": scatter,
}
"""Everything that builds a node, by its name in the language."""
