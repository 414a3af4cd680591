"""A scene as prototypes that hold shapes and references to other prototypes: a table of states.

States that stand in one place only belong to the prototype they stand in. Of the others so many
stay that references are nested no deeper than other programs follow them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from pcsg.errors import UsageError
from pcsg.export.looks import Look, Material, Paintbox
from pcsg.export.maps import composed
from pcsg.export.shapes import Floats, Ints, Shape
from pcsg.export.solids import Mesher
from pcsg.export.states import Key, States
from pcsg.export.surroundings import find_ground
from pcsg.scene import Scene

MOST_INSTANCES = 10_000_000
"""Shapes that a scene may have, each counted as often as it stands there."""

MOST_NESTED = 6
"""Levels of references: Blender shows eight, of which the whole and the shapes take one each."""

MOST_ITEMS = 1_000_000
"""References and shapes of all prototypes that are written for the sake of few levels."""

_HERE = np.eye(3, 4)


@dataclass
class Prototype:
    """What stands in a prototype's frame.

    Attributes
    ----------
    name
        For people.
    parts, part_maps
        Numbers of parts, and (N, 3, 4) where they stand.
    references, reference_maps
        Likewise of other prototypes.
    """

    name: str
    parts: list[int] = field(default_factory=list)
    part_maps: list[Floats] = field(default_factory=list)
    references: list[int] = field(default_factory=list)
    reference_maps: list[Floats] = field(default_factory=list)


@dataclass
class Assembly:
    """A scene to be written.

    Attributes
    ----------
    shapes, materials
        What parts are made of.
    parts
        Pairs of a shape and a material, and the label: -1 for none.
    prototypes
        The whole is the last one; each comes behind those that it refers to.
    instances
        How many parts stand in the scene.
    notes
        What was left out or changed.
    """

    shapes: list[Shape]
    materials: list[Material]
    parts: list[tuple[int, int, int]]
    prototypes: list[Prototype]
    instances: int
    notes: tuple[str, ...]

    def flattened(self) -> dict[int, Floats]:
        """Return (N, 3, 4) all places in the scene of every part."""
        places: list[list[Floats]] = [[] for _ in self.prototypes]
        places[-1].append(_HERE[None])
        found: dict[int, list[Floats]] = {}
        for k in range(len(self.prototypes) - 1, -1, -1):
            prototype = self.prototypes[k]
            if not places[k]:
                continue
            here = np.concatenate(places[k])
            places[k] = []
            for child, at in zip(prototype.references, prototype.reference_maps, strict=True):
                places[child].append(composed(here, at[None]))
            for part, at in zip(prototype.parts, prototype.part_maps, strict=True):
                found.setdefault(part, []).append(composed(here, at[None]))
        return {part: np.concatenate(maps) for part, maps in sorted(found.items())}


def assemble(
    scene: Scene, *, segments: int = 16, resolution: int = 64, depth: int | None = None
) -> Assembly:
    """Return a scene as prototypes.

    Parameters
    ----------
    segments
        Corners of a circle.
    resolution
        Cells along the longest side of what is contoured.
    depth
        Modules below the axiom after which boxes stand for what follows; None for all.

    Raises
    ------
    UsageError
        The scene has too many states or instances, or an operation too many operands.
    """
    states = States(scene.expand())
    count = states.count(depth)
    if count > MOST_INSTANCES:
        fitting = states.deepest(MOST_INSTANCES)
        hint = f"--depth {fitting} ends it there, with boxes" if fitting else "lower its order"
        raise UsageError(
            f"the scene has {_spelled(count)} solids, more than {MOST_INSTANCES:,}; {hint}"
        )
    if count == 0:
        raise UsageError("the scene is empty: there is nothing to export")
    mesher, paints = Mesher(segments, resolution), Paintbox(scene)
    return _Assembler(states, depth, mesher, paints).assemble(find_ground(scene))


def _spelled(count: int) -> str:
    return f"{count:,}" if count < 10**18 else f"about 10^{count.bit_length() * 0.30103:.0f}"


class _Assembler:
    """Turns states into prototypes."""

    def __init__(self, states: States, depth: int | None, mesher: Mesher, paints: Paintbox) -> None:
        self.states = states
        self.mesher = mesher
        self.paints = paints
        self.order: list[Key] = states.reachable(depth)
        self.parts: dict[tuple[int, Look], int] = {}
        self.materials: dict[Look, int] = {}
        self.made: list[Material] = []
        self.notes: dict[str, None] = {}

    def assemble(self, ground: tuple[Shape, Look] | None) -> Assembly:
        """Return the assembly."""
        kept = self._choose()
        number = {key: k for k, key in enumerate(k for k in self.order if k in kept)}
        prototypes = [self._fill(key, number) for key in number]
        if ground is not None:
            shape, look = ground
            self.parts[len(self.mesher.shapes), look] = len(self.parts)
            self.mesher.shapes.append(shape)
            prototypes[-1].parts.append(len(self.parts) - 1)
            prototypes[-1].part_maps.append(_HERE)
        parts = [
            (shape, self._material(look, self.mesher.shapes[shape]), look.label)
            for shape, look in self.parts
        ]
        notes = (*self.notes, *self.mesher.notes, *self.paints.notes)
        totals: list[int] = []
        for made in prototypes:
            totals.append(len(made.parts) + sum(totals[k] for k in made.references))
        return Assembly(self.mesher.shapes, self.made, parts, prototypes, totals[-1], notes)

    def _choose(self) -> set[Key]:
        """Return the states that become prototypes."""
        uses: dict[Key, int] = {}
        for key in self.order:
            for child, _ in self.states.children(key):
                uses[child] = uses.get(child, 0) + 1
        root = self.order[-1]
        several = {key for key in self.order if uses.get(key, 0) > 1}
        height: dict[Key, int] = {}
        for key in self.order:
            below = (height[c] + (c in several) for c, _ in self.states.children(key))
            height[key] = max(below, default=0)
        every = -(-height[root] // MOST_NESTED) or 1
        while True:
            kept = {key for key in several if height[key] % every == 0} | {root}
            if every == 1 or self._written(kept) <= MOST_ITEMS:
                break
            every -= 1
        levels = height[root] // every
        if levels > MOST_NESTED:
            self.notes[f"instances are nested {levels} deep; Blender shows 8 levels"] = None
        return kept

    def _written(self, kept: set[Key]) -> int:
        """Return how many references and shapes all prototypes would have."""
        size: dict[Key, int] = {}
        for key in self.order:
            size[key] = self.states.own(key) + sum(
                1 if child in kept else size[child] for child, _ in self.states.children(key)
            )
        return sum(size[key] for key in kept)

    def _fill(self, top: Key, number: dict[Key, int]) -> Prototype:
        """Return the prototype of a state, with all states in it that are none."""
        made = Prototype(f"{self.states.name(top)}_{number[top]}")
        waiting: list[tuple[Key, Floats]] = [(top, _HERE)]
        while waiting:
            key, here = waiting.pop()
            for shape, look, at in self._shapes(key):
                made.parts.append(self.parts.setdefault((shape, look), len(self.parts)))
                made.part_maps.append(composed(here, at))
            children = self.states.children(key)
            if not children:
                continue
            places = composed(here[None], np.array([at for _, at in children]))
            for (child, _), at in zip(reversed(children), places[::-1], strict=True):
                if child in number:
                    made.references.append(number[child])
                    made.reference_maps.append(at)
                else:
                    waiting.append((child, at))
        return made

    def _shapes(self, key: Key) -> Iterator[tuple[int, Look, Floats]]:
        """Yield the shapes of a state with their looks and places."""
        proxy = self.states.proxy(key)
        if proxy is not None:
            node, at = proxy
            for shape, _ in self.mesher.leaf(node, ()):
                yield shape, Look(), at
            return
        for primitive, look in self.states.primitives(key):
            for shape, _ in self.mesher.leaf(primitive.node, primitive.args):
                yield shape, look, primitive.matrix
        for carved, looks in self.states.operations(key):
            frame, shapes = self.mesher.operation(carved)
            for shape, k in shapes:
                yield shape, looks[max(k, 0)], frame

    def _material(self, look: Look, shape: Shape) -> int:
        # A solid's own colours stand below those of the grammar, and so before them.
        seen = look._replace(label=-1, color=shape.color or look.color)
        if seen not in self.materials:
            self.materials[seen] = len(self.made)
            self.made.append(self.paints.mix(seen))
        return self.materials[seen]


__all__ = ["Assembly", "Ints", "Prototype", "assemble"]
