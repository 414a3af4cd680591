"""Interval extensions of the functions and transformations of the language.

An interval ``(lower, upper)`` stands for any finite number in it; infinite ends mean that no bound
is known. Results are rounded outwards, except where all arguments are single numbers: these give
the number that evaluation gives. Arguments outside a function's domain are left out, because there
evaluation is a fault (Moore, Kearfott, Cloud 2009, "Introduction to Interval Analysis").
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from pcsg.graph.columns import Lookup
from pcsg.graph.expr import Apply, Expr, Number, Parameter, operands, postorder
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.graph import FRAME_SLOTS
from pcsg.graph.transforms import Transform
from pcsg.jit import plain
from pcsg.vec import Affine, Vec3

Interval = tuple[float, float]
Matrix = tuple[Interval, ...]
"""The 12 entries of a 3x4 matrix, row by row."""

INF = math.inf
ALL: Interval = (-INF, INF)
_TRUTH: Interval = (0.0, 1.0)
_UNIT: Interval = (-1.0, 1.0)

GAUSS_LIMIT = 8.58
"""More than ``sqrt(-2 ln 2^-53)``, the largest that `gauss` returns."""


def hull(a: Interval, b: Interval) -> Interval:
    """Return the smallest interval that contains both."""
    return min(a[0], b[0]), max(a[1], b[1])


def is_point(a: Interval) -> bool:
    """Return whether an interval is a single number."""
    return a[0] == a[1] and math.isfinite(a[0])


def _out(lower: float, upper: float, ulps: int) -> Interval:
    """Round outwards; what is undefined is unknown."""
    if lower != lower or upper != upper:
        return ALL
    return _step(lower, -ulps), _step(upper, ulps)


def _step(x: float, ulps: int) -> float:
    return x + ulps * math.ulp(x) if math.isfinite(x) and x != 0.0 else x


# Sums and products of floats are rounded monotonically: the rounded ends contain all that
# evaluation can give.


def add(a: Interval, b: Interval) -> Interval:
    """Return the interval of sums."""
    return a[0] + b[0], a[1] + b[1]


def subtract(a: Interval, b: Interval) -> Interval:
    """Return the interval of differences."""
    return a[0] - b[1], a[1] - b[0]


def multiply(a: Interval, b: Interval) -> Interval:
    """Return the interval of products; zero times an unknown number is zero."""
    ends = [0.0 if x == 0.0 or y == 0.0 else x * y for x in a for y in b]
    return min(ends), max(ends)


def _divide(a: Interval, b: Interval) -> Interval:
    if b[0] < 0.0 < b[1] or b == (0.0, 0.0):
        return ALL
    low = 1.0 / b[1] if b[1] != 0.0 else -INF
    high = 1.0 / b[0] if b[0] != 0.0 else INF
    lower, upper = multiply(a, (low, high))
    return _out(lower, upper, 4)


def _mod(a: Interval, b: Interval) -> Interval:
    if is_point(b) and b[0] != 0.0 and math.isfinite(a[0]) and math.isfinite(a[1]):
        below, above = math.floor(a[0] / b[0]), math.floor(a[1] / b[0])
        # A quotient that is rounded to zero has lost its sign.
        if below == above and all(x == 0.0 or x / b[0] != 0.0 for x in a):
            return _clip(_out(a[0] - below * b[0], a[1] - below * b[0], 8), b)
    return min(b[0], 0.0), max(b[1], 0.0)


def _clip(a: Interval, b: Interval) -> Interval:
    """Return a within the range of remainders by b."""
    return max(a[0], min(b[0], 0.0)), min(a[1], max(b[1], 0.0))


def _power(x: float, y: float) -> float:
    try:
        return math.pow(x, y)
    except OverflowError:
        return INF
    except ValueError:
        return INF if x == 0.0 else math.nan


def _pow(a: Interval, b: Interval) -> Interval:
    if a[0] >= 0.0:
        if math.inf in map(abs, b) and (a[0] == 0.0 or math.isinf(a[1])):
            return 0.0, INF
        ends = [_power(x, y) for x in a for y in b]
        lower, upper = _out(min(ends), max(ends), 4)
        return max(lower, 0.0), upper
    if not (is_point(b) and b[0] == round(b[0])):
        return ALL
    if b[0] < 0.0:
        return _divide((1.0, 1.0), _pow(a, (-b[0], -b[0])))
    if b[0] % 2.0 == 1.0:
        return _out(
            math.copysign(_power(abs(a[0]), b[0]), a[0]),
            math.copysign(_power(abs(a[1]), b[0]), a[1]),
            4,
        )
    m = _abs(a)
    return max(0.0, _out(_power(m[0], b[0]), 0.0, 4)[0]), _out(0.0, _power(m[1], b[0]), 4)[1]


def _neg(a: Interval) -> Interval:
    return -a[1], -a[0]


def _abs(a: Interval) -> Interval:
    if a[0] >= 0.0:
        return a
    if a[1] <= 0.0:
        return _neg(a)
    return 0.0, max(-a[0], a[1])


def truth(a: Interval) -> bool | None:
    """Return whether a condition holds for all of an interval or for none, else None."""
    if a[0] > 0.0 or a[1] < 0.0:
        return True
    return False if a == (0.0, 0.0) else None


def _boolean(always: bool, never: bool) -> Interval:
    return (1.0, 1.0) if always else (0.0, 0.0) if never else _TRUTH


def _not(a: Interval) -> Interval:
    known = truth(a)
    return _TRUTH if known is None else _boolean(not known, known)


def _less(a: Interval, b: Interval) -> Interval:
    return _boolean(a[1] < b[0], a[0] >= b[1])


def _less_equal(a: Interval, b: Interval) -> Interval:
    return _boolean(a[1] <= b[0], a[0] > b[1])


def _equal(a: Interval, b: Interval) -> Interval:
    return _boolean(is_point(a) and a == b, a[1] < b[0] or b[1] < a[0])


def _min(a: Interval, b: Interval) -> Interval:
    return min(a[0], b[0]), min(a[1], b[1])


def _max(a: Interval, b: Interval) -> Interval:
    return max(a[0], b[0]), max(a[1], b[1])


def _rising(
    function: Callable[[float], float], low: float = -INF, high: float = INF, ulps: int = 4
) -> Callable[[Interval], Interval]:
    """Return the extension of a function that does not fall on its domain [low, high]."""

    def extend(a: Interval) -> Interval:
        x, y = max(a[0], low), min(a[1], high)
        if x > y:
            return ALL
        return _out(_value(function, x, -INF), _value(function, y, INF), ulps)

    return extend


def _value(function: Callable[[float], float], x: float, unknown: float) -> float:
    if math.isinf(x):
        return unknown
    try:
        return float(function(x))
    except (ValueError, OverflowError):
        return unknown


def _exp(a: Interval) -> Interval:
    lower, upper = _rising(math.exp)(a)
    return max(0.0, lower), upper


def _sqrt(a: Interval) -> Interval:
    lower, upper = _rising(math.sqrt, 0.0)(a)
    return max(0.0, lower), upper


def _sine(a: Interval) -> Interval:
    if not a[1] - a[0] < 360.0 or max(-a[0], a[1]) > 1e12:
        return _UNIT
    sin = plain(FUNCTIONS["sin"].kernel)
    ends = sin(a[0]), sin(a[1])
    lower, upper = _out(min(ends), max(ends), 8)
    # Extremes at 90 (mod 360) and at 270, with room for the rounding of the ends.
    if _meets(a, 90.0):
        upper = 1.0
    if _meets(a, 270.0):
        lower = -1.0
    return max(-1.0, lower), min(1.0, upper)


def _meets(a: Interval, phase: float) -> bool:
    k = math.ceil((a[0] - phase - 1e-9) / 360.0)
    return k * 360.0 + phase <= a[1] + 1e-9


def _cosine(a: Interval) -> Interval:
    return _sine((a[0] + 90.0, a[1] + 90.0)) if math.isfinite(a[0] + a[1]) else _UNIT


def _tangent(a: Interval) -> Interval:
    if not math.isfinite(a[0] + a[1]) or _half_turn(a[0] - 1e-9) != _half_turn(a[1] + 1e-9):
        return ALL
    tan = plain(FUNCTIONS["tan"].kernel)
    return _out(tan(a[0]), tan(a[1]), 16)


def _half_turn(x: float) -> int:
    return math.floor((x + 90.0) / 180.0)


def _acos(a: Interval) -> Interval:
    return subtract((90.0, 90.0), _rising(lambda x: math.degrees(math.asin(x)), -1.0, 1.0, 16)(a))


def _atan2(y: Interval, x: Interval) -> Interval:
    if x[0] > 0.0 or y[0] > 0.0 or y[1] < 0.0:
        ends = [math.degrees(math.atan2(b, a)) for b in y for a in x]
        if not any(map(math.isnan, ends)):
            return _out(min(ends), max(ends), 8)
    return -180.0, 180.0


def _clamp(x: Interval, lo: Interval, hi: Interval) -> Interval:
    return _max(_min(x, hi), lo) if lo[1] <= hi[0] else hull(hull(x, lo), hi)


def _lerp(a: Interval, b: Interval, t: Interval) -> Interval:
    if t[0] >= 0.0 and t[1] <= 1.0:
        lower, upper = hull(a, b)
        room = 1e-15 * max(abs(lower), abs(upper)) if math.isfinite(lower + upper) else 0.0
        return lower - room, upper + room
    return add(a, multiply(t, subtract(b, a)))


def _smoothstep(a: Interval, b: Interval, x: Interval) -> Interval:
    if not (is_point(a) and is_point(b) and a[0] < b[0]):
        return _TRUTH
    smoothstep = plain(FUNCTIONS["smoothstep"].kernel)
    ends = [smoothstep(a[0], b[0], min(max(v, a[0]), b[0])) for v in x]
    lower, upper = _out(ends[0], ends[1], 8)
    return max(0.0, lower), min(1.0, upper)


_EXTENSIONS: dict[str, Callable[..., Interval]] = {
    "+": add,
    "-": subtract,
    "*": multiply,
    "/": _divide,
    "mod": _mod,
    "%": _mod,
    "pow": _pow,
    "^": _pow,
    "neg": _neg,
    "not": _not,
    "<": _less,
    "<=": _less_equal,
    ">": lambda a, b: _less(b, a),
    ">=": lambda a, b: _less_equal(b, a),
    "==": _equal,
    "!=": lambda a, b: _not(_equal(a, b)),
    "abs": _abs,
    "min": _min,
    "max": _max,
    "floor": _rising(math.floor, ulps=0),
    "ceil": _rising(math.ceil, ulps=0),
    "round": _rising(round, ulps=0),
    "sign": _rising(lambda x: (x > 0.0) - (x < 0.0), ulps=0),
    "sqrt": _sqrt,
    "exp": _exp,
    "ln": _rising(math.log, 0.0),
    "log10": _rising(math.log10, 0.0),
    "sin": _sine,
    "cos": _cosine,
    "tan": _tangent,
    "asin": _rising(lambda x: math.degrees(math.asin(x)), -1.0, 1.0, 16),
    "acos": _acos,
    "atan": lambda a: _atan2(a, (1.0, 1.0)),
    "atan2": _atan2,
    "clamp": _clamp,
    "lerp": _lerp,
    "smoothstep": _smoothstep,
    "step": lambda edge, x: _less_equal(edge, x),
    "if": lambda c, a, b: {True: a, False: b, None: hull(a, b)}[truth(c)],
    "and": lambda a, b: _min(_as_truth(a), _as_truth(b)),
    "or": lambda a, b: _max(_as_truth(a), _as_truth(b)),
    "rand": lambda *a: _TRUTH,
    "randedge": lambda *a: _TRUTH,
    "gauss": lambda *a: (-GAUSS_LIMIT, GAUSS_LIMIT),
}


def _as_truth(a: Interval) -> Interval:
    return _not(_not(a))


def evaluate(expr: Expr, values: Mapping[str, Interval]) -> Interval:
    """Return the interval of an expression; parameters without a value may be anything."""
    if isinstance(expr, Number):  # most are
        return expr.value, expr.value
    stack: list[Interval] = []
    for e in postorder(expr, operands):
        if isinstance(e, Number):
            stack.append((e.value, e.value))
        elif isinstance(e, Parameter):
            stack.append(values.get(e.name, ALL))
        elif isinstance(e, Apply):
            at = len(stack) - len(e.args)
            args = stack[at:]
            del stack[at:]
            stack.append(_apply(e, args, values))
    return stack[0]


def _apply(e: Apply, args: list[Interval], values: Mapping[str, Interval]) -> Interval:
    function = FUNCTIONS[e.function]
    if isinstance(e, Lookup):
        return _in_column(e, args[0])
    if function.form is Form.WORLD:
        return _world(e.function, args, values)
    if function.form is not Form.LAZY and all(map(is_point, args)):
        return _at_points(e, [a[0] for a in args])
    if e.function == "choose":
        return 1.0, float(len(args) - e.seeds)
    extension = _EXTENSIONS[e.function]
    if function.form is Form.BINARY and len(args) != 2:
        folded = args[0]
        for a in args[1:]:
            folded = extension(folded, a)
        return folded
    return extension(*args)


def _in_column(e: Lookup, row: Interval) -> Interval:
    """Return what the rows of a column may say; anything where one is a fault."""
    assert e.column is not None
    if not (row[0] >= 1.0 and row[1] <= len(e.column)):
        return ALL
    if is_point(row):
        return e.column.at(row[0]), e.column.at(row[0])
    return e.column.range


def _at_points(e: Apply, args: list[float]) -> Interval:
    """Return what evaluation returns; anything where it is a fault."""
    function = FUNCTIONS[e.function]
    kernel = plain(function.kernel)
    try:
        with np.errstate(all="ignore"):
            if function.form is Form.RANDOM:
                x = float(kernel(args, 0, len(args), e.seeds))
            elif function.form is Form.BINARY:
                x = args[0]
                for a in args[1:]:
                    x = float(kernel(x, a))
            else:
                x = float(kernel(*args))
    except (ValueError, OverflowError, ZeroDivisionError):
        return ALL
    return (x, x) if math.isfinite(x) else ALL


def _world(name: str, args: list[Interval], values: Mapping[str, Interval]) -> Interval:
    frame = tuple(values.get(slot, ALL) for slot in FRAME_SLOTS)
    if all(map(is_point, frame)) and all(map(is_point, args)):
        kernel = plain(FUNCTIONS[name].kernel)
        with np.errstate(all="ignore"):
            x = float(kernel(Affine(*(f[0] for f in frame)), Vec3(*(a[0] for a in args))))
        return (x, x) if math.isfinite(x) else ALL
    if name.startswith("local"):
        return ALL
    row = 4 * "xyz".index(name[-1])
    total = frame[row + 3] if name.startswith("world") else (0.0, 0.0)
    for k in range(3):
        total = add(total, multiply(frame[row + k], args[k]))
    return total


def transform_matrix(transform: Transform, args: Sequence[Interval]) -> Matrix:
    """Return the intervals of a transformation's matrix."""
    if all(map(is_point, args)):
        matrix = plain(transform.kernel)(*(a[0] for a in args))
        return tuple((x, x) for x in matrix)
    zero, one = (0.0, 0.0), (1.0, 1.0)
    name = transform.name
    if name in ("rotx", "roty", "rotz"):
        c, s = _cosine(args[0]), _sine(args[0])
        rows: list[list[Interval]] = [[zero] * 4 for _ in range(3)]
        axis = "xyz".index(name[-1])
        i, j = (axis + 1) % 3, (axis + 2) % 3
        rows[axis][axis] = one
        rows[i][i], rows[i][j], rows[j][i], rows[j][j] = c, _neg(s), s, c
        return tuple(x for row in rows for x in row)
    if name in ("rot", "align"):
        return (_UNIT, _UNIT, _UNIT, zero) * 3
    # What is left writes its arguments into the matrix unchanged: find out where.
    marks = [float(k + 2) for k in range(len(args))]
    matrix = plain(transform.kernel)(*marks)
    found = dict(zip(marks, args, strict=True))
    return tuple(found.get(x, (x, x)) for x in matrix)


def keeps_distances(transform: Transform) -> bool:
    """Return whether a transformation keeps the distance from the origin, whatever its angle."""
    return transform.name.startswith(("rot", "flip", "align"))


def compose_matrices(a: Matrix, b: Matrix) -> Matrix:
    """Return the intervals of the product of two matrices."""
    entries = []
    for i in range(0, 12, 4):
        for j in range(4):
            total = a[i + 3] if j == 3 else (0.0, 0.0)
            for k in range(3):
                total = add(total, multiply(a[i + k], b[4 * k + j]))
            entries.append(total)
    return tuple(entries)


def transform_intervals(m: Matrix, p: Sequence[Interval]) -> tuple[Interval, Interval, Interval]:
    """Return the box of a matrix applied to a box, both as three intervals."""
    rows = []
    for i in range(0, 12, 4):
        total = m[i + 3]
        for k in range(3):
            if m[i + k] != (0.0, 0.0):
                total = add(total, multiply(m[i + k], p[k]))
        rows.append(total)
    return rows[0], rows[1], rows[2]
