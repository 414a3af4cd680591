"""Nodes of the cyclic CSG graph, and the operators that combine them in Python.

=================  ==========  ===================================================================
node               successors  does
=================  ==========  ===================================================================
`Selection`        a rule each evaluates its selection function, passes the ray to that rule;
                               the only target of cyclic edges
`Calculation`      1           runs assignments on the parameters
`Transformation`   1           maps the ray into the successor's frame
`Operation`        n           union, intersection, difference
`Attribute`        1           sets surface attributes for what lies below
`Leaf`             0           a primitive solid
=================  ==========  ===================================================================

Nodes are compared by identity; `Graph` compares whole graphs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from pcsg.errors import SourceSpan, UsageError
from pcsg.graph.attributes import AttributeKind
from pcsg.graph.expr import Expr, as_expr
from pcsg.graph.flat import Flattened
from pcsg.graph.operators import DIFFERENCE, INTERSECTION, UNION, Operator
from pcsg.graph.transforms import Transform
from pcsg.leaf.registry import Box, Constant, LeafParameter, Model, Solid
from pcsg.vec import Vec3


class Combinable:
    """What ``|``, ``&``, ``-`` combine: nodes, and constructors of leaves without arguments."""

    __slots__: tuple[str, ...] = ()

    def as_node(self) -> Node:
        """Return the node this stands for."""
        raise NotImplementedError

    def __or__(self, other: Combinable) -> Operation:
        return combine(UNION, (self.as_node(), as_node(other)))

    def __and__(self, other: Combinable) -> Operation:
        return combine(INTERSECTION, (self.as_node(), as_node(other)))

    def __sub__(self, other: Combinable) -> Operation:
        return combine(DIFFERENCE, (self.as_node(), as_node(other)))


@dataclass(eq=False, slots=True)
class Node(Combinable, Flattened):
    """A node of the graph.

    Attributes
    ----------
    span
        The text it comes from, None if built in Python.
    definition
        Its name, if it is a named expression.
    """

    span: SourceSpan | None = field(default=None, kw_only=True, repr=False)
    definition: str | None = field(default=None, kw_only=True)

    def as_node(self) -> Node:
        """Return the node itself."""
        return self

    @property
    def successors(self) -> tuple[Node, ...]:
        """The nodes that edges lead to, in the order of the text."""
        return ()


@dataclass(frozen=True, slots=True)
class AttributedForm:
    """A module written in the attributed form of the paper's fig 2.

    Attributes
    ----------
    formals
        The parameters that a call assigns.
    labels
        The rules' names, in order.
    conditions
        The rules' conditions; None for ``else`` or none.
    """

    formals: tuple[str, ...]
    labels: tuple[str, ...]
    conditions: tuple[Expr | None, ...]


@dataclass(eq=False, slots=True)
class Selection(Node):
    """A module: selects one of its rules by a function of the parameters.

    Attributes
    ----------
    name
        The module's name.
    select
        Its selection function; None where there is one rule only.
    rules
        Right-hand sides by their numbers, from 1.
    attributed
        Set if the module is written in the attributed form.
    hidden
        Whether text has another form for it, so that its name is nobody's.
    """

    name: str
    select: Expr | None = None
    rules: dict[int, Node] = field(default_factory=dict, repr=False)
    attributed: AttributedForm | None = None
    hidden: bool = False

    def rule(self, number: int, solid: Combinable) -> Selection:
        """Set the right-hand side of a rule and return the module."""
        if not isinstance(number, int) or number < 1:
            raise UsageError(f"rules of `{self.name}` are numbered from 1, not {number!r}")
        if number in self.rules:
            raise UsageError(f"rule {number} of `{self.name}` is there already")
        self.rules[number] = as_node(solid)
        return self

    @property
    def successors(self) -> tuple[Node, ...]:
        """The rules in the order of their numbers."""
        return tuple(self.rules[k] for k in sorted(self.rules))


@dataclass(eq=False, slots=True)
class Calculation(Node):
    """Runs assignments on the parameters, one after the other, for its successor only.

    Attributes
    ----------
    assignments
        Pairs of a parameter's name and the expression assigned to it.
    successor
        The node below.
    call
        True for the call ``S(e1, e2)``: the formals of module S are assigned in parallel.
    """

    assignments: tuple[tuple[str, Expr], ...]
    successor: Node = field(repr=False)
    call: bool = False

    @property
    def successors(self) -> tuple[Node, ...]:
        """The one node below."""
        return (self.successor,)


@dataclass(eq=False, slots=True)
class Transformation(Node):
    """Maps rays into the frame of its successor.

    Attributes
    ----------
    transform
        Which one, with its kernel.
    args
        Its arguments.
    """

    transform: Transform
    args: tuple[Expr, ...]
    successor: Node = field(repr=False)

    @property
    def successors(self) -> tuple[Node, ...]:
        """The one node below."""
        return (self.successor,)


@dataclass(eq=False, slots=True)
class Operation(Node):
    """Union, intersection or difference of two or more operands, folded from the left."""

    operator: Operator
    operands: tuple[Node, ...] = field(repr=False)

    @property
    def successors(self) -> tuple[Node, ...]:
        """The operands."""
        return self.operands


@dataclass(eq=False, slots=True)
class Attribute(Node):
    """Sets a surface attribute for what lies below.

    Attributes
    ----------
    kind
        Which attribute.
    args
        Its arguments that are numbers.
    successor
        The node below.
    reference
        The name of the material or texture, where the attribute takes one.
    """

    kind: AttributeKind
    args: tuple[Expr, ...]
    successor: Node = field(repr=False)
    reference: str | None = None

    @property
    def successors(self) -> tuple[Node, ...]:
        """The one node below."""
        return (self.successor,)


MODELS_KEPT = 64
"""Models that a leaf remembers."""


@dataclass(eq=False, slots=True)
class Leaf(Node):
    """A primitive solid.

    Attributes
    ----------
    solid
        Its class, with the kernels.
    args
        Its arguments that are numbers, defaults filled in.
    constants
        Its constant arguments, such as files, for a leaf with data.
    """

    solid: type[Solid]
    args: tuple[Expr, ...] = ()
    constants: tuple[Constant, ...] = ()
    _models: dict[tuple[float, ...], Model] = field(default_factory=dict, init=False, repr=False)

    @property
    def parameters(self) -> tuple[LeafParameter, ...]:
        """The declarations of its numbers."""
        return self.solid.parameters_of(self.constants)

    @property
    def is_sheet(self) -> bool:
        """Whether it has a surface but no volume."""
        return self.solid.sheet_of(self.constants)

    @property
    def primitives(self) -> int:
        """What it counts for in primitive equivalents."""
        return self.solid.primitives_of(self.constants)

    def model(self, args: tuple[float, ...]) -> Model:
        """Return the model of a leaf with data for values of its numbers.

        Raises
        ------
        UsageError
            There is none for these values.
        """
        found = self._models.get(args)
        if found is None:
            if len(self._models) >= MODELS_KEPT:
                self._models.clear()
            found = self._models[args] = self.solid.make_model(self.constants, args)
        return found

    def bounds_of(self, args: tuple[float, ...]) -> Box:
        """Return a box that contains it with these arguments, in its own frame."""
        return self.model(args).bounds if self.constants else self.solid.bounds_of(args)

    def support(self, direction: Vec3, args: tuple[float, ...]) -> float:
        """Return the largest ``p . direction`` over it with these arguments, or more."""
        if self.constants:
            return self.model(args).support(direction)
        return self.solid.support_of(direction, args)


def as_node(solid: Combinable) -> Node:
    """Return the node of anything that can be combined."""
    if isinstance(solid, Combinable):
        return solid.as_node()
    raise UsageError(f"expected a solid, not {solid!r}")


def combine(
    operator: Operator, operands: Sequence[Node], span: SourceSpan | None = None
) -> Operation:
    """Return an operation, flattened where the operator folds from the left.

    An operand that has a definition's name stays a node of its own, because it is shared.
    """
    flat: list[Node] = []
    for k, operand in enumerate(operands):
        opens = (
            isinstance(operand, Operation)
            and operand.operator is operator
            and operand.definition is None
            and (operator.associative or k == 0)
        )
        if opens:
            flat.extend(operand.successors)
        else:
            flat.append(operand)
    return Operation(operator, tuple(flat), span=span)


def leaf_node(
    solid: type[Solid],
    args: Sequence[Expr | float],
    span: SourceSpan | None = None,
    constants: tuple[Constant, ...] = (),
) -> Node:
    """Return a leaf, with defaults for arguments that are missing, or the union of several."""
    if solid.parts:
        leaves = [leaf_node(part, args, span, constants) for part in solid.parts]
        return combine(UNION, leaves, span)
    parameters = solid.parameters_of(constants)
    least = sum(1 for p in parameters if p.default is None)
    if not least <= len(args) <= len(parameters):
        wanted = str(least) if least == len(parameters) else f"{least} to {len(parameters)}"
        raise UsageError(f"{solid.name} takes {wanted} argument(s), not {len(args)}")
    rest = [p.default for p in parameters[len(args) :] if p.default is not None]
    return Leaf(solid, tuple(as_expr(a) for a in (*args, *rest)), constants, span=span)
