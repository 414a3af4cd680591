"""A whole graph: its nodes in a fixed order, its settings, and what depends on neither.

The order is depth first from the axiom, successors in the order of the text; node numbers in
statistics, pictures and hits are positions in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

from pcsg.arguments import listed, shown
from pcsg.errors import UsageError, suggest
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.expr import Expr, Number, as_expr, asks_world, signature
from pcsg.graph.flat import Flat, flatten, restore
from pcsg.graph.nodes import (
    Attribute,
    Calculation,
    Leaf,
    Node,
    Operation,
    Selection,
    Transformation,
)
from pcsg.graph.ordering import successors_first
from pcsg.graph.settings import Setting
from pcsg.graph.words import normal

GLOBALS: dict[str, float] = {
    "SEED": 0.0,
    "TIME": 0.0,
    "SUNX": 0.0,
    "SUNY": 0.0,
    "SUNZ": 1.0,
}
"""Parameters that are readable everywhere. The scene sets their values."""

FRAME_SLOTS = tuple(f"@frame{k}" for k in range(12))
"""Hidden parameters that hold world_from_local where a grammar asks for it."""


class Graph:
    """A cyclic CSG graph.

    Parameters
    ----------
    root
        The axiom.
    settings
        Scene settings in the order of the text.
    """

    def __init__(self, root: Node, settings: Sequence[Setting] = ()) -> None:
        if not isinstance(root, Node):
            raise UsageError(f"the axiom is a node, not {shown(root)}")
        self.root = root
        self.settings = tuple(listed(settings, "settings", "settings"))
        for setting in self.settings:
            if not isinstance(setting, Setting):
                raise UsageError(f"`settings` is a list of settings, not {shown(setting)}")

    @cached_property
    def nodes(self) -> tuple[Node, ...]:
        """All nodes that the axiom reaches, in order."""
        found: list[Node] = []
        seen: set[int] = set()
        stack = [self.root]
        while stack:
            node = stack.pop()
            if id(node) in seen:
                continue
            seen.add(id(node))
            found.append(node)
            stack.extend(reversed(node.successors))
        return tuple(found)

    @cached_property
    def number(self) -> Mapping[Node, int]:
        """Position of every node."""
        return {node: k for k, node in enumerate(self.nodes)}

    @cached_property
    def successors(self) -> tuple[tuple[int, ...], ...]:
        """Numbers of the successors of every node."""
        return tuple(tuple(self.number[s] for s in node.successors) for node in self.nodes)

    @cached_property
    def successors_first(self) -> list[int]:
        """Numbers of the nodes so that successors precede, cycles apart."""
        return successors_first(self.successors)

    @cached_property
    def formulas(self) -> Mapping[int, list[Expr]]:
        """What nodes evaluate that is no number, by the nodes' numbers. Most have nothing."""
        found: dict[int, list[Expr]] = {}
        for k, node in enumerate(self.nodes):
            if isinstance(node, (Transformation, Attribute, Leaf)):
                for expr in node.args:
                    if not isinstance(expr, Number):
                        break
                else:
                    continue
            exprs = [e for e in expressions(node) if not isinstance(e, Number)]
            if exprs:
                found[k] = exprs
        return found

    @cached_property
    def selections(self) -> tuple[Selection, ...]:
        """All modules in order."""
        return tuple(n for n in self.nodes if isinstance(n, Selection))

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters that are assigned anywhere, in order of appearance."""
        names: dict[str, None] = {}
        for node in self.nodes:
            if isinstance(node, Calculation):
                names.update(dict.fromkeys(name for name, _ in node.assignments))
        return tuple(names)

    @cached_property
    def uses_frame(self) -> bool:
        """Whether any expression asks for world coordinates."""
        return asks_world(*(e for exprs in self.formulas.values() for e in exprs))

    @cached_property
    def slots(self) -> Mapping[str, int]:
        """Slot of every parameter: the grammar's, the global ones, attributes, the frame."""
        names = [*dict.fromkeys([*self.parameters, *GLOBALS])]
        names += ATTRIBUTE_SLOTS
        names += FRAME_SLOTS if self.uses_frame else ()
        return {name: k for k, name in enumerate(names)}

    def settings_of(self, kind: str) -> list[Setting]:
        """Return all settings of a kind."""
        return [s for s in self.settings if s.kind.name == kind]

    def numbers_of(self, kind: str) -> Mapping[str, int]:
        """Return the number of every named setting of a kind, in the order of the text."""
        names = [s.name for s in self.settings_of(kind)]
        return {name: k for k, name in enumerate(names) if name is not None}

    @cached_property
    def axiom_block(self) -> Calculation | None:
        """The leading block of the axiom, whose parameters can be overridden."""
        node = self.root
        while isinstance(node, Operation) and node.definition is None:
            node = node.operands[0]
        return node if isinstance(node, Calculation) and not node.call else None

    def override(self, values: Mapping[str, float | Expr]) -> Graph:
        """Return a graph whose axiom assigns other values.

        The first assignment of each name in the leading block gets the new right-hand side, its
        later ones are skipped, and later lines see it.

        Raises
        ------
        UsageError
            The leading block does not assign a name.
        """
        if not values:
            return self
        values = {normal(name): value for name, value in values.items()}
        block = self.axiom_block
        names = dict.fromkeys(name for name, _ in block.assignments) if block else {}
        for name in values:
            if name not in names:
                known = ", ".join(names) or "none"
                hint = suggest(name, names)
                raise UsageError(
                    f"the axiom has no parameter `{name}`"
                    + (f"; {hint}" if hint else f"; its parameters are: {known}")
                )
        assert block is not None
        changed: list[tuple[str, Expr]] = []
        done: set[str] = set()
        for name, expr in block.assignments:
            if name not in values:
                changed.append((name, expr))
            elif name not in done:
                changed.append((name, as_expr(values[name])))
                done.add(name)
        new: Node = Calculation(tuple(changed), block.successor, span=block.span)
        path: list[Operation] = []
        node = self.root
        while isinstance(node, Operation) and node.definition is None:
            path.append(node)
            node = node.operands[0]
        for operation in reversed(path):
            operands = (new, *operation.operands[1:])
            new = Operation(operation.operator, operands, span=operation.span)
        return Graph(new, self.settings)

    def __eq__(self, other: object) -> bool:
        """Graphs are equal if they have the same nodes, edges, sharing and settings."""
        if not isinstance(other, Graph):
            return NotImplemented
        return self is other or (
            self.successors == other.successors
            and [content(n) for n in self.nodes] == [content(n) for n in other.nodes]
            and [setting_content(s) for s in self.settings]
            == [setting_content(s) for s in other.settings]
        )

    __hash__ = object.__hash__

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore_graph, (flatten((self.root, self.settings)),)


def _restore_graph(flat: Flat) -> Graph:
    return Graph(*restore(flat))


def expressions(node: Node) -> Iterator[Expr]:
    """Yield the expressions that a node evaluates, in order."""
    if isinstance(node, Selection):
        if node.select is not None:
            yield node.select
    elif isinstance(node, Calculation):
        yield from (expr for _, expr in node.assignments)
    elif isinstance(node, (Transformation, Attribute, Leaf)):
        yield from node.args


def content(node: Node) -> tuple[object, ...]:
    """Return everything a node is but its successors, as a value that compares."""
    exprs = tuple(signature(e) for e in expressions(node))
    if isinstance(node, Selection):
        form = node.attributed
        return (
            "S",
            "" if node.hidden else node.name,
            exprs,
            tuple(sorted(node.rules)),
            form and form.formals,
        )
    if isinstance(node, Calculation):
        return ("C", tuple(name for name, _ in node.assignments), exprs, node.call)
    if isinstance(node, Transformation):
        return ("T", node.transform.name, exprs)
    if isinstance(node, Operation):
        return ("O", node.operator.name)
    if isinstance(node, Attribute):
        return ("A", node.kind.name, node.reference, exprs)
    assert isinstance(node, Leaf)
    return ("L", node.solid.name, tuple(c.signature for c in node.constants), exprs)


def setting_content(setting: Setting) -> tuple[object, ...]:
    """Return everything a setting is, as a value that compares."""
    values = tuple(
        (key, value if isinstance(value, str) else tuple(signature(e) for e in value))
        for key, value in setting.values.items()
    )
    return (setting.kind.name, setting.name, values)
