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

![A temple of superellipsoids and cylinders, with a drilled block in it](pictures/temple.png)

```pcsg
{} ( for(i, 0, 7) rotz(45*i) move(2.6, 0, 0) COLUMN
   | color("wheat") (FLOOR | RING) | color("#4f7d6b") move(0,0,3.5) DOME
   | color("gold") move(0,0,5.2) uscale(0.16) capsule(0.3)
   | move(0,0,0.9) color("#b3472e") uscale(0.9) (superellipsoid(0.25, 0.25) \\ BORES)
   | move(0,0,0.9) color("#2f5d8a") uscale(0.5) superellipsoid(2, 2) )
FLOOR = move(0,0,-0.15) scale(3.4, 3.4, 0.15) superellipsoid(0.9, 0.2)
DOME = scale(3, 3, 1.6) superellipsoid(1, 1.4) \\ halfspace
RING = move(0,0,3.35) (scale(3.2, 3.2, 0.25) superellipsoid(1, 0.3) \\ uscale(2) infcylinder)
BORE = uscale(0.62) infcylinder
BORES = (BORE | rotx(90) BORE | roty(90) BORE)
COLUMN = color("ivory") (move(0,0,0.3) scale(0.28, 0.28, 2.5) cylinder | FOOT | move(0,0,2.75) FOOT)
FOOT = move(0,0,0.2) scale(0.4, 0.4, 0.2) superellipsoid(0.2, 0.2)
camera { eye = (6.5, -8.5, 4.2); target = (0, 0, 2.2); fov = 38 }
sun { direction = (0.5, -0.75, 0.6) }
ground { z = -0.3 }
```
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
