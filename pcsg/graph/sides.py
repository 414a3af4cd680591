"""Boxes of entries as functions of their inputs.

A side of an entry's box is ``max(p_1, ..., p_n) + c`` over some of its inputs, or a constant,
whichever is larger: for a terrain the height of a triangle's corners and what displacements can add
below it. One pass from the leaves up finds it. Values of inputs are followed as affine forms, a
linear part and an interval (Comba and Stolfi 1993); a side that fits is one whose linear part is a
convex combination of inputs. What does not fit is bounded by the ranges of the inputs, and
everything by the boxes of `ranges`. Rounding is left to whoever uses the boxes: what is
added here is of their size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pcsg.graph.affine_forms import (
    Inputs,
    Linear,
    along_box,
    along_point,
    form_of,
    multiply_matrices,
    scale_form,
    transform_forms,
)
from pcsg.graph.expr import Expr
from pcsg.graph.extents import leaf_extent
from pcsg.graph.hulls import Bounds
from pcsg.graph.nodes import Leaf
from pcsg.graph.ordering import successors_first
from pcsg.graph.parametric_bounds import Sides, along_sides, fit_side
from pcsg.graph.recipes import Entry, FixedPart, LeafPart, Part, Recipe, Recipes
from pcsg.graph.sharing import Assign
from pcsg.vec import Affine


@dataclass
class _Registers:
    """What is known of the registers of a recipe, and of its matrices."""

    forms: dict[str, Linear]
    matrices: list[tuple[Linear, ...]]
    ranges: Inputs


def entry_sides(recipes: Recipes, fixture_boxes: Sequence[Bounds]) -> list[Sides]:
    """Return the sides of every entry.

    Parameters
    ----------
    fixture_boxes
        The box of every fixture in its own frame.
    """
    return _Measure(recipes, fixture_boxes).run()


class _Measure:
    def __init__(self, recipes: Recipes, fixture_boxes: Sequence[Bounds]) -> None:
        self.recipes = recipes
        self.fixture_boxes = fixture_boxes
        extents = recipes.ranges.extents()
        self.extents = [extents[entry.key] for entry in recipes.entries]
        self.found: dict[int, Sides] = {}

    def run(self) -> list[Sides]:
        """Measure the entries, each after those that it leads to where there is no cycle."""
        for k in successors_first(self.recipes.successors):
            self.found[k] = self._sides_of(k)
        return [self.found[k] for k in range(len(self.found))]

    def _sides_of(self, number: int) -> Sides:
        entry, extent = self.recipes.entries[number], self.extents[number]
        candidates: list[list[Linear]] = [[] for _ in range(6)]
        for recipe in entry.rules.values():
            known = _run(entry, recipe)
            for part in recipe.parts:
                matrix = _matrix(part, known)
                for i in range(6):
                    row = matrix[4 * (i % 3) : 4 * (i % 3) + 4]
                    if i < 3:
                        row = tuple(scale_form(x, -1.0) for x in row)
                    candidates[i] += self._bounds_of(part, row, known)
        sides = []
        for i, forms in enumerate(candidates):
            sign = -1.0 if i < 3 else 1.0
            sides.append(fit_side(forms, dict(enumerate(entry.ranges)), sign * extent.box[i], sign))
        return Sides(tuple(sides), extent.reach)

    def _bounds_of(self, part: Part, row: Sequence[Linear], known: _Registers) -> list[Linear]:
        """Return upper bounds of a part along a row; their largest holds."""
        if isinstance(part, LeafPart):
            node = self.recipes.graph.nodes[part.node]
            assert isinstance(node, Leaf)
            if node.solid.corners:
                return [along_point(row, corner) for corner in node.solid.corners]
            return along_box(row, leaf_extent(node, list(part.ranges)).box, known.ranges)
        if isinstance(part, FixedPart):
            return along_box(row, self.fixture_boxes[part.fixture], known.ranges)
        if part.entry not in self.found:  # around a cycle
            return along_box(row, self.extents[part.entry].box, known.ranges)
        values = [_form(v, known) for v in part.values]
        return along_sides(row, self.found[part.entry], values.__getitem__, known.ranges)


def _run(entry: Entry, recipe: Recipe) -> _Registers:
    """Follow a recipe on affine forms."""
    forms = {f"r{k}": Linear({k: 1.0}, (0.0, 0.0)) for k in range(len(entry.inputs))}
    known = _Registers(forms, [], dict(enumerate(entry.ranges)))
    for step in recipe.steps:
        if isinstance(step, Assign):
            forms[f"r{step.register}"] = _form(step.expr, known)
            continue
        if step.constant is not None:
            inner = tuple(Linear({}, (x, x)) for x in step.constant)
        else:
            assert step.transform is not None
            inner = transform_forms(
                step.transform, [_form(a, known) for a in step.args], known.ranges
            )
        outer = known.matrices[step.source] if step.source >= 0 else None
        known.matrices.append(
            inner if outer is None else multiply_matrices(outer, inner, known.ranges)
        )
    return known


def _form(expr: Expr, known: _Registers) -> Linear:
    """Return the affine form of an expression over registers."""
    return form_of(expr, known.forms, known.ranges)


def _matrix(part: Part, known: _Registers) -> tuple[Linear, ...]:
    if isinstance(part.matrix, Affine):
        return tuple(Linear({}, (x, x)) for x in part.matrix)
    return known.matrices[part.matrix]
