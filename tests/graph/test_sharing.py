"""Terms that several steps have in common: evaluated once, and with the same values."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
from strategies import expressions

from pcsg.graph.expr import Apply, Expr, P, call, if_, operands, postorder
from pcsg.graph.sharing import Assign, share_terms
from pcsg.graph.tape import Fault, Program

INPUTS = ("r0", "r1")


def steps_of(*exprs: Expr) -> list[Assign]:
    return [Assign(len(INPUTS) + k, e) for k, e in enumerate(exprs)]


def shared(steps: list[Assign]) -> list[Assign]:
    found, _ = share_terms([*steps, None], len(INPUTS) + len(steps))
    assert found[-1][1] is None
    return [s for before, own in found for s in (*before, own) if s is not None]


def values_of(steps: list[Assign], inputs: list[float], count: int) -> list[float] | None:
    """Return the first registers after all steps, None for a fault."""
    registers = max(s.register for s in steps) + 1
    program = Program({f"r{k}": k for k in range(registers)})
    at = program.add([s.expr for s in steps], [f"r{s.register}" for s in steps])
    values = inputs + [math.nan] * (registers - len(inputs))
    try:
        program.evaluate(at, values)
    except Fault:
        return None
    return values[:count]


def applications(steps: list[Assign]) -> int:
    exprs = [s.expr for s in steps]
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
    steps = steps_of(*first, *again)
    count = len(INPUTS) + len(steps)
    after = shared(steps)
    assert values_of(after, inputs, count) == values_of(steps, inputs, count)
    assert applications(after) <= applications(steps)


def test_a_term_of_three_colours_is_evaluated_once() -> None:
    level = call("ln", P.r0 * P.r1 + 2)
    steps = shared(steps_of(*(level * k for k in (0.2, 0.3, 0.4))))
    assert len(steps) == 4
    assert applications(steps) == 3 + 3


def test_what_is_evaluated_under_a_condition_only_stays_there() -> None:
    root = call("ln", P.r0 * P.r0 + P.r0 * P.r1)
    steps = shared(steps_of(if_(P.r0 > 0, root + 1, 0), if_(P.r0 > 0, root + 2, 0)))
    assert values_of(steps, [-1.0, 3.0], 4) == [-1.0, 3.0, 0.0, 0.0]
