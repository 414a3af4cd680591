"""The functions of the arithmetic language: one kernel each, registered in one place.

Every kernel is plain Python that numba compiles unchanged, and calls the same library functions
in both forms, so that all evaluators agree bit for bit. Angles are degrees. A result that is not
finite is a fault; kernels need not check their arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.vec import Affine, Vec3, invert, transform_point, transform_vector


class Form(Enum):
    """How a function takes its arguments."""

    UNARY = "unary"
    BINARY = "binary"
    TERNARY = "ternary"
    RANDOM = "random"
    WORLD = "world"
    LAZY = "lazy"
    COLUMN = "column"


@dataclass(frozen=True)
class Function:
    """A function of the language.

    Attributes
    ----------
    name
        As written; operators are registered under their symbol (``+``, unary minus as ``neg``).
    form
        How the kernel is called: UNARY (a), BINARY (a, b), TERNARY (a, b, c),
        RANDOM (stack, at, count, seeds), WORLD (world_from_local, point); LAZY and COLUMN have no
        kernel.
    arity
        Least and largest number of arguments; None for any number. A BINARY function with more
        than two arguments is folded from the left.
    kernel
        The compiled function; its ``py_func`` is the reference.
    summary
        First line of the docstring, for the reference page.
    """

    name: str
    form: Form
    arity: tuple[int, int | None]
    kernel: Any
    summary: str


FUNCTIONS: dict[str, Function] = {}

F = TypeVar("F", bound=Callable[..., Any])


def _register(
    form: Form, name: str | None = None, arity: tuple[int, int | None] | None = None
) -> Callable[[F], F]:
    def register(plain: F) -> F:
        kernel = njit(plain)
        key = name or plain.__name__.strip("_")
        count = {Form.UNARY: 1, Form.BINARY: 2}.get(form, 3)
        summary = (plain.__doc__ or "").strip().partition("\n")[0]
        FUNCTIONS[key] = Function(key, form, arity or (count, count), kernel, summary)
        return kernel

    return register


def _register_lazy(name: str, arity: tuple[int, int], summary: str) -> None:
    FUNCTIONS[name] = Function(name, Form.LAZY, arity, None, summary)


# What reads a table: see `pcsg.graph.columns`. Text has no word for it.

COLUMN = "@column"
FUNCTIONS[COLUMN] = Function(COLUMN, Form.COLUMN, (1, 1), None, "")

# Operators.

_register_lazy(
    "if", (3, 3), "if(cond, a, b): a where cond is not zero, else b; the other is not evaluated."
)
_register_lazy("and", (2, 2), "1 where both are not zero, else 0; the second only when needed.")
_register_lazy("or", (2, 2), "1 where one is not zero, else 0; the second only when needed.")


@_register(Form.BINARY, "+")
def add(a: float, b: float) -> float:
    """The sum a + b."""
    return a + b


@_register(Form.BINARY, "-")
def subtract(a: float, b: float) -> float:
    """The difference a - b."""
    return a - b


@_register(Form.BINARY, "*")
def multiply(a: float, b: float) -> float:
    """The product a * b."""
    return a * b


@_register(Form.BINARY, "/")
def divide(a: float, b: float) -> float:
    """The quotient a / b."""
    return a / b


@_register(Form.BINARY)
def mod(a: float, b: float) -> float:
    """mod(a, b): the remainder of floored division; it has the sign of b."""
    r = float(np.fmod(a, b))
    if r == 0.0:
        return math.copysign(0.0, b)
    if (r < 0.0) != (b < 0.0):
        return r + b
    return r


FUNCTIONS["%"] = Function("%", Form.BINARY, (2, 2), mod, "a % b: as mod(a, b).")


@_register(Form.BINARY)
def pow_(a: float, b: float) -> float:
    """pow(a, b): a to the power b."""
    return math.pow(a, b)


FUNCTIONS["^"] = Function("^", Form.BINARY, (2, 2), pow_, "a ^ b: as pow(a, b).")


@_register(Form.UNARY, "neg")
def negate(a: float) -> float:
    """The negative -a."""
    return -a


@_register(Form.UNARY, "not")
def not_(a: float) -> float:
    """1 where a is zero, else 0."""
    return 1.0 if a == 0.0 else 0.0


@_register(Form.BINARY, "<")
def less(a: float, b: float) -> float:
    """1 where a < b, else 0."""
    return 1.0 if a < b else 0.0


@_register(Form.BINARY, "<=")
def less_equal(a: float, b: float) -> float:
    """1 where a <= b, else 0."""
    return 1.0 if a <= b else 0.0


@_register(Form.BINARY, ">")
def greater(a: float, b: float) -> float:
    """1 where a > b, else 0."""
    return 1.0 if a > b else 0.0


@_register(Form.BINARY, ">=")
def greater_equal(a: float, b: float) -> float:
    """1 where a >= b, else 0."""
    return 1.0 if a >= b else 0.0


@_register(Form.BINARY, "==")
def equal(a: float, b: float) -> float:
    """1 where a = b, else 0."""
    return 1.0 if a == b else 0.0


@_register(Form.BINARY, "!=")
def not_equal(a: float, b: float) -> float:
    """1 where a differs from b, else 0."""
    return 1.0 if a != b else 0.0


# Functions of one, two and three numbers.


@_register(Form.UNARY)
def abs_(a: float) -> float:
    """abs(a): the magnitude."""
    return math.fabs(a)


@_register(Form.BINARY, arity=(1, None))
def min_(a: float, b: float) -> float:
    """min(a, b, ...): the smallest."""
    return b if b < a else a


@_register(Form.BINARY, arity=(1, None))
def max_(a: float, b: float) -> float:
    """max(a, b, ...): the largest."""
    return b if b > a else a


@_register(Form.UNARY)
def floor(a: float) -> float:
    """floor(a): the largest integer not above a."""
    return float(np.floor(a))


@_register(Form.UNARY)
def ceil(a: float) -> float:
    """ceil(a): the smallest integer not below a."""
    return float(np.ceil(a))


@_register(Form.UNARY)
def round_(a: float) -> float:
    """round(a): the nearest integer, halves to even."""
    return float(np.rint(a))


@_register(Form.UNARY)
def sign(a: float) -> float:
    """sign(a): -1, 0 or 1."""
    return 1.0 if a > 0.0 else (-1.0 if a < 0.0 else 0.0)


@_register(Form.UNARY)
def sqrt(a: float) -> float:
    """sqrt(a): the square root."""
    return math.sqrt(a)


@_register(Form.UNARY)
def exp(a: float) -> float:
    """exp(a): e to the power a."""
    return math.exp(a)


@_register(Form.UNARY)
def ln(a: float) -> float:
    """ln(a): the natural logarithm."""
    return math.log(a)


@_register(Form.UNARY)
def log10(a: float) -> float:
    """log10(a): the decimal logarithm."""
    return math.log10(a)


_RADIANS = math.pi / 180.0
_DEGREES = 180.0 / math.pi


@_register(Form.UNARY)
def sin(a: float) -> float:
    """sin(a): the sine of a in degrees, exact at multiples of 90."""
    r = np.fmod(a, 360.0)
    q = r / 90.0
    if q == np.floor(q):
        k = int(q) % 4
        return 0.0 if k % 2 == 0 else (1.0 if k == 1 else -1.0)
    return math.sin(r * _RADIANS)


@_register(Form.UNARY)
def cos(a: float) -> float:
    """cos(a): the cosine of a in degrees, exact at multiples of 90."""
    r = np.fmod(a, 360.0)
    q = r / 90.0
    if q == np.floor(q):
        k = int(q) % 4
        return 0.0 if k % 2 == 1 else (1.0 if k == 0 else -1.0)
    return math.cos(r * _RADIANS)


@_register(Form.UNARY)
def tan(a: float) -> float:
    """tan(a): the tangent of a in degrees."""
    return sin(a) / cos(a)


@_register(Form.UNARY)
def asin(a: float) -> float:
    """asin(a): the arc sine in degrees."""
    return math.asin(a) * _DEGREES


@_register(Form.UNARY)
def acos(a: float) -> float:
    """acos(a): the arc cosine in degrees."""
    return math.acos(a) * _DEGREES


@_register(Form.UNARY)
def atan(a: float) -> float:
    """atan(a): the arc tangent in degrees."""
    return math.atan(a) * _DEGREES


@_register(Form.BINARY)
def atan2(y: float, x: float) -> float:
    """atan2(y, x): the angle of the direction (x, y) in degrees, in [-180, 180]."""
    return math.atan2(y, x) * _DEGREES


@_register(Form.TERNARY)
def clamp(x: float, lo: float, hi: float) -> float:
    """clamp(x, lo, hi): x moved into [lo, hi]."""
    return lo if x < lo else (hi if x > hi else x)


@_register(Form.TERNARY)
def lerp(a: float, b: float, t: float) -> float:
    """lerp(a, b, t): a at t = 0, b at t = 1, linear between and beyond."""
    return a + t * (b - a)


@_register(Form.TERNARY)
def smoothstep(a: float, b: float, x: float) -> float:
    """smoothstep(a, b, x): 0 below a, 1 above b, 3u2 - 2u3 between."""
    if a == b:
        return math.nan
    u = (x - a) / (b - a)
    u = 0.0 if u < 0.0 else (1.0 if u > 1.0 else u)
    return u * u * (3.0 - 2.0 * u)


@_register(Form.BINARY)
def step(edge: float, x: float) -> float:
    """step(edge, x): 1 where x >= edge, else 0."""
    return 1.0 if x >= edge else 0.0


# Random functions: splitmix64 chained over the count and the bit patterns of the arguments.
# Steele, Lea, Flood 2014, "Fast splittable pseudorandom number generators".

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_U27, _U30, _U31, _U11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)
_TWO_53 = 1.0 / 9007199254740992.0

_SALT_RAND = np.uint64(0x72616E64)  # the functions' names in ASCII
_SALT_EDGE = np.uint64(0x65646765)
_SALT_GAUSS_1 = np.uint64(0x676175737331)
_SALT_GAUSS_2 = np.uint64(0x676175737332)
_SALT_CHOOSE = np.uint64(0x63686F6F7365)


@njit
def _mix(z: np.uint64) -> np.uint64:
    z = (z ^ (z >> _U30)) * _MIX_1
    z = (z ^ (z >> _U27)) * _MIX_2
    return z ^ (z >> _U31)


@njit
def _absorb(h: np.uint64, value: float) -> np.uint64:
    bits = np.float64(value + 0.0).view(np.uint64)  # -0 + 0 is +0
    return _mix((h ^ bits) + _GOLDEN)


@njit
def _begin(salt: np.uint64, count: int) -> np.uint64:
    return _mix(salt + np.uint64(count) * _GOLDEN)


@njit
def _uniform(h: np.uint64) -> float:
    return float(h >> _U11) * _TWO_53


@njit
def _hash(salt: np.uint64, stack: NDArray[np.float64], at: int, count: int) -> float:
    h = _begin(salt, count)
    for k in range(count):
        h = _absorb(h, stack[at + k])
    return _uniform(h)


@_register(Form.RANDOM, arity=(1, None))
def rand(stack: NDArray[np.float64], at: int, count: int, seeds: int) -> float:
    """rand(s, ...): uniform in [0, 1), a pure function of its arguments."""
    return _hash(_SALT_RAND, stack, at, count)


@_register(Form.RANDOM, arity=(4, 4))
def randedge(stack: NDArray[np.float64], at: int, count: int, seeds: int) -> float:
    """randedge(x1, y1, x2, y2): as rand, but the same when the two points are swapped."""
    x1, y1, x2, y2 = stack[at], stack[at + 1], stack[at + 2], stack[at + 3]
    if x2 < x1 or (x2 == x1 and y2 < y1):
        x1, y1, x2, y2 = x2, y2, x1, y1
    h = _absorb(_absorb(_begin(_SALT_EDGE, 4), x1), y1)
    return _uniform(_absorb(_absorb(h, x2), y2))


@_register(Form.RANDOM, arity=(1, None))
def gauss(stack: NDArray[np.float64], at: int, count: int, seeds: int) -> float:
    """gauss(s, ...): standard normal, a pure function of its arguments (Box and Muller 1958)."""
    u = _hash(_SALT_GAUSS_1, stack, at, count)
    v = _hash(_SALT_GAUSS_2, stack, at, count)
    return math.sqrt(-2.0 * math.log(1.0 - u)) * math.cos(2.0 * math.pi * v)


@_register(Form.RANDOM, arity=(2, None))
def choose(stack: NDArray[np.float64], at: int, count: int, seeds: int) -> float:
    """choose(s, ...; w1, w2, ...): an index from 1, drawn with the given weights."""
    total = 0.0
    last = 0
    for k in range(seeds, count):
        weight = stack[at + k]
        if weight < 0.0:
            return math.nan
        if weight > 0.0:
            last = k - seeds + 1
        total += weight
    if total <= 0.0:
        return math.nan
    x = _hash(_SALT_CHOOSE, stack, at, seeds) * total
    for k in range(seeds, count):
        x -= stack[at + k]
        if x < 0.0:
            return k - seeds + 1.0
    return float(last)


# World queries: world_from_local is a live value of the sub-graph that asks.


@_register(Form.WORLD)
def worldx(frame: Affine, p: Vec3) -> float:
    """worldx(x, y, z): world coordinate x of a local point."""
    return transform_point(frame, p).x


@_register(Form.WORLD)
def worldy(frame: Affine, p: Vec3) -> float:
    """worldy(x, y, z): world coordinate y of a local point."""
    return transform_point(frame, p).y


@_register(Form.WORLD)
def worldz(frame: Affine, p: Vec3) -> float:
    """worldz(x, y, z): world coordinate z of a local point."""
    return transform_point(frame, p).z


@_register(Form.WORLD)
def wdirx(frame: Affine, p: Vec3) -> float:
    """wdirx(x, y, z): world component x of a local direction."""
    return transform_vector(frame, p).x


@_register(Form.WORLD)
def wdiry(frame: Affine, p: Vec3) -> float:
    """wdiry(x, y, z): world component y of a local direction."""
    return transform_vector(frame, p).y


@_register(Form.WORLD)
def wdirz(frame: Affine, p: Vec3) -> float:
    """wdirz(x, y, z): world component z of a local direction."""
    return transform_vector(frame, p).z


@njit
def _local_direction(frame: Affine, d: Vec3) -> Vec3:
    inverse, regular = invert(frame)
    if not regular:
        return Vec3(math.nan, math.nan, math.nan)
    return transform_vector(inverse, d)


@_register(Form.WORLD)
def localx(frame: Affine, p: Vec3) -> float:
    """localx(X, Y, Z): local component x of a world direction."""
    return _local_direction(frame, p).x


@_register(Form.WORLD)
def localy(frame: Affine, p: Vec3) -> float:
    """localy(X, Y, Z): local component y of a world direction."""
    return _local_direction(frame, p).y


@_register(Form.WORLD)
def localz(frame: Affine, p: Vec3) -> float:
    """localz(X, Y, Z): local component z of a world direction."""
    return _local_direction(frame, p).z
