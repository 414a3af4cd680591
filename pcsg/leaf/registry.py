"""The registry of leaves: a new primitive is one class with one decorator, in one place.

The kernels of a leaf are static methods that all end with the same arguments:

=========  =============================================================================
args, at   float64 (A,), int: the evaluated parameters of this leaf begin at ``args[at]``
pool       tuple of float64, float32 and int32 arrays: constants such as mesh vertices
=========  =============================================================================

They are compiled by the dispatch, not here, so that reading a grammar compiles nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import mul
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcsg.vec import Ray, Vec3

Array = NDArray[np.float64]
Pool = tuple[Array, NDArray[np.float32], NDArray[np.int32]]

ALL, FIRST, ANY = 0, 1, 2
"""What a caller wants: all inside intervals on the whole line, the first crossing in
[tmin, tmax], or any."""


@dataclass(frozen=True)
class Box:
    """An axis-aligned box; may be infinite. Empty where a lower bound exceeds an upper one."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


UNIT_BOX = Box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
EMPTY_BOX = Box((math.inf,) * 3, (-math.inf,) * 3)


@dataclass(frozen=True)
class LeafParameter:
    """A parameter of a primitive.

    Attributes
    ----------
    name
        For messages and the reference page.
    default
        None if it must be given.
    low, high
        Legal values: ``low <= x <= high``, without `low` itself where `open_low`.
    """

    name: str
    default: float | None = None
    low: float = -math.inf
    high: float = math.inf
    open_low: bool = False

    @property
    def condition(self) -> str:
        """The legal values in words."""
        left = f"{self.low:g} {'<' if self.open_low else '<='} " if self.low > -math.inf else ""
        right = f" <= {self.high:g}" if self.high < math.inf else ""
        return f"{left}{self.name}{right}"


class Solid:
    """What every leaf answers; see `registry` for the common arguments.

    Class attributes
    ----------------
    aliases
        Other names in grammars.

    Parameters
    ----------
        In the order of the arguments.
    bounds
        A box that contains the solid in its own frame, if that does not depend on arguments.
    ball
        Centre and radius of a ball that contains it; not given, the one around its box.
    corners
        Points whose convex hull contains it, where these are fewer than a box's.
    sheet
        True for a surface without volume: its intervals have length zero.
    primitives
        What it counts for in primitive equivalents.
    """

    name: ClassVar[str]
    kind: ClassVar[int]
    aliases: ClassVar[tuple[str, ...]] = ()
    parameters: ClassVar[tuple[LeafParameter, ...]] = ()
    bounds: ClassVar[Box] = UNIT_BOX
    ball: ClassVar[tuple[Vec3, float] | None] = None
    corners: ClassVar[tuple[Vec3, ...]] = ()
    sheet: ClassVar[bool] = False
    primitives: ClassVar[int] = 1

    @classmethod
    def bounds_of(cls, args: Sequence[float]) -> Box:
        """Return a box that contains the solid with these arguments, in its own frame."""
        return cls.bounds

    @classmethod
    def support(cls, direction: Vec3, args: Sequence[float]) -> float:
        """Return the largest ``p . direction`` over the solid, or more; by default its box's."""
        if cls.corners:
            return max(math.fsum(map(mul, corner, direction)) for corner in cls.corners)
        box = cls.bounds_of(args)
        total = 0.0
        for d, lower, upper in zip(direction, box.lower, box.upper, strict=True):
            if lower > upper:
                return -math.inf
            if d != 0.0:
                total += d * (upper if d > 0.0 else lower)
        return total

    @staticmethod
    def crossings(
        ray: Ray,
        want: int,
        args: Array,
        at: int,
        pool: Pool,
        t: Array,
        n: int,
    ) -> int:
        """Write where the ray enters and leaves into ``t[n:]`` and return the new length.

        For ALL: an even number, not decreasing, alternating enter and leave; unbounded solids
        write infinities, sheets an interval of length zero. `want` lets a leaf with many parts
        stop early; a simple one always answers ALL.
        """
        raise NotImplementedError

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        """Return the outward normal at a point of the surface; any length but zero."""
        raise NotImplementedError

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        """Return whether the closed solid contains a point."""
        raise NotImplementedError

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        """Return surface coordinates of a point of the surface, for textures."""
        raise NotImplementedError


LEAVES: dict[str, type[Solid]] = {}
"""Every primitive by its name."""

LEAF_NAMES: dict[str, type[Solid]] = {}
"""Every primitive by its name and its aliases."""

L = TypeVar("L", bound=type[Solid])


def leaf(cls: L) -> L:
    """Register a primitive under the name of its class in lower case."""
    cls.name = cls.__name__.lower()
    cls.kind = len(LEAVES)
    LEAVES[cls.name] = cls
    for name in (cls.name, *cls.aliases):
        LEAF_NAMES[name] = cls
    return cls


def kernels(method: str) -> list[Callable[..., Any]]:
    """Return one static method of every leaf, in the order of their kinds."""
    return [getattr(cls, method) for cls in LEAVES.values()]
