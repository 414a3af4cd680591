"""Expressions of fields: primitives, operators, warps and attributes, combined in Python.

``+`` is the sum, ``|``, ``&``, ``-`` are union, intersection and difference, a number times a field
its weight. Nothing is computed here; `pcsg.blobtree.model.Model` makes arrays of an expression.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, repeat
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.blobtree.blends import BLENDS, Blend
from pcsg.blobtree.skeletons import SKELETONS, Skeleton
from pcsg.blobtree.warps import WARPS, Warp
from pcsg.errors import UsageError

Array = NDArray[np.float64]


class Field:
    """A field F(p) >= 0 of compact support; the solid is where it is 0.5 or more."""

    def __add__(self, other: Field) -> Field:
        return total(self, other) if isinstance(other, Field) else NotImplemented

    def __or__(self, other: Field) -> Field:
        return union(self, other) if isinstance(other, Field) else NotImplemented

    def __and__(self, other: Field) -> Field:
        return intersect(self, other) if isinstance(other, Field) else NotImplemented

    def __sub__(self, other: Field) -> Field:
        return subtract(self, other) if isinstance(other, Field) else NotImplemented

    def __rmul__(self, factor: float) -> Field:
        return weight(factor, self) if isinstance(factor, (int, float)) else NotImplemented


@dataclass(frozen=True, eq=False)
class Primitive(Field):
    """A skeleton along +z from the origin."""

    skeleton: type[Skeleton]
    args: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Cones(Field):
    """The sum of many branches, or their union, as arrays: quicker than one node each.

    Attributes
    ----------
    start, axis : float64 (N, 3)
        Foot of the skeleton, and the vector to its top; its length may be zero.
    foot, reach : float64 (N,)
        Radius of the skeleton's foot, and where the field ends.
    uv : float32 (N, 2), optional
        Turns to add to u, and v at the foot.
    blend
        ``sum`` or ``union``.
    groups : int64 (G,), optional
        Where groups begin, the first one at 0: cones of a group are blended, and groups summed.
    """

    start: Array
    axis: Array
    foot: Array
    reach: Array
    uv: NDArray[np.float32] | None = None
    blend: str = "sum"
    groups: NDArray[np.int64] | None = None

    @property
    def parts(self) -> tuple[Cones, ...]:
        """The groups, each as cones of its own."""
        if self.groups is None:
            return (self,)
        ends = [*self.groups[1:].tolist(), len(self.start)]
        return tuple(
            Cones(
                self.start[a:b],
                self.axis[a:b],
                self.foot[a:b],
                self.reach[a:b],
                None if self.uv is None else self.uv[a:b],
                self.blend,
            )
            for a, b in zip(self.groups.tolist(), ends, strict=True)
        )


@dataclass(frozen=True, eq=False)
class Combination(Field):
    """An operator and its children."""

    blend: type[Blend]
    children: tuple[Field, ...]
    args: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Placed(Field):
    """A field in another frame: `matrix` (3, 4) takes the child's coordinates to those outside."""

    matrix: Array
    child: Field


@dataclass(frozen=True, eq=False)
class Bent(Field):
    """A field in warped space; `height` is the warp's range, None for the child's own top."""

    warp: type[Warp]
    args: tuple[float, ...]
    child: Field
    height: float | None = None


@dataclass(frozen=True, eq=False)
class Painted(Field):
    """A field with attributes: values by the names of their slots, as grammars name them."""

    attributes: Mapping[str, float]
    child: Field = field(kw_only=True)


def primitive(name: str, *args: float) -> Field:
    """Return a primitive by its name."""
    kind = SKELETONS[name]
    values = tuple(float(a) for a in args)
    kind.check(values)
    if name == "cone" and values[2] > values[1]:
        # The thick end is the foot: the same branch upside down.
        length, rb, rt = values
        upside_down = np.array([[1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, -1.0, length]])
        return Placed(upside_down, Primitive(kind, (length, rt, rb)))
    return Primitive(kind, values)


def point(r: float) -> Field:
    """Return a ball of radius r about the origin."""
    return primitive("point", r)


def segment(l: float, r: float) -> Field:  # noqa: E741 -- the name in the language
    """Return a capsule from the origin to z = l."""
    return primitive("segment", l, r)


def cone(l: float, rb: float, rt: float) -> Field:  # noqa: E741 -- the name in the language
    """Return a branch from the origin to z = l, of radius rb at its foot and rt at its top."""
    return primitive("cone", l, rb, rt)


def disc(rd: float, r: float) -> Field:
    """Return a disc of radius rd in the xy-plane, r thick to either side."""
    return primitive("disc", rd, r)


def box(x: float, y: float, z: float, r: float) -> Field:
    """Return a box of half widths x, y, z, offset by r."""
    return primitive("box", x, y, z, r)


def polygon(corners: ArrayLike, r: float) -> Field:
    """Return a convex sheet in the xy-plane, r thick to either side.

    Parameters
    ----------
    corners : array_like (N, 2)
        Counterclockwise.
    """
    return primitive("polygon", *np.asarray(corners, np.float64).ravel(), r)


def total(*children: Field) -> Field:
    """Return the sum of fields."""
    return combine("sum", children)


def union(*children: Field) -> Field:
    """Return the greatest field."""
    return combine("union", children)


def intersect(*children: Field) -> Field:
    """Return the least field."""
    return combine("intersect", children)


def subtract(a: Field, b: Field) -> Field:
    """Return min(a, 2T - b)."""
    return combine("subtract", (a, b))


def weight(w: float, child: Field) -> Field:
    """Return a field times a factor; negative ones dig into a sum."""
    if not math.isfinite(w):
        raise UsageError(f"weight: the factor must be finite, is {w:g}")
    return combine("weight", (child,), w)


def ricci(n: float, *children: Field) -> Field:
    """Return (sum a^n)^(1/n) of fields (Ricci 1973)."""
    return combine("ricci", children, n)


def pcm(*children: Field, w: float | None = None, a0: float | None = None) -> Field:
    """Return fields in precise contact.

    Parameters
    ----------
    w, a0
        Width and height of the swelling beside the contact, as field values; 0.4 and w/6.
    """
    args = () if w is None and a0 is None else (0.4 if w is None else w,)
    return combine("pcm", children, *args, *(() if a0 is None else (a0,)))


def gbb(bound: Field, first: Field, second: Field) -> Field:
    """Return ``second + b (first - second)``, b the bound clamped to [0, 1]."""
    return combine("gbb", (bound, first, second))


def controlled(*children: Field, pairs: Iterable[tuple[int, int]] | None = None) -> Field:
    """Return fields of which only some pairs blend, by default neighbours in the list."""
    args = () if pairs is None else tuple(k for pair in pairs for k in pair)
    if pairs is not None and not args:
        return combine("union", children)
    return combine("controlled", children, *args)


def joint(
    base: Field,
    *junctions: tuple[Field, Field, Field],
    w: float = 0.4,
    a0: float | None = None,
    united: Iterable[bool] = (),
) -> Field:
    """Return a field with contact where bounds are: junctions on a continuing axis.

    Parameters
    ----------
    base
        The field of everything.
    junctions
        For each its bound and its two partners.
    united
        For each whether the base holds the union of its partners; it holds their sum where nothing
        is told.
    """
    children: list[Field] = [base]
    height = w / 6.0 if a0 is None else a0
    flags = chain(united, repeat(False))
    for (bound, a, b), flag in zip(junctions, flags, strict=False):
        children += [bound, combine("excess", (a, b), w, height, float(flag))]
    return combine("joint", children)


def r_union(*children: Field) -> Field:
    """Return the R-function of a union: without a crease."""
    return _nest("r_union", children)


def r_intersect(*children: Field) -> Field:
    """Return the R-function of an intersection."""
    return _nest("r_intersect", children)


def _nest(name: str, children: Sequence[Field]) -> Field:
    if not children:
        raise UsageError(f"{name} needs a field")
    result = children[0]
    for child in children[1:]:
        result = combine(name, (result, child))
    return result


def combine(name: str, children: Sequence[Field], *args: float) -> Field:
    """Return an operator by its name, over at least one child."""
    if not children:
        raise UsageError(f"{name} needs a field")
    if name in ("r_union", "r_intersect") and len(children) != 2:
        return _nest(name, children)
    blend = BLENDS[name]
    values = tuple(float(a) for a in args)
    blend.arguments(values, len(children))
    return Combination(blend, tuple(children), values)


def warped(name: str, child: Field, *args: float, height: float | None = None) -> Field:
    """Return a warped field by the warp's name."""
    kind = WARPS[name]
    values = tuple(float(a) for a in args)
    most, least = len(kind.parameters), len(kind.parameters) - len(kind.defaults)
    if not least <= len(values) <= most or not all(map(math.isfinite, values)):
        raise UsageError(f"{name} takes {least} to {most} finite numbers")
    values += kind.defaults[len(values) - least :] if len(values) < most else ()
    if name == "bend" and values[1] != 0.0:
        # Towards another azimuth: the frame is turned there and back.
        turned = Bent(kind, (values[0], 0.0), place(turn_about_z(-values[1]), child), height)
        return place(turn_about_z(values[1]), turned)
    return Bent(kind, values, child, height)


def turn_about_z(degrees: float) -> Array:
    """Return the map (3, 4) that turns about z by an angle."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0.0, 0.0], [s, c, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])


def bend(angle: float, child: Field, azimuth: float = 0.0, height: float | None = None) -> Field:
    """Return a field whose +z is curved by an angle (degrees) towards a direction of the xy-plane.

    Parameters
    ----------
    height
        The range is z from 0 to it; by default the top of the child's skeletons.
    """
    return warped("bend", child, angle, azimuth, height=height)


def twist(k: float, child: Field) -> Field:
    """Return a field turned about z by k degrees per unit of z."""
    return warped("twist", child, k)


def taper(a: float, b: float, child: Field, height: float | None = None) -> Field:
    """Return a field whose cross-section is scaled by a at z = 0 up to b at the top."""
    return warped("taper", child, a, b, height=height)


def place(matrix: ArrayLike, child: Field) -> Field:
    """Return a field in another frame.

    Parameters
    ----------
    matrix : array_like (3, 4)
        Takes the child's coordinates to those outside.
    """
    m = np.asarray(matrix, np.float64).reshape(3, 4)
    # The determinant of larger numbers may be beyond all numbers, and that of tiny ones below them.
    with np.errstate(divide="ignore", under="ignore"):
        singular = not np.abs(m).max() < 1e90 or abs(np.linalg.det(m[:, :3])) < 1e-300
    if singular:
        raise UsageError("place: the matrix must be finite and not singular")
    return Placed(m, child)


def paint(child: Field, **attributes: float) -> Field:
    """Return a field with attributes, by the names of their slots."""
    return Painted(attributes, child=child)


def color(r: float, g: float, b: float, child: Field) -> Field:
    """Return a field of a linear colour; where fields blend, colours do."""
    return Painted({"@red": r, "@green": g, "@blue": b}, child=child)


def label(number: int, child: Field) -> Field:
    """Return a field with a label, which rays return where it contributes most."""
    return Painted({"@label": float(number)}, child=child)


def convolution_segment(l: float, ra: float, rb: float, kernel: str = "quartic") -> Field:  # noqa: E741
    """Return a convolution segment from the origin to z = l, of about radius ra to rb."""
    return primitive(kernel, l, ra, rb)


def children_of(node: Field) -> tuple[Field, ...]:
    """Return what stands directly below a node."""
    if isinstance(node, Combination):
        return node.children
    if isinstance(node, (Placed, Bent, Painted)):
        return (node.child,)
    return ()


def below(root: Field) -> list[Field]:
    """Return every node once, children before parents; without recursion, models are deep."""
    order: list[Field] = []
    seen: set[int] = set()
    todo: list[tuple[Any, bool]] = [(root, False)]
    while todo:
        node, done = todo.pop()
        if done:
            order.append(node)
        elif id(node) not in seen:
            seen.add(id(node))
            todo.append((node, True))
            todo.extend((child, False) for child in reversed(children_of(node)))
    return order


def digest_of(root: Field) -> str:
    """Return a digest of an expression, equal where kinds, numbers and sharing are."""
    digest = hashlib.sha256()
    number: dict[int, int] = {}

    def add(value: object) -> None:
        if isinstance(value, Field):
            digest.update(f"#{number[id(value)]} ".encode())
        elif isinstance(value, np.ndarray):
            digest.update(f"{value.dtype} {value.shape} ".encode())
            digest.update(value.tobytes())
        elif isinstance(value, tuple):
            digest.update(f"({len(value)} ".encode())
            for part in value:
                add(part)
        else:
            told = value.__name__ if isinstance(value, type) else repr(value)
            digest.update(f"{told} ".encode())

    for k, node in enumerate(below(root)):
        add(type(node))
        for name in node.__dataclass_fields__:  # type: ignore[attr-defined]  # every kind has them
            add(getattr(node, name))
        number[id(node)] = k
    return digest.hexdigest()
