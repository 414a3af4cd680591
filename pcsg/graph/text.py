"""A graph written back in the language, such that reading it gives an equal graph."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

from pcsg.errors import UsageError
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.expr import Apply, Expr, Number, Parameter, parameters_of, signature
from pcsg.graph.exprtext import call_text, expr_text
from pcsg.graph.graph import Graph, expressions
from pcsg.graph.nodes import (
    Attribute,
    AttributedForm,
    Calculation,
    Leaf,
    Node,
    Operation,
    Selection,
    Transformation,
)
from pcsg.graph.operators import Operator
from pcsg.graph.pretty import Mark, Token, format_tokens
from pcsg.graph.scattering import Scatter, written_below, written_nodes
from pcsg.graph.settings import Setting, ValueKind
from pcsg.graph.transforms import TRANSFORMS
from pcsg.graph.words import WORD, is_name
from pcsg.leaf import LEAF_NAMES

_WORD = re.compile(WORD)

UNARY = 100
"""How tightly unary operators bind; operators on solids bind by their precedence."""

Below = TypeVar("Below")


class BracedText(NamedTuple):
    """What stands in braces behind a leaf's name, and what the file must say for it.

    Attributes
    ----------
    tokens
        The expression in the braces.
    modules, definitions
        Items of the file by their names, in order of appearance.
    """

    tokens: Sequence[Token]
    modules: Mapping[str, str]
    definitions: Mapping[str, str]


@runtime_checkable
class Braced(Protocol):
    """A constant argument that is written in braces, and reads parameters from around it."""

    parameters: tuple[str, ...]

    @property
    def braced(self) -> BracedText:
        """What is written."""


def node_text(node: Node) -> str:
    """Return what a node says by itself, without its successors.

    A selection gives its name, a calculation its block, an operation its operator's sign.
    """
    if isinstance(node, Selection):
        return node.name
    if isinstance(node, Scatter):
        return node.head
    if isinstance(node, Calculation):
        if node.call and isinstance(node.successor, Selection):
            return f"{node.successor.name}({', '.join(expr_text(e) for _, e in node.assignments)})"
        return "{" + "; ".join(assignment_texts(node)) + "}"
    if isinstance(node, Transformation):
        return call_text(node.transform.name, node.args)
    if isinstance(node, Attribute):
        return call_text(node.kind.name, node.args, node.reference)
    if isinstance(node, Operation):
        return node.operator.symbols[0]
    assert isinstance(node, Leaf)
    if _braced(node) is not None:
        return f"{node.solid.name} {{...}}"
    constants = ", ".join(c.text or "..." for c in node.constants)
    return call_text(node.solid.name, _given_args(node), constants or None)


def assignment_texts(node: Calculation) -> list[str]:
    """Return the assignments of a calculation, one text each."""
    return [f"{name} = {expr_text(expr)}" for name, expr in node.assignments]


def _braced(leaf: Leaf) -> BracedText | None:
    for constant in leaf.constants:
        if isinstance(constant, Braced):
            if [signature(a) for a in leaf.args] != [
                signature(Parameter(name)) for name in constant.parameters
            ]:
                raise UsageError(
                    f"what this `{leaf.solid.name}` reads must be given by a block above it"
                )
            return constant.braced
    return None


def _given_args(leaf: Leaf) -> Sequence[Expr]:
    """Return a leaf's arguments without those at the end that are the defaults."""
    count = len(leaf.args)
    for parameter in reversed(leaf.parameters[: len(leaf.args)]):
        default = parameter.default
        if default is None or signature(leaf.args[count - 1]) != signature(Number(default)):
            break
        count -= 1
    return leaf.args[:count]


def to_pcsg(graph: Graph) -> str:
    """Return a graph as a grammar: the axiom, modules, definitions, settings.

    Nodes that are reached from several places become definitions, with the names they have or
    with generated ones, so that reading the text gives an equal graph.

    Raises
    ------
    UsageError
        The graph has what the language cannot say: a name that is reserved or used twice, a
        cycle without a module, a module without rules or without a selection function, data
        without a file.
    """
    _check_constants(graph)
    return _Writer(graph).write()


def _check_constants(graph: Graph) -> None:
    for node in graph.nodes:
        for constant in node.constants if isinstance(node, Leaf) else ():
            if constant.text is None and not isinstance(constant, Braced):
                assert isinstance(node, Leaf)
                raise UsageError(
                    f"a grammar cannot hold the data of this `{node.solid.name}`; "
                    f"{constant.instead}"
                )


def reserved_names() -> frozenset[str]:
    """Return the words that no module, definition or parameter can be called."""
    words = {"else", "and", "or", "not", "pi", "e", "true", "false"}
    primitives = {name for name, leaf in LEAF_NAMES.items() if not leaf.soft}
    return frozenset(words | {*TRANSFORMS, *ATTRIBUTES} | primitives)


class _Writer:
    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._reserved = reserved_names()
        self._nodes = written_nodes(graph)
        self._names: dict[Node, str] = {}
        braced = [_braced(node) for node in self._nodes if isinstance(node, Leaf)]
        self._braced = [text for text in braced if text is not None]

    def write(self) -> str:
        graph = self._graph
        self._check_names()
        self._name_definitions()
        self._check_definitions()
        modules = [node for node in self._nodes if isinstance(node, Selection)]
        items = [self._item(self._axiom_head(), graph.root)]
        items += ["\n".join(self._module(module)) for module in modules]
        items += dict.fromkeys(t for text in self._braced for t in text.modules.values())
        definitions = [
            self._item(f"{name} = ", node, body=True) for node, name in self._names.items()
        ]
        definitions += dict.fromkeys(t for text in self._braced for t in text.definitions.values())
        if definitions:
            items.append("\n".join(definitions))
        items += [_setting_text(setting) for setting in graph.settings]
        return "\n\n".join(items) + "\n"

    def _check_names(self) -> None:
        leaves = (node.solid for node in self._nodes if isinstance(node, Leaf))
        seen = {solid.name: "primitive" for solid in leaves if solid.soft}
        for node in self._nodes:
            if isinstance(node, Selection):
                self._claim(node.name, "module", seen)
            elif node.definition is not None:
                self._claim(node.definition, "definition", seen)
        texts: dict[str, str] = {}
        for braced in self._braced:
            for name, text in (*braced.modules.items(), *braced.definitions.items()):
                if texts.setdefault(name, text) != text or name in seen:
                    raise UsageError(f"two things are called `{name}`, one of them in a blob")
        for node in self._nodes:
            for name in (*_parameters_written(node), *parameters_of(*expressions(node))):
                self._check_name(name, "parameter")
            if isinstance(node, Attribute) and node.reference is not None:
                self._check_name(node.reference, str(node.kind.refers_to))
            if isinstance(node, Selection) and node.attributed:
                for label in node.attributed.labels:
                    self._check_name(label, "rule label")
        for setting in self._graph.settings:
            if setting.name is not None:
                self._check_name(setting.name, setting.kind.name)

    def _claim(self, name: str, kind: str, seen: dict[str, str]) -> None:
        self._check_name(name, kind)
        if name in seen:
            raise UsageError(f"two things are called `{name}`: a {seen[name]} and a {kind}")
        seen[name] = kind

    def _check_name(self, name: str, kind: str) -> None:
        if not is_name(name):
            raise UsageError(
                f"a {kind} cannot be called {name!r}: names are made of letters, digits "
                "and _, and begin with no digit"
            )
        if name in self._reserved:
            raise UsageError(f"a {kind} cannot be called `{name}`: the language reserves that word")

    def _name_definitions(self) -> None:
        """Find the nodes that need a name, and give them one."""
        nodes = self._nodes
        places = dict.fromkeys(nodes, 0)
        places[self._graph.root] = 1
        for node in nodes:
            for successor in written_below(node):
                places[successor] += 1
        shared = {n for n in nodes if places[n] > 1 or n.definition is not None}
        # Read back without a name, such operands would be merged into their operation.
        shared |= {
            operand
            for node in nodes
            if isinstance(node, Operation)
            for k, operand in enumerate(node.operands)
            if isinstance(operand, Operation)
            and operand.operator is node.operator
            and (operand.operator.associative or k == 0)
        }
        taken = {n.name if isinstance(n, Selection) else n.definition for n in nodes}
        taken |= {name for node in nodes for name in _parameters_written(node)}
        taken |= {name for braced in self._braced for name in _words_of(braced)}
        fresh = (name for k in range(1, 10**9) if (name := f"part_{k}") not in taken)
        for node in nodes:
            if node in shared and not isinstance(node, Selection):
                self._names[node] = node.definition or next(fresh)

    def _check_definitions(self) -> None:
        """Check that every cycle passes a module: expressions cannot contain themselves."""
        done: set[Node] = set()
        open_: dict[Node, None] = {}
        for start in self._nodes:
            stack: list[tuple[Node, int]] = [(start, 0)]
            while stack:
                node, k = stack.pop()
                if k == 0 and (isinstance(node, Selection) or node in done):
                    continue
                if k == 0 and node in open_:
                    raise UsageError(
                        f"the {type(node).__name__.lower()} `{node_text(node)}` contains itself; "
                        "only a module can be reached again from below"
                    )
                open_[node] = None
                below = written_below(node)
                if k < len(below):
                    stack += [(node, k + 1), (below[k], 0)]
                else:
                    del open_[node]
                    done.add(node)

    def _axiom_head(self) -> str:
        """Return what stands before the axiom: a label where it would begin with a parenthesis."""
        node = self._graph.root
        while isinstance(node, Operation) and node not in self._names:
            first = node.operands[0]
            if self._needs_parentheses(first, node.operator.precedence):
                return "axiom: "
            node = first
        return ""

    def _needs_parentheses(self, node: Node, least: int) -> bool:
        named = node in self._names
        return isinstance(node, Operation) and not named and node.operator.precedence < least

    def _module(self, module: Selection) -> Iterator[str]:
        if sorted(module.rules) != list(range(1, len(module.rules) + 1)) or not module.rules:
            numbers = ", ".join(str(k) for k in sorted(module.rules)) or "none"
            raise UsageError(f"module `{module.name}` needs rules 1, 2, ...; it has {numbers}")
        if module.attributed is not None:
            yield from self._attributed_rules(module)
            return
        if module.select is not None:
            yield declaration_text(module.name, module.select)
        elif len(module.rules) > 1:
            raise UsageError(f"module `{module.name}` has several rules and no selection function")
        for number in sorted(module.rules):
            yield self._item(f"{number}: {module.name} -> ", module.rules[number])

    def _attributed_rules(self, module: Selection) -> Iterator[str]:
        form = module.attributed
        assert form is not None
        count = len(module.rules)
        if not len(form.labels) == len(form.conditions) == count:
            raise UsageError(f"module `{module.name}` needs a label and a condition for every rule")
        selects = (module.select, _select_of(form))
        if len({None if e is None else signature(e) for e in selects}) > 1:
            raise UsageError(
                f"the selection function of module `{module.name}` differs from its conditions"
            )
        for k, (label, condition) in enumerate(zip(form.labels, form.conditions, strict=True)):
            if condition is None and k < count - 1:
                raise UsageError(f"rule `{label}` of module `{module.name}` needs a condition")
            head = attributed_head(label, module.name, form.formals, condition, count)
            yield self._item(head, module.rules[k + 1])

    def _item(self, head: str, node: Node, body: bool = False) -> str:
        return format_tokens([head, *self._tokens(node, body)])

    def _tokens(self, root: Node, body: bool) -> Iterator[Token]:
        """Yield an expression; with `body` that of a definition, not its name."""
        work: list[Token | tuple[Node, int]] = [(root, 0)]
        while work:
            item = work.pop()
            if not isinstance(item, tuple):
                yield item
                continue
            node, least = item
            if node in self._names and not (body and node is root):
                yield self._names[node]
            elif isinstance(node, Operation):
                work.extend(reversed(self._operation(node, least)))
            elif isinstance(node, Calculation) and not isinstance(node, Scatter):
                work.extend(reversed(self._calculation(node)))
            elif isinstance(node, (Transformation, Attribute, Scatter)):
                work += [(written_below(node)[0], UNARY), Mark.FILL, node_text(node)]
            elif isinstance(node, Leaf) and (braced := _braced(node)) is not None:
                yield from (f"{node.solid.name} {{ ", *braced.tokens, " }")
            else:
                yield node_text(node)

    def _operation(self, node: Operation, least: int) -> list[Token | tuple[Node, int]]:
        if len(node.operands) < 2:
            raise UsageError(f"{node.operator.name} needs two operands or more")
        return infix_tokens(node.operator, node.operands, least)

    def _calculation(self, node: Calculation) -> list[Token | tuple[Node, int]]:
        if node.call:
            module = node.successor
            form = module.attributed if isinstance(module, Selection) else None
            if form is None or form.formals != tuple(name for name, _ in node.assignments):
                raise UsageError("a call must assign the formals of an attributed module below it")
            return [node_text(node)]
        return [*block_tokens(assignment_texts(node)), Mark.FILL, (node.successor, UNARY)]


def infix_tokens(
    operator: Operator, operands: Sequence[Below], least: int
) -> list[Token | tuple[Below, int]]:
    """Return operands with the signs between them, in parentheses where they must bind tighter.

    Parameters
    ----------
    least
        How tightly the result must bind; each operand is returned with how tightly it must.
    """
    parts: list[Token | tuple[Below, int]] = [Mark.OPEN]
    for k, operand in enumerate(operands):
        if k:
            parts += [Mark.BREAK, f"{operator.symbols[0]} "]
        parts.append((operand, operator.precedence + (k > 0)))
    parts.append(Mark.CLOSE)
    return ["(", *parts, ")"] if operator.precedence < least else parts


def block_tokens(assignments: Sequence[str]) -> list[Token]:
    """Return a block of assignments."""
    parts: list[Token] = ["{", Mark.OPEN]
    for k, text in enumerate(assignments):
        parts += [Mark.BREAK] if k else []
        parts.append(text + (";" if k < len(assignments) - 1 else ""))
    return [*parts, Mark.CLOSE, "}"]


def declaration_text(name: str, select: Expr) -> str:
    """Return a module with its selection function."""
    text = expr_text(select)
    # A minus after a name would be a difference.
    return f"{name} ({text})" if text.startswith("-") else f"{name} {text}"


def attributed_head(
    label: str, name: str, formals: Sequence[str], condition: Expr | None, count: int
) -> str:
    """Return what stands before the expression of an attributed rule, one of `count`."""
    if condition is not None:
        guard = f": {expr_text(condition)}"
    else:
        guard = ": else" if count > 1 else ""
    return f"{label}: {name}({', '.join(formals)}){guard} -> "


def _words_of(braced: BracedText) -> set[str]:
    texts = (*braced.tokens, *braced.modules.values(), *braced.definitions.values())
    return {word for text in texts if isinstance(text, str) for word in _WORD.findall(text)}


def _select_of(form: AttributedForm) -> Expr | None:
    """Return the selection function that conditions stand for: the first that holds is taken."""
    if len(form.conditions) == 1 and form.conditions[0] is None:
        return None
    select: Expr = Number(0.0)
    for k, condition in reversed(list(enumerate(form.conditions, 1))):
        taken = Number(float(k))
        select = taken if condition is None else Apply("if", (condition, taken, select))
    return select


def _parameters_written(node: Node) -> Sequence[str]:
    """Return the parameters that a node's text assigns."""
    if isinstance(node, Calculation):
        return [name for name, _ in node.assignments]
    if isinstance(node, Selection) and node.attributed:
        return node.attributed.formals
    return ()


def _setting_text(setting: Setting) -> str:
    head = f"{setting.kind.name} {setting.name} " if setting.name else f"{setting.kind.name} "
    pairs: list[Token] = []
    for key, value in setting.values.items():
        pairs += [Mark.BREAK] if pairs else []
        pairs.append(f"{key} = {_value_text(setting, key, value)};")
    return format_tokens([head, "{", Mark.OPEN, *pairs, Mark.CLOSE, "}"])


def _value_text(setting: Setting, key: str, value: tuple[Expr, ...] | str) -> str:
    if isinstance(value, str):
        if setting.kind.keys[key].kind is not ValueKind.FILE:
            return value
        if '"' in value or "\n" in value:
            raise UsageError(
                f"the name of a file in a grammar has no quotes and no line ends: {value!r}"
            )
        return f'"{value}"'
    if setting.kind.keys[key].kind is ValueKind.STOPS:
        numbers = [expr_text(e) for e in value]
        rows = (numbers[k : k + 4] for k in range(0, len(numbers), 4))
        return "(" + ", ".join(f"({x}, ({r}, {g}, {b}))" for x, r, g, b in rows) + ")"
    texts = ", ".join(expr_text(e) for e in value)
    return f"({texts})" if len(value) > 1 else texts
