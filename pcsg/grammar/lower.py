"""From syntax to the graph. Nothing here recurses: nesting has no limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from pcsg.grammar import syntax
from pcsg.grammar.check import FOR_ARGUMENTS, definition_order, read_constants
from pcsg.grammar.colors import is_palette, palette_color
from pcsg.grammar.fields import GrammarBlob, field_names
from pcsg.grammar.loops import lower_for, lower_repeat
from pcsg.grammar.names import ModuleEntry, Names
from pcsg.grammar.rows import read_rows
from pcsg.grammar.syntax import Arguments, Solid
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.expr import Apply, Expr, Number, Parameter
from pcsg.graph.nodes import (
    Attribute,
    AttributedForm,
    Calculation,
    Node,
    Selection,
    Transformation,
    combine,
)
from pcsg.graph.nodes import leaf_node as make_leaf
from pcsg.graph.scattering import scatter_node
from pcsg.graph.transforms import TRANSFORMS
from pcsg.leaf import LEAF_NAMES


def lower(names: Names, sound: bool = True) -> Node | None:
    """Return the axiom's node, None without an axiom.

    What was reported as wrong is left out or replaced by the empty solid, so that the whole graph
    can be checked all the same.

    Parameters
    ----------
    sound
        Whether all names are in order, so that blobs can be unrolled.
    """
    if names.axiom is None:
        return None
    lowering = _Lowering(names, sound)
    root = lowering.solid(names.axiom.solid)
    # What a loop assigns is none of the axiom's parameters.
    return Calculation((), root) if _begins_with_loop(names.axiom.solid) else root


class _Lowering:
    """Nodes by name: one selection for each module, one node for each definition."""

    def __init__(self, names: Names, sound: bool) -> None:
        self.names = names
        self.sound = sound
        self.numbers: dict[str, dict[str, int]] = {}
        for item in names.settings:
            if item.name is not None:
                of_kind = self.numbers.setdefault(item.kind.text, {})
                of_kind.setdefault(item.name.text, len(of_kind))
        self.palettes = {
            item.name.text: value.numbers
            for item in names.settings
            for key, value in item.pairs
            if item.kind.text == "palette" and item.name and key.text == "stops" and value.stops
        }
        self.nodes: dict[str, Node] = {}
        self.loops = 0
        # What blobs are made of is unrolled into them.
        fields = field_names(names)
        solids = [e for e in names.modules.values() if e.name not in fields]
        for entry in solids:
            self.nodes[entry.name] = _selection(entry)
        for name in definition_order(names)[0]:
            if name not in fields:
                self._define(name)
        for entry in solids:
            selection = self.nodes[entry.name]
            if isinstance(selection, Selection):
                self._fill(selection, entry)

    def _define(self, name: str) -> None:
        if name in self.nodes:
            return  # a module of that name: reported
        node = self.solid(self.names.definitions[name].solid)
        if node.definition is None and not isinstance(node, Selection):
            node.definition = name
        self.nodes[name] = node

    def _fill(self, selection: Selection, entry: ModuleEntry) -> None:
        solids: Sequence[tuple[int, Solid | None]]
        if entry.attributed:
            solids = [(k + 1, rule.solid) for k, rule in enumerate(entry.attributed)]
        else:
            solids = [(k, rule.solid) for k, rule in entry.rules.items()]
        for number, solid in solids:
            selection.rules[number] = self.solid(solid)
        if not selection.rules:
            selection.rules[1] = _placeholder()

    def solid(self, root: Solid | None) -> Node:
        """Return the node of an expression."""
        if root is None:
            return _placeholder()
        done: list[Node] = []
        # What is to do, last first: expressions, and what to make of the nodes below them.
        work: list[tuple[Solid, int]] = [(root, -1)]
        while work:
            solid, below = work.pop()
            if isinstance(solid, syntax.Combination):
                if below < 0:
                    operands = _flatten(solid)
                    work.append((solid, len(operands)))
                    work.extend((operand, -1) for operand in reversed(operands))
                else:
                    operands_done = done[len(done) - below :]
                    del done[len(done) - below :]
                    done.append(combine(solid.operator, operands_done, solid.span))
            elif isinstance(solid, syntax.Prefixed):
                if below < 0:
                    work.append((solid, 1))
                    work.append((solid.operand, -1))
                else:
                    done.append(self._apply(solid.prefixes, done.pop()))
            elif isinstance(solid, syntax.Primitive):
                done.append(self._leaf(solid))
            elif isinstance(solid, syntax.Blob):
                done.append(self._blob(solid))
            elif isinstance(solid, syntax.BlendUse):
                done.append(_placeholder())  # reported: it stands in blobs only
            else:
                done.append(self._use(solid))
        return done[0]

    def _apply(self, prefixes: Sequence[syntax.Prefix], node: Node) -> Node:
        """Put unary operators and loops on a node, the last one first."""
        for prefix in reversed(prefixes):
            if isinstance(prefix, syntax.For):
                if len(prefix.arguments.values) in FOR_ARGUMENTS:
                    node = lower_for(prefix, self._name_loop("FOR"), node)
            elif isinstance(prefix, syntax.Scatter):
                table, _ = read_rows(prefix, self.names)
                if table is not None:
                    name = self._name_loop("SCATTER")
                    node = scatter_node(table, node, name, prefix.span)
            elif isinstance(prefix, syntax.Repeat):
                apply = partial(self._apply, prefix.prefixes)
                node = lower_repeat(prefix, self._name_loop("REPEAT"), node, apply)
            else:
                node = _apply(self._with_color(prefix), node)
        return node

    def _with_color(self, prefix: syntax.Block | syntax.Unary) -> syntax.Block | syntax.Unary:
        """Return ``color(palette(NAME, x))`` as three numbers, anything else as it is."""
        if isinstance(prefix, syntax.Block) or not prefix.attribute:
            return prefix
        if prefix.name != "color" or not is_palette(prefix.arguments.values):
            return prefix
        (call,) = prefix.arguments.values
        assert isinstance(call, Apply)
        if len(call.args) != 2 or not isinstance(call.args[0], Parameter):
            return prefix
        stops = self.palettes.get(call.args[0].name)
        return (
            replace(prefix, arguments=Arguments(palette_color(stops, call.args[1])))
            if stops
            else prefix
        )

    def _name_loop(self, word: str) -> str:
        """Return the name of a loop's module, which no other has."""
        taken = self.names.modules.keys() | self.names.definitions.keys()
        while True:
            self.loops += 1
            if (name := f"{word}{self.loops}") not in taken:
                return name

    def _use(self, use: syntax.Use) -> Node:
        primitive = self.names.primitive_of(use)
        if primitive is not None:
            return self._leaf(primitive)
        node = self.nodes.get(use.name)
        if node is None:
            return _placeholder()
        if use.arguments is None or not isinstance(node, Selection) or not node.attributed:
            return node
        formals = node.attributed.formals
        # A wrong number was reported; the formals count as assigned all the same.
        values = [*use.arguments.values, *[Number(0.0)] * len(formals)]
        pairs = tuple(zip(formals, values, strict=False))
        return Calculation(pairs, node, call=True, span=use.span)

    def _blob(self, blob: syntax.Blob) -> Node:
        if self.names.broken or not self.sound:
            return _placeholder()
        source = GrammarBlob(self.names, blob.fields[0], self.numbers)
        values = [Parameter(name, blob.span) for name in source.parameters]
        return make_leaf(LEAF_NAMES["blob"], values, blob.span, (source,))

    def _leaf(self, primitive: syntax.Primitive) -> Node:
        solid = LEAF_NAMES[primitive.name]
        constants, _ = read_constants(primitive, self.names)
        if len(constants) < len(solid.constants):
            return _placeholder()
        parameters = solid.parameters_of(constants)
        values = primitive.arguments.values
        least = sum(1 for p in parameters if p.default is None)
        if not least <= len(values) <= len(parameters):
            return _placeholder()
        return make_leaf(solid, values, primitive.span, constants)


def _placeholder() -> Node:
    return make_leaf(LEAF_NAMES["empty"], ())


def _flatten(solid: syntax.Combination) -> list[Solid]:
    """Return the operands, those of nested combinations of the same operator in their place."""
    flat: list[Solid] = []
    operator = solid.operator
    stack: list[tuple[Solid, bool]] = [(o, k == 0) for k, o in enumerate(solid.operands)][::-1]
    while stack:
        operand, leftmost = stack.pop()
        opens = isinstance(operand, syntax.Combination) and operand.operator is operator
        if opens and (operator.associative or leftmost):
            assert isinstance(operand, syntax.Combination)
            inner = [(o, leftmost and k == 0) for k, o in enumerate(operand.operands)]
            stack.extend(reversed(inner))
        else:
            flat.append(operand)
    return flat


def _begins_with_loop(solid: Solid) -> bool:
    while isinstance(solid, syntax.Combination):
        solid = solid.operands[0]
    return isinstance(solid, syntax.Prefixed) and isinstance(
        solid.prefixes[0], (syntax.For, syntax.Repeat, syntax.Scatter)
    )


def _apply(prefix: syntax.Block | syntax.Unary, node: Node) -> Node:
    """Put a unary operator on a node."""
    if isinstance(prefix, syntax.Block):
        pairs = tuple((name.text, expr) for name, expr in prefix.assignments)
        return Calculation(pairs, node, span=prefix.span)
    if prefix.attribute:
        return _attribute(prefix, node)
    transform = TRANSFORMS.get(prefix.name)
    if transform is None or len(prefix.arguments.values) != len(transform.parameters):
        return node
    return Transformation(transform, prefix.arguments.values, node, span=prefix.span)


def _attribute(prefix: syntax.Unary, node: Node) -> Node:
    kind = ATTRIBUTES[prefix.name]
    values = prefix.arguments.values
    reference = None
    if kind.refers_to:
        if not values or not isinstance(values[0], Parameter):
            return node
        reference, values = values[0].name, values[1:]
    least, most = kind.arity
    if not least <= len(values) <= most:
        return node
    return Attribute(kind, values, node, reference, span=prefix.span)


def _selection(entry: ModuleEntry) -> Selection:
    """Return the node of a module, its rules still to come."""
    if not entry.attributed:
        select = entry.declaration.select if entry.declaration else None
        return Selection(entry.name, select, span=entry.span)
    rules = entry.attributed
    form = AttributedForm(
        entry.formals or (),
        tuple(rule.label.text for rule in rules),
        tuple(rule.condition for rule in rules),
    )
    return Selection(entry.name, _derived_select(rules), attributed=form, span=entry.span)


def _derived_select(rules: Sequence[syntax.AttributedRule]) -> Expr | None:
    """Return ``if(c1, 1, if(c2, 2, ...))``: the first rule whose condition holds, 0 if none."""
    if len(rules) == 1 and rules[0].condition is None:
        return None
    select: Expr = Number(0.0)
    for k in reversed(range(len(rules))):
        condition = rules[k].condition
        taken = Number(k + 1.0)
        if condition is None:
            select = taken
        else:
            span = getattr(condition, "span", None)
            select = Apply("if", (condition, taken, select), 0, span)
    return select
