"""Growing trees in grammars: ``tree("populus", t)``, and its wood and leaves by themselves.

The wood is an implicit model and the leaves are a mesh: these words need no kernels of their own.
Imported when a grammar is read, so it loads the model of growth only when a tree is named.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

from pcsg.errors import Diagnostic, GrammarError, UsageError, suggest
from pcsg.graph.build import LeafConstructor
from pcsg.leaf.blob import Blob, BlobModel, BlobSource
from pcsg.leaf.mesh import Mesh, MeshModel
from pcsg.leaf.registry import Constant, LeafConstant, LeafParameter, Solid, word

if TYPE_CHECKING:
    from pcsg.growth.model import GrowthModel
    from pcsg.growth.state import State

_SPECIES = (LeafConstant("species", "the name of a species or of a .json file in quotes"),)
_NUMBERS = (
    LeafParameter("t", low=0.0, open_low=True),
    LeafParameter("seed", 0.0, low=0.0, high=2.0**53),
    LeafParameter("day", 0.0, low=0.0, high=365.0),
)

DAYS = 365.0
"""Of a year, from winter to winter."""

STATES_KEPT = 8
"""Instants of a species whose arrays are remembered: wood and leaves ask for the same ones."""


class Growth(BlobSource):
    """A species, whose trees are made for a time, a seed and a day of the year.

    A seed of 0 is the species' own; without a day the part of the year is that of the time.
    """

    darkening = 0.6

    def __init__(self, name: str, text: str) -> None:
        super().__init__(tuple(p.name for p in _NUMBERS))
        self.name = name
        self._text = text
        self._trees: dict[int, GrowthModel] = {}
        self._states: dict[tuple[float, ...], State] = {}
        self._foliage: dict[tuple[float, ...], MeshModel] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return Growth, (self.name, self._text)

    @property
    def signature(self) -> object:
        return self.name

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(self._text.encode()).hexdigest()

    @property
    def text(self) -> str | None:
        return f'"{self.name}"'

    def state(self, values: Sequence[float]) -> State:
        """Return the tree at a time, with a seed, at a day."""
        from pcsg.growth.model import GrowthModel
        from pcsg.growth.species import read_species

        key = time_of(values), values[1]
        if key not in self._states:
            seed = int(key[1])
            if seed not in self._trees:
                species = read_species(self._text, self.name)
                self._trees[seed] = GrowthModel(species, seed or None)
            if len(self._states) >= STATES_KEPT:
                self._states.pop(next(iter(self._states)))
            self._states[key] = self._trees[seed].at(key[0])
        return self._states[key]

    def build(self, values: Sequence[float]) -> Any:
        from pcsg.growth.wood import wood_field

        return wood_field(self.state(values))

    def foliage(self, values: Sequence[float]) -> MeshModel:
        """Return the leaves at a time, with a seed, at a day."""
        from pcsg.growth.foliage import foliage_mesh

        key = tuple(values)
        if key not in self._foliage:
            if len(self._foliage) >= STATES_KEPT:
                self._foliage.pop(next(iter(self._foliage)))
            self._foliage[key] = MeshModel(foliage_mesh(self.state(values)), self.name, sheet=True)
        return self._foliage[key]


def time_of(values: Sequence[float]) -> float:
    """Return the time in years for the numbers t, seed, day: a day counts in the year behind t."""
    t, _, day = values
    return math.floor(t) + day / DAYS if day > 0.0 else t


def is_species(text: str) -> bool:
    """Return whether a JSON text looks like a growing tree's and not like a skeleton's."""
    return '"curves"' in text or '"species"' in text


def species_mistakes(text: str, name: str) -> list[Diagnostic]:
    """Return what is wrong with the text of a species' file."""
    from pcsg.growth.species import read_species

    try:
        read_species(text, name)
    except GrammarError as error:
        return list(error.diagnostics)
    return []


_READ: WeakValueDictionary[tuple[str, str], Growth] = WeakValueDictionary()


def read_growth(text: str, folder: Path) -> Growth:
    """Return a species by its name, or by a file in a folder.

    Raises
    ------
    UsageError
        What is wrong with the file.
    """
    from pcsg.growth.species import shipped, species_text

    if text not in shipped() and not text.lower().endswith(".json"):
        # Mistakes in species quote them: only what calls itself one is read as one.
        hint = suggest(text, shipped())
        known = f"the species that come along are {', '.join(shipped())}"
        raise UsageError(
            f"there is no species `{text}`: {known}; the name of your own file ends in .json"
            + (f"; {hint}" if hint else "")
        )
    name, content = species_text(text if text in shipped() else folder / text)
    key = text, content
    found = _READ.get(key)
    if found is None:
        mistakes = species_mistakes(content, name)
        if mistakes:
            first, *more = mistakes
            told = f"{first.span}: {first.message}" if first.span else first.message
            rest = f", and {len(more)} more: `pcsg check {text}` tells all" if more else ""
            raise UsageError(told + rest)
        found = _READ[key] = Growth(text, content)
    return found


@word
class TreeWood(Blob):
    """The wood of a growing tree: ``tree_wood("populus", t)``; see `tree`."""

    constants = _SPECIES
    parameters = _NUMBERS

    @classmethod
    def read_constant(cls, text: str, folder: Path) -> Growth:
        return read_growth(text, folder)

    @classmethod
    def take_arguments(cls, args: Sequence[Any]) -> tuple[tuple[Constant, ...], Sequence[Any]]:
        return Solid.take_arguments.__func__(cls, args)  # type: ignore[attr-defined, no-any-return]

    @classmethod
    def parameters_of(cls, constants: Sequence[Constant]) -> tuple[LeafParameter, ...]:
        return cls.parameters

    @classmethod
    def make_model(cls, constants: Sequence[Constant], args: Sequence[float]) -> BlobModel:
        return _growth(constants).model(args)


@word
class TreeLeaves(Mesh):
    """The leaves of a growing tree: ``tree_leaves("populus", t)``, sheets; see `tree`."""

    constants = _SPECIES
    parameters = _NUMBERS
    sheet = True

    @classmethod
    def read_constant(cls, text: str, folder: Path) -> Growth:  # type: ignore[override]
        return read_growth(text, folder)

    @classmethod
    def take_arguments(cls, args: Sequence[Any]) -> tuple[tuple[Constant, ...], Sequence[Any]]:
        return Solid.take_arguments.__func__(cls, args)  # type: ignore[attr-defined, no-any-return]

    @classmethod
    def sheet_of(cls, constants: Sequence[Constant]) -> bool:
        return True

    @classmethod
    def primitives_of(cls, constants: Sequence[Constant]) -> int:
        return 1

    @classmethod
    def make_model(cls, constants: Sequence[Constant], args: Sequence[float]) -> MeshModel:
        return _growth(constants).foliage(args)

    @classmethod
    def notes_of(cls, constants: Sequence[Constant], args: Sequence[float]) -> tuple[str, ...]:
        growth = _growth(constants)
        note = leafless(growth.state(args))
        return () if note is None else (f"{growth.name}: {note}",)


def leafless(state: State) -> str | None:
    """Return why a tree has no leaves, and when it has; None for one that has."""
    if len(state.leaves.size):
        return None
    full = state.species.season.leaf_end
    year = min(math.floor(state.time), state.species.ymax - 1)
    why = "whole years are midwinter" if state.time == round(state.time) else "it is winter"
    return (
        f"no leaves at t = {state.time:g}: {why}; they are whole at t = {year + full:g}, that is "
        f'day {full * DAYS:.0f}: tree("...", {year}, 0, {full * DAYS:.0f})'
    )


@word
class Tree(Solid):
    """A tree of any age: ``tree("populus", t)``, its wood and its leaves.

    The name is that of a species which comes along, or of a .json file relative to the grammar's;
    t is the time in years; whole years are midwinter, without leaves. The next number is the seed
    of another tree of the kind, 0 for the species' own. The last is the day of the year, from 1 to
    365, in place of the part of the year in t: ``tree("populus", 12, 0, 200)`` is twelve years old,
    in summer. Metres, the foot at the origin, z up. Colours are the species'. See
    [growth.md](growth.md).
    """

    constants = _SPECIES
    parameters = _NUMBERS
    parts = (TreeWood, TreeLeaves)

    @classmethod
    def read_constant(cls, text: str, folder: Path) -> Growth:
        return read_growth(text, folder)


def _growth(constants: Sequence[Constant]) -> Growth:
    (growth,) = constants
    assert isinstance(growth, Growth)
    return growth


tree = LeafConstructor(Tree)
tree_wood = LeafConstructor(TreeWood)
tree_leaves = LeafConstructor(TreeLeaves)
