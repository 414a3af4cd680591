"""The registry of leaves: a new primitive is one class with one decorator, in one place.

The kernels of a leaf are static methods that all end with the same arguments:

=========  =============================================================================
args, at   float64 (A,), int: the evaluated parameters of this leaf begin at ``args[at]``
pool       tuple of float64, float32 and int32 arrays: constants such as mesh vertices
=========  =============================================================================

They are compiled by the dispatch, not here, so that reading a grammar compiles nothing.

A leaf with data declares constant arguments, such as the name of a file. They are read with the
grammar; from them, and from the values of its numbers, `Solid.make_model` makes a `Model` in
Python, whose arrays are placed in the pool. Its kernels see no numbers of the grammar:
``args[at]``, ``args[at + 1]``, ``args[at + 2]`` say where its own float64, float32 and int32 arrays
begin.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from operator import mul
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.vec import Ray, Vec3

Array = NDArray[np.float64]
Pool = tuple[Array, NDArray[np.float32], NDArray[np.int32]]
OtherUv = tuple[float, float, float, float, float, float]

ALL, FIRST, ANY = 0, 1, 2
"""What a caller wants: all inside intervals on the whole line, the first crossing in
[tmin, tmax], or any."""

NO_PART = -1.0
"""The part of a leaf where it is not known; see `Solid.part_normal`."""

OVERFLOW = -1
"""What `Solid.crossings` returns where the array is too short for all of them."""

MODEL_ARGS = 3
"""Kernel arguments of a leaf with data: where its arrays begin in the pool."""


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


class Constant:
    """A constant argument of a leaf, read once, such as the content of a file."""

    instead: ClassVar[str] = "save them to a file and name it"
    """What to do where the language cannot say it."""

    notes: tuple[str, ...] = ()
    """What of a file is left out or mended, a sentence for each kind."""

    @property
    def why_sheet(self) -> str | None:
        """Why it is a sheet and no solid, None if nothing is known about that."""
        return None

    @property
    def signature(self) -> object:
        """A value that is equal for, and only for, constants that are written alike."""
        return id(self)

    @property
    def digest(self) -> str:
        """What tells other content apart, for the digest of a scene."""
        return ""

    @property
    def text(self) -> str | None:
        """What stands in a grammar, None where the language cannot say it."""
        return None

    def __copy__(self) -> Self:
        return self  # nobody changes it

    def __deepcopy__(self, memo: object) -> Self:
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes, without those that are made when they are needed."""
        return {
            name: x
            for name, x in self.__dict__.items()
            if not isinstance(getattr(type(self), name, None), cached_property)
        }


@dataclass(frozen=True)
class LeafConstant:
    """The declaration of a constant argument, which stands before the numbers.

    Attributes
    ----------
    name
        For messages and the reference page.
    expected
        What must be written, in words.
    """

    name: str
    expected: str


class Data(NamedTuple):
    """The arrays that a model places in the pool."""

    doubles: Array
    singles: NDArray[np.float32] = np.zeros(0, np.float32)
    integers: NDArray[np.int32] = np.zeros(0, np.int32)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays in bytes."""
        return sum(a.nbytes for a in self)


class Model:
    """What a leaf with data is for given constants and numbers; built in Python.

    Attributes
    ----------
    bounds
        A box that contains this very model.
    data
        Its arrays, made when a ray first needs them.
    """

    bounds: Box

    @cached_property
    def data(self) -> Data:
        """The arrays for the pool."""
        raise NotImplementedError

    def support(self, direction: Vec3) -> float:
        """Return the largest ``p . direction`` over the model, or more; by default its box's."""
        return support_of_box(self.bounds, direction)


def support_of_box(box: Box, direction: Vec3) -> float:
    """Return the largest ``p . direction`` over a box."""
    total = 0.0
    for d, lower, upper in zip(direction, box.lower, box.upper, strict=True):
        if lower > upper:
            return -math.inf
        if d != 0.0:
            total += d * (upper if d > 0.0 else lower)
    return total


class Solid:
    """What every leaf answers; see `registry` for the common arguments.

    Class attributes
    ----------------
    aliases
        Other names in grammars.
    constants
        Constant arguments, which come first. A leaf that has them is one with data.

    Parameters
    ----------
        Numbers, in the order of the arguments.
    bounds
        A box that contains the solid in its own frame, if that does not depend on arguments.
    ball
        Centre and radius of a ball that contains it; not given, the one around its box.
    corners
        Points whose convex hull contains it, where these are fewer than a box's.
    sheet
        True for a surface without volume: its intervals have length zero.
    inlined
        True where `crossings` is compiled into the loops that call it, for the most common solids:
        calls would cost operations a third of the time.
    apart
        True where its kernels are compiled apart, and only for scenes that have it: for what is not
        among the most common solids. A call costs some nanoseconds more.
    soft
        True for a name that is free for a grammar's own modules, definitions and parameters.
    primitives
        What it counts for in primitive equivalents.
    parts
        Of a word that stands for several leaves, with the same arguments: their union.
    """

    name: ClassVar[str]
    kind: ClassVar[int]
    aliases: ClassVar[tuple[str, ...]] = ()
    constants: ClassVar[tuple[LeafConstant, ...]] = ()
    parameters: ClassVar[tuple[LeafParameter, ...]] = ()
    bounds: ClassVar[Box] = UNIT_BOX
    ball: ClassVar[tuple[Vec3, float] | None] = None
    corners: ClassVar[tuple[Vec3, ...]] = ()
    sheet: ClassVar[bool] = False
    inlined: ClassVar[bool] = False
    apart: ClassVar[bool] = False
    soft: ClassVar[bool] = False
    primitives: ClassVar[int] = 1
    parts: ClassVar[tuple[type[Solid], ...]] = ()

    @classmethod
    def bounds_of(cls, args: Sequence[float]) -> Box:
        """Return a box that contains the solid with these arguments, in its own frame."""
        return cls.bounds

    @classmethod
    def support_of(cls, direction: Vec3, args: Sequence[float]) -> float:
        """Return the largest ``p . direction`` over the solid with these arguments, or more."""
        if cls.support is not Solid.support:
            return cls.support(direction, args, 0)
        if cls.corners:
            return max(math.fsum(map(mul, corner, direction)) for corner in cls.corners)
        return support_of_box(cls.bounds_of(args), direction)

    # For leaves with data.

    @classmethod
    def read_constant(cls, text: str, folder: Path) -> Constant:
        """Return the constant that a text in quotes stands for.

        Parameters
        ----------
        folder
            What names of files are relative to.

        Raises
        ------
        UsageError
            What is wrong with the text, or with the file that it names.
        """
        raise NotImplementedError

    @classmethod
    def take_arguments(cls, args: Sequence[Any]) -> tuple[tuple[Constant, ...], Sequence[Any]]:
        """Split the arguments of a call in Python into constants and numbers.

        Raises
        ------
        UsageError
            A constant is missing or wrong.
        """
        count = len(cls.constants)
        for declared, arg in zip_longest(cls.constants, args[:count]):
            if not isinstance(arg, (str, Path)):
                raise UsageError(f"{cls.name} takes {declared.expected} first")
        return tuple(cls.read_constant(str(a), Path()) for a in args[:count]), args[count:]

    @classmethod
    def parameters_of(cls, constants: Sequence[Constant]) -> tuple[LeafParameter, ...]:
        """Return the numbers that a leaf with these constants takes."""
        return cls.parameters

    @classmethod
    def sheet_of(cls, constants: Sequence[Constant]) -> bool:
        """Return whether a leaf with these constants is a sheet."""
        return cls.sheet

    @classmethod
    def primitives_of(cls, constants: Sequence[Constant]) -> int:
        """Return what a leaf with these constants counts for in primitive equivalents."""
        return cls.primitives

    @classmethod
    def notes_of(cls, constants: Sequence[Constant], args: Sequence[float]) -> tuple[str, ...]:
        """Return what a user should know of a leaf with these constants and numbers."""
        return ()

    @classmethod
    def make_model(cls, constants: Sequence[Constant], args: Sequence[float]) -> Model:
        """Return the model for constants and values of the numbers.

        Raises
        ------
        UsageError
            There is none for these values.
        """
        raise NotImplementedError

    # Kernels.

    @staticmethod
    def support(d: Vec3, args: Sequence[float] | Array, at: int) -> float:
        """Return the largest ``p . d`` over the solid.

        Only a leaf that is rounder than its box and its corners defines this.
        """
        raise NotImplementedError

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
        stop early; a simple one always answers ALL. For FIRST and ANY intervals that end before
        tmin may be left out, and so may those that begin behind tmax or behind the first one
        (for ANY: any one) that does not, but none that begins before tmin and ends behind it. Of
        an interval that begins before tmin the beginning need only lie before tmin; of one that
        begins in [tmin, tmax] the end need only lie behind tmin, and so need an end behind tmax.
        `OVERFLOW` where the array is too short.

        A leaf with `part_normal` leaves a number behind its answer where there is room: the part
        that the first crossing belongs to, or `NO_PART`.
        """
        raise NotImplementedError

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        """Return the outward normal at a point of the surface; any length but zero."""
        raise NotImplementedError

    @staticmethod
    def part_normal(p: Vec3, part: float, args: Array, at: int, pool: Pool) -> Vec3:
        """Return the normal at a point of the surface that is the first crossing of a ray.

        `part` is what `crossings` left behind its answer, or `NO_PART`. Only a leaf that need not
        look for the part then defines this.
        """
        raise NotImplementedError

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        """Return whether the closed solid contains a point."""
        raise NotImplementedError

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        """Return surface coordinates of a point of the surface, for textures."""
        raise NotImplementedError

    @staticmethod
    def other_uv(p: Vec3, args: Array, at: int, pool: Pool) -> OtherUv:
        """Return u, v and share of two more parts that blend at a point.

        Only a leaf whose parts blend defines this. The rest is the share of `uv`, the largest.
        """
        raise NotImplementedError

    @staticmethod
    def attributes(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float, float, float]:
        """Return red, green, blue and label at a point of the surface; -1 for those it has not.

        Only a leaf that has some of its own defines this. They stand below, hence before, what
        attributes of the grammar set.
        """
        raise NotImplementedError


LEAVES: dict[str, type[Solid]] = {}
"""Every primitive by its name."""

LEAF_NAMES: dict[str, type[Solid]] = {}
"""Every primitive by its name and its aliases."""

L = TypeVar("L", bound=type[Solid])


MOST_PARAMETERS = 8
"""Most numbers of a primitive: boxes look at all combinations of their least and largest values."""


def leaf(cls: L) -> L:
    """Register a primitive under the name of its class in lower case.

    Raises
    ------
    TypeError
        It has too many parameters.
    """
    if len(cls.parameters) > MOST_PARAMETERS:
        count = len(cls.parameters)
        raise TypeError(
            f"{cls.__name__} has {count} parameters: a primitive has at most {MOST_PARAMETERS}"
        )
    cls.name = cls.__name__.lower()
    cls.kind = len(LEAVES)
    LEAVES[cls.name] = cls
    for name in (cls.name, *cls.aliases):
        LEAF_NAMES[name] = cls
    return cls


def word(cls: L) -> L:
    """Register a word that stands for leaves which are there already: it needs no kernels.

    ``TreeWood`` is written ``tree_wood``.

    A subclass of a leaf has that leaf's kernels and makes models of its own; any other class says
    in `Solid.parts` what it stands for.
    """
    cls.name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", cls.__name__).lower()
    LEAF_NAMES[cls.name] = cls
    return cls


def kernels(method: str) -> list[Callable[..., Any] | None]:
    """Return one static method of every leaf, in the order of their kinds; None where undefined."""
    found = (getattr(cls, method) for cls in LEAVES.values())
    return [None if kernel is getattr(Solid, method) else kernel for kernel in found]
