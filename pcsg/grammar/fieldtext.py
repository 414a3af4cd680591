"""What stands in the braces of a blob, written back in the language, with what it uses."""

from __future__ import annotations

from collections.abc import Iterator

from pcsg.grammar import syntax
from pcsg.grammar.names import ModuleEntry, Names
from pcsg.grammar.syntax import Solid
from pcsg.graph.exprtext import call_text, expr_text
from pcsg.graph.pretty import Mark, Token, format_tokens
from pcsg.graph.text import (
    UNARY,
    BracedText,
    attributed_head,
    block_tokens,
    declaration_text,
    infix_tokens,
)


def write_fields(names: Names, body: Solid) -> BracedText:
    """Return the expression of a blob, and every module and definition that it uses.

    Reading what is written gives the same text again.
    """
    modules: dict[str, str] = {}
    definitions: dict[str, str] = {}
    todo = [body]
    seen: set[str] = set()
    while todo:
        uses = [p.name for p in syntax.inner(todo.pop()) if isinstance(p, syntax.Use)]
        for name in dict.fromkeys(uses):
            if name in seen:
                continue
            seen.add(name)
            if name in names.modules:
                entry = names.modules[name]
                modules[name] = "\n".join(_module(entry))
                todo += [solid for solid in entry.solids.values() if solid is not None]
            elif name in names.definitions:
                solid = names.definitions[name].solid
                assert solid is not None
                definitions[name] = format_tokens([f"{name} = ", *field_tokens(solid)])
                todo.append(solid)
    return BracedText((Mark.OPEN, *field_tokens(body), Mark.CLOSE), modules, definitions)


def _module(entry: ModuleEntry) -> Iterator[str]:
    if entry.attributed:
        count = len(entry.attributed)
        for rule in entry.attributed:
            formals = [formal.text for formal in rule.formals]
            head = attributed_head(rule.label.text, entry.name, formals, rule.condition, count)
            yield _rule(head, rule.solid)
        return
    if entry.declaration is not None:
        yield declaration_text(entry.name, entry.declaration.select)
    for number, numbered in sorted(entry.rules.items()):
        yield _rule(f"{number}: {entry.name} -> ", numbered.solid)


def _rule(head: str, solid: Solid | None) -> str:
    assert solid is not None
    return format_tokens([head, *field_tokens(solid)])


def field_tokens(root: Solid) -> Iterator[Token]:
    """Yield an expression of fields; without recursion, texts may nest deeply."""
    work: list[Token | tuple[Solid, int]] = [(root, 0)]
    while work:
        item = work.pop()
        if not isinstance(item, tuple):
            yield item
            continue
        solid, least = item
        if isinstance(solid, syntax.Combination):
            work.extend(reversed(infix_tokens(solid.operator, _operands(solid), least)))
        elif isinstance(solid, syntax.Prefixed):
            work.append((solid.operand, UNARY))
            for prefix in reversed(solid.prefixes):
                assert isinstance(prefix, (syntax.Block, syntax.Unary))
                work += [Mark.FILL, *reversed(_prefix(prefix))]
        elif isinstance(solid, syntax.BlendUse):
            work.extend(reversed(_blend(solid)))
        else:
            assert isinstance(solid, (syntax.Use, syntax.Primitive))
            values = solid.arguments.values if solid.arguments is not None else ()
            yield call_text(solid.name, values)


def _operands(solid: syntax.Combination) -> list[Solid]:
    """Return the operands, those of a first one of the same operator in its place."""
    last_first: list[Solid] = []
    first: Solid = solid
    while isinstance(first, syntax.Combination) and first.operator is solid.operator:
        last_first.extend(reversed(first.operands[1:]))
        first = first.operands[0]
    return [first, *reversed(last_first)]


def _prefix(prefix: syntax.Block | syntax.Unary) -> list[Token]:
    if isinstance(prefix, syntax.Unary):
        return [call_text(prefix.name, prefix.arguments.values)]
    return block_tokens([f"{name.text} = {expr_text(expr)}" for name, expr in prefix.assignments])


def _blend(use: syntax.BlendUse) -> list[Token | tuple[Solid, int]]:
    parts: list[Token | tuple[Solid, int]] = [call_text(use.name, use.arguments.values)]
    if use.name == "gbb":
        for field in use.fields:
            parts += [Mark.FILL, "{ ", Mark.OPEN, (field, 0), Mark.CLOSE, " }"]
        return parts
    parts += [" { ", Mark.OPEN]
    for k, field in enumerate(use.fields):
        parts += [" ,", Mark.BREAK] if k else []
        parts.append((field, 0))
    return [*parts, Mark.CLOSE, " }"]
