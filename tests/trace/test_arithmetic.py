"""Instructions over registers compute what the tape computes, bit for bit."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import expressions

from pcsg.graph.columns import Column, look_up
from pcsg.graph.expr import Expr, Number, P, and_, call, if_, or_
from pcsg.graph.graph import FRAME_SLOTS
from pcsg.graph.sharing import register, substitute
from pcsg.graph.tape import Fault, Program
from pcsg.trace.expand.arithmetic import Arithmetic, compute

NAMES = ("a", "b", "c", *FRAME_SLOTS)
FRAME = (0.5, -1.0, 0.25, 3.0, 2.0, 1.0, 0.0, -1.5, 0.0, 0.125, -2.0, 7.0)
TARGET = len(NAMES)


def by_instructions(exprs: Sequence[Expr], given: Sequence[float]) -> bytes | None:
    """Return the values of expressions, one after the other; None for a fault."""
    written = Arithmetic()
    written.begin(len(NAMES), TARGET + len(exprs))
    values = {name: register(k) for k, name in enumerate(NAMES)}
    for k, expr in enumerate(exprs):
        written.assign(TARGET + k, substitute(expr, values), 3)
    written.end()
    n = written.registers
    code, sources = (
        np.array([n - 1 - x if x < 0 else x for x in numbers] or [0], np.int32)
        for numbers in (written.code, written.sources)
    )
    params = np.array([*given, *[0.0] * (n - len(given)), *written.literals])
    stack = np.zeros(max(16, written.most_arguments))
    columns = np.concatenate([np.zeros(0), *(c.values for c in written.columns)])
    if not compute(code, sources, columns, params, stack, 0):
        return None
    return params[TARGET : TARGET + len(exprs)].tobytes()


def by_tape(exprs: Sequence[Expr], given: Sequence[float]) -> bytes | None:
    program = Program({name: k for k, name in enumerate(NAMES)}, 3)
    try:
        found = [program.evaluate(program.add([expr]), list(given))[0] for expr in exprs]
    except Fault:
        return None
    return struct.pack(f"{len(found)}d", *found)


@pytest.mark.parametrize("name", ["min", "max"])
def test_the_smallest_of_one_number(name: str) -> None:
    exprs = [call(name, 1.0), call(name, P.a), call(name, call(name, P.b + 1.0))]
    given = [2.0, 3.0, 4.0, *FRAME]
    assert (
        by_instructions(exprs, given) == by_tape(exprs, given) == struct.pack("3d", 1.0, 2.0, 4.0)
    )


@given(
    st.lists(expressions(NAMES[:3]), min_size=1, max_size=3),
    st.lists(st.one_of(st.integers(-3, 3).map(float), st.floats(-9, 9)), min_size=3, max_size=3),
    st.sampled_from([(), (0,), (1, 2)]),
)
def test_values_and_faults(
    exprs: list[Expr], numbers: list[float], missing: tuple[int, ...]
) -> None:
    given = [math.nan if k in missing else x for k, x in enumerate(numbers)] + [*FRAME]
    assert by_instructions(exprs, given) == by_tape(exprs, given)


@pytest.mark.parametrize(
    "expr",
    [
        P.a > 0,
        if_(P.a, 1, 2),
        if_(1, P.a, 2),
        if_(P.b, P.a, P.a),
        if_(P.b, 1, P.a + 1),
        and_(1, P.a),
        or_(0, P.a),
        and_(0, P.a),
        or_(1, P.a),
        call("max", P.a, 1),
        call("max", 1, 2, P.a),
        -P.a,
        P.a + 1,
        P.a,
        look_up(Column("c", np.array([1.0])), P.a),
    ],
    ids=str,
)
def test_what_has_no_value_is_a_fault_where_it_is_asked_for(expr: Expr) -> None:
    given = [math.nan, 1.0, 2.0, *FRAME]
    # What one branch asks for says nothing of what comes behind it.
    for exprs in ([expr], [if_(P.b - 1, P.a + 1, 5), expr], [expr, P.b + P.c]):
        assert by_instructions(exprs, given) == by_tape(exprs, given)


def test_columns() -> None:
    left, right = (Column(n, np.array(v)) for n, v in (("l", [3.0, 4.0]), ("r", [5.0, 6.0, 7.0])))
    for row in (0.0, 0.9, 1.0, 1.5, 2.0, 2.1, 3.0, 3.5, -1.0):
        given = [row, 0.0, 0.0, *FRAME]
        for exprs in (
            [look_up(left, P.a)],
            [look_up(right, P.a), look_up(left, P.a * 0 + 2)],
            [look_up(right, P.a) + look_up(right, P.a + 0.0)],
        ):
            assert by_instructions(exprs, given) == by_tape(exprs, given)


def test_long_sums_take_no_recursion() -> None:
    total: Expr = Number(0.0)
    for k in range(5_000):
        total = total + P.b * k
    given = [1.0, 0.1, 2.0, *FRAME]
    assert by_instructions([total], given) == by_tape([total], given)
