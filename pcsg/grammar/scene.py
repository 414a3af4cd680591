"""Scene settings: checks of their keys and values, and from syntax to `Setting`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, suggest
from pcsg.grammar.check import check_numbers, unknown_reference
from pcsg.grammar.colors import check_stops, is_hsv, read_color, read_hsv
from pcsg.grammar.names import Names
from pcsg.grammar.precedence import SyntaxFault
from pcsg.grammar.reach import Reach
from pcsg.grammar.syntax import Name, SettingItem, Value
from pcsg.graph.expr import Expr, Number, Parameter, asks_world
from pcsg.graph.settings import AUTO, SETTINGS, FileName, Key, Setting, SettingKind, ValueKind

_VECTORS = (ValueKind.VECTOR, ValueKind.COLOR)


def build_settings(names: Names) -> tuple[list[Setting], list[Diagnostic]]:
    """Return the settings in the order of the text, and what is wrong with them."""
    settings: list[Setting] = []
    problems: list[Diagnostic] = []
    first: dict[tuple[str, str | None], SettingItem] = {}
    named = {
        kind: dict.fromkeys(i.name.text for i in names.settings if i.kind.text == kind and i.name)
        for kind in SETTINGS
    }
    for item in names.settings:
        kind = SETTINGS.get(item.kind.text)
        if kind is None:
            hint = suggest(item.kind.text, SETTINGS)
            message = f"unknown setting `{item.kind.text}`"
            expected = ", ".join(SETTINGS)
            problems.append(
                diagnose("unknown-setting", message, item.kind.span, expected=expected, hint=hint)
            )
            continue
        problems += _check_head(item, kind, first)
        values = _build_values(item, kind, named, names, problems)
        if kind.name == "palette" and not any(key.text == "stops" for key, _ in item.pairs):
            expected = '`stops = ((0, "#203010"), (1, "olive"))`'
            problems.append(
                diagnose("bad-value", "a palette has stops", item.span, expected=expected)
            )
        name = item.name.text if item.name else None
        settings.append(Setting(kind, name, values, item.span))
    return settings, problems


def _check_head(
    item: SettingItem, kind: SettingKind, first: dict[tuple[str, str | None], SettingItem]
) -> list[Diagnostic]:
    if kind.named and item.name is None:
        message = f"the {kind.name} has no name"
        expected = f"`{kind.name} NAME {{ ... }}`"
        return [diagnose("setting-name", message, item.kind.span, expected=expected)]
    if not kind.named and item.name is not None:
        message = f"`{kind.name}` takes no name"
        return [diagnose("setting-name", message, item.name.span)]
    key = (kind.name, item.name.text if item.name else None)
    other = first.setdefault(key, item)
    if other is item or kind.repeated or (kind.several and not kind.named):
        return []
    shown = f"{kind.name} `{key[1]}`" if key[1] else f"`{kind.name}`"
    notes = [("the first one", other.kind.span)]
    return [diagnose("duplicate-setting", f"a second {shown}", item.kind.span, notes=notes)]


def _build_values(
    item: SettingItem,
    kind: SettingKind,
    named: Mapping[str, Collection[str]],
    names: Names,
    problems: list[Diagnostic],
) -> dict[str, tuple[Expr, ...] | str]:
    values: dict[str, tuple[Expr, ...] | str] = {}
    first: dict[str, Name] = {}
    for name, value in item.pairs:
        key = kind.keys.get(name.text)
        if key is None:
            message = f"`{kind.name}` has no key `{name.text}`"
            hint = suggest(name.text, kind.keys)
            expected = ", ".join(kind.keys)
            problems.append(
                diagnose("unknown-key", message, name.span, expected=expected, hint=hint)
            )
            continue
        if name.text in first:
            message = f"a second `{name.text}`"
            notes = [("the first one", first[name.text].span)]
            problems.append(diagnose("duplicate-setting", message, name.span, notes=notes))
            continue
        first[name.text] = name
        if key.default is None and _is_auto(value, named.get(key.refers_to or "", ())):
            continue
        try:
            built = _build_value(key, value, names.reach, problems)
        except SyntaxFault as fault:
            problems.append(fault.problem)
            continue
        if built is None:
            continue
        if key.refers_to and isinstance(built, str) and built not in named[key.refers_to]:
            problems.append(
                unknown_reference(key.refers_to, built, value.span, named[key.refers_to], names)
            )
        values[name.text] = built
    return values


def _is_auto(value: Value, names: Collection[str]) -> bool:
    """Whether a value is the word ``auto``, and not the name of something."""
    word = value.numbers[0] if len(value.numbers) == 1 else None
    return isinstance(word, Parameter) and word.name == AUTO and AUTO not in names


def _build_value(
    key: Key, value: Value, reach: Reach, problems: list[Diagnostic]
) -> tuple[Expr, ...] | str | None:
    """Return a value as the key takes it; None if it does not, and a fault for a wrong colour."""
    kind = key.kind
    if kind is ValueKind.COLOR and not value.stops and is_hsv(value.numbers):
        value = replace(value, numbers=read_hsv(value.numbers, value.span))
    if kind is ValueKind.FILE:
        if value.text is not None:
            file = FileName(value.text, value.span.folder)
            if reach.find(file.path) is None:
                problems.append(reach.refuse(file.path, value.span))
            return file
    elif kind in (ValueKind.WORD, ValueKind.NAME):
        word = value.numbers[0] if len(value.numbers) == 1 else None
        if isinstance(word, Parameter) and (kind is ValueKind.NAME or word.name in key.words):
            return word.name
        if isinstance(word, Parameter):
            message = f"unknown word `{word.name}`"
            hint = suggest(word.name, key.words)
            problems.append(
                diagnose("bad-value", message, value.span, expected=", ".join(key.words), hint=hint)
            )
            return None
    elif kind is ValueKind.COLOR and value.text is not None:
        return read_color(value.text, value.span)
    elif kind is ValueKind.STOPS and value.stops:
        found = check_stops(value)
        problems += found
        return None if found else value.numbers
    elif not value.stops and len(value.numbers) == (3 if kind in _VECTORS else 1):
        found = check_numbers(value.numbers)
        problems += found
        if asks_world(*value.numbers):
            message = "settings have no local frame to ask for"
            problems.append(diagnose("bad-value", message, value.span))
        return None if found else value.numbers
    expected = ", ".join(key.words) if key.words else kind.value
    problems.append(
        diagnose("bad-value", f"`{_shown(value)}` does not fit", value.span, expected=expected)
    )
    return None


def _shown(value: Value) -> str:
    if len(value.numbers) == 1 and isinstance(value.numbers[0], Number):
        return f"{value.numbers[0].value:g}"
    text = " ".join(value.span.text.split())
    return text if len(text) <= 40 else text[:40] + "..."
