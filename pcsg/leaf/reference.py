"""The reference page of the primitives, written from the registry.

``python -m pcsg.leaf.reference > docs/primitives.md`` renews the page in the repository.
"""

from __future__ import annotations

import inspect
import math

from pcsg.leaf import LEAF_NAMES, LEAVES, Box, Solid

HEAD = """# Primitives

Written from the registry of leaves (`pcsg/leaf/`); do not edit.

Every primitive stands in its own frame; transformations give it size and place. Solids are closed
sets. A sheet has a surface but no volume. A bad argument is a fault that names the grammar's line.
"""


def signature(solid: type[Solid]) -> str:
    """Return how a primitive is written, defaults included."""
    names = [f'"{c.name}"' for c in solid.constants]
    names += [
        p.name if p.default is None else f"{p.name} = {p.default:g}" for p in solid.parameters
    ]
    return f"{solid.name}({', '.join(names)})" if names else solid.name


def _interval(low: float, high: float) -> str:
    if low > high:
        return "empty"
    return f"{_number(low)} to {_number(high)}"


def _number(x: float) -> str:
    return f"{x:+g}" if math.isinf(x) else f"{x:g}"


def _bounds(solid: type[Solid]) -> str:
    if solid.parameters:
        return "with the arguments"
    box: Box = solid.bounds_of(())
    sides = [_interval(a, b) for a, b in zip(box.lower, box.upper, strict=True)]
    if len(set(sides)) == 1:
        return sides[0] if sides[0] == "empty" else f"{sides[0]} in x, y and z"
    return ", ".join(f"{axis} {side}" for axis, side in zip("xyz", sides, strict=True))


def section(solid: type[Solid]) -> str:
    """Return the section of one primitive."""
    kind = "sheet" if solid.sheet else "solid"
    lines = [f"## `{signature(solid)}`", "", inspect.cleandoc(solid.__doc__ or ""), ""]
    if solid.aliases:
        lines.append(f"- also called: {', '.join(f'`{a}`' for a in solid.aliases)}")
    lines += [f"- argument: {c.expected}" for c in solid.constants]
    lines += [f"- argument: {p.condition}" for p in solid.parameters]
    if solid.constants:
        lines.append("- kind, bounds and primitive equivalents: with the data")
        return "\n".join(lines) + "\n"
    lines += [
        f"- kind: {kind}, counts as {solid.primitives} in primitive equivalents",
        f"- bounds: {_bounds(solid)}",
    ]
    return "\n".join(lines) + "\n"


def reference_page() -> str:
    """Return the whole page as Markdown."""
    words = [s for s in LEAF_NAMES.values() if s.__module__.startswith("pcsg.leaf.")]
    solids = dict.fromkeys([*LEAVES.values(), *words])
    return "\n".join([HEAD, *map(section, solids)])


if __name__ == "__main__":
    print(reference_page(), end="")
