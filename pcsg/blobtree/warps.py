"""Warps: fields of bent, twisted and tapered space (Barr 1984), ``F(w^-1(p))``.

The kernel of a warp is the inverse map: a point and a velocity before it to those after it, which
is the frame of what is warped, where z runs along. A straight ray becomes a curve in which
distances are no longer convex; what is needed of it are bounds of its speed and its acceleration:

========  ==============================================================================
speed     ``|q'| <= speed |p'|``
bend      ``|q''| <= bend |p'|2``, for a straight p
========  ==============================================================================

Both hold in a domain, and where the map is smooth. The kernel returns how far the point is from
where it is not smooth, and from the end of the domain; beyond, what is warped has no field.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.jit import build_ladder, njit
from pcsg.vec import Vec3

Array = NDArray[np.float64]
Corners = tuple[Array, Array]
"""Lower and upper corner of a box, (3,) each."""

WARP_ARGS = 4
"""Numbers that the kernel of a warp reads."""


class Warped(NamedTuple):
    """A point and a velocity behind a warp, and how far the point is from its trouble spots."""

    p: Vec3
    v: Vec3
    smooth: float
    domain: float


class Warp:
    """A warp of the space in which z runs along what is warped."""

    name: ClassVar[str]
    kind: ClassVar[int]
    parameters: ClassVar[tuple[str, ...]]
    defaults: ClassVar[tuple[float, ...]] = ()

    @classmethod
    def constants(
        cls, args: Sequence[float], height: float, box: Corners
    ) -> tuple[list[float], float, float, Corners]:
        """Return what the kernel reads, the speed, the bend, and the box of the warped box.

        Parameters
        ----------
        args
            As written.
        height
            The warp's range: z from 0 to it.
        box
            Contains the support of what is warped.
        """
        raise NotImplementedError

    @staticmethod
    def pull(p: Vec3, v: Vec3, c: Array, at: int) -> Warped:
        """Map a point and a velocity backwards."""
        raise NotImplementedError


WARPS: dict[str, type[Warp]] = {}
"""Every warp by its name."""

W = TypeVar("W", bound=type[Warp])


def warp(cls: W) -> W:
    """Register a warp under the name of its class in lower case."""
    cls.name = cls.__name__.lower()
    cls.kind = len(WARPS)
    WARPS[cls.name] = cls
    return cls


def _hull_of(points: Array, margin: float) -> Corners:
    return points.min(axis=0) - margin, points.max(axis=0) + margin


LEAST = 1e-6
"""Of the factors of a taper, and over their most."""


@warp
class Bend(Warp):
    """``bend(angle)``: curves +z towards +x by an angle in all, between z = 0 and the top.

    ``bend(angle, azimuth)`` curves it towards a direction of the xy-plane. What lies beyond the top
    goes on straight. Contents must stay on this side of the centre of curvature.
    """

    parameters = ("angle", "azimuth")
    defaults = (0.0,)

    @classmethod
    def constants(
        cls, args: Sequence[float], height: float, box: Corners
    ) -> tuple[list[float], float, float, Corners]:
        total = math.radians(args[0])
        if not abs(total) < 3.1:
            raise UsageError(f"bend: the angle must lie between -177 and 177, is {args[0]:g}")
        k = total / height if height > 0.0 else 0.0
        if abs(k) < 1e-9:
            # So little that the centre of curvature would cancel digits.
            return [0.0, height, 0.0, 0.0], 1.0, 0.0, box
        lower, upper = box
        inner = 1.0 - max(k * lower[0], k * upper[0])
        if inner < 0.15:
            raise UsageError(
                f"bend: by {args[0]:g} degrees over a length of {height:.4g} is too much for what "
                f"reaches {max(abs(lower[0]), abs(upper[0])):.4g} aside; bend less, or thin it"
            )
        edge = 0.6 * inner
        speed = max(1.0, 1.0 / edge)
        # In polar coordinates about the centre: rho'' and theta'' of a straight line.
        acceleration = abs(k) * math.hypot(1.0 / edge, 1.0 / edge**2)
        steps = np.linspace(0.0, height, 17)
        zs = np.unique(np.concatenate([steps, [lower[2], upper[2]]]))
        x, y, z = (
            a.ravel()
            for a in np.meshgrid([lower[0], upper[0]], [lower[1], upper[1]], zs, indexing="ij")
        )
        margin = (1.0 / abs(k) + max(abs(lower[0]), abs(upper[0]))) * (total / 16) ** 2 / 8
        image = _hull_of(push_bend(np.stack([x, y, z], axis=1), k, height), margin)
        return [k, height, edge, 0.0], speed, acceleration, image

    @staticmethod
    def pull(p: Vec3, v: Vec3, c: Array, at: int) -> Warped:
        k, height, edge = c[at], c[at + 1], c[at + 2]
        if k == 0.0:
            return Warped(p, v, math.inf, math.inf)
        # The centre of curvature is at x = 1/k, z = 0; s is 1 on the axis, 0 in the centre.
        s, w = 1.0 - k * p.x, k * p.z
        end = k * height
        low, high = min(0.0, end), max(0.0, end)
        # Angles are counted from the middle of the bend, so that they jump behind its back.
        cm, sm = math.cos(0.5 * end), math.sin(0.5 * end)
        front, side = cm * s + sm * w, cm * w - sm * s
        angle = math.atan2(side, front) + 0.5 * end
        turn = min(max(angle, low), high)
        cos, sin = math.cos(turn), math.sin(turn)
        # Back by the turn about the centre: across and along the axis there.
        across, along = cos * s + sin * w, cos * w - sin * s
        va, vb = cos * v.x - sin * v.z, sin * v.x + cos * v.z
        i = 1.0 / k
        rho = math.sqrt(s * s + w * w)
        # Distance from the two half-planes between which it bends, and from that of the jump.
        ce, se = math.cos(end), math.sin(end)
        foot = abs(w) if s > 0.0 else rho
        top = abs(ce * w - se * s) if ce * s + se * w > 0.0 else rho
        jump = abs(side) if front < 0.0 else rho
        smooth = min(foot, top) * abs(i)
        domain = min(rho - edge, jump) * abs(i)
        if low < angle < high:
            # Inside, rho is kept and the angle becomes length.
            return Warped(
                Vec3((1.0 - rho) * i, p.y, angle * i), Vec3(va, v.y, vb / rho), smooth, domain
            )
        return Warped(
            Vec3((1.0 - across) * i, p.y, turn * i + along * i), Vec3(va, v.y, vb), smooth, domain
        )


def push_bend(points: Array, k: float, height: float) -> Array:
    """Return bent points (N, 3)."""
    x, y, z = points.T
    along = np.clip(z, 0.0, height)
    c, s = np.cos(k * along), np.sin(k * along)
    rest = z - along
    return np.stack(
        [1.0 / k - c * (1.0 / k - x) + s * rest, y, s * (1.0 / k - x) + c * rest], axis=1
    )


@warp
class Twist(Warp):
    """``twist(k)``: turns about z by k degrees per unit of z, everywhere."""

    parameters = ("k",)

    @classmethod
    def constants(
        cls, args: Sequence[float], height: float, box: Corners
    ) -> tuple[list[float], float, float, Corners]:
        k = math.radians(args[0])
        lower, upper = box
        rho = math.hypot(max(abs(lower[0]), abs(upper[0])), max(abs(lower[1]), abs(upper[1])))
        edge = 1.25 * rho + 1e-12
        # The largest singular value of the inverse.
        speed = 0.5 * (abs(k) * edge + math.sqrt((k * edge) ** 2 + 4.0))
        acceleration = abs(k) + k * k * edge
        image = (
            np.array([-rho, -rho, lower[2]], dtype=np.float64),
            np.array([rho, rho, upper[2]], dtype=np.float64),
        )
        return [k, edge, 0.0, 0.0], speed, acceleration, image

    @staticmethod
    def pull(p: Vec3, v: Vec3, c: Array, at: int) -> Warped:
        k, edge = c[at], c[at + 1]
        cos, sin = math.cos(k * p.z), math.sin(k * p.z)
        x, y = cos * p.x + sin * p.y, cos * p.y - sin * p.x
        vx, vy = cos * v.x + sin * v.y, cos * v.y - sin * v.x
        spin = k * v.z
        q = Vec3(x, y, p.z)
        return Warped(q, Vec3(vx + spin * y, vy - spin * x, v.z), math.inf, edge - math.hypot(x, y))


@warp
class Taper(Warp):
    """``taper(a, b)``: scales the cross-section by a at z = 0 up to b at the top, linearly."""

    parameters = ("a", "b")

    @classmethod
    def constants(
        cls, args: Sequence[float], height: float, box: Corners
    ) -> tuple[list[float], float, float, Corners]:
        a, b = args
        if not (LEAST <= a <= 1.0 / LEAST and LEAST <= b <= 1.0 / LEAST):
            raise UsageError(
                f"taper: both factors must be > 0, between {LEAST:g} and {1.0 / LEAST:g}, are "
                f"{a:g} and {b:g}"
            )
        slope = (b - a) / height if height > 0.0 else 0.0
        least, most = min(a, b), max(a, b)
        lower, upper = box
        wide = math.hypot(max(abs(lower[0]), abs(upper[0])), max(abs(lower[1]), abs(upper[1])))
        edge = 1.25 * wide + 1e-12
        # Rows (1/s, -x s'/s2) and (0, 1), with x/s below the edge.
        shear = edge * abs(slope) / least
        speed = max(1.0, 1.0 / least) + shear
        acceleration = abs(slope) / least**2 + 2.0 * edge * (slope / least) ** 2
        image = (
            np.array([min(x * most, x * least) for x in lower[:2]] + [lower[2]]),
            np.array([max(x * most, x * least) for x in upper[:2]] + [upper[2]]),
        )
        return [a, slope, height, edge], speed, 2.0 * acceleration, image

    @staticmethod
    def pull(p: Vec3, v: Vec3, c: Array, at: int) -> Warped:
        a, slope, height, edge = c[at], c[at + 1], c[at + 2], c[at + 3]
        z = min(max(p.z, 0.0), height)
        inside = 0.0 < p.z < height
        i = 1.0 / (a + slope * z)
        x, y = p.x * i, p.y * i
        change = slope * v.z * i if inside else 0.0
        smooth = math.inf if slope == 0.0 else min(abs(p.z), abs(p.z - height))
        # Distance from the cone that the edge becomes: its equation over its steepest slope.
        domain = (edge - math.hypot(x, y)) * (a + slope * z) / math.hypot(1.0, edge * slope)
        return Warped(
            Vec3(x, y, p.z), Vec3(v.x * i - x * change, v.y * i - y * change, v.z), smooth, domain
        )


def warp_ladder() -> Callable[..., Any]:
    """Return the kernel that dispatches over the kinds of warps."""
    cases = [njit(contract=True)(cls.pull) for cls in WARPS.values()]
    return build_ladder(
        "warp_pull", "kind", ["p", "v", "c", "at"], cases, "case_0(p, v, c, at)", contract=True
    )
