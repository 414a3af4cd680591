"""Surface attributes: numbers that travel down the graph beside the parameters.

An attribute node assigns hidden parameters; the innermost assignment wins, field by field. Names
of materials and textures become their numbers in the scene's settings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class AttributeKind:
    """An attribute of the language.

    Attributes
    ----------
    name
        As written.
    refers_to
        The kind of setting that the first argument names, None if it takes numbers only.
    arity
        Least and largest number of arguments that are numbers.
    slots
        Hidden parameters: first the number of the named thing (if any), then the arguments.
    defaults
        Their values where nothing was assigned.
    summary
        For the reference page.
    """

    name: str
    refers_to: str | None
    arity: tuple[int, int]
    slots: tuple[str, ...]
    defaults: tuple[float, ...]
    summary: str

    def __reduce__(self) -> tuple[Any, ...]:
        return attribute_named, (self.name,)  # there is one of each


def attribute_named(name: str) -> AttributeKind:
    """Return an attribute by its name."""
    return ATTRIBUTES[name]


ATTRIBUTES = {
    kind.name: kind
    for kind in (
        AttributeKind(
            "color",
            None,
            (3, 3),
            ("@red", "@green", "@blue"),
            (-1.0, -1.0, -1.0),
            "Colour (r, g, b), linear, in place of the material's.",
        ),
        AttributeKind(
            "material", "material", (0, 0), ("@material",), (-1.0,), "A material of the scene."
        ),
        AttributeKind(
            "texture",
            "texture",
            (0, 1),
            ("@texture", "@texture_scale"),
            (-1.0, 1.0),
            "A texture of the scene, and its scale.",
        ),
        AttributeKind(
            "label", None, (1, 1), ("@label",), (-1.0,), "A number that ray casts return."
        ),
    )
}

ATTRIBUTE_SLOTS = tuple(slot for kind in ATTRIBUTES.values() for slot in kind.slots)
ATTRIBUTE_DEFAULTS = tuple(value for kind in ATTRIBUTES.values() for value in kind.defaults)
