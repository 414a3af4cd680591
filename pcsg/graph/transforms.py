"""Transformations: one kernel each, which returns ``world_from_local`` of its arguments.

Angles are degrees, frames right-handed. Sines and cosines are exact at multiples of 90 degrees.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pcsg.graph.functions import cos, sin
from pcsg.jit import build_ladder, njit
from pcsg.vec import Affine, Vec3, normalize


@dataclass(frozen=True)
class Transform:
    """A transformation of the language.

    Attributes
    ----------
    name
        As written.
    kind
        Its number in `matrix`.
    parameters
        Names of the arguments; their number is the arity.
    kernel
        ``kernel(*arguments) -> Affine``, compiled; ``py_func`` is the reference.
    summary
        First line of the docstring.
    """

    name: str
    kind: int
    parameters: tuple[str, ...]
    kernel: Any
    summary: str

    def __reduce__(self) -> tuple[Any, ...]:
        return transform_named, (self.name,)  # there is one of each


TRANSFORMS: dict[str, Transform] = {}


def transform_named(name: str) -> Transform:
    """Return a transformation by its name."""
    return TRANSFORMS[name]


def _transform(plain: Callable[..., Affine]) -> Any:
    kernel = njit(plain)
    parameters = tuple(inspect.signature(plain).parameters)
    summary = (plain.__doc__ or "").strip().partition("\n")[0]
    name = plain.__name__
    TRANSFORMS[name] = Transform(name, len(TRANSFORMS), parameters, kernel, summary)
    return kernel


@_transform
def move(x: float, y: float, z: float) -> Affine:
    """Translation by (x, y, z)."""
    return Affine(1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, y, 0.0, 0.0, 1.0, z)


@_transform
def scale(x: float, y: float, z: float) -> Affine:
    """Scaling along the axes."""
    return Affine(x, 0.0, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, 0.0, z, 0.0)


@_transform
def uscale(s: float) -> Affine:
    """Uniform scaling."""
    return Affine(s, 0.0, 0.0, 0.0, 0.0, s, 0.0, 0.0, 0.0, 0.0, s, 0.0)


@_transform
def rotx(a: float) -> Affine:
    """Rotation about the x axis, y towards z."""
    c, s = cos(a), sin(a)
    return Affine(1.0, 0.0, 0.0, 0.0, 0.0, c, -s, 0.0, 0.0, s, c, 0.0)


@_transform
def roty(a: float) -> Affine:
    """Rotation about the y axis, z towards x."""
    c, s = cos(a), sin(a)
    return Affine(c, 0.0, s, 0.0, 0.0, 1.0, 0.0, 0.0, -s, 0.0, c, 0.0)


@_transform
def rotz(a: float) -> Affine:
    """Rotation about the z axis, x towards y."""
    c, s = cos(a), sin(a)
    return Affine(c, -s, 0.0, 0.0, s, c, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@_transform
def rot(a: float, x: float, y: float, z: float) -> Affine:
    """Rotation by a about the axis (x, y, z); a zero axis is singular."""
    if x == 0.0 and y == 0.0 and z == 0.0:
        return Affine(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    u = normalize(Vec3(x, y, z))
    c, s = cos(a), sin(a)
    k = 1.0 - c
    return Affine(
        c + u.x * u.x * k,
        u.x * u.y * k - u.z * s,
        u.x * u.z * k + u.y * s,
        0.0,
        u.y * u.x * k + u.z * s,
        c + u.y * u.y * k,
        u.y * u.z * k - u.x * s,
        0.0,
        u.z * u.x * k - u.y * s,
        u.z * u.y * k + u.x * s,
        c + u.z * u.z * k,
        0.0,
    )


@_transform
def flipxy() -> Affine:
    """Mirror through the xy plane."""
    return Affine(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0)


@_transform
def flipxz() -> Affine:
    """Mirror through the xz plane."""
    return Affine(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@_transform
def flipyz() -> Affine:
    """Mirror through the yz plane."""
    return Affine(-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@_transform
def xshear(a: float, b: float) -> Affine:
    """Shear x += a y + b z."""
    return Affine(1.0, a, b, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@_transform
def yshear(a: float, b: float) -> Affine:
    """Shear y += a x + b z."""
    return Affine(1.0, 0.0, 0.0, 0.0, a, 1.0, b, 0.0, 0.0, 0.0, 1.0, 0.0)


@_transform
def zshear(a: float, b: float) -> Affine:
    """Shear z += a x + b y."""
    return Affine(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, a, b, 1.0, 0.0)


@_transform
def align(x: float, y: float, z: float) -> Affine:
    """Turn +z to the direction (x, y, z) by the smallest rotation; opposite: half turn about x."""
    if x == 0.0 and y == 0.0 and z == 0.0:
        return Affine(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    d = normalize(Vec3(x, y, z))
    sine2 = d.x * d.x + d.y * d.y
    if sine2 < 1e-290:  # its digits are lost, and the turn is one about any axis
        s = 1.0 if d.z > 0.0 else -1.0
        return Affine(1.0, 0.0, 0.0, 0.0, 0.0, s, 0.0, 0.0, 0.0, 0.0, s, 0.0)
    # k = (1 - c) / sin^2, written so that it keeps its digits near the opposite direction.
    k = 1.0 / (1.0 + d.z) if d.z > 0.0 else (1.0 - d.z) / sine2
    return Affine(
        1.0 - k * d.x * d.x,
        -k * d.x * d.y,
        d.x,
        0.0,
        -k * d.x * d.y,
        1.0 - k * d.y * d.y,
        d.y,
        0.0,
        -d.x,
        -d.y,
        d.z,
        0.0,
    )


@_transform
def matrix(
    a: float,
    b: float,
    c: float,
    d: float,
    e: float,
    f: float,
    g: float,
    h: float,
    i: float,
    j: float,
    k: float,
    l: float,  # noqa: E741 -- the twelfth letter of a 3x4 matrix
) -> Affine:
    """Any affine map: 12 numbers, the rows of a 3x4 matrix one after the other."""
    return Affine(a, b, c, d, e, f, g, h, i, j, k, l)


evaluate_transform = build_ladder(
    "evaluate_transform",
    "kind",
    ["stack"],
    [t.kernel for t in TRANSFORMS.values()],
    "case_0(0.0, 0.0, 0.0)",
    calls=[", ".join(f"stack[{i}]" for i in range(len(t.parameters))) for t in TRANSFORMS.values()],
)
"""``evaluate_transform(kind, stack) -> Affine``: world_from_local of the arguments on a stack."""
