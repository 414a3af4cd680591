"""Recipes packed into flat arrays, as kernels read them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.code import invert_affine
from pcsg.graph.expr import Expr, Number, Parameter, parameters_of
from pcsg.graph.extents import leaf_extent
from pcsg.graph.hulls import Bounds
from pcsg.graph.nodes import Leaf
from pcsg.graph.parametric_bounds import Sides
from pcsg.graph.recipes import (
    EntryPart,
    FixedPart,
    LeafPart,
    NoRecipe,
    Part,
    Place,
    Recipe,
    Recipes,
)
from pcsg.graph.sharing import Assign, register
from pcsg.graph.sides import entry_sides
from pcsg.graph.tape import Program
from pcsg.leaf.registry import Solid
from pcsg.slabs import WIDTH
from pcsg.trace.bounding import BALL, CORNERS, SIDES
from pcsg.vec import IDENTITY, Affine

# Operations of steps.
RUN, PLACE_CONSTANT, PLACE_TRANSFORM = range(3)

# Kinds of parts.
ENTRY, FIXTURE, PRIMITIVE = range(3)

ENTRY_FIELDS, RECIPE_FIELDS, STEP_FIELDS, PART_FIELDS = 6, 4, 6, 12
E_SIDES, E_STAND_IN = 4, 5
R_STEPS, R_STEPS_END, R_PARTS, R_PARTS_END = range(RECIPE_FIELDS)
P_KIND, P_TARGET, P_MATRIX, P_VALUES, P_COUNT, P_SHAPE, P_SHAPE_AT, P_SOLID = range(8)
P_STEPS, P_STEPS_END, P_LOOKS, P_N_LOOKS = range(8, PART_FIELDS)


class Rulebook(NamedTuple):
    """Recipes of a graph.

    Attributes
    ----------
    entries : int32 (6 E,)
        Code of the selection function (-1 for none), offset into `rules`, largest number of a
        rule, number of inputs, offset of the sides in `shapes`, recipe of the stand-in (-1 for
        none).
    rules : int32
        Recipe of every rule, -1 where there is none; number 0 comes first.
    recipes : int32 (4 R,)
        First step, end of the steps, first part, end of the parts.
    steps : int32 (6 S,)
        Operation, result, source, constant matrix or kind of transformation or code, offset of the
        arguments in `sources` and their number.
    parts : int32 (12 P,)
        Kind; entry, first block of a fixture or leaf node; matrix (-1 - k for a constant one);
        offset of the values in `sources` and their number; kind and offset of the bounding shape;
        ``2 kind + sheet`` of a primitive; first step and end of the steps that follow those of the
        recipe for the attributes, offset of these in `sources` and their number. The last part is
        the axiom.
    sources : int32
        A register, or -1 - k for a constant.
    constants : float64
    maps : float64 (24,)
        Constant matrices and their inverses.
    shapes : float64
        Bounding shapes, see `bounding`.
    code, code_constants
        See `tape.Program`; the slots are the registers.
    n_registers, n_matrices, stack_size, width, n_values, n_looks : int
        Sizes of working space; parts of the largest recipe, a multiple of four; values and
        attributes that a part has at most.
    """

    entries: NDArray[np.int32]
    rules: NDArray[np.int32]
    recipes: NDArray[np.int32]
    steps: NDArray[np.int32]
    parts: NDArray[np.int32]
    sources: NDArray[np.int32]
    constants: NDArray[np.float64]
    maps: NDArray[np.float64]
    shapes: NDArray[np.float64]
    code: NDArray[np.int32]
    code_constants: NDArray[np.float64]
    n_registers: int
    n_matrices: int
    stack_size: int
    width: int
    n_values: int
    n_looks: int

    @property
    def nbytes(self) -> int:
        """Memory of all arrays in bytes."""
        return sum(a.nbytes for a in self if isinstance(a, np.ndarray))


class Fixture(NamedTuple):
    """A fixture as blocks: its first block, its box and its ball, in its own frame."""

    block: int
    box: Bounds
    center: tuple[float, float, float]
    radius: float


def write_rulebook(recipes: Recipes, fixtures: Sequence[Fixture]) -> Rulebook:
    """Pack recipes.

    Raises
    ------
    NoRecipe
        An argument of a leaf might be out of its range.
    """
    return _Writer(recipes, fixtures).write()


class _Writer:
    def __init__(self, recipes: Recipes, fixtures: Sequence[Fixture]) -> None:
        self.recipes = recipes
        self.fixtures = fixtures
        self.sides = entry_sides(recipes, [f.box for f in fixtures])
        all_recipes = [r for entry in recipes.entries for r in entry.rules.values()]
        all_recipes += [entry.stand_in for entry in recipes.entries if entry.stand_in]
        self.n_registers = max(r.registers for r in all_recipes) + 1
        self.program = Program({f"r{k}": k for k in range(self.n_registers)})
        self.entries: list[int] = []
        self.rules: list[int] = []
        self.of_recipes: list[int] = []
        self.steps: list[int] = []
        self.parts: list[int] = []
        self.sources: list[int] = []
        self.constants: list[float] = []
        self.constant_of: dict[str, int] = {}
        self.maps: list[float] = []
        self.map_of: dict[Affine, int] = {}
        self.shapes: list[float] = []
        self.sides_at = [self._write_sides(s) for s in self.sides]

    def write(self) -> Rulebook:
        most_parts = most_values = most_matrices = most_looks = 1
        for k, entry in enumerate(self.recipes.entries):
            select = -1 if entry.select is None else self.program.add([entry.select])
            largest = max(entry.rules)
            self.entries += [select, len(self.rules), largest, len(entry.inputs), self.sides_at[k]]
            only = next(iter(entry.rules)) if entry.select is None else -1
            first = len(self.of_recipes) // RECIPE_FIELDS
            numbers = {number: first + i for i, number in enumerate(entry.rules)}
            # Without a choice the rule taken is found at number 0.
            self.rules += [numbers.get(n or only, -1) for n in range(largest + 1)]
            self.entries.append(first + len(entry.rules) if entry.stand_in else -1)
            recipes = [*entry.rules.values(), *([entry.stand_in] if entry.stand_in else [])]
            for recipe in recipes:
                self._write_recipe(recipe)
                most_parts = max(most_parts, len(recipe.parts))
                most_matrices = max(most_matrices, recipe.matrices)
                most_values = max([most_values, *(len(_values(p)) for p in recipe.parts)])
                most_looks = max([most_looks, *(len(_looks(p)) for p in recipe.parts)])
        # The axiom, as a part of a slot of its own.
        self._write_part(EntryPart(IDENTITY, 0, ()))
        code, code_constants = self.program.arrays()
        return Rulebook(
            entries=np.array(self.entries, np.int32),
            rules=np.array(self.rules, np.int32),
            recipes=np.array(self.of_recipes, np.int32),
            steps=np.array(self.steps or [0], np.int32),
            parts=np.array(self.parts or [0], np.int32),
            sources=np.array(self.sources or [0], np.int32),
            constants=np.array(self.constants or [0.0]),
            maps=np.array(self.maps or [0.0]),
            shapes=np.array(self.shapes or [0.0]),
            code=code,
            code_constants=code_constants,
            n_registers=self.n_registers,
            n_matrices=most_matrices,
            stack_size=max(self.program.stack_size, 16),
            width=-(-most_parts // WIDTH) * WIDTH,
            n_values=most_values,
            n_looks=most_looks,
        )

    def _write_recipe(self, recipe: Recipe) -> None:
        shaping = _find_needed(recipe, recipe.parts, _values)
        steps = self._write_steps(compress(recipe.steps, shaping))
        looks = []
        for part in recipe.parts:
            needed = _find_needed(recipe, [part], _looks)
            own = (n and not shapes for n, shapes in zip(needed, shaping, strict=True))
            looks.append(self._write_steps(compress(recipe.steps, own)))
        first = len(self.parts) // PART_FIELDS
        for part, own_steps in zip(recipe.parts, looks, strict=True):
            self._write_part(part, own_steps)
        self.of_recipes += [*steps, first, len(self.parts) // PART_FIELDS]

    def _write_steps(self, steps: Iterable[Assign | Place]) -> tuple[int, int]:
        """Write steps and return where they begin and end."""
        begin = len(self.steps) // STEP_FIELDS
        pending: list[Assign] = []
        for step in steps:
            if isinstance(step, Assign):
                pending.append(step)
                continue
            self._write_code(pending)
            pending = []
            self._write_place(step)
        self._write_code(pending)
        return begin, len(self.steps) // STEP_FIELDS

    def _write_code(self, steps: list[Assign]) -> None:
        if steps:
            at = self.program.add([s.expr for s in steps], [f"r{s.register}" for s in steps])
            self.steps += [RUN, 0, 0, at, 0, 0]

    def _write_place(self, step: Place) -> None:
        if step.constant is not None:
            constant = self._map(step.constant)
            self.steps += [PLACE_CONSTANT, step.matrix, step.source, constant, 0, 0]
        else:
            assert step.transform is not None
            at = self._write_sources(step.args)
            kind, n = step.transform.kind, len(step.args)
            self.steps += [PLACE_TRANSFORM, step.matrix, step.source, kind, at, n]

    def _write_part(self, part: Part, steps: tuple[int, int] = (0, 0)) -> None:
        matrix = -1 - self._map(part.matrix) if isinstance(part.matrix, Affine) else part.matrix
        solid = 0
        if isinstance(part, EntryPart):
            kind, target = ENTRY, part.entry
            shape, at = SIDES, self.sides_at[part.entry]
        elif isinstance(part, FixedPart):
            target, box, center, radius = self.fixtures[part.fixture]
            kind, shape, at = FIXTURE, BALL, self._write_shape([*box, *center, radius])
        else:
            kind, target = PRIMITIVE, part.node
            solid, shape, at = self._write_leaf(part)
        values, looks = _values(part), _looks(part)
        self.parts += [kind, target, matrix, self._write_sources(values), len(values)]
        self.parts += [shape, at, solid, *steps, self._write_sources(looks), len(looks)]

    def _write_leaf(self, part: LeafPart) -> tuple[int, int, int]:
        """Return the code of a primitive's solid, and its bounding shape."""
        node = self.recipes.graph.nodes[part.node]
        assert isinstance(node, Leaf)
        solid = node.solid
        _check_arguments(solid, part)
        code = 2 * solid.kind + solid.sheet
        if solid.corners:
            numbers = [x for corner in solid.corners for x in corner]
            return code, CORNERS, self._write_shape([float(len(solid.corners)), *numbers])
        extent = leaf_extent(node, list(part.ranges))
        center, radius = solid.ball or ball_of(extent.box)
        return code, BALL, self._write_shape([*extent.box, *center, radius])

    def _write_sources(self, exprs: Sequence[Expr]) -> int:
        at = len(self.sources)
        for expr in exprs:
            if isinstance(expr, Number):
                self.sources.append(-1 - self._constant(expr.value))
            else:
                assert isinstance(expr, Parameter)
                self.sources.append(int(expr.name[1:]))
        return at

    def _constant(self, value: float) -> int:
        key = value.hex()
        if key not in self.constant_of:
            self.constant_of[key] = len(self.constants)
            self.constants.append(value)
        return self.constant_of[key]

    def _map(self, m: Affine) -> int:
        if m not in self.map_of:
            self.map_of[m] = len(self.maps) // 24
            self.maps += [*m, *invert_affine(m)[0]]
        return self.map_of[m]

    def _write_shape(self, numbers: list[float]) -> int:
        at = len(self.shapes)
        self.shapes += numbers
        return at

    def _write_sides(self, sides: Sides) -> int:
        numbers: list[float] = [sides.reach]
        for side in sides.sides:
            group = [float(k) for k in side.group]
            numbers += [side.shift, side.floor, float(len(group)), *group]
        return self._write_shape(numbers)


def _values(part: Part) -> tuple[Expr, ...]:
    """Return what a state's shape needs to know of a part."""
    if isinstance(part, LeafPart):
        return part.args
    return part.values if isinstance(part, EntryPart) else ()


def _looks(part: Part) -> tuple[Expr, ...]:
    """Return the attributes of a part, which only a visible hit needs."""
    return () if isinstance(part, EntryPart) else part.attributes


def _find_needed(
    recipe: Recipe, parts: Sequence[Part], of: Callable[[Part], tuple[Expr, ...]]
) -> list[bool]:
    """Return for each step whether what is told of parts, or their matrices, depend on it."""
    needed = {name for part in parts for name in parameters_of(*of(part))}
    matrices = {part.matrix for part in parts if isinstance(part.matrix, int)}
    found = []
    for step in reversed(recipe.steps):
        if isinstance(step, Place):
            found.append(step.matrix in matrices)
            if found[-1]:
                matrices.add(step.source)
                needed |= parameters_of(*step.args)
        else:
            found.append(register(step.register).name in needed)
            if found[-1]:
                needed |= parameters_of(step.expr)
    return found[::-1]


def ball_of(box: Bounds) -> tuple[tuple[float, float, float], float]:
    """Return centre and radius of the ball around a box."""
    if not np.isfinite(box).all():
        return (0.0, 0.0, 0.0), float("inf")
    lower, upper = np.array(box[:3]), np.array(box[3:])
    x, y, z = (lower + upper) / 2.0
    return (float(x), float(y), float(z)), float(np.linalg.norm(upper - lower)) / 2.0 * (1 + 1e-15)


def _check_arguments(solid: type[Solid], part: LeafPart) -> None:
    for parameter, (low, high) in zip(solid.parameters, part.ranges, strict=True):
        legal = parameter.low < low if parameter.open_low else parameter.low <= low
        if not (legal and high <= parameter.high):
            raise NoRecipe(f"an argument of {solid.name} that may be out of range")
