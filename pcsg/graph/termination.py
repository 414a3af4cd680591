"""Whether a grammar can end: two checks on the graph, both necessary, not sufficient.

Paper, section 2.1: every module needs a terminating rule. Beyond that a cycle must change what the
selections on it read, or it never ends once it was entered.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, SourceSpan
from pcsg.graph.expr import Parameter, asks_world, parameters_of
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Calculation, Node, Operation, Selection, Transformation
from pcsg.graph.text import assignment_texts

_NOTES_SHOWN = 12


def check_termination(graph: Graph) -> list[Diagnostic]:
    """Return what keeps a grammar from ending; see the two checks."""
    if not graph.selections:
        return []  # only modules are targets of cyclic edges
    return [*check_terminating_rules(graph), *check_cycles(graph)]


# Terminating rules.


def check_terminating_rules(graph: Graph) -> list[Diagnostic]:
    """Report modules that no choice of rules brings to an expression of leaves only."""
    endless = _unproductive(graph)
    problems: list[Diagnostic] = []
    for component in strong_components(graph.successors, endless):
        modules = _selections(graph, component)
        if not modules:
            continue
        module = modules[0]
        others = ", ".join(f"`{m.name}`" for m in modules[1:4])
        message = f"module `{module.name}` has no terminating rule"
        if others:
            message += f", neither have {others}" if len(modules) > 2 else f", nor has {others}"
        problems.append(
            diagnose(
                "no-terminating-rule",
                message,
                module.span,
                expected="a rule that leads to primitives only",
                hint=f"add a rule such as `{len(module.rules) + 1}: {module.name} -> empty`"
                + ("" if module.select is not None else " and a selection function"),
            )
        )
    return problems


def _unproductive(graph: Graph) -> set[int]:
    """Return the nodes that cannot be derived to leaves, by counting successors that can."""
    waiting = [
        1 if isinstance(node, Selection) else len(set(below))
        for node, below in zip(graph.nodes, graph.successors, strict=True)
    ]
    above: list[list[int]] = [[] for _ in graph.nodes]
    for k, below in enumerate(graph.successors):
        for successor in set(below):
            above[successor].append(k)
    ready = [k for k, count in enumerate(waiting) if count == 0]
    productive = set(ready)
    while ready:
        for k in above[ready.pop()]:
            waiting[k] -= 1
            if waiting[k] == 0:
                productive.add(k)
                ready.append(k)
    return set(range(len(graph.nodes))) - productive


# Cycles that change nothing.


def check_cycles(graph: Graph) -> list[Diagnostic]:
    """Report cycles on which no parameter is assigned that a selection in their component reads.

    For every strongly connected component the nodes that assign such a parameter are taken out
    and, where a selection asks for world coordinates, the transformations; a cycle in what is
    left never ends.
    """
    endless = _unproductive(graph)
    problems: list[Diagnostic] = []
    for component in strong_components(graph.successors, set(range(len(graph.nodes)))):
        if endless.intersection(component):
            continue  # reported for want of a terminating rule
        selects = [m.select for m in _selections(graph, component) if m.select is not None]
        read = parameters_of(*selects)
        world = asks_world(*selects)
        kept = {
            k
            for k in component
            if not _changes(graph.nodes[k], read)
            and not (world and isinstance(graph.nodes[k], Transformation))
        }
        for rest in strong_components(graph.successors, kept):
            cycle = _shortest_cycle(graph, rest)
            problems.append(_describe_cycle(graph, cycle, set(rest), read))
    return problems


def _changes(node: Node, read: set[str]) -> bool:
    """Whether a node assigns one of the parameters, other than ``p = p``."""
    return isinstance(node, Calculation) and any(
        name in read and not (isinstance(expr, Parameter) and expr.name == name)
        for name, expr in node.assignments
    )


def _shortest_cycle(graph: Graph, component: Sequence[int]) -> list[int]:
    """Return a shortest cycle through the first module of a strongly connected component."""
    inside = set(component)
    start = next(
        (k for k in sorted(component) if isinstance(graph.nodes[k], Selection)), min(component)
    )
    before: dict[int, int] = {}
    queue = deque([start])
    while queue:
        k = queue.popleft()
        for successor in graph.successors[k]:
            if successor == start:
                path = [k]
                while path[-1] != start:
                    path.append(before[path[-1]])
                return path[::-1]
            if successor in inside and successor not in before:
                before[successor] = k
                queue.append(successor)
    return [start]


def _describe_cycle(
    graph: Graph, cycle: Sequence[int], component: set[int], read: set[str]
) -> Diagnostic:
    nodes = [graph.nodes[k] for k in cycle]
    modules = [n for n in nodes if isinstance(n, Selection)]
    names = [m.name for m in modules]
    shown = " -> ".join(names[:8] + ["..."] * (len(names) > 8) + names[:1])
    wanted = _listing(sorted(read))
    if read:
        message = f"endless cycle {shown}: nothing on it changes {wanted}"
    else:
        message = f"endless cycle {shown}: no selection function on it reads a parameter"
    steps = _steps(nodes)
    notes = [
        (f"rule {number} of `{module.name}` leads to `{target.name}`", place)
        for module, number, target, place in steps[:_NOTES_SHOWN]
    ]
    place = steps[0][3] if steps else nodes[0].span
    expected = f"an assignment to {wanted} on the way" if read else None
    hint = _parentheses(graph, component, read) or _plain_repair(modules, read)
    return diagnose("endless-cycle", message, place, expected=expected, hint=hint, notes=notes)


def _steps(nodes: Sequence[Node]) -> list[tuple[Selection, int, Selection, SourceSpan | None]]:
    """Return the rules that a cycle takes: module, number, the next module, a place in the rule."""
    starts = [k for k, n in enumerate(nodes) if isinstance(n, Selection)]
    steps = []
    for i, k in enumerate(starts):
        module, target = nodes[k], nodes[starts[(i + 1) % len(starts)]]
        assert isinstance(module, Selection) and isinstance(target, Selection)
        end = starts[i + 1] if i + 1 < len(starts) else len(nodes)
        way = [*nodes[k + 1 : end], target]
        number = next(n for n, below in sorted(module.rules.items()) if below is way[0])
        # The first place that is not a whole combination tells most about the way.
        places = [n.span for n in way[:-1] if n.span and not isinstance(n, Operation)]
        places += [n.span for n in way[:-1] if n.span]
        steps.append((module, number, target, places[0] if places else module.span))
    return steps


def _plain_repair(modules: Sequence[Selection], read: set[str]) -> str:
    name = modules[0].name if modules else "S"
    formals = modules[0].attributed.formals if modules and modules[0].attributed else ()
    if read.intersection(formals):
        changed = [f"{f}-1" if f in read else f for f in formals]
        return f"call it with other arguments, such as `{name}({', '.join(changed)})`"
    if read:
        parameter = min(read)
        return f"put a block before the module, such as `{{{parameter}={parameter}-1}} {name}`"
    return f"let the selection function of `{name}` read a parameter that the cycle changes"


def _parentheses(graph: Graph, component: set[int], read: set[str]) -> str | None:
    """Return the repair where a block binds to the first of several operands only.

    The paper's fig 3a is printed so.
    """
    for number in sorted(component):
        selection = graph.nodes[number]
        if not isinstance(selection, Selection):
            continue
        for rule, body in sorted(selection.rules.items()):
            way: list[Node] = []
            node = body
            while not isinstance(node, (Selection, Operation)) and node.successors:
                way.append(node)
                node = node.successors[0]
            if not isinstance(node, Operation) or graph.number[node] not in component:
                continue
            block = node.operands[0]
            if isinstance(block, Calculation) and not block.call and _changes(block, read):
                before = "... " if way else ""
                sign = node.operator.symbols[0]
                return (
                    f"the block binds to the first operand only; put parentheses behind it: "
                    f"`{rule}: {selection.name} -> {before}{_block_text(block)} "
                    f"( {_first_word(block.successor)}... {sign} ... )`"
                )
    return None


def _block_text(block: Calculation) -> str:
    if block.span is not None and block.span.body is None:
        text = " ".join(block.span.text.split())
    else:
        text = "{" + "; ".join(assignment_texts(block)) + "}"
    return text if len(text) <= 60 else "{...}"


def _first_word(node: Node) -> str:
    while isinstance(node, Operation):
        node = node.operands[0]
    if isinstance(node, Transformation):
        return node.transform.name
    return node.name if isinstance(node, Selection) else ""


def _listing(names: Sequence[str]) -> str:
    shown = [f"`{n}`" for n in names[:6]]
    return ", ".join(shown[:-1]) + " or " + shown[-1] if len(shown) > 1 else "".join(shown)


def _selections(graph: Graph, numbers: Iterable[int]) -> list[Selection]:
    found = (graph.nodes[k] for k in sorted(numbers))
    return [n for n in found if isinstance(n, Selection)]


def strong_components(successors: Sequence[Sequence[int]], within: set[int]) -> list[list[int]]:
    """Return the strongly connected components that hold a cycle (Tarjan 1972, iterative).

    Parameters
    ----------
    successors
        Numbers of the successors of every node.
    within
        The nodes that count; edges to others are left out.
    """
    index: dict[int, int] = {}
    low: dict[int, int] = {}
    on_stack: set[int] = set()
    stack: list[int] = []
    found: list[list[int]] = []
    for root in sorted(within):
        if root in index:
            continue
        work = [(root, 0)]
        while work:
            node, k = work.pop()
            if k == 0:
                index[node] = low[node] = len(index)
                stack.append(node)
                on_stack.add(node)
            elif successors[node][k - 1] in on_stack:
                low[node] = min(low[node], low[successors[node][k - 1]])
            while k < len(successors[node]):
                below = successors[node][k]
                k += 1
                if below not in within:
                    continue
                if below not in index:
                    work += [(node, k), (below, 0)]
                    break
                if below in on_stack:
                    low[node] = min(low[node], index[below])
            else:
                if low[node] == index[node]:
                    component: list[int] = []
                    while not component or component[-1] != node:
                        component.append(stack.pop())
                        on_stack.discard(component[-1])
                    if len(component) > 1 or node in successors[node]:
                        found.append(component)
    return sorted(found, key=min)
