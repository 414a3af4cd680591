"""Checks of every name and every number of arguments, wherever it stands in the files."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, SourceSpan, UsageError, suggest
from pcsg.grammar import syntax
from pcsg.grammar.colors import is_palette
from pcsg.grammar.fields import FIELD_BLENDS, FIELD_PRIMITIVES, FIELD_UNARY, field_names
from pcsg.grammar.names import Names
from pcsg.grammar.places import check_part_places, check_places
from pcsg.grammar.rows import read_rows
from pcsg.grammar.syntax import Arguments, Solid
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.expr import Apply, Expr, Number, Parameter, applications
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.operators import SUM
from pcsg.graph.settings import SETTINGS
from pcsg.graph.transforms import TRANSFORMS
from pcsg.leaf import LEAF_NAMES
from pcsg.leaf.registry import Constant

MAX_ARGUMENTS = 1000
"""Largest number of arguments of a function that takes any number."""

CALLABLE = tuple(n for n in FUNCTIONS if n.isidentifier() and n not in ("and", "or", "not", "neg"))
"""Names of the functions that are written with parentheses."""

Part = syntax.Use | syntax.Primitive | syntax.Prefix | syntax.BlendUse

FOR_ARGUMENTS = (2, 3)
"""Numbers of arguments of a `for` behind its parameter."""


def parts_of(solid: Solid | None) -> Iterator[Part]:
    """Yield uses, primitives, unary operators and blocks in the order of the text."""
    stack: list[Solid | Part] = [solid] if solid is not None else []
    while stack:
        item = stack.pop()
        if isinstance(item, syntax.Combination):
            stack.extend(reversed(item.operands))
        elif isinstance(item, syntax.Prefixed):
            stack.append(item.operand)
            stack.extend(reversed(item.prefixes))
        elif isinstance(item, syntax.Blob):
            stack.extend(item.fields)
        else:
            if isinstance(item, syntax.BlendUse):
                stack.extend(reversed(item.fields))
            elif isinstance(item, syntax.Repeat):
                stack.extend(reversed(item.prefixes))
            yield item


def bodies_of(names: Names) -> Iterator[Solid | None]:
    """Yield every expression for a solid in the files."""
    if names.axiom:
        yield names.axiom.solid
    for entry in names.modules.values():
        yield from (rule.solid for rule in entry.rules.values())
        yield from (rule.solid for rule in entry.attributed)
    yield from (definition.solid for definition in names.definitions.values())


def check_names(names: Names) -> list[Diagnostic]:
    """Check all expressions of the files against the tables and the registries."""
    problems: list[Diagnostic] = []
    materials = _setting_names(names)
    fields = field_names(names)
    for body, of_fields in _bodies_with_meaning(names, fields):
        problems += check_meaning(body, of_fields)
        for part, in_blob in _parts_with_meaning(body, of_fields):
            if in_blob:
                problems += check_field(part, names, fields)
                problems += check_part_places(part)
                if isinstance(part, (syntax.Use, syntax.Primitive, syntax.BlendUse)):
                    continue
                if isinstance(part, syntax.Unary) and part.name in FIELD_UNARY:
                    continue
            problems += _check_part(part, names, materials)
    for entry in names.modules.values():
        selections = [entry.declaration.select] if entry.declaration else []
        conditions = [r.condition for r in entry.attributed if r.condition is not None]
        problems += check_numbers([*selections, *conditions])
        if entry.name in fields:
            problems += check_places([*selections, *conditions], entry.span)
    return [*problems, *_definition_cycles(names)]


def _bodies_with_meaning(names: Names, fields: set[str]) -> Iterator[tuple[Solid | None, bool]]:
    """Yield every expression, and whether it is one of fields."""
    if names.axiom:
        yield names.axiom.solid, False
    for entry in names.modules.values():
        yield from ((rule.solid, entry.name in fields) for rule in entry.rules.values())
        yield from ((rule.solid, entry.name in fields) for rule in entry.attributed)
    for name, definition in names.definitions.items():
        yield definition.solid, name in fields


def _parts_with_meaning(solid: Solid | None, of_fields: bool) -> Iterator[tuple[Part, bool]]:
    """Yield the parts of an expression, and whether they stand in a blob."""
    stack: list[tuple[Solid | Part, bool]] = [(solid, of_fields)] if solid is not None else []
    while stack:
        item, inside = stack.pop()
        if isinstance(item, syntax.Combination):
            stack.extend((o, inside) for o in reversed(item.operands))
        elif isinstance(item, syntax.Prefixed):
            stack.append((item.operand, inside))
            stack.extend((p, inside) for p in reversed(item.prefixes))
        elif isinstance(item, syntax.Blob):
            stack.extend((f, True) for f in item.fields)
        else:
            if isinstance(item, syntax.BlendUse):
                stack.extend((f, inside) for f in reversed(item.fields))
            elif isinstance(item, syntax.Repeat):
                stack.extend((p, inside) for p in reversed(item.prefixes))
            yield item, inside


def check_meaning(body: Solid | None, of_fields: bool) -> list[Diagnostic]:
    """Report what stands in blobs only and does not, and blobs in blobs."""
    problems: list[Diagnostic] = []
    stack: list[tuple[Solid, bool]] = [(body, of_fields)] if body is not None else []
    while stack:
        item, inside = stack.pop()
        if isinstance(item, syntax.Combination):
            if item.operator is SUM and not inside:
                message = "`+` combines fields, in a blob"
                hint = "write `|` for the union, or put it into `blob { ... }`"
                problems.append(diagnose("outside-blob", message, item.span, hint=hint))
            stack.extend((o, inside) for o in reversed(item.operands))
        elif isinstance(item, syntax.Prefixed):
            stack.append((item.operand, inside))
        elif isinstance(item, syntax.BlendUse):
            if not inside:
                message = f"`{item.name}` combines fields, in a blob"
                hint = "put it into `blob { ... }`"
                problems.append(diagnose("outside-blob", message, item.span, hint=hint))
            stack.extend((f, inside) for f in reversed(item.fields))
        elif isinstance(item, syntax.Blob):
            if inside:
                message = "a blob cannot stand in a blob"
                problems.append(diagnose("not-a-field", message, item.span))
            stack.extend((f, True) for f in item.fields)
    return problems


def check_field(part: Part, names: Names, fields: set[str]) -> list[Diagnostic]:
    """Check what stands in a blob."""
    if isinstance(part, (syntax.For, syntax.Repeat, syntax.Scatter)):
        word = type(part).__name__.lower()
        instead = "let a module of the blob repeat it"
        return [diagnose("not-a-field", f"`{word}` repeats solids", part.span, hint=instead)]
    if isinstance(part, syntax.BlendUse):
        least, most = FIELD_BLENDS[part.name]
        given = len(part.arguments.values)
        problems = check_numbers(part.arguments.values)
        problems += _check_count(part.name, given, least, most, part.span)
        if part.name == "gbb" and len(part.fields) != 3:
            usage = "`gbb { bound } { a } { b }`"
            message = f"`gbb` takes 3 fields, not {len(part.fields)}"
            problems.append(diagnose("wrong-arguments", message, part.span, expected=usage))
        return problems
    if isinstance(part, syntax.Unary) and part.name in FIELD_UNARY:
        least, most = FIELD_UNARY[part.name]
        given = len(part.arguments.values)
        return check_numbers(part.arguments.values) + _check_count(
            part.name, given, least, most, part.span
        )
    if isinstance(part, syntax.Use) and (
        part.name in names.modules or part.name in names.definitions
    ):
        return (check_numbers(part.arguments.values) if part.arguments else []) + _check_use(
            part, names
        )
    if isinstance(part, (syntax.Use, syntax.Primitive)):
        count = FIELD_PRIMITIVES.get(part.name)
        if count is None:
            message = f"`{part.name}` is not a field"
            expected = "one of " + ", ".join(f"`{n}`" for n in FIELD_PRIMITIVES)
            hint = names.suggest(part.name, FIELD_PRIMITIVES, names.modules, names.definitions)
            return [diagnose("not-a-field", message, part.span, expected=expected, hint=hint)]
        values = part.arguments.values if part.arguments else ()
        return check_numbers(values) + _check_count(part.name, len(values), count, count, part.span)
    return []


def check_numbers(exprs: Iterable[Expr]) -> list[Diagnostic]:
    """Check the functions that expressions call, and their numbers of arguments."""
    return [problem for expr in applications(exprs) for problem in _check_function(expr)]


def _check_function(expr: Apply) -> list[Diagnostic]:
    function = FUNCTIONS.get(expr.function)
    written = expr.span is not None and expr.function.isidentifier()
    if not written or expr.function in ("and", "or", "not"):
        return []  # an operator
    if function is None:
        message = f"unknown function `{expr.function}`"
        hint = suggest(expr.function, CALLABLE)
        return [diagnose("unknown-function", message, expr.span, hint=hint)]
    if expr.function == "choose":
        if expr.seeds < 1:
            expected = "`choose(seed, ...; weight, ...)`"
            message = "`choose` needs a `;` between seeds and weights"
            return [diagnose("wrong-arguments", message, expr.span, expected=expected)]
    elif expr.seeds:
        message = f"`{expr.function}` takes no `;` among its arguments"
        return [diagnose("wrong-arguments", message, expr.span)]
    least, most = function.arity
    if most is None or function.form is Form.RANDOM:
        most = most or MAX_ARGUMENTS
    return _check_count(expr.function, len(expr.args), least, most, expr.span, function.summary)


def _check_count(
    name: str,
    count: int,
    least: int,
    most: int,
    span: SourceSpan | None,
    usage: str | None = None,
    after_text: bool = False,
) -> list[Diagnostic]:
    if least <= count <= most:
        return []
    if most == MAX_ARGUMENTS and count < least:
        wanted = f"at least {least}"
    else:
        wanted = str(least) if least == most else f"{least} to {most}"
    plural = "" if wanted in ("1", "at least 1") else "s"
    if most == 0 and after_text:
        message = f"`{name}` takes no numbers"
    elif most == 0:
        message = f"`{name}` takes no arguments"
    else:
        message = f"`{name}` takes {wanted} argument{plural}, not {count}"
    hint = None
    if most == 0 and not after_text and name in LEAF_NAMES and count in (1, 3):
        size = "uscale(2)" if count == 1 else "scale(1,2,3)"
        hint = f"size and place are transformations before it: `{size} {name}`"
    elif name == "scale" and count == 1:
        hint = "`uscale` scales alike in all directions"
    return [diagnose("wrong-arguments", message, span, expected=usage, hint=hint)]


def _setting_names(names: Names) -> dict[str, dict[str, None]]:
    found: dict[str, dict[str, None]] = {kind: {} for kind, s in SETTINGS.items() if s.named}
    for item in names.settings:
        if item.name and item.kind.text in found:
            found[item.kind.text][item.name.text] = None
    return found


def _check_part(
    part: Part, names: Names, setting_names: Mapping[str, Collection[str]]
) -> list[Diagnostic]:
    if isinstance(part, syntax.Block):
        return check_numbers(expr for _, expr in part.assignments)
    if isinstance(part, syntax.Repeat):
        return check_numbers([part.count])
    if isinstance(part, syntax.Scatter):
        return read_rows(part, names)[1]
    if (
        isinstance(part, syntax.Unary)
        and part.name == "color"
        and is_palette(part.arguments.values)
    ):
        return _check_palette(part, names, setting_names["palette"])
    problems = check_numbers(part.arguments.values) if part.arguments else []
    if isinstance(part, syntax.Use):
        primitive = names.primitive_of(part)
        if primitive is None:
            return [*problems, *_check_use(part, names)]
        part = primitive
    if isinstance(part, syntax.Primitive):
        return [*problems, *_check_primitive(part, names)]
    if isinstance(part, syntax.BlendUse):
        return problems
    if isinstance(part, syntax.For):
        return [*problems, *_check_for(part)]
    if part.attribute:
        return [*problems, *_check_attribute(part, names, setting_names)]
    return [*problems, *_check_transformation(part)]


def _check_primitive(part: syntax.Primitive, names: Names) -> list[Diagnostic]:
    solid = LEAF_NAMES[part.name]
    problems = _check_seeds(part.name, part.arguments, part.span)
    usage = [f'"{c.name}"' for c in solid.constants]
    surplus = part.texts[len(solid.constants) :]
    if surplus:
        message = f"`{part.name}` takes no text here"
        problems.append(diagnose("wrong-arguments", message, surplus[0].span))
    elif len(part.texts) < len(solid.constants):
        missing = solid.constants[len(part.texts)]
        values = part.arguments.values
        span = (getattr(values[0], "span", None) if values else None) or part.span
        message = f"`{part.name}` takes {missing.expected} first"
        usage += [p.name for p in solid.parameters]
        expected = f"`{part.name}({', '.join(usage)})`"
        return [*problems, diagnose("wrong-arguments", message, span, expected=expected)]
    else:
        constants, found = read_constants(part, names)
        problems += found
        if found:
            return problems
        parameters = solid.parameters_of(constants)
        least = sum(1 for p in parameters if p.default is None)
        usage += [p.name for p in parameters]
        expected_usage = f"`{part.name}({', '.join(usage)})`" if usage else None
        count = len(part.arguments.values)
        problems += _check_count(
            part.name, count, least, len(parameters), part.span, expected_usage, bool(constants)
        )
    return problems


def read_constants(
    part: syntax.Primitive, names: Names
) -> tuple[tuple[Constant, ...], list[Diagnostic]]:
    """Return what the texts of a primitive stand for, and what is wrong with them."""
    constants: list[Constant] = []
    problems: list[Diagnostic] = []
    solid = LEAF_NAMES[part.name]
    for text, _ in zip(part.texts, solid.constants, strict=False):
        target = Path(text.span.folder) / text.text
        if names.reach.find(target) is None:
            problems.append(names.reach.refuse(target, text.span))
            continue
        key = solid.name, text.span.folder, text.text
        found = names.constants.get(key)
        if found is None:
            try:
                found = solid.read_constant(text.text, Path(text.span.folder))
            except UsageError as error:
                found = error
            names.constants[key] = found
        if isinstance(found, UsageError):
            problems.append(diagnose("bad-file", str(found), text.span))
        else:
            constants.append(found)
    return tuple(constants), problems


def _check_seeds(name: str, arguments: Arguments, span: SourceSpan) -> list[Diagnostic]:
    if not arguments.seeds:
        return []
    message = f"`{name}` takes no `;` among its arguments"
    return [diagnose("wrong-arguments", message, span)]


def _check_use(use: syntax.Use, names: Names) -> list[Diagnostic]:
    """Check a name that stands for a solid, and the arguments of a call."""
    entry = names.modules.get(use.name)
    if entry is None and use.name not in names.definitions:
        return [_unknown_name(use, names)]
    if use.arguments is None:
        return []
    count = len(use.arguments.values)
    problems = _check_seeds(use.name, use.arguments, use.span)
    formals = entry.formals if entry else None
    if entry is not None and formals is not None:
        usage = f"`{use.name}({', '.join(formals)})`"
        return problems + _check_count(use.name, count, len(formals), len(formals), use.span, usage)
    if entry is not None and entry.incomplete:
        return problems
    what = f"module `{use.name}`" if entry else f"definition `{use.name}`"
    hint = f"assign parameters before it: `{{c = ...}} {use.name}`"
    return [*problems, diagnose("not-callable", f"{what} takes no arguments", use.span, hint=hint)]


def _unknown_name(use: syntax.Use, names: Names) -> Diagnostic:
    """Return the diagnostic of a name that nothing has; capitals are for modules."""
    hint = names.suggest(use.name, names.modules, names.definitions, LEAF_NAMES)
    if use.name[:1].isupper():
        hint = hint or f"add rules: `1: {use.name} -> ...`"
        return diagnose("unknown-module", f"unknown module `{use.name}`", use.span, hint=hint)
    if hint is None and (use.name in TRANSFORMS or suggest(use.name, TRANSFORMS)):
        hint = suggest(use.name, TRANSFORMS)
    message = f"unknown primitive `{use.name}`"
    expected = "a primitive, a definition or a module"
    return diagnose("unknown-primitive", message, use.span, expected=expected, hint=hint)


def _check_for(part: syntax.For) -> list[Diagnostic]:
    problems = _check_seeds("for", part.arguments, part.span)
    given = len(part.arguments.values)
    if given not in FOR_ARGUMENTS:
        least, most = FOR_ARGUMENTS
        usage = "`for(i, first, last)` or `for(i, first, last, step)`"
        problems += _check_count("for", 1 + given, 1 + least, 1 + most, part.span, usage)
    step = part.arguments.values[-1]
    if given == FOR_ARGUMENTS[1] and isinstance(step, Number) and step.value == 0.0:
        problems.append(diagnose("bad-value", "a step of 0 never gets anywhere", step.span))
    return problems


def _check_transformation(part: syntax.Unary) -> list[Diagnostic]:
    transform = TRANSFORMS.get(part.name)
    if transform is None:
        hint = suggest(part.name, [*TRANSFORMS, *ATTRIBUTES])
        message = f"unknown transformation `{part.name}`"
        return [diagnose("unknown-transformation", message, part.span, hint=hint)]
    count = len(transform.parameters)
    given = len(part.arguments.values)
    if given == count and not part.arguments.seeds:
        return []
    usage = f"`{part.name}({', '.join(transform.parameters)})`"
    seeds = _check_seeds(part.name, part.arguments, part.span)
    return seeds + _check_count(part.name, given, count, count, part.span, usage)


def _check_palette(part: syntax.Unary, names: Names, known: Collection[str]) -> list[Diagnostic]:
    """Check ``color(palette(NAME, x))``."""
    (call,) = part.arguments.values
    assert isinstance(call, Apply)
    name, *places = call.args or (None,)
    if len(places) != 1 or call.seeds or not isinstance(name, Parameter):
        expected = "`palette(NAME, x)`"
        message = "a palette takes its name and a number"
        return [diagnose("wrong-arguments", message, call.span, expected=expected)]
    problems = check_numbers(places)
    if name.name not in known and "setting" not in names.broken_kinds:
        problems.append(unknown_reference("palette", name.name, name.span, known, names))
    return problems


def _check_attribute(
    part: syntax.Unary, names: Names, setting_names: Mapping[str, Collection[str]]
) -> list[Diagnostic]:
    kind = ATTRIBUTES[part.name]
    values = part.arguments.values
    problems = _check_seeds(part.name, part.arguments, part.span)
    least, most = kind.arity
    if kind.refers_to is None:
        return problems + _check_count(part.name, len(values), least, most, part.span)
    problems += _check_count(part.name, len(values), least + 1, most + 1, part.span)
    if not values:
        return problems
    reference = values[0]
    if not isinstance(reference, Parameter):
        span = getattr(reference, "span", None) or part.span
        expected = f"the name of a {kind.refers_to}"
        return [*problems, diagnose("bad-value", "this is not a name", span, expected=expected)]
    known = setting_names[kind.refers_to]
    if reference.name not in known and "setting" not in names.broken_kinds:
        problem = unknown_reference(kind.refers_to, reference.name, reference.span, known, names)
        problems.append(problem)
    return problems


def unknown_reference(
    kind: str, name: str, span: SourceSpan | None, known: Iterable[str], names: Names
) -> Diagnostic:
    """Return the diagnostic of the name of a material or texture that is not there."""
    hint = names.suggest(name, known) or f"add `{kind} {name} {{ ... }}`"
    return diagnose(f"unknown-{kind}", f"unknown {kind} `{name}`", span, hint=hint)


def definition_order(names: Names) -> tuple[list[str], list[list[str]]]:
    """Return the definitions, those used before those that use them, and their cycles."""
    uses = {
        name: [
            part.name
            for part in parts_of(definition.solid)
            if isinstance(part, syntax.Use) and part.name in names.definitions
        ]
        for name, definition in names.definitions.items()
    }
    order: list[str] = []
    cycles: list[list[str]] = []
    done: set[str] = set()
    for start in uses:
        path: dict[str, int] = {}
        stack = [(start, 0)]
        while stack:
            name, k = stack.pop()
            if k == 0 and name in done:
                continue
            path[name] = k
            if k >= len(uses[name]):
                done.add(name)
                order.append(name)
                del path[name]
                continue
            stack.append((name, k + 1))
            target = uses[name][k]
            if target in path:
                cycles.append(list(path)[list(path).index(target) :])
            elif target not in done:
                stack.append((target, 0))
    return order, cycles


def _definition_cycles(names: Names) -> list[Diagnostic]:
    _, cycles = definition_order(names)
    problems: list[Diagnostic] = []
    for cycle in cycles:
        first = names.definitions[cycle[0]].name
        shown = " -> ".join(f"`{n}`" for n in [*cycle, cycle[0]])
        notes = [(f"through `{n}`", names.definitions[n].name.span) for n in cycle[1:8]]
        message = f"definition `{cycle[0]}` reaches itself: {shown}"
        if len(cycle) > 8:
            message = f"definition `{cycle[0]}` reaches itself through {len(cycle) - 1} others"
        hint = "recursion needs a module with a selection function"
        problems.append(diagnose("definition-cycle", message, first.span, hint=hint, notes=notes))
    return problems


def never_used(names: Names) -> list[Diagnostic]:
    """Return warnings for modules and definitions that the axiom does not lead to."""
    if names.axiom is None or names.broken:
        return []
    reached: set[str] = set()
    stack: list[Solid | None] = [names.axiom.solid]
    while stack:
        for part in parts_of(stack.pop()):
            if not isinstance(part, syntax.Use) or part.name in reached:
                continue
            reached.add(part.name)
            if entry := names.modules.get(part.name):
                stack += [rule.solid for rule in entry.rules.values()]
                stack += [rule.solid for rule in entry.attributed]
            if definition := names.definitions.get(part.name):
                stack.append(definition.solid)
    warnings = [
        diagnose("never-used", f"module `{entry.name}` is never used", entry.span)
        for entry in names.modules.values()
        if entry.name not in reached
    ]
    warnings += [
        diagnose("never-used", f"definition `{name}` is never used", definition.name.span)
        for name, definition in names.definitions.items()
        if name not in reached
    ]
    return warnings
