"""Colours of surfaces that are written as pictures count them, from 0 to 255."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, SourceSpan
from pcsg.graph.expr import Expr, Number
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Attribute

_LEAST = 10.0
"""From which greatest part on a colour is meant so: no surface returns ten times the light."""

_KEYS = {"material": ("color",), "texture": ("color", "color2")}
"""Colours of surfaces among the settings; those of lights may be as bright as one likes."""


def check_colours(graph: Graph) -> list[Diagnostic]:
    """Return a warning for every colour of a surface whose parts go from 0 to 255."""
    places: dict[tuple[float, ...], list[SourceSpan | None]] = {}
    for args, span in _written(graph):
        numbers = [e for e in args if isinstance(e, Number)]
        values = tuple([e.value for e in numbers])
        whole = all(0.0 <= v <= 255.0 and v == int(v) for v in values)
        if len(values) == 3 and whole and max(values) >= _LEAST:
            places.setdefault(values, []).append(numbers[0].span or span)
    problems: list[Diagnostic] = []
    for values, spans in places.items():
        shown = ", ".join(f"{v:g}" for v in values)
        linear = ", ".join(f"{_linear(v / 255.0):.3g}" for v in values)
        message = f"({shown}) is no colour of a surface: its parts go from 0 to 1"
        message += f" (at {len(spans)} places)" if len(spans) > 1 else ""
        hint = f"colours are linear; what pictures call {shown} is ({linear})"
        problems.append(diagnose("colour-range", message, spans[0], hint=hint))
    return problems


def _written(graph: Graph) -> Iterator[tuple[Sequence[Expr], SourceSpan | None]]:
    """Yield the three parts of every colour of a surface, and where it stands."""
    for node in graph.nodes:
        if isinstance(node, Attribute) and node.kind.name == "color":
            yield node.args, node.span
    for setting in graph.settings:
        for key in _KEYS.get(setting.kind.name, ()):
            value = setting.values.get(key, ())
            if value and not isinstance(value, str):
                yield value, setting.span


def _linear(shown: float) -> float:
    """Return the light of a part of a colour as pictures keep it (sRGB)."""
    return shown / 12.92 if shown <= 0.04045 else ((shown + 0.055) / 1.055) ** 2.4
