"""What grammars mean, naively: the graph is expanded by recursion and every ray meets every leaf.

This is docs/solids.md in Python, written without the kernels: own arithmetic, own matrices, own
formulas of every primitive, own lists. Only where the definition names a function of pcsg
(`pcsg.vec.invert` in world queries) is it called.
"""

from __future__ import annotations

import itertools
import math
import struct
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pcsg.graph.columns import Lookup
from pcsg.graph.expr import Apply, Expr, Number, Parameter
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import (
    Attribute,
    Calculation,
    Leaf,
    Node,
    Operation,
    Selection,
    Transformation,
)
from pcsg.vec import Affine, invert

MOST_SELECTIONS = 2_000_000
"""On a path; what is deeper than Python's recursion goes is no test for this."""

# Python 3.11 keeps calls of plain Python functions off the C stack, so this is only a number.
sys.setrecursionlimit(max(sys.getrecursionlimit(), 200_000))

Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]
Rows = tuple[Row, Row, Row]
Turns = tuple[Rows, "Turns"] | None
INF = math.inf


class Fault(Exception):
    """The definition calls this a fault."""


# Arithmetic


def _check(x: float) -> float:
    if not math.isfinite(x):
        raise Fault(f"result {x}")
    return x


def _floored_mod(a: float, b: float) -> float:
    r = math.fmod(a, b)
    if r == 0.0:
        return math.copysign(0.0, b)
    return r + b if (r < 0.0) != (b < 0.0) else r


def _quarter_turns(a: float) -> tuple[int | None, float]:
    """Return the number of quarter turns where it is exact, and the angle in radians."""
    r = math.fmod(a, 360.0)
    if (r / 90.0).is_integer():
        return int(r / 90.0) % 4, 0.0
    return None, r * (math.pi / 180.0)


def _sin(a: float) -> float:
    quarter, radians = _quarter_turns(a)
    return math.sin(radians) if quarter is None else (0.0, 1.0, 0.0, -1.0)[quarter]


def _cos(a: float) -> float:
    quarter, radians = _quarter_turns(a)
    return math.cos(radians) if quarter is None else (1.0, 0.0, -1.0, 0.0)[quarter]


def _smoothstep(a: float, b: float, x: float) -> float:
    u = (x - a) / (b - a)
    u = 0.0 if u < 0.0 else 1.0 if u > 1.0 else u
    return u * u * (3.0 - 2.0 * u)


_TO_DEGREES = 180.0 / math.pi

_PLAIN: dict[str, Callable[..., float]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "%": _floored_mod,
    "mod": _floored_mod,
    "^": math.pow,
    "pow": math.pow,
    "neg": lambda a: -a,
    "not": lambda a: float(a == 0.0),
    "<": lambda a, b: float(a < b),
    "<=": lambda a, b: float(a <= b),
    ">": lambda a, b: float(a > b),
    ">=": lambda a, b: float(a >= b),
    "==": lambda a, b: float(a == b),
    "!=": lambda a, b: float(a != b),
    "abs": abs,
    "floor": lambda a: a // 1.0,
    "ceil": lambda a: -(-a // 1.0),
    "round": lambda a: math.copysign(float(round(a)), a),
    "sign": lambda a: float(a > 0.0) - float(a < 0.0),
    "sqrt": math.sqrt,
    "exp": math.exp,
    "ln": math.log,
    "log10": math.log10,
    "sin": _sin,
    "cos": _cos,
    "tan": lambda a: _sin(a) / _cos(a),
    "asin": lambda a: math.asin(a) * _TO_DEGREES,
    "acos": lambda a: math.acos(a) * _TO_DEGREES,
    "atan": lambda a: math.atan(a) * _TO_DEGREES,
    "atan2": lambda y, x: math.atan2(y, x) * _TO_DEGREES,
    "clamp": lambda x, lo, hi: lo if x < lo else hi if x > hi else x,
    "lerp": lambda a, b, t: a + t * (b - a),
    "smoothstep": _smoothstep,
    "step": lambda edge, x: float(x >= edge),
}

_64 = (1 << 64) - 1
_GOLDEN = 0x9E3779B97F4A7C15


def _splitmix(z: int) -> int:
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & _64
    z = (z ^ z >> 27) * 0x94D049BB133111EB & _64
    return z ^ z >> 31


def _uniform(salt: bytes, values: Sequence[float]) -> float:
    """Splitmix64 chained over the count and the bit patterns, -0 as +0; 53 bits."""
    h = _splitmix((int.from_bytes(salt, "big") + len(values) * _GOLDEN) & _64)
    for value in values:
        bits = 0 if value == 0.0 else int.from_bytes(struct.pack(">d", value), "big")
        h = _splitmix(((h ^ bits) + _GOLDEN) & _64)
    return math.ldexp(h >> 11, -53)


def _choose(seeds: Sequence[float], weights: Sequence[float]) -> float:
    total = 0.0
    for w in weights:
        total += w
    if min(weights) < 0.0 or not total > 0.0:
        raise Fault("weights")
    x = _uniform(b"choose", seeds) * total
    for k, w in enumerate(weights):
        x -= w
        if x < 0.0:
            return float(k + 1)
    return float(max(k + 1 for k, w in enumerate(weights) if w > 0.0))


def _random(name: str, values: list[float], seeds: int) -> float:
    if name == "rand":
        return _uniform(b"rand", values)
    if name == "randedge":
        first, second = sorted([tuple(values[:2]), tuple(values[2:])])
        return _uniform(b"edge", [*first, *second])
    if name == "gauss":
        u, v = _uniform(b"gauss1", values), _uniform(b"gauss2", values)
        return math.sqrt(-2.0 * math.log(1.0 - u)) * math.cos(2.0 * math.pi * v)
    assert name == "choose"
    return _choose(values[:seeds], values[seeds:])


def _query(name: str, frame: Rows, p: Sequence[float]) -> float:
    """World queries: worldx... of a point, wdirx... and localx... of a direction."""
    axis = "xyz".index(name[-1])
    rows = frame
    if name.startswith("local"):
        inverse, regular = invert.py_func(Affine(*frame[0], *frame[1], *frame[2]))  # type: ignore[attr-defined]
        if not regular:
            raise Fault("frame without inverse")
        rows = (inverse[0:4], inverse[4:8], inverse[8:12])
    a, b, c, d = rows[axis]
    sum_ = a * p[0] + b * p[1] + c * p[2]
    return sum_ + d if name.startswith("world") else sum_


def evaluate(expr: Expr, values: Mapping[str, float], frame: Rows) -> float:
    """Return the value of an expression."""
    if isinstance(expr, Number):
        return expr.value
    if isinstance(expr, Parameter):
        if expr.name not in values:
            raise Fault(f"{expr.name} was never assigned")
        return values[expr.name]
    assert isinstance(expr, Apply)
    name, args = expr.function, expr.args
    if name == "if":
        return evaluate(args[1 if evaluate(args[0], values, frame) else 2], values, frame)
    if name == "and":
        return float(all(evaluate(a, values, frame) != 0.0 for a in args))
    if name == "or":
        return float(any(evaluate(a, values, frame) != 0.0 for a in args))
    numbers = [evaluate(a, values, frame) for a in args]
    if name in ("min", "max"):
        best = numbers[0]
        for x in numbers[1:]:
            best = x if (x < best if name == "min" else x > best) else best
        return best
    try:
        if name in _PLAIN:
            return _check(float(_PLAIN[name](*numbers)))
        if isinstance(expr, Lookup):
            return _cell(expr, numbers[0])
        if name in ("rand", "randedge", "gauss", "choose"):
            return _check(_random(name, numbers, expr.seeds))
        return _check(_query(name, frame, numbers))
    except (ValueError, OverflowError, ZeroDivisionError) as error:
        raise Fault(str(error)) from error


def _cell(expr: Lookup, row: float) -> float:
    """The number in a row of a column; rows count from 1."""
    assert expr.column is not None
    values = expr.column.values.tolist()
    if not (row.is_integer() and 1 <= row <= len(values)):
        raise Fault("no such row")
    return float(values[int(row) - 1])


# Matrices, as three rows of four


IDENTITY: Rows = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


def compose(a: Rows, b: Rows) -> Rows:
    """Return the product, each sum from the left to the right."""
    rows: list[Row] = []
    for r in a:
        row = [r[0] * b[0][j] + r[1] * b[1][j] + r[2] * b[2][j] for j in range(4)]
        row[3] += r[3]
        rows.append((row[0], row[1], row[2], row[3]))
    return (rows[0], rows[1], rows[2])


def _linear(rows: Sequence[Sequence[float]]) -> Rows:
    a, b, c = ((float(r[0]), float(r[1]), float(r[2]), 0.0) for r in rows)
    return (a, b, c)


def _unit(v: Sequence[float]) -> Vector:
    """Divide by the largest component first, as the definition of the matrices does."""
    big = max(abs(x) for x in v)
    x, y, z = (c / big for c in v)
    s = 1.0 / math.sqrt(x * x + y * y + z * z)
    return (x * s, y * s, z * s)


def _rotation(a: float, axis: Sequence[float]) -> Rows:
    """Rodrigues' formula: c 1 + s [u] + (1 - c) u uT."""
    u = _unit(axis)
    c, s = _cos(a), _sin(a)
    k = 1.0 - c
    rows = [[0.0] * 3 for _ in range(3)]
    for i in range(3):
        for j in range(3):
            uu = u[i] * u[j] * k
            if i == j:
                rows[i][j] = c + uu
            elif (j - i) % 3 == 1:
                rows[i][j] = uu - u[3 - i - j] * s
            else:
                rows[i][j] = uu + u[3 - i - j] * s
    return _linear(rows)


def _align(v: Sequence[float]) -> Rows:
    """The smallest rotation that takes +z to v; opposite: half a turn about x."""
    x, y, z = _unit(v)
    if x * x + y * y < 1e-290:
        return _linear([[1, 0, 0], [0, math.copysign(1, z), 0], [0, 0, math.copysign(1, z)]])
    k = 1.0 / (1.0 + z) if z > 0.0 else (1.0 - z) / (x * x + y * y)
    return _linear(
        [[1.0 - k * x * x, -k * x * y, x], [-k * x * y, 1.0 - k * y * y, y], [-x, -y, z]]
    )


def matrix(name: str, a: Sequence[float]) -> Rows:
    """Return world_from_local of a transformation."""
    if name == "move":
        return ((1.0, 0.0, 0.0, a[0]), (0.0, 1.0, 0.0, a[1]), (0.0, 0.0, 1.0, a[2]))
    if name == "scale":
        return _linear([[a[0], 0, 0], [0, a[1], 0], [0, 0, a[2]]])
    if name == "uscale":
        return _linear([[a[0], 0, 0], [0, a[0], 0], [0, 0, a[0]]])
    if name in ("rotx", "roty", "rotz"):
        i = "xyz".index(name[-1])
        j, k = (i + 1) % 3, (i + 2) % 3
        rows = np.eye(3)
        rows[j, j] = rows[k, k] = _cos(a[0])
        rows[j, k], rows[k, j] = -_sin(a[0]), _sin(a[0])
        return _linear(rows.tolist())
    if name in ("rot", "align"):
        if not any(a[-3:]):
            raise Fault("no direction")
        return _rotation(a[0], a[1:]) if name == "rot" else _align(a)
    if name.startswith("flip"):
        rows = np.eye(3)
        (normal,) = set("xyz") - set(name[4:])
        rows["xyz".index(normal), "xyz".index(normal)] = -1.0
        return _linear(rows.tolist())
    if name.endswith("shear"):
        rows = np.eye(3)
        i = "xyz".index(name[0])
        j, k = [j for j in range(3) if j != i]
        rows[i, j], rows[i, k] = a
        return _linear(rows.tolist())
    assert name == "matrix"
    return (tuple(a[0:4]), tuple(a[4:8]), tuple(a[8:12]))  # type: ignore[return-value]


def _inverse(m: Rows) -> Rows:
    """Invert by LU; what `pcsg.vec.invert` calls singular is a fault."""
    linear = np.array(m)[:, :3]
    scales = np.abs(linear).max(axis=1)
    if not scales.all() or not abs(np.linalg.det(linear / scales[:, None])) > 1e-14:
        raise Fault("singular matrix")
    inverse = np.linalg.inv(linear)
    shift = -inverse @ np.array(m)[:, 3]
    a, b, c = ((*map(float, r), float(s)) for r, s in zip(inverse, shift, strict=True))
    return (a, b, c)  # type: ignore[return-value]


def _point(m: Rows, p: Vector) -> Vector:
    x, y, z = (r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3] for r in m)
    return (x, y, z)


def _direction(m: Rows, d: Vector) -> Vector:
    x, y, z = (r[0] * d[0] + r[1] * d[1] + r[2] * d[2] for r in m)
    return (x, y, z)


# Primitives. A piece is an interval of the ray with a normal of the surface at either end.

Piece = tuple[float, Any, float, Any]
CURVED = "the gradient at the point"


def _at(o: Vector, d: Vector, t: float) -> Vector:
    return (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _plane(normal: Vector, c: float, o: Vector, d: Vector) -> list[Piece]:
    """Where normal . p <= c."""
    value, slope = _dot(normal, o) - c, _dot(normal, d)
    if slope == 0.0:
        return [(-INF, None, INF, None)] if value <= 0.0 else []
    t = -value / slope
    return [(-INF, None, t, normal)] if slope > 0.0 else [(t, normal, INF, None)]


def _quadratic(a: float, b: float, c: float) -> list[Piece]:
    """Where a t2 + 2 b t + c <= 0."""
    if a == 0.0:
        if b == 0.0:
            return [(-INF, None, INF, None)] if c <= 0.0 else []
        t = -c / (2.0 * b)
        return [(-INF, None, t, CURVED)] if b > 0.0 else [(t, CURVED, INF, None)]
    discriminant = b * b - a * c
    if discriminant <= 0.0:
        return [] if a > 0.0 else [(-INF, None, INF, None)]
    q = -(b + math.copysign(math.sqrt(discriminant), b))
    t0, t1 = sorted((q / a, c / q))
    if a > 0.0:
        return [(t0, CURVED, t1, CURVED)]
    return [(-INF, None, t0, CURVED), (t1, CURVED, INF, None)]


def _real_roots(p: Sequence[float]) -> list[float]:
    """Return where a polynomial (highest power first) changes sign, by bisection between turns."""
    if len(p) == 2:
        return [-p[1] / p[0]]
    n = len(p) - 1
    turns = _real_roots([c * (n - k) for k, c in enumerate(p[:-1])])
    reach = 1.0 + max(abs(c / p[0]) for c in p)
    ends = [-reach, *turns, reach]

    def value(t: float) -> float:
        v = 0.0
        for c in p:
            v = v * t + c
        return v

    roots = []
    for low, high in itertools.pairwise(ends):
        sign = value(low) > 0.0
        if (value(high) > 0.0) == sign:
            continue
        while True:
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            if (value(middle) > 0.0) == sign:
                low = middle
            else:
                high = middle
        roots.append(middle)
    return roots


def _torus(radius: float, o: Vector, d: Vector) -> list[Piece]:
    """Where (p.p + 1 - r2)2 <= 4 (x2 + y2); o is the foot of the perpendicular from the centre."""
    speed = math.sqrt(_dot(d, d))
    u = tuple(x / speed for x in d)
    k = _dot(o, o) + 1.0 - radius * radius
    a, b, c = u[0] ** 2 + u[1] ** 2, u[0] * o[0] + u[1] * o[1], o[0] ** 2 + o[1] ** 2
    # o.u vanishes, so p.p = s2 + o.o
    roots = _real_roots([1.0, 0.0, 2.0 * k - 4.0 * a, -8.0 * b, k * k - 4.0 * c])
    assert len(roots) % 2 == 0
    ts = [s / speed for s in roots]
    return [(t0, CURVED, t1, CURVED) for t0, t1 in zip(ts[::2], ts[1::2], strict=True)]


def _meet(a: list[Piece], b: list[Piece]) -> list[Piece]:
    """Intersect two lists of pieces; what has no length is dropped."""
    out = []
    for p in a:
        for q in b:
            low = p[:2] if p[0] >= q[0] else q[:2]
            high = p[2:] if p[2] <= q[2] else q[2:]
            if low[0] < high[0]:
                out.append((*low, *high))
    return sorted(out, key=lambda piece: piece[0])


def _norm(e: float, n: float, p: Vector) -> float:
    """Return the number by which a superellipsoid must be scaled to reach a point."""
    ring = _power_mean(abs(p[0]), abs(p[1]), 2.0 / e)
    return _power_mean(ring, abs(p[2]), 2.0 / n)


def _power_mean(a: float, b: float, power: float) -> float:
    a, b = max(a, b), min(a, b)
    return a * (1.0 + (b / a) ** power) ** (1.0 / power) if a > 0.0 else 0.0


def _superellipsoid(e: float, n: float, p: Vector, d: Vector) -> list[Piece]:
    """Where the norm is at most 1: it is convex; p is the foot of the perpendicular."""
    reach = 2.0 * (1.0 + math.sqrt(_dot(p, p))) / math.sqrt(_dot(d, d))

    def norm(t: float) -> float:
        return _norm(e, n, _at(p, d, t))

    low, high = -reach, reach
    for _ in range(200):
        a, b = low + (high - low) / 3.0, high - (high - low) / 3.0
        low, high = (a, high) if norm(a) > norm(b) else (low, b)
    middle = 0.5 * (low + high)
    if norm(middle) >= 1.0:
        return []
    ends = []
    for out in (-reach, reach):
        inner, outer = middle, out
        for _ in range(100):
            half = 0.5 * (inner + outer)
            inner, outer = (half, outer) if norm(half) <= 1.0 else (inner, half)
        ends.append(inner)
    return [(ends[0], CURVED, ends[1], CURVED)]


def _round_cone(r: float, p: Vector, d: Vector) -> list[Piece]:
    """Where some ball of radius 1 + (r - 1) h about (0, 0, h) contains the ray, 0 <= h <= 1.

    For the best h of a point: the balls at the ends, and the envelope of those between.
    """
    found: list[Piece] = []
    for h, radius in ((0.0, 1.0), (1.0, r)):
        q = (p[0], p[1], p[2] - h)
        found += _quadratic(_dot(d, d), _dot(q, d), _dot(q, q) - radius * radius)
    g = 1.0 - r
    if g * g < 1.0:
        # The envelope: a cone that is met at a right angle from (0, 0, h), where 0 <= h <= 1.
        c2 = 1.0 - g * g
        w, dw = (1.0 - g * p[2]) / math.sqrt(c2), -g * d[2] / math.sqrt(c2)
        side = _quadratic(
            d[0] ** 2 + d[1] ** 2 - dw * dw,
            p[0] * d[0] + p[1] * d[1] - w * dw,
            p[0] ** 2 + p[1] ** 2 - w * w,
        )
        for normal, c in (((0.0, 0.0, -1.0), -g), ((0.0, 0.0, 1.0), 1.0 + r * g)):
            side = _meet(side, _plane(normal, c, p, d))
        found += side
    found = [piece for piece in found if piece[0] < piece[2]]
    if not found:
        return []
    return [(min(x[0] for x in found), CURVED, max(x[2] for x in found), CURVED)]


_SLAB: list[tuple[Vector, float]] = [((0.0, 0.0, -1.0), 0.0), ((0.0, 0.0, 1.0), 1.0)]
_CORNERS: list[Vector] = [
    (1.0, 1.0, 1.0),
    (-1.0, -1.0, 1.0),
    (1.0, -1.0, -1.0),
    (-1.0, 1.0, -1.0),
]
_PLANES: dict[str, list[tuple[Vector, float]]] = {
    "box": [
        (tuple(s if i == k else 0.0 for i in range(3)), 1.0)  # type: ignore[misc]
        for k in range(3)
        for s in (-1.0, 1.0)
    ],
    "tetrahedron": [((-v[0], -v[1], -v[2]), 1.0) for v in _CORNERS],
    "halfspace": [((0.0, 0.0, 1.0), 0.0)],
    "cylinder": _SLAB,
    "cone": _SLAB,
}


def pieces(name: str, args: Sequence[float], o: Vector, d: Vector) -> list[Piece]:
    """Return the intervals of a ray inside a solid in its own frame."""
    if name == "empty":
        return []
    found: list[Piece] = [(-INF, None, INF, None)]
    for normal, c in _PLANES.get(name, []):
        found = _meet(found, _plane(normal, c, o, d))
    if name == "infcone":
        # On this side of the apex.
        k = 1.0 - args[0]
        found = [(a, CURVED, b, CURVED) for a, _, b, _ in _plane((0.0, 0.0, k), 1.0, o, d)]
    if name in (
        "sphere",
        "cylinder",
        "cone",
        "torus",
        "capsule",
        "superellipsoid",
        "infcylinder",
        "infcone",
    ):
        # Parameters count from the point nearest to the centre, where digits are not lost.
        foot = -_dot(o, d) / _dot(d, d)
        p = _at(o, d, foot)
        if name == "sphere":
            curved = _quadratic(_dot(d, d), _dot(p, d), _dot(p, p) - 1.0)
        elif name == "torus":
            curved = _torus(args[0], p, d)
        elif name == "superellipsoid":
            curved = _superellipsoid(args[0], args[1], p, d)
        elif name == "capsule":
            curved = _round_cone(args[0], p, d)
        else:
            # x2 + y2 <= (1 - k z)2, the cylinder with k = 0
            k = 1.0 - args[0] if name in ("cone", "infcone") else 0.0
            w, dw = 1.0 - k * p[2], -k * d[2]
            curved = _quadratic(
                d[0] ** 2 + d[1] ** 2 - dw * dw,
                p[0] * d[0] + p[1] * d[1] - w * dw,
                p[0] ** 2 + p[1] ** 2 - w * w,
            )
        found = _meet(found, [(a + foot, na, b + foot, nb) for a, na, b, nb in curved])
    return found


def _capsule_center(r: float, p: Vector) -> float:
    """Return the height of the ball that lets a point be farthest inside: by its derivative."""
    across, g = math.hypot(p[0], p[1]), 1.0 - r

    def grows(h: float) -> bool:
        # Of 1 - g h - |p - (0, 0, h)| by h.
        away = math.hypot(across, p[2] - h)
        return away > 0.0 and (p[2] - h) / away > g

    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if grows(middle) else (low, middle)
    return 0.0 if high < 1e-15 else 1.0 if low > 1.0 - 1e-15 else low


def gradient(name: str, args: Sequence[float], p: Vector) -> Vector:
    """Return the outward normal of a curved surface, of any length."""
    x, y, z = p
    if name == "sphere":
        return p
    if name in ("cylinder", "infcylinder"):
        return (x, y, 0.0)
    if name == "superellipsoid":
        a, b = 2.0 / args[0], 2.0 / args[1]
        ring, whole = _power_mean(abs(x), abs(y), a), _norm(args[0], args[1], p)
        outer = (ring / whole) ** (b - 1.0)
        parts = [outer * (abs(c) / ring) ** (a - 1.0) if ring > 0.0 else 0.0 for c in (x, y)]
        parts.append((abs(z) / whole) ** (b - 1.0))
        # On a plane between two faces neither counts.
        g, h, k = (math.copysign(v, c) if c != 0.0 else 0.0 for v, c in zip(parts, p, strict=True))
        return (g, h, k)
    if name == "capsule":
        return (x, y, z - _capsule_center(args[0], p))
    if name in ("cone", "infcone"):
        k = 1.0 - args[0]
        return (x, y, k * (1.0 - k * z))
    assert name == "torus"
    ring = math.hypot(x, y)
    if ring == 0.0:  # the point where a torus with a tube of radius 1 touches itself
        return (0.0, 0.0, z)
    return (x - x / ring, y - y / ring, z)


def sheet(name: str, o: Vector, d: Vector) -> list[float]:
    """Return where a ray meets a sheet; straight edges reach out by 1e-11."""
    if d[2] == 0.0:
        return []
    t = -o[2] / d[2]
    if name in ("disc", "rectangle"):
        x, y = o[0] + t * d[0], o[1] + t * d[1]
        far = math.hypot(x, y) - 1.0 if name == "disc" else max(abs(x), abs(y)) - 1.0 - 1e-11
        return [t] if far <= 0.0 else []
    s = 1.0 if name == "tri1" else -1.0
    x, y = s * (o[0] + t * d[0]), s * (o[1] + t * d[1])
    return [t] if min(x, y, 1.0 - x - y) >= -1e-11 else []


def inside(name: str, args: Sequence[float], p: Vector) -> bool:
    """Return whether the closed solid contains a point; sheets contain nothing."""
    x, y, z = p
    if name == "sphere":
        return x * x + y * y + z * z <= 1.0
    if name == "cylinder":
        return x * x + y * y <= 1.0 and 0.0 <= z <= 1.0
    if name == "cone":
        return x * x + y * y <= (1.0 - (1.0 - args[0]) * z) ** 2 and 0.0 <= z <= 1.0
    if name == "box":
        return max(abs(x), abs(y), abs(z)) <= 1.0
    if name == "tetrahedron":
        return all(_dot(v, p) >= -1.0 for v in _CORNERS)
    if name == "torus":
        return (math.hypot(x, y) - 1.0) ** 2 + z * z <= args[0] ** 2
    if name == "halfspace":
        return z <= 0.0
    if name == "capsule":
        h = _capsule_center(args[0], p)
        return math.hypot(x, y, z - h) <= 1.0 - (1.0 - args[0]) * h
    if name == "superellipsoid":
        return _norm(args[0], args[1], p) <= 1.0
    if name == "infcylinder":
        return x * x + y * y <= 1.0
    if name == "infcone":
        radius = 1.0 - (1.0 - args[0]) * z
        return radius >= 0.0 and x * x + y * y <= radius * radius
    assert name == "empty" or name in SHEETS
    return False


SHEETS = ("tri1", "tri2", "disc", "rectangle")


# Meshes: every triangle, one by one.

Triangle = tuple[Vector, Vector, Vector]


class _Ambiguous(Exception):
    """A ray meets an edge."""


def triangles_of(node: Leaf) -> list[Triangle]:
    """Return the triangles of a mesh."""
    (mesh,) = node.constants
    polygons = mesh.polygons  # type: ignore[attr-defined]
    corners = polygons.vertices[polygons.triangles].tolist()
    return [(tuple(a), tuple(b), tuple(c)) for a, b, c in corners]


def is_closed(triangles: Sequence[Triangle]) -> bool:
    """Return whether every edge is passed as often forwards as backwards."""
    passed: dict[tuple[Vector, Vector], int] = {}
    for t in triangles:
        for k in range(3):
            a, b = t[k], t[(k + 1) % 3]
            passed[min(a, b), max(a, b)] = passed.get((min(a, b), max(a, b)), 0) + (
                1 if a < b else -1
            )
    return not any(passed.values())


def _minus(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def plane_of(triangle: Triangle) -> tuple[Vector, float]:
    """Return the normal n of a triangle, of any length, and c of its plane n . p = c."""
    a, b, c = triangle
    n = _cross(_minus(b, a), _minus(c, a))
    return n, _dot(n, a)


def _meets(triangle: Triangle, o: Vector, d: Vector) -> float | None:
    """Return where a ray passes through the inside of a triangle."""
    n, c = plane_of(triangle)
    slope = _dot(n, d)
    size = math.sqrt(_dot(n, n) * _dot(d, d))
    weights = []
    if abs(slope) <= 1e-12 * size:
        # Nearly in the plane: beside the triangle it does not matter.
        if abs(_dot(n, o) - c) > 1e-9 * math.sqrt(_dot(n, n)):
            return None
        raise _Ambiguous
    t = (c - _dot(n, o)) / slope
    p = _at(o, d, t)
    for k in range(3):
        a, b = triangle[k], triangle[(k + 1) % 3]
        weights.append(_dot(_cross(_minus(b, a), _minus(p, a)), n) / _dot(n, n))
    if min(weights) < -1e-12:
        return None
    if min(weights) < 1e-12:
        raise _Ambiguous
    return t


def mesh_crossings(
    triangles: Sequence[Triangle], o: Vector, d: Vector
) -> list[tuple[float, Vector]]:
    """Return where a ray meets triangles, and their normals; through edges, a hair beside them."""
    for k in range(9):
        moved = (o[0] + 3e-12 * k, o[1] - 2.3e-12 * k, o[2] + 1.7e-12 * k)
        try:
            met = [(_meets(t, moved, d), plane_of(t)[0]) for t in triangles]
        except _Ambiguous:
            continue
        return sorted(((t, n) for t, n in met if t is not None), key=lambda hit: hit[0])
    return []


def mesh_pieces(triangles: Sequence[Triangle], o: Vector, d: Vector) -> list[Piece]:
    """Return the intervals in which a closed mesh winds about the points of a ray."""
    volume = sum(_dot(a, _cross(b, c)) for a, b, c in triangles)
    found: list[Piece] = []
    winding = 0
    for t, n in mesh_crossings(triangles, o, d):
        outward = n if volume > 0.0 else (-n[0], -n[1], -n[2])
        if winding == 0:
            begin = t, outward
        winding += 1 if _dot(n, d) < 0.0 else -1
        if winding == 0:
            found.append((*begin, t, outward))
    return found


def mesh_contains(triangles: Sequence[Triangle], p: Vector) -> bool:
    """Return whether a closed mesh winds about a point."""
    direction = (0.31, -0.52, 0.77)
    return any(t0 <= 0.0 <= t1 for t0, _, t1, _ in mesh_pieces(triangles, p, direction))


# Lists of events


@dataclass(frozen=True)
class Event:
    """The ray enters, leaves or meets a sheet.

    Attributes
    ----------
    t
        Parameter on the ray, the same in every frame.
    kind
        ``enter``, ``leave`` or ``sheet``.
    leaf
        Number of the leaf's node in the graph.
    flipped
        Whether it is the second operand of an odd number of differences.
    normal
        Outward unit normal in the world, (0, 0, 0) at infinity.
    attributes
        Values of the attributes' slots (``@red``...) where they were set.
    """

    t: float
    kind: str
    leaf: int
    flipped: bool
    normal: Vector
    attributes: Mapping[str, float]

    def _slots(self, names: Sequence[str], defaults: Sequence[float]) -> tuple[float, ...]:
        return tuple(self.attributes.get(n, x) for n, x in zip(names, defaults, strict=True))

    @property
    def color(self) -> tuple[float, ...]:
        """Red, green, blue; -1 where none."""
        return self._slots(("@red", "@green", "@blue"), (-1.0, -1.0, -1.0))

    @property
    def material(self) -> float:
        """Number of the material, -1 if none."""
        return self._slots(("@material",), (-1.0,))[0]

    @property
    def texture(self) -> tuple[float, ...]:
        """Number of the texture (-1 if none) and its scale."""
        return self._slots(("@texture", "@texture_scale"), (-1.0, 1.0))

    @property
    def label(self) -> float:
        """The label, -1 if none."""
        return self._slots(("@label",), (-1.0,))[0]


UNIT = (1e-10, 1e-10)
"""Precision of a ray whose origin and direction have the same size."""


def precision(
    origin: Sequence[float],
    direction: Sequence[float],
    anchor: Sequence[float] = (0.0, 0.0, 0.0),
    size: float = INF,
) -> tuple[float, float]:
    """Return the least tolerance along a ray, and what it is per t.

    The anchor is the scene's point nearest to the world's origin, `size` how far the scene reaches
    from there.
    """
    away = max(abs(o - a) for o, a in zip(origin, anchor, strict=True))
    speed = max(map(abs, direction))
    if 0.0 < size < INF and away > 1000.0 * size:
        return max(1e-10 * (1000.0 * size), 1e-14 * away) / speed, 1e-14
    return 1e-10 * away / speed, 1e-10


def tolerance(t: float, of_ray: tuple[float, float] = UNIT) -> float:
    """Return how far apart ends may be and still coincide."""
    least, slope = of_ray
    return 0.0 if math.isinf(t) else max(least, slope * abs(t))


_TRUTH: dict[str, Callable[[bool, bool], bool]] = {
    "union": lambda a, b: a or b,
    "intersection": lambda a, b: a and b,
    "difference": lambda a, b: a and not b,
}

# Whether a sheet stays, given the membership of the other operand before and after it.
_SHEET_STAYS: dict[tuple[str, int], Callable[[bool, bool], bool]] = {
    ("union", 0): lambda before, after: not (before and after),
    ("union", 1): lambda before, after: not (before and after),
    ("intersection", 0): lambda before, after: before or after,
    ("intersection", 1): lambda before, after: before or after,
    ("difference", 0): lambda before, after: not (before and after),
    ("difference", 1): lambda before, after: False,
}


def combine(
    operator: str,
    a: Sequence[Event],
    b: Sequence[Event],
    of_ray: tuple[float, float] = UNIT,
) -> list[Event]:
    """Combine two lists as "Combining two lists" of docs/solids.md tells."""
    if operator == "difference":
        b = [
            replace(e, flipped=not e.flipped, normal=(-e.normal[0], -e.normal[1], -e.normal[2]))
            for e in b
        ]
    truth = _TRUTH[operator]
    rest_a, rest_b = list(a), list(b)
    inside_a = inside_b = False
    out: list[Event] = []
    while rest_a or rest_b:
        ta = rest_a[0].t if rest_a else INF
        tb = rest_b[0].t if rest_b else INF
        if tb < ta - tolerance(ta, of_ray):
            t = reach = tb
            group_a: list[Event] = []
        else:
            t, reach = ta, ta + tolerance(ta, of_ray)
            group_a = [e for e in rest_a if e.t == ta]
        group_b = [e for e in rest_b if e.t <= reach]
        rest_a, rest_b = rest_a[len(group_a) :], rest_b[len(group_b) :]

        turns_a = [e for e in group_a if e.kind != "sheet"]
        turns_b = [e for e in group_b if e.kind != "sheet"]
        after_a = inside_a ^ (len(turns_a) % 2 == 1)
        after_b = inside_b ^ (len(turns_b) % 2 == 1)
        before, after = truth(inside_a, inside_b), truth(after_a, after_b)
        # Everything of A stands before everything of B, and what comes from one keeps its order.
        changes = before != after
        for which, group, around in (
            (0, group_a, (inside_b, after_b)),
            (1, group_b, (inside_a, after_a)),
        ):
            for e in group:
                if e.kind == "sheet":
                    if _SHEET_STAYS[operator, which](*around):
                        out.append(replace(e, t=t))
                elif changes:
                    out.append(replace(e, t=t, kind="enter" if after else "leave"))
                    changes = False
        inside_a, inside_b = after_a, after_b
    return out


# The walk


@dataclass(frozen=True)
class Place:
    """Where the walk stands: the ray in the local frame, and all that travels down.

    Attributes
    ----------
    origin, direction
        The local ray; a point is a ray without direction.
    zero
        The world's origin in the local frame.
    turns
        The innermost inverse matrix, and the same for those around it; None where there is none.
    frame
        World from local, for world queries.
    values
        Parameters.
    attributes
        Surface attributes.
    selections
        How many have been passed.
    """

    origin: Vector
    direction: Vector
    zero: Vector
    turns: Turns
    frame: Rows
    values: Mapping[str, float]
    attributes: Mapping[str, float]
    selections: int


def _legal(node: Leaf, args: Sequence[float]) -> bool:
    for parameter, x in zip(node.parameters, args, strict=True):
        if not parameter.low <= x <= parameter.high or (parameter.open_low and x == parameter.low):
            return False
    return True


class _Walk:
    """The recursion; subclasses say what a leaf answers and how answers combine."""

    def __init__(self, graph: Graph, depth_limit: int) -> None:
        self.graph = graph
        self.depth_limit = depth_limit

    def leaf(self, node: Leaf, args: list[float], place: Place) -> Any:
        raise NotImplementedError

    def nothing(self) -> Any:
        raise NotImplementedError

    def both(self, operator: str, a: Any, b: Any) -> Any:
        raise NotImplementedError

    def visit(self, node: Node, place: Place) -> Any:
        def value(expr: Expr) -> float:
            return evaluate(expr, place.values, place.frame)

        if isinstance(node, Selection):
            return self._select(node, place)
        if isinstance(node, Calculation):
            return self.visit(node.successor, self._calculate(node, place))
        if isinstance(node, Transformation):
            m = matrix(node.transform.name, [value(a) for a in node.args])
            return self.visit(node.successor, self._transform(m, place))
        if isinstance(node, Operation):
            answer = self.visit(node.operands[0], place)
            for operand in node.operands[1:]:
                answer = self.both(node.operator.name, answer, self.visit(operand, place))
            return answer
        if isinstance(node, Attribute):
            numbers = [value(a) for a in node.args]
            if node.kind.refers_to:
                named = [s.name for s in self.graph.settings if s.kind.name == node.kind.refers_to]
                numbers.insert(0, float(named.index(node.reference)))
            new = {**place.attributes, **dict(zip(node.kind.slots, numbers, strict=False))}
            return self.visit(node.successor, replace(place, attributes=new))
        assert isinstance(node, Leaf)
        args = [value(a) for a in node.args]
        if not _legal(node, args):
            raise Fault(f"arguments of {node.solid.name}: {args}")
        return self.leaf(node, args, place)

    def _select(self, node: Selection, place: Place) -> Any:
        place = replace(place, selections=place.selections + 1)
        if place.selections > self.depth_limit:
            raise Fault("depth limit")
        if max(map(abs, place.zero)) > 2.0**52 or max(map(abs, place.direction)) > 1e150:
            return self.nothing()
        if node.select is None:
            (number,) = node.rules
        else:
            number = round(evaluate(node.select, place.values, place.frame))
        if number not in node.rules:
            raise Fault(f"{node.name} has no rule {number}")
        return self.visit(node.rules[number], place)

    def _calculate(self, node: Calculation, place: Place) -> Place:
        values = dict(place.values)
        source = dict(values) if node.call else values
        for name, expr in node.assignments:
            values[name] = evaluate(expr, source, place.frame)
        return replace(place, values=values)

    def _transform(self, m: Rows, place: Place) -> Place:
        inverse = _inverse(m)
        return replace(
            place,
            origin=_point(inverse, place.origin),
            direction=_direction(inverse, place.direction),
            zero=_point(inverse, place.zero),
            turns=(inverse, place.turns),
            frame=compose(place.frame, m),
        )


def _world_normal(turns: Turns, n: Vector) -> Vector:
    while turns is not None:
        m, turns = turns
        x, y, z = (m[0][j] * n[0] + m[1][j] * n[1] + m[2][j] * n[2] for j in range(3))
        big = max(abs(x), abs(y), abs(z))
        n = (x / big, y / big, z / big)
    size = math.sqrt(_dot(n, n))
    return (n[0] / size, n[1] / size, n[2] / size)


class _Events(_Walk):
    def __init__(self, graph: Graph, depth_limit: int, of_ray: tuple[float, float]) -> None:
        super().__init__(graph, depth_limit)
        self.of_ray = of_ray

    def leaf(self, node: Leaf, args: list[float], place: Place) -> list[Event]:
        name, o, d = node.solid.name, place.origin, place.direction

        def event(t: float, kind: str, normal: Any) -> Event:
            if math.isinf(t):
                world: Vector = (0.0, 0.0, 0.0)
            else:
                local = gradient(name, args, _at(o, d, t)) if normal is CURVED else normal
                world = _world_normal(place.turns, local) if any(local) else (0.0, 0.0, 0.0)
            number = self.graph.number[node]
            return Event(t, kind, number, False, world, place.attributes)

        if node.constants:
            triangles = triangles_of(node)
            if not is_closed(triangles):
                return [event(t, "sheet", n) for t, n in mesh_crossings(triangles, o, d)]
            found = mesh_pieces(triangles, o, d)
        elif name in SHEETS:
            return [event(t, "sheet", (0.0, 0.0, 1.0)) for t in sheet(name, o, d)]
        else:
            found = pieces(name, args, o, d)
        events = []
        for t0, n0, t1, n1 in found:
            if math.isfinite(t0) and t1 - t0 <= 4e-15 * abs(t0):
                continue
            events += [event(t0, "enter", n0), event(t1, "leave", n1)]
        return events

    def nothing(self) -> list[Event]:
        return []

    def both(self, operator: str, a: list[Event], b: list[Event]) -> list[Event]:
        return combine(operator, a, b, self.of_ray)


class _Contains(_Walk):
    def leaf(self, node: Leaf, args: list[float], place: Place) -> bool:
        if node.constants:
            triangles = triangles_of(node)
            return is_closed(triangles) and mesh_contains(triangles, place.origin)
        return inside(node.solid.name, args, place.origin)

    def nothing(self) -> bool:
        return False

    def both(self, operator: str, a: bool, b: bool) -> bool:
        return _TRUTH[operator](a, b)


@dataclass(frozen=True)
class Placed:
    """A leaf of the expanded grammar."""

    number: int
    name: str
    args: tuple[float, ...]
    frame: Rows
    attributes: Mapping[str, float]
    node: Leaf

    def alone(self) -> Leaf:
        """Return the leaf with its arguments as constants."""
        args = tuple(Number(a) for a in self.args)
        return Leaf(self.node.solid, args, self.node.constants)


class _Leaves(_Walk):
    def leaf(self, node: Leaf, args: list[float], place: Place) -> list[Placed]:
        number = self.graph.number[node]
        name = node.solid.name
        return [Placed(number, name, tuple(args), place.frame, place.attributes, node)]

    def nothing(self) -> list[Placed]:
        return []

    def both(self, operator: str, a: list[Placed], b: list[Placed]) -> list[Placed]:
        return a + b


_GLOBALS = {"SEED": 0.0, "TIME": 0.0, "SUNX": 0.0, "SUNY": 0.0, "SUNZ": 1.0}


def _start(
    origin: Sequence[float],
    direction: Sequence[float],
    parameters: Mapping[str, float] | None,
    globals_: Mapping[str, float] | None,
) -> Place:
    o = (float(origin[0]), float(origin[1]), float(origin[2]))
    d = (float(direction[0]), float(direction[1]), float(direction[2]))
    values = {**_GLOBALS, **(globals_ or {}), **(parameters or {})}
    return Place(o, d, (0.0, 0.0, 0.0), None, IDENTITY, values, {}, 0)


def events(
    graph: Graph,
    origin: Sequence[float],
    direction: Sequence[float],
    parameters: Mapping[str, float] | None = None,
    globals: Mapping[str, float] | None = None,
    depth_limit: int = MOST_SELECTIONS,
    anchor: Sequence[float] = (0.0, 0.0, 0.0),
    size: float = INF,
) -> list[Event]:
    """Return all events of the whole line; `anchor` and `size` as for `precision`."""
    place = _start(origin, direction, parameters, globals)
    of_ray = precision(origin, direction, anchor, size)
    return _Events(graph, depth_limit, of_ray).visit(graph.root, place)  # type: ignore[no-any-return]


def first(
    graph: Graph,
    origin: Sequence[float],
    direction: Sequence[float],
    t_min: float = 0.0,
    t_max: float = INF,
    **options: Any,
) -> Event | None:
    """Return the first event at a finite t in [t_min, t_max]."""
    return first_of(events(graph, origin, direction, **options), t_min, t_max)


def first_of(found: Sequence[Event], t_min: float = 0.0, t_max: float = INF) -> Event | None:
    """Return the first event of a list at a finite t in [t_min, t_max]."""
    return next((e for e in found if t_min <= e.t <= t_max and math.isfinite(e.t)), None)


def any_(
    graph: Graph,
    origin: Sequence[float],
    direction: Sequence[float],
    t_min: float = 0.0,
    t_max: float = INF,
    **options: Any,
) -> bool:
    """Return whether there is an event at a finite t in [t_min, t_max]."""
    return first(graph, origin, direction, t_min, t_max, **options) is not None


def contains(graph: Graph, point: Sequence[float], **options: Any) -> bool:
    """Return whether a point is in the solid."""
    place = _start(point, (0.0,) * 3, options.pop("parameters", None), options.pop("globals", None))
    return bool(
        _Contains(graph, options.get("depth_limit", MOST_SELECTIONS)).visit(graph.root, place)
    )


def leaves(graph: Graph, **options: Any) -> list[Placed]:
    """Return every leaf of the expanded grammar, in the order of the text."""
    place = _start(
        (0.0,) * 3, (0.0,) * 3, options.pop("parameters", None), options.pop("globals", None)
    )
    return _Leaves(graph, options.get("depth_limit", MOST_SELECTIONS)).visit(graph.root, place)  # type: ignore[no-any-return]


def spans(found: Sequence[Event]) -> Iterator[tuple[float, float]]:
    """Yield the pairs of enter and leave of a list."""
    turns = [e.t for e in found if e.kind != "sheet"]
    return zip(turns[::2], turns[1::2], strict=True)
