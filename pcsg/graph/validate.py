"""Checks of a whole graph, whether it comes from text or was built in Python."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, SourceSpan, suggest
from pcsg.graph.colours import check_colours
from pcsg.graph.expr import Expr, Number, Parameter, operands, postorder
from pcsg.graph.graph import GLOBALS, Graph, expressions
from pcsg.graph.nodes import Calculation, Leaf, Node, Operation, Selection
from pcsg.graph.operators import DIFFERENCE
from pcsg.graph.termination import check_termination

MOST_SUGGESTIONS = 200
"""Most unknown parameters that are compared with all that there are."""


def check_graph(graph: Graph) -> list[Diagnostic]:
    """Return everything that is wrong with a graph before any ray walks it."""
    return [
        *check_rules(graph),
        *check_parameters(graph),
        *check_setting_parameters(graph),
        *check_sheets(graph),
        *check_constant_selections(graph),
        *check_termination(graph),
        *check_files(graph),
        *check_colours(graph),
    ]


def check_rules(graph: Graph) -> list[Diagnostic]:
    """Report modules without rules, which only graphs built in Python can have."""
    return [
        diagnose(
            "undefined-module",
            f"module `{node.name}` has no rules",
            node.span,
            hint="give it one: `.rule(1, ...)`",
        )
        for node in graph.nodes
        if isinstance(node, Selection) and not node.rules
    ]


def check_files(graph: Graph) -> list[Diagnostic]:
    """Return a warning for everything that was left out of a file or mended in it."""
    told: set[tuple[object, str]] = set()
    problems: list[Diagnostic] = []
    for leaf in graph.nodes:
        if not isinstance(leaf, Leaf):
            continue
        for constant in leaf.constants:
            for note in constant.notes:
                if (constant.signature, note) not in told:
                    told.add((constant.signature, note))
                    message = f"{leaf.solid.name}({constant.text or '...'}): {note}"
                    problems.append(diagnose("file-mended", message, leaf.span))
    return problems


def check_parameters(graph: Graph, ignore: Collection[str] = ()) -> list[Diagnostic]:
    """Report parameters that are read where no path from the axiom has assigned them.

    Parameters
    ----------
    ignore
        Names that are not reported.
    """
    exprs = (e for exprs in graph.formulas.values() for e in exprs)
    read = {e.name for expr in exprs for e in _parameters_in(expr)}
    if read <= GLOBALS.keys() | set(ignore):
        return []
    bit = {name: 1 << k for k, name in enumerate(sorted(read))}
    known = sum(bit[name] for name in GLOBALS if name in bit)
    assigned = _assigned_before(graph, bit, known)
    first: dict[str, tuple[Node, Parameter]] = {}
    count: dict[str, int] = {}
    for number in graph.formulas:
        node = graph.nodes[number]
        for parameter, have in _reads(node, assigned[number], bit):
            if not have & bit[parameter.name] and parameter.name not in ignore:
                first.setdefault(parameter.name, (node, parameter))
                count[parameter.name] = count.get(parameter.name, 0) + 1
    elsewhere = set(graph.parameters)
    block = graph.axiom_block
    in_axiom = {name for name, _ in block.assignments} if block else set()
    problems: list[Diagnostic] = []
    for k, (name, (node, parameter)) in enumerate(first.items()):
        message = f"parameter `{name}` is never assigned"
        hint = f"assign it in the axiom: `{{{name} = ...}}`"
        if name in elsewhere:
            message += " on the way here"
            if name in in_axiom:
                hint = (
                    "a block reaches only the solid behind it; brackets make several one:"
                    f" `{{{name} = ...}} ( ... | ... )`"
                )
        elif k < MOST_SUGGESTIONS:
            hint = suggest(name, [*graph.parameters, *GLOBALS]) or hint
        message += f" (read at {count[name]} places)" if count[name] > 1 else ""
        place = parameter.span or node.span
        problems.append(diagnose("parameter-never-assigned", message, place, hint=hint))
    return problems


def _parameters_of(node: Node) -> Iterator[Parameter]:
    for root in expressions(node):
        if not isinstance(root, Number):
            yield from _parameters_in(root)


def _parameters_in(root: Expr) -> Iterator[Parameter]:
    for expr in postorder(root, operands):
        if isinstance(expr, Parameter):
            yield expr


def _reads(node: Node, have: int, bit: dict[str, int]) -> Iterator[tuple[Parameter, int]]:
    """Yield every parameter that a node reads with what is assigned at that moment."""
    if not isinstance(node, Calculation) or node.call:
        for parameter in _parameters_of(node):
            yield parameter, have
        return
    for name, expr in node.assignments:
        for parameter in _parameters_in(expr):
            yield parameter, have
        have |= bit.get(name, 0)


def _assigned_before(graph: Graph, bit: dict[str, int], known: int) -> list[int]:
    """Return for every node the parameters that some path from the axiom assigns, as bits."""
    stores = [0] * len(graph.nodes)
    for k, node in enumerate(graph.nodes):
        if isinstance(node, Calculation):
            for name, _ in node.assignments:
                stores[k] |= bit.get(name, 0)
    assigned = [known] * len(graph.nodes)
    pending = list(range(len(graph.nodes)))[::-1]
    waiting = set(pending)
    while pending:
        k = pending.pop()
        waiting.discard(k)
        out = assigned[k] | stores[k]
        for successor in graph.successors[k]:
            joined = assigned[successor] | out
            if joined != assigned[successor]:
                assigned[successor] = joined
                if successor not in waiting:
                    waiting.add(successor)
                    pending.append(successor)
    return assigned


def check_setting_parameters(graph: Graph) -> list[Diagnostic]:
    """Report parameters that settings read but the axiom's leading block does not assign."""
    block = graph.axiom_block
    known = dict.fromkeys([*GLOBALS, *(name for name, _ in (block.assignments if block else ()))])
    problems: list[Diagnostic] = []
    for setting in graph.settings:
        for value in setting.values.values():
            for root in () if isinstance(value, str) else value:
                for parameter in _parameters_in(root):
                    if parameter.name in known:
                        continue
                    compared = known if len(problems) < MOST_SUGGESTIONS else ()
                    problems.append(
                        diagnose(
                            "parameter-never-assigned",
                            f"the axiom's first block does not assign `{parameter.name}`",
                            parameter.span or setting.span,
                            expected="a number, or an expression over the axiom's parameters",
                            hint=suggest(parameter.name, compared),
                        )
                    )
    return problems


def check_sheets(graph: Graph) -> list[Diagnostic]:
    """Report sheets that are subtracted, also through modules and definitions."""
    # For every node that leads to a sheet the sheet that it leads to.
    sheet_of: dict[int, Leaf] = {}
    pending: list[int] = []
    for k, node in enumerate(graph.nodes):
        if isinstance(node, Leaf) and node.is_sheet:
            sheet_of[k] = node
            pending.append(k)
    if not pending:
        return []
    above: list[list[int]] = [[] for _ in graph.nodes]
    for k, below in enumerate(graph.successors):
        for successor in below:
            above[successor].append(k)
    while pending:
        k = pending.pop()
        for upper in above[k]:
            if upper not in sheet_of:
                sheet_of[upper] = sheet_of[k]
                pending.append(upper)
    problems: list[Diagnostic] = []
    for node in graph.nodes:
        if not isinstance(node, Operation) or node.operator is not DIFFERENCE:
            continue
        for operand in node.operands[1:]:
            sheet = sheet_of.get(graph.number[operand])
            if sheet is not None:
                problems.append(_subtracted(node, operand, sheet))
    return problems


def _subtracted(difference: Operation, operand: Node, sheet: Leaf) -> Diagnostic:
    notes: list[tuple[str, SourceSpan | None]] = []
    if operand is not sheet:
        notes.append((f"the sheet `{sheet.solid.name}`", sheet.span))
    notes += [(c.why_sheet, None) for c in sheet.constants if c.why_sheet]
    # A module or a definition has its own place; the difference is the one to look at.
    shared = isinstance(operand, Selection) or operand.definition is not None
    place = difference.span if shared or operand.span is None else operand.span
    return diagnose(
        "sheet-subtracted",
        f"the sheet `{sheet.solid.name}` is subtracted, but it has no volume",
        place,
        hint="subtract a solid, such as a thin `box`",
        notes=notes,
    )


def check_constant_selections(graph: Graph) -> list[Diagnostic]:
    """Report selection functions that are a constant which names no rule."""
    problems: list[Diagnostic] = []
    for module in graph.selections:
        select = module.select
        if not isinstance(select, Number) or round(select.value) in module.rules:
            continue
        numbers = ", ".join(str(k) for k in sorted(module.rules)[:8])
        problems.append(
            diagnose(
                "selection-range",
                f"the selection function of `{module.name}` is always {select.value:g}",
                select.span or module.span,
                expected=f"the number of a rule: {numbers}",
            )
        )
    return problems
