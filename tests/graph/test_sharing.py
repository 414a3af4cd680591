"""Terms that several steps have in common: evaluated once, and with the same values."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
from strategies import expressions

from pcsg.graph.expr import Apply, Expr, P, call, if_, operands, postorder
from pcsg.graph.recipes import Assign, Recipe
from pcsg.graph.sharing import share_terms
from pcsg.graph.tape import Fault, Program

INPUTS = ("r0", "r1")


def recipe_of(*exprs: Expr) -> Recipe:
    steps = [Assign(len(INPUTS) + k, e) for k, e in enumerate(exprs)]
    return Recipe(list(steps), [], registers=len(INPUTS) + len(exprs))


def values_of(recipe: Recipe, inputs: list[float], count: int) -> list[float] | None:
    """Return the first registers after all steps, None for a fault."""
    program = Program({f"r{k}": k for k in range(recipe.registers)})
    steps = [s for s in recipe.steps if isinstance(s, Assign)]
    at = program.add([s.expr for s in steps], [f"r{s.register}" for s in steps])
    registers = inputs + [math.nan] * (recipe.registers - len(inputs))
    try:
        program.evaluate(at, registers)
    except Fault:
        return None
    return registers[:count]


def applications(recipe: Recipe) -> int:
    exprs = [s.expr for s in recipe.steps if isinstance(s, Assign)]
    return sum(isinstance(e, Apply) for x in exprs for e in postorder(x, operands))


@given(
    first=st.lists(expressions(INPUTS, world=False), min_size=1, max_size=3),
    parts=st.lists(expressions(("r0", "r1", "r2"), world=False), min_size=1, max_size=3),
    inputs=st.lists(st.floats(-10, 10), min_size=2, max_size=2),
    data=st.data(),
)
def test_values_stay(
    first: list[Expr], parts: list[Expr], inputs: list[float], data: st.DataObject
) -> None:
    pool = [*first, *(e for x in first for e in postorder(x, operands) if isinstance(e, Apply))]
    again = [data.draw(st.sampled_from(pool)) + p for p in parts]
    again += [if_(P.r0 > 0, data.draw(st.sampled_from(pool)), p) for p in parts]
    recipe = recipe_of(*first, *again)
    count = recipe.registers
    expected, before = values_of(recipe, inputs, count), applications(recipe)
    share_terms(recipe)
    assert values_of(recipe, inputs, count) == expected
    assert applications(recipe) <= before


def test_a_term_of_three_colours_is_evaluated_once() -> None:
    level = call("ln", P.r0 * P.r1 + 2)
    recipe = recipe_of(*(level * k for k in (0.2, 0.3, 0.4)))
    share_terms(recipe)
    assert len(recipe.steps) == 4
    assert applications(recipe) == 3 + 3


def test_what_is_evaluated_under_a_condition_only_stays_there() -> None:
    root = call("ln", P.r0 * P.r0 + P.r0 * P.r1)
    recipe = recipe_of(if_(P.r0 > 0, root + 1, 0), if_(P.r0 > 0, root + 2, 0))
    share_terms(recipe)
    assert values_of(recipe, [-1.0, 3.0], 4) == [-1.0, 3.0, 0.0, 0.0]
