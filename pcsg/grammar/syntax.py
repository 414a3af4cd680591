"""What a file says, before names mean anything: records, each with its place.

Nobody changes one. They are not frozen, because a long file has hundreds of thousands, and frozen
ones take three times as long to make. Arithmetic is kept as expressions of the graph at once,
because their trees are the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from pcsg.errors import SourceSpan
from pcsg.graph.expr import Expr
from pcsg.graph.operators import Operator


@dataclass(slots=True, eq=False)
class Name:
    """A name where it is given to something."""

    text: str
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Arguments:
    """Arguments in parentheses; `seeds` is the number before a semicolon, 0 without one."""

    values: tuple[Expr, ...] = ()
    seeds: int = 0


# Expressions for solids.


@dataclass(slots=True, eq=False)
class Use:
    """A module or a definition by its name; arguments for a call."""

    name: str
    arguments: Arguments | None
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Text:
    """A text in quotes, without them."""

    text: str
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Primitive:
    """A primitive; texts stand before the numbers."""

    name: str
    arguments: Arguments
    span: SourceSpan
    texts: tuple[Text, ...] = ()


@dataclass(slots=True, eq=False)
class Block:
    """Assignments in braces, a unary operator."""

    assignments: tuple[tuple[Name, Expr], ...]
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Unary:
    """A transformation or an attribute, a unary operator."""

    name: str
    arguments: Arguments
    attribute: bool
    span: SourceSpan


@dataclass(slots=True, eq=False)
class For:
    """A copy for each value of a parameter; the arguments are first, last and perhaps step."""

    name: Name
    arguments: Arguments
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Repeat:
    """Copies of which each stands in the frame and has the parameters of the one before it."""

    count: Expr
    prefixes: tuple[Prefix, ...]
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Scatter:
    """A copy for each row of a table, whose file stands in quotes."""

    file: Text
    words: tuple[tuple[Name, Text], ...]
    span: SourceSpan


Prefix = Block | Unary | For | Repeat | Scatter


@dataclass(slots=True, eq=False)
class Prefixed:
    """Unary operators and loops, outermost first, before what they apply to."""

    prefixes: tuple[Prefix, ...]
    operand: Solid
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Combination:
    """Two or more operands of one operator, folded from the left."""

    operator: Operator
    operands: tuple[Solid, ...]
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Blob:
    """A blob; what stands in its braces is one field."""

    fields: tuple[Solid, ...]
    span: SourceSpan
    arguments: Arguments = field(default_factory=Arguments)


@dataclass(slots=True, eq=False)
class BlendUse:
    """An operator on fields that is written with braces."""

    name: str
    arguments: Arguments
    fields: tuple[Solid, ...]
    span: SourceSpan


Solid = Use | Primitive | Prefixed | Combination | Blob | BlendUse


def inner(solid: Solid) -> Iterator[Solid | Prefix]:
    """Yield every part of an expression, those in the braces of blobs and blends, too."""
    stack: list[Solid | Prefix] = [solid]
    while stack:
        item = stack.pop()
        yield item
        if isinstance(item, Combination):
            stack.extend(reversed(item.operands))
        elif isinstance(item, Prefixed):
            stack.append(item.operand)
            stack.extend(reversed(item.prefixes))
        elif isinstance(item, Repeat):
            stack.extend(reversed(item.prefixes))
        elif isinstance(item, (Blob, BlendUse)):
            stack.extend(reversed(item.fields))


# Items of a file.


@dataclass(slots=True, eq=False)
class Axiom:
    """The expression that a grammar begins with."""

    solid: Solid
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Module:
    """A module with its selection function."""

    name: Name
    select: Expr


@dataclass(slots=True, eq=False)
class Rule:
    """A numbered rule."""

    number: int
    name: Name
    solid: Solid | None
    span: SourceSpan


@dataclass(slots=True, eq=False)
class AttributedRule:
    """A rule in the attributed form of fig 2; no condition for ``else`` or none."""

    label: Name
    name: Name
    formals: tuple[Name, ...]
    condition: Expr | None
    solid: Solid | None
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Definition:
    """A named expression."""

    name: Name
    solid: Solid | None


@dataclass(slots=True, eq=False)
class Value:
    """What stands behind a key: one or three numbers, a text in quotes, or stops of a palette.

    Of stops the numbers are four for each.
    """

    numbers: tuple[Expr, ...]
    text: str | None
    span: SourceSpan
    stops: bool = False


@dataclass(slots=True, eq=False)
class SettingItem:
    """A scene setting."""

    kind: Name
    name: Name | None
    pairs: tuple[tuple[Name, Value], ...]
    span: SourceSpan


@dataclass(slots=True, eq=False)
class Broken:
    """An item with a mistake, with as much as is known: what it names and what it assigns."""

    kind: str
    name: Name | None
    number: int | None
    assigned: frozenset[str]


Item = Axiom | Module | Rule | AttributedRule | Definition | SettingItem | Broken
