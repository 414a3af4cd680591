"""Places in the world, which blobs cannot ask for: one blob stands in many places."""

from __future__ import annotations

from collections.abc import Sequence

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, SourceSpan
from pcsg.grammar import syntax
from pcsg.graph.expr import Expr, functions_of
from pcsg.graph.functions import FUNCTIONS, Form


def check_part_places(part: object) -> list[Diagnostic]:
    """Report what a part of a blob asks of the world."""
    if isinstance(part, syntax.Block):
        return check_places([expr for _, expr in part.assignments], part.span)
    if isinstance(part, (syntax.Unary, syntax.Primitive, syntax.Use, syntax.BlendUse)):
        return check_places(part.arguments.values if part.arguments else (), part.span)
    return []


def check_places(exprs: Sequence[Expr], span: SourceSpan) -> list[Diagnostic]:
    """Report questions for places in the world among expressions of a blob."""
    asked = [f for f in functions_of(*exprs) if f in FUNCTIONS]
    return [
        diagnose(
            "world-in-blob",
            f"`{name}` asks for a place in the world, which a blob has not",
            span,
            hint="assign it in a block before `blob`, and read the parameter inside",
        )
        for name in sorted(f for f in asked if FUNCTIONS[f].form is Form.WORLD)
    ]
