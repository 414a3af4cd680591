"""Faults that are met while a graph is walked, told in one form by every engine.

A fault names the grammar's line, the derivation path (modules with the numbers of the rules taken)
and the values of the parameters at the place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import Diagnostic, EvaluationFault, SourceSpan
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Attribute, Calculation, Leaf, Node, Selection, Transformation

NOT_FINITE = "not-finite"
UNASSIGNED_PARAMETER = "unassigned-parameter"
SELECTION_RANGE = "selection-range"
SINGULAR_MATRIX = "singular-matrix"
BAD_ARGUMENT = "bad-argument"
DEPTH_LIMIT = "depth-limit"
LONG_RAY = "long-ray"
MEMORY_BUDGET = "memory-budget"
TOO_MANY_MODELS = "too-many-models"

_MESSAGES = {
    NOT_FINITE: "a result {where} is not a finite number",
    UNASSIGNED_PARAMETER: "a parameter that is read {where} has no value on this path",
    SELECTION_RANGE: "the selection function {where} names no rule",
    SINGULAR_MATRIX: "the matrix {where} has no inverse",
    BAD_ARGUMENT: "an argument {where} is outside its legal range",
    DEPTH_LIMIT: "the recursion {where} does not end within the depth limit",
    LONG_RAY: "a ray does not come to an end within the copies {where}",
    MEMORY_BUDGET: "the work {where} does not fit into the memory budget",
    TOO_MANY_MODELS: "too many models {where}",
}

_HINTS = {
    SINGULAR_MATRIX: "scale by something other than 0",
    DEPTH_LIMIT: "check that every cycle of rules changes a parameter towards a terminating rule",
    LONG_RAY: "make fewer copies, or let modules stand for many",
    TOO_MANY_MODELS: "round a parameter, as in `round(8 * x) / 8`, so that places share models",
    UNASSIGNED_PARAMETER: "assign it in the axiom's block or on every path to this place; a block"
    " reaches only the solid behind it, and brackets make several one: `{n = 2} ( ... | ... )`",
}

_PATH_SHOWN = 12
_PARAMETERS_SHOWN = 16


def fault_diagnostic(
    kind: str,
    graph: Graph,
    node_number: int,
    span: SourceSpan | None,
    path: Sequence[tuple[str, int]],
    parameters: Mapping[str, float],
    detail: str = "",
) -> Diagnostic:
    """Return the diagnostic of a fault.

    Parameters
    ----------
    kind
        One of the codes of this module, such as ``not-finite``.
    node_number
        The node where it happened.
    span
        The expression at fault; None: the node's own place.
    path
        Modules and numbers of the rules taken, from the axiom down.
    parameters
        Values of the grammar's parameters at the place; hidden ones (``@...``) are left out.
    detail
        What is known beyond the kind, such as the value that was found.
    """
    node = graph.nodes[node_number]
    message = _MESSAGES[kind].format(where=_describe(node))
    if kind == BAD_ARGUMENT and isinstance(node, Leaf) and node.constants:
        message = f"this `{node.solid.name}` cannot be made"
    if detail:
        message += f": {detail}"
    notes = [(f"derivation: {format_path(path)}", None)]
    shown = {k: v for k, v in parameters.items() if not k.startswith("@") and v == v}
    if shown:
        notes.append((f"parameters: {_format_parameters(shown)}", None))
    return Diagnostic(kind, message, span or node.span, hint=_HINTS.get(kind), notes=tuple(notes))


def evaluation_fault(
    kind: str,
    graph: Graph,
    node_number: int,
    span: SourceSpan | None,
    path: Sequence[tuple[str, int]],
    parameters: Mapping[str, float],
    detail: str = "",
) -> EvaluationFault:
    """Return the exception of a fault; arguments as for `fault_diagnostic`."""
    return EvaluationFault(
        fault_diagnostic(kind, graph, node_number, span, path, parameters, detail)
    )


def spell_path(
    steps: NDArray[np.int64], link_of: Callable[[int], tuple[str, int]]
) -> list[tuple[str, int]]:
    """Return a path of steps that are numbers: of millions hardly any two may differ.

    Parameters
    ----------
    link_of
        Returns the module and the rule that a number stands for.
    """
    different, which = np.unique(steps, return_inverse=True)
    links = np.empty(len(different), object)
    for k, step in enumerate(different.tolist()):
        links[k] = link_of(step)
    return links[which].tolist()  # type: ignore[no-any-return]


def format_path(path: Sequence[tuple[str, int]]) -> str:
    """Return a derivation path as text: its last modules, repetitions of one rule counted."""
    runs = [(*step, len(list(same))) for step, same in groupby(path)]
    parts = [f"{name}:{rule}" + (f" ({n} times)" if n > 1 else "") for name, rule, n in runs]
    if len(parts) > _PATH_SHOWN:
        parts = ["...", *parts[-_PATH_SHOWN:]]
    else:
        parts = ["axiom", *parts]
    return " > ".join(parts)


def _format_parameters(values: Mapping[str, float]) -> str:
    names = list(values)
    shown = ", ".join(f"{name} = {values[name]:.17g}" for name in names[:_PARAMETERS_SHOWN])
    more = len(names) - _PARAMETERS_SHOWN
    return f"{shown} and {more} more" if more > 0 else shown


def _describe(node: Node) -> str:
    if isinstance(node, Selection):
        return f"of module `{node.name}`"
    if isinstance(node, Calculation):
        return "in a call" if node.call else "in an assignment"
    if isinstance(node, Transformation):
        return f"of `{node.transform.name}`"
    if isinstance(node, Attribute):
        return f"of `{node.kind.name}`"
    if isinstance(node, Leaf):
        return f"of `{node.solid.name}`"
    return f"of `{node.definition}`" if node.definition else "of an expression"
