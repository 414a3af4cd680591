"""Rules as recipes: how a state is made from the values of its parameters while rays are traced.

Where states are too many to be unrolled, what they have in common is worked out beforehand. An
*entry* of `ranges` is a module with the parameters that are the same wherever it is met; what is
left are its *inputs*. The recipe of one of its rules is straight code over registers: inputs first,
then what calculations assign, arguments, matrices; and a list of *parts*, each a solid with its
matrix. Whatever does not depend on inputs is a number already, and a part below which nothing
depends on them is a *fixture*: a finite graph of states of its own.

Binding times, in the words of Jones, Gomard and Sestoft 1993, "Partial Evaluation": entries are the
static part of a derivation, inputs the dynamic one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from pcsg.graph.expr import Expr
from pcsg.graph.graph import Graph
from pcsg.graph.ranges import Key, Ranges
from pcsg.graph.sharing import Assign
from pcsg.graph.states import Start
from pcsg.graph.transforms import Transform
from pcsg.vec import Affine


class NoRecipe(Exception):
    """The graph has something that recipes cannot tell."""


class Place(NamedTuple):
    """Matrix `matrix` becomes matrix `source` (-1: none) times a constant or a transformation.

    Attributes
    ----------
    args
        Registers or numbers, in the order of the transformation's arguments.
    """

    matrix: int
    source: int
    constant: Affine | None
    transform: Transform | None
    args: tuple[Expr, ...]


class LeafPart(NamedTuple):
    """A primitive.

    Attributes
    ----------
    matrix
        Number of a matrix of the recipe, or a constant one.
    args, attributes
        Numbers or registers.
    ranges
        What the arguments can be.
    """

    matrix: int | Affine
    node: int
    args: tuple[Expr, ...]
    attributes: tuple[Expr, ...]
    ranges: tuple[tuple[float, float], ...]


class EntryPart(NamedTuple):
    """Another entry, with its inputs."""

    matrix: int | Affine
    entry: int
    values: tuple[Expr, ...]


class FixedPart(NamedTuple):
    """A fixture, by its number; and the attributes of its leaves that have none of their own."""

    matrix: int | Affine
    fixture: int
    attributes: tuple[Expr, ...]


Part = LeafPart | EntryPart | FixedPart


@dataclass
class Recipe:
    """How the right-hand side of a rule is made.

    Attributes
    ----------
    steps
        In the order of execution.
    parts
        In the order of the text.
    registers, matrices
        How many there are.
    """

    steps: list[Assign | Place] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    registers: int = 0
    matrices: int = 0


@dataclass
class Entry:
    """A module for some values of its parameters.

    Attributes
    ----------
    key
        Its key among the ranges.
    inputs
        Names of the parameters that recipes find in registers 0, 1, ...
    ranges
        What the inputs can be.
    select
        The selection function over registers; None where only one rule can be taken.
    rules
        Recipes by the rules' numbers.
    stand_in
        The recipe of a rule of a few leaves that are sheets: what the state looks like from afar.
    """

    key: Key
    inputs: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    select: Expr | None = None
    rules: dict[int, Recipe] = field(default_factory=dict)
    stand_in: Recipe | None = None


@dataclass
class Recipes:
    """All recipes of a graph; the axiom's entry is the first.

    Attributes
    ----------
    order
        Numbers of the entries, each after those that it leads to; None where there is a cycle.
    """

    graph: Graph
    ranges: Ranges
    entries: list[Entry]
    fixtures: list[Start]

    @property
    def successors(self) -> list[list[int]]:
        """Entries that every entry leads to, each once."""
        return [
            list(
                dict.fromkeys(
                    part.entry
                    for recipe in entry.rules.values()
                    for part in recipe.parts
                    if isinstance(part, EntryPart)
                )
            )
            for entry in self.entries
        ]
