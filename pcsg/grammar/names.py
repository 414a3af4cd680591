"""Who is who: the modules, definitions, axiom and settings of a set of files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, SourceSpan, UsageError, suggest
from pcsg.grammar import syntax
from pcsg.grammar.reach import Reach
from pcsg.grammar.syntax import Name, Rule, Solid
from pcsg.graph.columns import Table
from pcsg.leaf import LEAF_NAMES
from pcsg.leaf.registry import Constant

MOST_SUGGESTIONS = 200
"""Most unknown names that are compared with all names of the files."""


@dataclass
class ModuleEntry:
    """Everything that is said about a module.

    Attributes
    ----------
    incomplete
        Whether a broken item may say more, so that what seems to be missing is not reported.
    """

    name: str
    span: SourceSpan
    declaration: syntax.Module | None = None
    declared: bool = False
    rules: dict[int, Rule] = field(default_factory=dict)
    attributed: list[syntax.AttributedRule] = field(default_factory=list)
    incomplete: bool = False

    @property
    def formals(self) -> tuple[str, ...] | None:
        """The formals of the attributed form, None in the numbered one."""
        return tuple(f.text for f in self.attributed[0].formals) if self.attributed else None

    @property
    def solids(self) -> dict[int, Solid | None]:
        """What each rule derives, by its number; None where it is broken."""
        if self.attributed:
            return {k + 1: rule.solid for k, rule in enumerate(self.attributed)}
        return {k: rule.solid for k, rule in self.rules.items()}


@dataclass
class Names:
    """The tables of a set of files.

    Attributes
    ----------
    reach
        Where the files that they name may lie.
    constants
        What texts among arguments stand for, by primitive, folder and text; or why they do not.
    tables
        Those that a `scatter` names, by folder, text and words; or what is wrong with them.
    suggestions
        How many unknown names were compared with all that there are.
    """

    reach: Reach

    modules: dict[str, ModuleEntry] = field(default_factory=dict)
    definitions: dict[str, syntax.Definition] = field(default_factory=dict)
    axiom: syntax.Axiom | None = None
    settings: list[syntax.SettingItem] = field(default_factory=list)
    broken: list[syntax.Broken] = field(default_factory=list)
    constants: dict[tuple[str, str, str], Constant | UsageError] = field(default_factory=dict)
    tables: dict[tuple[object, ...], Table | UsageError] = field(default_factory=dict)

    suggestions: int = 0

    def suggest(self, word: str, *candidates: Iterable[str]) -> str | None:
        """Return what `suggest` does, for the first 200 mistakes; a hundred are told."""
        self.suggestions += 1
        if self.suggestions > MOST_SUGGESTIONS:
            return None
        return suggest(word, chain(*candidates))

    def primitive_of(self, use: syntax.Use) -> syntax.Primitive | None:
        """Return the primitive that a name stands for where the files have none of that name."""
        solid = LEAF_NAMES.get(use.name)
        if solid is None or use.name in self.modules or use.name in self.definitions:
            return None
        return syntax.Primitive(use.name, use.arguments or syntax.Arguments(), use.span)

    @cached_property
    def broken_kinds(self) -> set[str]:
        """The kinds of items that are broken."""
        return {item.kind for item in self.broken}

    @property
    def assigned_in_broken(self) -> set[str]:
        """Parameters that broken items seem to assign."""
        return {name for item in self.broken for name in item.assigned}


def collect_names(
    items: Iterable[syntax.Item], start: SourceSpan, reach: Reach
) -> tuple[Names, list[Diagnostic]]:
    """Enter all items into tables and report what is there twice or missing.

    Parameters
    ----------
    start
        The start of the root file, where a missing axiom is reported.
    reach
        Where the files that they name may lie.
    """
    names = Names(reach)
    problems: list[Diagnostic] = []
    axioms: list[syntax.Axiom] = []
    axiom_broken = False
    labels: dict[str, Name] = {}
    for item in items:
        match item:
            case syntax.Axiom():
                axioms.append(item)
            case syntax.Module():
                _declare(names, item.name, item, problems)
            case syntax.Rule():
                _add_rule(names, item, problems)
            case syntax.AttributedRule():
                _add_label(labels, item.label, problems)
                entry = _module(names, item.name)
                entry.attributed.append(item)
            case syntax.Definition():
                _define(names, item, problems)
            case syntax.SettingItem():
                names.settings.append(item)
            case syntax.Broken():
                names.broken.append(item)
                axiom_broken |= item.kind == "axiom"
                _enter_broken(names, item, problems)
    for entry in names.modules.values():
        problems += _check_module(entry)
        if entry.name in names.definitions:
            spans = (names.definitions[entry.name].name.span, entry.span)
            first, second = sorted(spans, key=lambda s: s.start)
            problems.append(_duplicate(entry.name, second, first))
    names.axiom = axioms[0] if axioms else None
    problems += [_second_axiom(axioms[0], other) for other in axioms[1:]]
    if not axioms and not axiom_broken:
        problems.append(_no_axiom(names, start))
    return names, problems


def _module(names: Names, name: Name) -> ModuleEntry:
    return names.modules.setdefault(name.text, ModuleEntry(name.text, name.span))


def _declare(
    names: Names, name: Name, item: syntax.Module | None, problems: list[Diagnostic]
) -> None:
    entry = _module(names, name)
    if entry.declared:
        problems.append(_duplicate(name.text, name.span, entry.span))
        return
    entry.declared = True
    entry.declaration = item
    entry.span = name.span


def _add_rule(names: Names, rule: Rule, problems: list[Diagnostic]) -> None:
    entry = _module(names, rule.name)
    if rule.number in entry.rules:
        first = entry.rules[rule.number]
        problems.append(
            diagnose(
                "duplicate-rule",
                f"`{entry.name}` has a rule {rule.number} already",
                join_head(rule),
                notes=[("the first one", join_head(first))],
            )
        )
        return
    entry.rules[rule.number] = rule


def join_head(rule: Rule) -> SourceSpan:
    """Return the place of a rule's number and name."""
    return SourceSpan(rule.span.source, rule.span.start, rule.name.span.end)


def _add_label(labels: dict[str, Name], label: Name, problems: list[Diagnostic]) -> None:
    first = labels.setdefault(label.text, label)
    if first is not label:
        problems.append(
            diagnose(
                "duplicate-rule",
                f"there is a rule `{label.text}` already",
                label.span,
                notes=[("the first one", first.span)],
            )
        )


def _define(names: Names, item: syntax.Definition, problems: list[Diagnostic]) -> None:
    first = names.definitions.setdefault(item.name.text, item)
    if first is not item:
        problems.append(_duplicate(item.name.text, item.name.span, first.name.span))


def _enter_broken(names: Names, item: syntax.Broken, problems: list[Diagnostic]) -> None:
    """Enter the name of a broken item, so that its uses are not reported as unknown."""
    name = item.name
    if name is None:
        return
    if item.kind == "definition":
        _define(names, syntax.Definition(name, None), problems)
    elif item.kind == "module":
        _declare(names, name, None, problems)
        names.modules[name.text].incomplete = True
    else:
        entry = _module(names, name)
        entry.incomplete = True
        if item.number is not None and item.number not in entry.rules:
            entry.rules[item.number] = Rule(item.number, name, None, name.span)


def _duplicate(name: str, second: SourceSpan, first: SourceSpan) -> Diagnostic:
    return diagnose(
        "duplicate-name", f"`{name}` is there already", second, notes=[("the first one", first)]
    )


def _second_axiom(first: syntax.Axiom, second: syntax.Axiom) -> Diagnostic:
    return diagnose(
        "two-axioms",
        "a second axiom",
        second.span,
        hint="join the two with `|`, or name one: `part = ...`",
        notes=[("the first one", first.span)],
    )


def _no_axiom(names: Names, start: SourceSpan) -> Diagnostic:
    first = next((m.name for m in names.modules.values()), None)
    hint = f"begin the file with the expression to draw, such as `{{}} {first}`" if first else None
    return diagnose(
        "no-axiom",
        "the grammar has no axiom",
        start,
        expected="an expression for a solid",
        hint=hint,
    )


def _check_module(entry: ModuleEntry) -> list[Diagnostic]:
    """Check the rules of one module against each other."""
    if entry.attributed:
        return _check_attributed(entry)
    if not entry.rules:
        if entry.incomplete:
            return []
        message = f"module `{entry.name}` has no rules"
        hint = f"add a rule: `1: {entry.name} -> ...`"
        return [diagnose("undefined-module", message, entry.span, hint=hint)]
    problems: list[Diagnostic] = []
    count = max(entry.rules)
    absent = next((k for k in range(1, len(entry.rules) + 1) if k not in entry.rules), None)
    if 0 in entry.rules:
        message = f"the rules of `{entry.name}` are numbered from 1"
        problems.append(diagnose("missing-rule", message, join_head(entry.rules[0])))
    elif absent is not None and not entry.incomplete:
        problems.append(
            diagnose(
                "missing-rule",
                f"`{entry.name}` has a rule {count} but no rule {absent}",
                join_head(entry.rules[count]),
            )
        )
    if len(entry.rules) > 1 and not entry.declared and not entry.incomplete:
        rule = entry.rules[min(entry.rules)]
        problems.append(
            diagnose(
                "no-selection-function",
                f"`{entry.name}` has {len(entry.rules)} rules but no selection function",
                rule.name.span,
                hint=f"add a line such as `{entry.name} if(c > 0, 2, 1)`",
            )
        )
    return problems


def _check_attributed(entry: ModuleEntry) -> list[Diagnostic]:
    problems: list[Diagnostic] = []
    rules = entry.attributed
    other = [r.name.span for r in entry.rules.values()]
    if entry.declaration is not None:
        other.append(entry.declaration.name.span)
    if other:
        problems.append(
            diagnose(
                "mixed-forms",
                f"`{entry.name}` is written in two forms",
                other[0],
                notes=[("the attributed form", rules[0].name.span)],
            )
        )
    for rule in rules:
        problems += _check_formals(rule, rules[0])
    for rule in rules[:-1]:
        if rule.condition is None and not entry.incomplete:
            problems.append(
                diagnose(
                    "missing-condition",
                    f"rule `{rule.label.text}` has no condition, so later ones are never reached",
                    rule.label.span,
                    expected="a condition on every rule but the last",
                )
            )
    return problems


def _check_formals(rule: syntax.AttributedRule, first: syntax.AttributedRule) -> list[Diagnostic]:
    problems: list[Diagnostic] = []
    formals = _texts(rule.formals)
    for k, formal in enumerate(rule.formals):
        if formal.text in formals[:k]:
            message = f"`{formal.text}` is named twice"
            problems.append(diagnose("formals-differ", message, formal.span))
    if formals != _texts(first.formals):
        wanted = ", ".join(_texts(first.formals))
        problems.append(
            diagnose(
                "formals-differ",
                f"rule `{rule.label.text}` names other formals than `{first.label.text}`",
                rule.name.span,
                expected=f"`{first.name.text}({wanted})`",
                notes=[("the first rule", first.name.span)],
            )
        )
    return problems


def _texts(names: Sequence[Name]) -> list[str]:
    return [n.text for n in names]
