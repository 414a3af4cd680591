"""The two evaluators of the tape, against each other and against the oracle, bit for bit."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence

import numpy as np
import oracle
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from strategies import expressions

from pcsg.graph.expr import Apply, Expr, Number, P, and_, apply, call, if_, or_, seeds_first
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.graph import FRAME_SLOTS
from pcsg.graph.tape import NOT_FINITE, OK, UNASSIGNED, Fault, Program, run
from pcsg.graph.transforms import TRANSFORMS, evaluate_transform
from pcsg.jit import plain

NAMES = ("a", "b", "c", "d")
SLOTS = {name: k for k, name in enumerate((*NAMES, *FRAME_SLOTS))}
FRAME = ((0.5, -1.0, 0.25, 3.0), (2.0, 1.0, 0.0, -1.5), (0.0, 0.125, -2.0, 7.0))

ARGUMENTS = st.one_of(
    st.integers(-8, 8).map(float),
    st.sampled_from([0.0, -0.0, 0.5, -1.5, 2.5, 90.0, -270.0, 1e-300, 1e300, 1.0 / 3.0]),
    st.floats(-1.0, 1.0),
    st.floats(-1e3, 1e3),
    st.floats(allow_nan=False, allow_infinity=False),
)


def bits(x: float) -> bytes:
    return struct.pack("d", x)


def parameters(values: Mapping[str, float]) -> list[float]:
    frame = [x for row in FRAME for x in row]
    return [values.get(name, math.nan) for name in NAMES] + frame


def by_kernel(program: Program, at: int, params: Sequence[float]) -> tuple[int, int, list[float]]:
    """Return the status, the instruction, and the stack of the compiled interpreter."""
    code, constants = program.arrays()
    stack = np.full(program.stack_size, np.nan)
    # Offset slots, as the walker has them for every level.
    slots = np.array([7.0, *params])
    status, where = run(code, constants, at, program.frame_slot, slots, 1, stack)
    return status, where, [float(x) for x in stack]


def by_python(program: Program, at: int, params: Sequence[float]) -> tuple[int, int, list[float]]:
    try:
        return OK, -1, program.evaluate(at, list(params))
    except Fault as fault:
        return fault.status, fault.instruction, []


def assert_agreement(expr: Expr, values: Mapping[str, float]) -> None:
    program = Program(SLOTS, len(NAMES))
    at = program.add([expr])
    params = parameters(values)
    status, where, stack = by_kernel(program, at, params)
    expected, instruction, result = by_python(program, at, params)
    assert status == expected, (expr, values)
    try:
        meaning = oracle.evaluate(expr, values, FRAME)
    except oracle.Fault:
        assert status in (NOT_FINITE, UNASSIGNED), (expr, values)
        assert where == instruction
        return
    assert status == OK, (expr, values)
    assert bits(stack[0]) == bits(result[0]) == bits(meaning), (expr, values)


@pytest.mark.parametrize("name", [n for n, f in FUNCTIONS.items() if f.form is not Form.COLUMN])
@given(data=st.data())
def test_evaluators_agree_on_every_function(name: str, data: st.DataObject) -> None:
    least, most = FUNCTIONS[name].arity
    count = data.draw(st.integers(least, 5 if most is None else most))
    args = [data.draw(ARGUMENTS) for _ in range(count)]
    # Half of the arguments are parameters, the others constants.
    exprs = [Number(x) if k % 2 else getattr(P, NAMES[k // 2]) for k, x in enumerate(args)]
    seeds = data.draw(st.integers(1, count - 1)) if name == "choose" else 0
    values = {NAMES[k // 2]: x for k, x in enumerate(args) if not k % 2}
    assert_agreement(Apply(name, tuple(exprs), seeds), values)


@given(expressions(NAMES), st.lists(ARGUMENTS, min_size=4, max_size=4), st.integers(0, 4))
@example(if_(P.a, P.d, 1.0), [0.0, 1.0, 2.0, 3.0], 3)
def test_evaluators_agree_on_expressions(expr: Expr, numbers: list[float], assigned: int) -> None:
    assert_agreement(expr, dict(zip(NAMES[:assigned], numbers, strict=False)))


@pytest.mark.parametrize(
    ("expr", "value"),
    [
        (if_(P.a > 0, 1.0, 1 / (P.a * 0)), 1.0),
        (if_(P.a < 0, 1 / (P.a * 0), 2.0), 2.0),
        (if_(P.a < 0, P.d, 3.0), 3.0),
        (and_(P.a < 0, 1 / (P.a * 0)), 0.0),
        (and_(P.a > 0, 7.0), 1.0),
        (or_(P.a > 0, call("ln", -1.0)), 1.0),
        (or_(P.a < 0, -3.0), 1.0),
        (or_(P.a < 0, 0.0), 0.0),
    ],
)
def test_branches_not_taken_are_not_evaluated(expr: Expr, value: float) -> None:
    assert_agreement(expr, {"a": 2.0})
    program = Program(SLOTS, len(NAMES))
    assert program.evaluate(program.add([expr]), parameters({"a": 2.0})) == [value]


@pytest.mark.parametrize(
    "expr", [and_(P.a > 0, 1 / (P.a - P.a)), or_(P.a < 0, P.d), if_(P.a > 0, P.d, 1)]
)
def test_branches_taken_are(expr: Expr) -> None:
    program = Program(SLOTS, len(NAMES))
    at = program.add([expr])
    assert by_kernel(program, at, parameters({"a": 2.0}))[0] != OK
    assert by_python(program, at, parameters({"a": 2.0}))[0] != OK


VECTORS = [
    (call("rand", 0.0), "0x1.ab8434ea53dcdp-1"),
    (call("rand", 1.0), "0x1.60a61f59e3cafp-1"),
    (call("rand", -1.5, 2.0), "0x1.5ae4f1439b6c0p-6"),
    (call("rand", 1e300, 0.0, 3.0), "0x1.59b345e6f299bp-1"),
    (call("randedge", 0.0, 0.0, 1.0, 0.5), "0x1.4bce666a0903fp-1"),
    (call("randedge", 1.0, 0.5, 0.0, 0.0), "0x1.4bce666a0903fp-1"),
    (call("gauss", 0.0), "-0x1.261d7c0ef870ep+1"),
    (call("gauss", 7.0, 11.0), "0x1.b017e8161eabfp-1"),
    (seeds_first([0.0], [1.0, 1.0]), "0x1.0000000000000p+0"),
    (seeds_first([1.0], [1.0, 2.0, 3.0]), "0x1.8000000000000p+1"),
    (seeds_first([5.0, 6.0], [0.0, 4.0, 4.0, 4.0]), "0x1.0000000000000p+2"),
]


@pytest.mark.parametrize(("expr", "value"), VECTORS)
def test_random_functions_are_fixed_for_ever(expr: Expr, value: str) -> None:
    # The normal distribution goes through the C library's logarithm and cosine, which may differ
    # in the last place on another machine; the others are integer arithmetic.
    isclose = isinstance(expr, Apply) and expr.function == "gauss"
    assert value_of(expr) == pytest.approx(float.fromhex(value), rel=1e-15 if isclose else 0, abs=0)


def test_zero_has_one_sign_for_random_functions() -> None:
    for name in ("rand", "gauss"):
        assert value_of(call(name, 0.0)) == value_of(call(name, -0.0))
    assert value_of(call("randedge", -0.0, 1.0, 2.0, -0.0)) == value_of(
        call("randedge", 2.0, 0.0, 0.0, 1.0)
    )


def value_of(expr: Expr) -> float:
    program = Program({}, -1)
    at = program.add([expr])
    status, _, stack = by_kernel(program, at, [])
    assert status == OK
    assert program.evaluate(at, []) == [stack[0]]
    return stack[0]


def test_random_numbers_look_uniform_and_normal() -> None:
    program = Program({}, -1)
    uniform = [program.evaluate(program.add([call("rand", k, 3)]), [])[0] for k in range(2000)]
    normal = [program.evaluate(program.add([call("gauss", k, 3)]), [])[0] for k in range(2000)]
    chosen = [
        program.evaluate(program.add([seeds_first([float(k)], [1.0, 3.0])]), [])[0]
        for k in range(2000)
    ]
    assert 0.0 <= min(uniform) < 0.01 < 0.99 < max(uniform) < 1.0
    assert abs(np.mean(uniform) - 0.5) < 0.03
    assert abs(np.mean(normal)) < 0.1
    assert abs(np.std(normal) - 1.0) < 0.1
    assert abs(np.mean(chosen) - 1.75) < 0.05


@given(st.integers(-(10**6), 10**6))
def test_sines_are_exact_at_multiples_of_90_degrees(turns: int) -> None:
    sines, k = [0.0, 1.0, 0.0, -1.0], turns % 4
    angle = 90.0 * turns
    assert value_of(call("sin", angle)) == sines[k]
    assert value_of(call("cos", angle)) == sines[(k + 1) % 4]


@pytest.mark.parametrize("name", ["rotx", "roty", "rotz"])
def test_rotations_are_exact_at_multiples_of_90_degrees(name: str) -> None:
    kernel = plain(TRANSFORMS[name].kernel)
    for turns in range(-5, 6):
        assert set(map(abs, kernel(90.0 * turns))) == {0.0, 1.0}


@pytest.mark.parametrize("name", TRANSFORMS)
@given(data=st.data())
def test_transformations_agree(name: str, data: st.DataObject) -> None:
    transform = TRANSFORMS[name]
    args = [data.draw(st.floats(-400.0, 400.0) | ARGUMENTS) for _ in transform.parameters]
    stack = np.array([*args, 0.0])
    compiled = evaluate_transform(transform.kind, stack)
    with np.errstate(all="ignore"):
        reference = plain(transform.kernel)(*args)
    assert [bits(float(x)) for x in compiled] == [bits(float(x)) for x in reference]


def test_directions_next_to_the_opposite_one_are_aligned() -> None:
    for x in (1e-200, 1e-160, 1e-150, 1e-9):
        matrix = plain(TRANSFORMS["align"].kernel)(x, 0.0, -1.0)
        columns = [[matrix[4 * i + j] for i in range(3)] for j in range(3)]
        for i in range(3):
            for j in range(3):
                assert np.dot(columns[i], columns[j]) == pytest.approx(float(i == j), abs=1e-12)
        assert columns[2] == pytest.approx([x, 0.0, -1.0], abs=1e-12)


def test_assignments_in_order_and_in_parallel() -> None:
    for parallel, expected in ((False, [5.0, 50.0]), (True, [5.0, 10.0])):
        program = Program(SLOTS, len(NAMES))
        add = program.add_parallel if parallel else program.add
        at = add([Number(5.0), P.a * 10], ["a", "b"])
        params = parameters({"a": 1.0})
        program.evaluate(at, params)
        assert params[:2] == expected
        code, constants = program.arrays()
        array = np.array(parameters({"a": 1.0}))
        status, _ = run(code, constants, at, 4, array, 0, np.zeros(program.stack_size))
        assert status == OK
        assert array[:2].tolist() == expected


def test_nesting_needs_no_recursion() -> None:
    expr: Expr = P.a
    for _ in range(20_000):
        expr = apply("+", expr, 1.0)
    assert_shallow(expr, 20_001.0)
    right: Expr = P.a
    for _ in range(20_000):
        right = if_(P.b, 0.0, apply("+", 1.0, right))
    assert_shallow(right, 20_001.0)


def assert_shallow(expr: Expr, value: float) -> None:
    program = Program(SLOTS, len(NAMES))
    at = program.add([expr])
    params = parameters({"a": 1.0, "b": 0.0})
    assert program.evaluate(at, params) == [value]
    assert by_kernel(program, at, params)[2][0] == value


def test_forms_are_complete() -> None:
    assert {f.form for f in FUNCTIONS.values()} == set(Form)
