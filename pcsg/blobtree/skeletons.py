"""Skeletons of primitives: convex sets, each one function of a squared distance and its slope.

``distance(p, d, c, at, pool)`` returns ``(g, g')``: the squared distance of point p to the set, and
its derivative in direction d, which need not be a unit vector. Along a line g is convex and
``0 <= g'' <= 2 |d|2`` because the set is convex; that is all the root search needs. The gradient at
a point is the slopes along the axes.

==========  =======================================================================
p, d        point and direction in the primitive's own frame, +z its axis
c, at       the primitive's constants begin at ``c[at]``, `CONSTANTS` of them
pool        float64: what does not fit into them (corners of a polygon)
==========  =======================================================================
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.convolution import (
    cauchy_segment,
    cauchy_weight,
    quartic_segment,
    quartic_weight,
)
from pcsg.blobtree.fields import REACH, T
from pcsg.errors import UsageError
from pcsg.jit import build_ladder, njit
from pcsg.vec import Vec3

Array = NDArray[np.float64]

SMALLEST, LARGEST = 1e-30, 1e30
"""Sizes beyond lose their meaning in single precision."""

CONSTANTS = 5
"""Constants of a primitive that its kernel reads."""


class Skeleton:
    """What a primitive is made of.

    Class attributes
    ----------------

    Parameters
    ----------
        Names of the arguments, all numbers; the last is the distance r of the lone surface.
    slim
        Whether rotations about +z leave it as it is, so that a row of eight numbers holds it.
    """

    name: ClassVar[str]
    kind: ClassVar[int]
    parameters: ClassVar[tuple[str, ...]] = ()
    slim: ClassVar[bool] = True

    @classmethod
    def check(cls, args: Sequence[float]) -> None:
        """Raise if arguments are not those of a primitive."""
        if len(args) != len(cls.parameters):
            raise UsageError(f"{cls.name} takes {len(cls.parameters)} number(s), not {len(args)}")
        for name, value in zip(cls.parameters, args, strict=True):
            positive = name in ("r", "rt", "rb", "ra")
            if not (SMALLEST if positive else 0.0) <= value <= LARGEST:
                sign = "> 0" if positive else ">= 0"
                beyond = f", and not beyond {SMALLEST:g} and {LARGEST:g}" if value > 0.0 else ""
                raise UsageError(f"{cls.name}: {name} must be {sign}{beyond}, is {value:g}")

    @classmethod
    def reach(cls, args: Sequence[float]) -> float:
        """Return the distance at which the field ends."""
        return REACH * args[-1]

    @classmethod
    def extent(cls, args: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        """Return the box of the skeleton."""
        raise NotImplementedError

    @classmethod
    def slim_row(cls, args: Sequence[float]) -> tuple[float, float]:
        """Return length along +z and radius at its foot."""
        raise NotImplementedError

    @classmethod
    def constants(cls, args: Sequence[float], extra: list[float]) -> list[float]:
        """Return what the kernel reads; more goes to the end of `extra`."""
        return cone_constants(*cls.slim_row(args))

    @classmethod
    def curvature(cls, args: Sequence[float]) -> tuple[float, float, float]:
        """Return bounds of a direct field along a line.

        Its second derivative lies between minus the first and the second; its slope is at most
        the third.
        """
        return 0.0, 0.0, 0.0

    @staticmethod
    def distance(p: Vec3, d: Vec3, c: Array, at: int, pool: Array) -> tuple[float, float]:
        """Return the squared distance and its slope in direction d."""
        raise NotImplementedError

    @staticmethod
    def uv(p: Vec3, c: Array, at: int) -> tuple[float, float]:
        """Return surface coordinates: u round the axis from +x in turns, v along it."""
        return math.atan2(p.y, p.x) / (2.0 * math.pi), p.z


SKELETONS: dict[str, type[Skeleton]] = {}
"""Every primitive by its name."""

K = TypeVar("K", bound=type[Skeleton])


def skeleton(cls: K) -> K:
    """Register a primitive under the name of its class in lower case."""
    cls.name = cls.__name__.lower()
    cls.kind = len(SKELETONS)
    SKELETONS[cls.name] = cls
    return cls


def cone_constants(length: float, radius: float) -> list[float]:
    """Return length, radius of the foot, and the normal of the side with its slant height."""
    slant = math.hypot(length, radius)
    if slant == 0.0:
        return [length, radius, 0.0, 1.0, 0.0]
    return [length, radius, radius / slant, length / slant, slant]


@skeleton
class Point(Skeleton):
    """``point(r)``: a ball of radius r about the origin."""

    parameters = ("r",)

    @classmethod
    def extent(cls, args: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    @classmethod
    def slim_row(cls, args: Sequence[float]) -> tuple[float, float]:
        return 0.0, 0.0

    @staticmethod
    def distance(p: Vec3, d: Vec3, c: Array, at: int, pool: Array) -> tuple[float, float]:
        return (
            p.x * p.x + p.y * p.y + p.z * p.z,
            2.0 * (p.x * d.x + p.y * d.y + p.z * d.z),
        )

    @staticmethod
    def uv(p: Vec3, c: Array, at: int) -> tuple[float, float]:
        latitude = math.atan2(p.z, math.hypot(p.x, p.y))
        return math.atan2(p.y, p.x) / (2.0 * math.pi), latitude / math.pi


@skeleton
class Segment(Skeleton):
    """``segment(l, r)``: from the origin to z = l; the surface is a capsule of radius r."""

    parameters = ("l", "r")

    @classmethod
    def extent(cls, args: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        return (0.0, 0.0, 0.0), (0.0, 0.0, args[0])

    @classmethod
    def slim_row(cls, args: Sequence[float]) -> tuple[float, float]:
        return args[0], 0.0

    @staticmethod
    def distance(p: Vec3, d: Vec3, c: Array, at: int, pool: Array) -> tuple[float, float]:
        z = p.z if p.z < 0.0 else max(p.z - c[at], 0.0)
        return (
            p.x * p.x + p.y * p.y + z * z,
            2.0 * (p.x * d.x + p.y * d.y + z * d.z),
        )


@skeleton
class Cone(Skeleton):
    """``cone(l, rb, rt)``: a branch from the origin to z = l, of radius rb at its foot, rt on top.

    The skeleton is a solid cone with radius |rb - rt| at the thick end and 0 at the other; the
    surface is its offset by the smaller radius (Galbraith, MacMurchy, Wyvill 2004).
    """

    parameters = ("l", "rb", "rt")

    @classmethod
    def reach(cls, args: Sequence[float]) -> float:
        return REACH * min(args[1], args[2])

    @classmethod
    def extent(cls, args: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        a = abs(args[1] - args[2])
        return (-a, -a, 0.0), (a, a, args[0])

    @classmethod
    def slim_row(cls, args: Sequence[float]) -> tuple[float, float]:
        return args[0], abs(args[1] - args[2])

    @staticmethod
    def distance(p: Vec3, d: Vec3, c: Array, at: int, pool: Array) -> tuple[float, float]:
        z, r2, rd = p.z, p.x * p.x + p.y * p.y, p.x * d.x + p.y * d.y
        length, a = c[at], c[at + 1]
        if a == 0.0:
            x = z if z < 0.0 else max(z - length, 0.0)
            return r2 + x * x, 2.0 * (rd + x * d.z)
        rho = math.sqrt(r2)
        e = rho - a
        if z < 0.0:
            if e <= 0.0:
                return z * z, 2.0 * z * d.z
            return z * z + e * e, 2.0 * (z * d.z + e * rd / rho)
        # (nz, nr) is the side's normal in the plane through the axis, s runs up the side.
        nz, nr, slant = c[at + 2], c[at + 3], c[at + 4]
        off = z * nz + e * nr
        if off <= 0.0:
            return 0.0, 0.0
        s = z * nr - e * nz
        if s < 0.0:
            return z * z + e * e, 2.0 * (z * d.z + e * rd / rho)
        if s > slant:
            x = z - length
            return r2 + x * x, 2.0 * (rd + x * d.z)
        return off * off, 2.0 * off * (nz * d.z + nr * rd / rho)


@skeleton
class Disc(Skeleton):
    """``disc(rd, r)``: a disc of radius rd in the xy-plane about the origin, r thick each way."""

    parameters = ("rd", "r")

    @classmethod
    def extent(cls, args: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        return (-args[0], -args[0], 0.0), (args[0], args[0], 0.0)

    @classmethod
    def slim_row(cls, args: Sequence[float]) -> tuple[float, float]:
        return 0.0, args[0]

    @staticmethod
    def distance(p: Vec3, d: Vec3, c: Array, at: int, pool: Array) -> tuple[float, float]:
        rho = math.sqrt(p.x * p.x + p.y * p.y)
        e = rho - c[at + 1]
        if e <= 0.0:
            return p.z * p.z, 2.0 * p.z * d.z
        return (
            p.z * p.z + e * e,
            2.0 * (p.z * d.z + e * (p.x * d.x + p.y * d.y) / rho),
        )

    @staticmethod
    def uv(p: Vec3, c: Array, at: int) -> tuple[float, float]:
        return p.x, p.y


@skeleton
class Box(Skeleton):
    """``box(x, y, z, r)``: a box of half widths x, y, z about the origin, offset by r."""

    parameters = ("x", "y", "z", "r")
    slim = False

    @classmethod
    def extent(cls, args: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        return (-args[0], -args[1], -args[2]), (args[0], args[1], args[2])

    @classmethod
    def constants(cls, args: Sequence[float], extra: list[float]) -> list[float]:
        return [args[0], args[1], args[2], 0.0, 0.0]

    @staticmethod
    def distance(p: Vec3, d: Vec3, c: Array, at: int, pool: Array) -> tuple[float, float]:
        x = math.copysign(max(abs(p.x) - c[at], 0.0), p.x)
        y = math.copysign(max(abs(p.y) - c[at + 1], 0.0), p.y)
        z = math.copysign(max(abs(p.z) - c[at + 2], 0.0), p.z)
        return x * x + y * y + z * z, 2.0 * (x * d.x + y * d.y + z * d.z)

    @staticmethod
    def uv(p: Vec3, c: Array, at: int) -> tuple[float, float]:
        return p.x, p.y


@skeleton
class Polygon(Skeleton):
    """``polygon(corners, r)``: a convex sheet in the xy-plane, r thick each way.

    In Python only. Arguments: x and y of the corners, counterclockwise, then r.
    """

    parameters = ("x1", "y1", "...", "r")
    slim = False

    @classmethod
    def check(cls, args: Sequence[float]) -> None:
        if len(args) < 7 or len(args) % 2 == 0:
            raise UsageError("polygon takes at least three corners (x, y) and r")
        if not args[-1] >= SMALLEST:
            raise UsageError(f"polygon: r must be > 0, is {args[-1]:g}")
        corners = np.reshape(args[:-1], (-1, 2))
        edges = np.roll(corners, -1, 0) - corners
        following = np.roll(edges, -1, 0)
        turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
        if not np.all(np.isfinite(corners)) or np.any(turns <= 0.0):
            raise UsageError("polygon: corners must be convex and counterclockwise")

    @classmethod
    def extent(cls, args: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        x, y = args[:-1:2], args[1:-1:2]
        return (min(x), min(y), 0.0), (max(x), max(y), 0.0)

    @classmethod
    def constants(cls, args: Sequence[float], extra: list[float]) -> list[float]:
        at = len(extra)
        extra.extend(args[:-1])
        return [(len(args) - 1) // 2, at, 0.0, 0.0, 0.0]

    @staticmethod
    def distance(p: Vec3, d: Vec3, c: Array, at: int, pool: Array) -> tuple[float, float]:
        n, first = int(c[at]), int(c[at + 1])
        within = True
        best, slope = math.inf, 0.0
        xa, ya = pool[first + 2 * n - 2], pool[first + 2 * n - 1]
        for k in range(n):
            xb, yb = pool[first + 2 * k], pool[first + 2 * k + 1]
            ex, ey = xb - xa, yb - ya
            px, py = p.x - xa, p.y - ya
            if ex * py - ey * px < 0.0:
                within = False
                s = min(max((px * ex + py * ey) / (ex * ex + ey * ey), 0.0), 1.0)
                px, py = px - s * ex, py - s * ey
                g = px * px + py * py
                if g < best:
                    best, slope = g, px * d.x + py * d.y
            xa, ya = xb, yb
        if within:
            best, slope = 0.0, 0.0
        return p.z * p.z + best, 2.0 * (p.z * d.z + slope)

    @staticmethod
    def uv(p: Vec3, c: Array, at: int) -> tuple[float, float]:
        return p.x, p.y


class Convolution(Skeleton):
    """A segment whose field is an integral: ``distance`` returns the field and its slope itself.

    Radii are those of endless segments of these weights; a short one, and its ends, are thinner.
    """

    parameters = ("l", "ra", "rb")
    slim = False

    @classmethod
    def check(cls, args: Sequence[float]) -> None:
        super().check(args)
        if not args[0] > 0.0:
            raise UsageError(f"{cls.name}: l must be > 0, is {args[0]:g}")

    @classmethod
    def extent(cls, args: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        return (0.0, 0.0, 0.0), (0.0, 0.0, args[0])


@skeleton
class Quartic(Convolution):
    """``convolution(l, ra, rb)``: from the origin to z = l under the kernel (1 - r2/R2)2.

    R is twice the larger radius; see `convolution`.
    """

    @classmethod
    def reach(cls, args: Sequence[float]) -> float:
        return 2.0 * max(args[1], args[2])

    @classmethod
    def constants(cls, args: Sequence[float], extra: list[float]) -> list[float]:
        reach = cls.reach(args)
        wa, wb = (quartic_weight(d, reach, T) for d in args[1:])
        return [args[0], wa, wb, reach, 0.0]

    @classmethod
    def curvature(cls, args: Sequence[float]) -> tuple[float, float, float]:
        length, wa, wb, reach, _ = cls.constants(args, [])
        whole = max(wa, wb) * min(length, 2.0 * reach)
        # Of the kernel along a line: its second derivative and its slope.
        return 4.0 * whole / reach**2, 8.0 * whole / reach**2, 1.54 * whole / reach

    @staticmethod
    def distance(p: Vec3, d: Vec3, c: Array, at: int, pool: Array) -> tuple[float, float]:
        h2 = p.x * p.x + p.y * p.y
        f, fx, fh = quartic_segment(p.z, h2, c[at], c[at + 1], c[at + 2], c[at + 3])
        return f, fx * d.z + 2.0 * fh * (p.x * d.x + p.y * d.y)


@skeleton
class Cauchy(Convolution):
    """The same under the Cauchy kernel, which a window ends between five and six radii away."""

    @classmethod
    def reach(cls, args: Sequence[float]) -> float:
        return 6.0 * max(args[1], args[2])

    @classmethod
    def constants(cls, args: Sequence[float], extra: list[float]) -> list[float]:
        s = 1.0 / max(args[1], args[2])
        wa, wb = (cauchy_weight(d, s, T) for d in args[1:])
        return [args[0], wa, wb, s, 0.0]

    @classmethod
    def curvature(cls, args: Sequence[float]) -> tuple[float, float, float]:
        length, wa, wb, s, _ = cls.constants(args, [])
        w = max(wa, wb)
        # Integrals of the kernel's derivatives along the segment, and 0.2 for the window's.
        return (
            w * (min(4.0 * s * s * length, 4.72 * s) + 0.2 * s),
            w * (min(2.54 * s * s * length, 28.3 * s) + 0.2 * s),
            w * (min(1.15 * s * length, 4.0) + 0.1),
        )

    @staticmethod
    def distance(p: Vec3, d: Vec3, c: Array, at: int, pool: Array) -> tuple[float, float]:
        length, s = c[at], c[at + 3]
        h2, rd = p.x * p.x + p.y * p.y, p.x * d.x + p.y * d.y
        z = p.z if p.z < 0.0 else max(p.z - length, 0.0)
        away = math.sqrt(h2 + z * z)
        u = away * s - 5.0
        if u >= 1.0:
            return 0.0, 0.0
        f, fx, fh = cauchy_segment(p.z, h2, length, c[at + 1], c[at + 2], s)
        slope = fx * d.z + 2.0 * fh * rd
        if u <= 0.0:
            return f, slope
        # 1 - (6 u5 - 15 u4 + 10 u3): twice continuously differentiable.
        window = 1.0 - u * u * u * (u * (6.0 * u - 15.0) + 10.0)
        change = -30.0 * u * u * (1.0 - u) * (1.0 - u) * s * (rd + z * d.z) / away
        return f * window, slope * window + f * change


DIRECT = Quartic.kind
"""Primitives of this kind and later ones have a field, not a distance."""


def skeleton_ladder(method: str, arguments: str, default: str) -> Callable[..., Any]:
    """Return a kernel that dispatches over the kinds of primitives."""
    cases = [njit(contract=True)(getattr(cls, method)) for cls in SKELETONS.values()]
    return build_ladder(
        f"skeleton_{method}", "kind", arguments.split(), cases, default, contract=True
    )
