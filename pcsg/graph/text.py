"""A graph written back in the language, such that reading it gives an equal graph."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from pcsg.errors import UsageError
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.expr import Apply, Expr, Number, Parameter, parameters_of, signature
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
from pcsg.graph.pretty import Mark, Token, format_tokens
from pcsg.graph.settings import Setting, ValueKind
from pcsg.graph.transforms import TRANSFORMS
from pcsg.leaf import LEAF_NAMES

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")

# How tightly arithmetic binds, as in Python.
_OR, _AND, _NOT, _COMPARE, _ADD, _MULTIPLY, _NEGATE, _POWER, _ATOM = range(1, 10)

# Of every infix operator: how tightly it binds, and what its two sides must at least.
_INFIX = {
    "or": (_OR, _OR, _AND),
    "and": (_AND, _AND, _NOT),
    **dict.fromkeys(("<", "<=", ">", ">=", "==", "!="), (_COMPARE, _ADD, _ADD)),
    **dict.fromkeys(("+", "-"), (_ADD, _ADD, _MULTIPLY)),
    **dict.fromkeys(("*", "/", "%"), (_MULTIPLY, _MULTIPLY, _NEGATE)),
    "^": (_POWER, _ATOM, _NEGATE),
}

# How tightly solids bind: operators by their precedence, unary operators above them.
_UNARY = 100


def number_text(value: float) -> str:
    """Return the shortest text that reads as this number; integers have no point."""
    if not math.isfinite(value):
        raise UsageError(f"a grammar cannot hold the number {value}")
    if value.is_integer() and abs(value) < 1e16:
        return f"{value:.0f}"
    return repr(value)


def expr_text(expr: Expr) -> str:
    """Return an expression in the language, with as few parentheses as it needs.

    Parameters
    ----------
    expr
        Any nesting.

    Raises
    ------
    UsageError
        A constant is infinite or NaN.
    """
    out: list[str] = []
    work: list[str | tuple[Expr, int]] = [(expr, 0)]
    while work:
        item = work.pop()
        if isinstance(item, str):
            out.append(item)
            continue
        inner, least = item
        binds, parts = _parts(inner)
        work.extend(reversed(parts if binds >= least else ["(", *parts, ")"]))
    return "".join(out)


def _parts(expr: Expr) -> tuple[int, list[str | tuple[Expr, int]]]:
    """Return how tightly an expression binds, and its text with its arguments left open."""
    if isinstance(expr, Number):
        return (_NEGATE if math.copysign(1.0, expr.value) < 0 else _ATOM), [number_text(expr.value)]
    if isinstance(expr, Parameter):
        return _ATOM, [expr.name]
    assert isinstance(expr, Apply)
    args = expr.args
    if expr.function in _INFIX:
        binds, left, right = _INFIX[expr.function]
        sign = "^" if expr.function == "^" else f" {expr.function} "
        return binds, [(args[0], left), sign, (args[1], right)]
    if expr.function == "neg":
        return _NEGATE, ["-", (args[0], _POWER)]
    if expr.function == "not":
        return _NOT, ["not ", (args[0], _NOT)]
    parts: list[str | tuple[Expr, int]] = [f"{expr.function}("]
    for k, arg in enumerate(args):
        if k:
            parts.append("; " if k == expr.seeds else ", ")
        parts.append((arg, 0))
    return _ATOM, [*parts, ")"]


def call_text(name: str, args: Sequence[Expr], reference: str | None = None) -> str:
    """Return ``name(reference, args)``, or the bare name where there are no arguments."""
    texts = [*([reference] if reference else []), *(expr_text(a) for a in args)]
    return f"{name}({', '.join(texts)})" if texts else name


def node_text(node: Node) -> str:
    """Return what a node says by itself, without its successors.

    A selection gives its name, a calculation its block, an operation its operator's sign.
    """
    if isinstance(node, Selection):
        return node.name
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
    constants = ", ".join(c.text or "..." for c in node.constants)
    return call_text(node.solid.name, _given_args(node), constants or None)


def assignment_texts(node: Calculation) -> list[str]:
    """Return the assignments of a calculation, one text each."""
    return [f"{name} = {expr_text(expr)}" for name, expr in node.assignments]


def _given_args(leaf: Leaf) -> Sequence[Expr]:
    """Return a leaf's arguments without those at the end that are the defaults."""
    count = len(leaf.args)
    for parameter in reversed(leaf.parameters[: len(leaf.args)]):
        default = parameter.default
        if default is None or signature(leaf.args[count - 1]) != signature(Number(default)):
            break
        count -= 1
    return leaf.args[:count]


def to_pcsg(graph: Graph, *, abridged: bool = False) -> str:
    """Return a graph as a grammar: the axiom, modules, definitions, settings.

    Parameters
    ----------
    abridged
        Write ``...`` for data that the language cannot say, such as a mesh given as arrays.

    Nodes that are reached from several places become definitions, with the names they have or
    with generated ones, so that reading the text gives an equal graph.

    Raises
    ------
    UsageError
        The graph has what the language cannot say: a name that is reserved or used twice, a
        cycle without a module, a module without rules or without a selection function, data
        without a file.
    """
    if not abridged:
        _check_constants(graph)
    return _Writer(graph).write()


def _check_constants(graph: Graph) -> None:
    for node in graph.nodes:
        for constant in node.constants if isinstance(node, Leaf) else ():
            if constant.text is None:
                assert isinstance(node, Leaf)
                raise UsageError(
                    f"a grammar cannot hold the data of this `{node.solid.name}`; "
                    "save them to a file and name it"
                )


def reserved_names() -> frozenset[str]:
    """Return the words that no module, definition or parameter can be called."""
    words = {"else", "and", "or", "not", "pi", "e", "true", "false"}
    return frozenset(words | {*TRANSFORMS, *ATTRIBUTES, *LEAF_NAMES})


class _Writer:
    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._reserved = reserved_names()
        self._names: dict[Node, str] = {}

    def write(self) -> str:
        graph = self._graph
        self._check_names()
        self._name_definitions()
        self._check_definitions()
        items = [self._item(self._axiom_head(), graph.root)]
        items += ["\n".join(self._module(module)) for module in graph.selections]
        definitions = [
            self._item(f"{name} = ", node, body=True) for node, name in self._names.items()
        ]
        if definitions:
            items.append("\n".join(definitions))
        items += [_setting_text(setting) for setting in graph.settings]
        return "\n\n".join(items) + "\n"

    def _check_names(self) -> None:
        seen: dict[str, str] = {}
        for node in self._graph.nodes:
            if isinstance(node, Selection):
                self._claim(node.name, "module", seen)
            elif node.definition is not None:
                self._claim(node.definition, "definition", seen)
        for node in self._graph.nodes:
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
        if not _NAME.match(name):
            raise UsageError(
                f"a {kind} cannot be called {name!r}: names are made of letters a-z, A-Z, "
                "digits and _, and begin with no digit"
            )
        if name in self._reserved:
            raise UsageError(f"a {kind} cannot be called `{name}`: the language reserves that word")

    def _name_definitions(self) -> None:
        """Find the nodes that need a name, and give them one."""
        nodes = self._graph.nodes
        places = dict.fromkeys(nodes, 0)
        places[self._graph.root] = 1
        for node in nodes:
            for successor in node.successors:
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
        fresh = (name for k in range(1, 10**9) if (name := f"part_{k}") not in taken)
        for node in nodes:
            if node in shared and not isinstance(node, Selection):
                self._names[node] = node.definition or next(fresh)

    def _check_definitions(self) -> None:
        """Check that every cycle passes a module: expressions cannot contain themselves."""
        done: set[Node] = set()
        open_: dict[Node, None] = {}
        for start in self._graph.nodes:
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
                if k < len(node.successors):
                    stack += [(node, k + 1), (node.successors[k], 0)]
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
            text = expr_text(module.select)
            # A minus after a name would be a difference.
            yield f"{module.name} ({text})" if text.startswith("-") else f"{module.name} {text}"
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
        formals = ", ".join(form.formals)
        for k, (label, condition) in enumerate(zip(form.labels, form.conditions, strict=True)):
            if condition is not None:
                guard = f": {expr_text(condition)}"
            elif k < count - 1:
                raise UsageError(f"rule `{label}` of module `{module.name}` needs a condition")
            else:
                guard = ": else" if count > 1 else ""
            head = f"{label}: {module.name}({formals}){guard} -> "
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
            elif isinstance(node, Calculation):
                work.extend(reversed(self._calculation(node)))
            elif isinstance(node, (Transformation, Attribute)):
                work += [(node.successor, _UNARY), Mark.FILL, node_text(node)]
            else:
                yield node_text(node)

    def _operation(self, node: Operation, least: int) -> list[Token | tuple[Node, int]]:
        operator = node.operator
        if len(node.operands) < 2:
            raise UsageError(f"{operator.name} needs two operands or more")
        parts: list[Token | tuple[Node, int]] = [Mark.OPEN]
        for k, operand in enumerate(node.operands):
            if k:
                parts += [Mark.BREAK, f"{operator.symbols[0]} "]
            parts.append((operand, operator.precedence + (k > 0)))
        parts.append(Mark.CLOSE)
        return ["(", *parts, ")"] if operator.precedence < least else parts

    def _calculation(self, node: Calculation) -> list[Token | tuple[Node, int]]:
        if node.call:
            module = node.successor
            form = module.attributed if isinstance(module, Selection) else None
            if form is None or form.formals != tuple(name for name, _ in node.assignments):
                raise UsageError("a call must assign the formals of an attributed module below it")
            return [node_text(node)]
        texts = assignment_texts(node)
        parts: list[Token | tuple[Node, int]] = ["{", Mark.OPEN]
        for k, text in enumerate(texts):
            parts += [Mark.BREAK] if k else []
            parts.append(text + (";" if k < len(texts) - 1 else ""))
        return [*parts, Mark.CLOSE, "}", Mark.FILL, (node.successor, _UNARY)]


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
        if setting.kind.keys[key].kind is not ValueKind.TEXT:
            return value
        if '"' in value or "\n" in value:
            raise UsageError(f"a text in a grammar has no quotes and no line ends: {value!r}")
        return f'"{value}"'
    texts = ", ".join(expr_text(e) for e in value)
    return f"({texts})" if len(value) > 1 else texts
