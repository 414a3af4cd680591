"""Implicit models as leaves: blobs, and trees of L-systems and of skeletons."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

import numpy as np

from pcsg.addresses import join_address, split_address
from pcsg.blobtree.fields import T
from pcsg.blobtree.layout import wide
from pcsg.blobtree.native import (
    DESCRIPTION,
    FIELD,
    GRADIENT,
    INTERVALS,
    address,
    ask,
    reserve_floats,
)
from pcsg.blobtree.points import ATTRIBUTE_COLUMNS, BOUND, LABEL, OTHERS, U, V
from pcsg.errors import UsageError
from pcsg.jit import njit
from pcsg.leaf.registry import (
    Array,
    Box,
    Constant,
    Data,
    LeafConstant,
    LeafParameter,
    Model,
    OtherUv,
    Pool,
    Solid,
    leaf,
)
from pcsg.skeletonfile import SKELETON_ENDINGS, parse_rows, read_skeleton_text
from pcsg.vec import Ray, Vec3

if TYPE_CHECKING:
    from pcsg.blobtree.areas import Areas
    from pcsg.blobtree.model import Model as Fields
    from pcsg.blobtree.nodes import Field


class BlobModel(Model):
    """A flattened field in the pool.

    Parameters
    ----------
    darkening
        By which part its colours are darker where bounds mix all of the other blend in.
    """

    def __init__(self, fields: Fields, darkening: float = 0.0) -> None:
        self.darkening = darkening
        if not fields.primitives:
            raise UsageError("the blob has no primitives")
        self.fields = fields
        lower, upper = fields.bounds.tolist()
        self.bounds = Box(tuple(lower), tuple(upper))

    @cached_property
    def data(self) -> Data:
        """The darkening before the numbers, the address of who answers before the integers."""
        doubles, singles, integers = self.fields.pool
        return Data(
            np.concatenate([[self.darkening], doubles]),
            singles,
            np.concatenate([split_address(address()), integers]),
        )


class BlobSource(Constant):
    """What fields are made of: the constant argument of a blob.

    Parameters
    ----------
    parameters
        Names of the numbers that the fields depend on.
    """

    darkening = 0.0
    """Of its models."""

    def __init__(self, parameters: Sequence[str] = ()) -> None:
        self.parameters = tuple(parameters)
        self._models: WeakValueDictionary[tuple[float, ...], BlobModel] = WeakValueDictionary()

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_models": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _models=WeakValueDictionary())

    def build(self, values: Sequence[float]) -> Field:
        """Return the field for values of the numbers; raises UsageError if there is none."""
        raise NotImplementedError

    def count(self) -> int:
        """Return what it counts for in primitive equivalents."""
        return 1

    def junctions(self, values: Sequence[float]) -> Areas | None:
        """Return the areas at a tree's junctions; None for what is made of no skeleton."""
        return None

    def model(self, values: Sequence[float]) -> BlobModel:
        """Return the flattened field, the same one for the same values."""
        # Most scenes have no blobs, and do without what makes them.
        from pcsg.blobtree.model import Model as Fields

        key = tuple(values)
        found = self._models.get(key)
        if found is None:
            found = self._models[key] = BlobModel(Fields(self.build(key)), self.darkening)
        return found


class FieldSource(BlobSource):
    """A field built in Python."""

    instead = "write the field in `blob { ... }`"

    def __init__(self, field: Field) -> None:
        super().__init__()
        self._field = field

    @cached_property
    def digest(self) -> str:
        from pcsg.blobtree.nodes import digest_of

        return digest_of(self._field)

    def build(self, values: Sequence[float]) -> Field:
        return self._field


class FileSource(BlobSource):
    """What a file tells; its parameters have defaults."""

    defaults: tuple[float, ...] = ()

    def __init__(self, text: str, name: str, parameters: Sequence[str]) -> None:
        super().__init__(parameters)
        self._text = text
        self._name = name

    @property
    def signature(self) -> object:
        return self._name

    @property
    def digest(self) -> str:
        return hashlib.sha256(self._text.encode()).hexdigest()

    @property
    def text(self) -> str | None:
        return f'"{self._name}"'


class PlantSource(FileSource):
    """The trees that the L-system of a file draws, for a seed and values of its constants."""

    def __init__(self, text: str, name: str) -> None:
        from pcsg.blobtree.plant import numbers_of

        numbers = numbers_of(text)
        super().__init__(text, name, ("seed", *numbers))
        self.defaults = (0.0, *numbers.values())

    def build(self, values: Sequence[float]) -> Field:
        from pcsg.blobtree.plant import plant_of

        return plant_of(self._text, self._name, *self._chosen(values))

    def junctions(self, values: Sequence[float]) -> Areas | None:
        from pcsg.blobtree.areas import junction_areas
        from pcsg.blobtree.plant import drawing_of

        return junction_areas(drawing_of(self._text, self._name, *self._chosen(values)).skeleton)

    def _chosen(self, values: Sequence[float]) -> tuple[int | None, dict[str, float]]:
        """Return the seed, none for the file's own, and the constants that are changed."""
        given = zip(self.parameters[1:], values[1:], self.defaults[1:], strict=True)
        changed = {name: value for name, value, default in given if value != default}
        return (int(values[0]) if values[0] != 0.0 else None), changed


class SkeletonSource(FileSource):
    """The tree of a skeleton's file, with junctions of a mode's number, and bent laterals."""

    defaults = (1.0, 0.0)

    def __init__(self, text: str, name: str) -> None:
        from pcsg.blobtree.lines import internodes

        super().__init__(text, name, ("junctions", "bend"))
        try:
            self._skeleton = internodes(parse_rows(text, name))
        except UsageError as error:
            told = str(error)
            raise UsageError(told if told.startswith(name) else f"{name}: {told}") from None

    def build(self, values: Sequence[float]) -> Field:
        from pcsg.blobtree.nodes import color
        from pcsg.blobtree.plantsettings import BARK
        from pcsg.blobtree.tree import MODES, Junctions, grow

        mode, bend = values
        if mode not in range(len(MODES)):
            known = ", ".join(f"{k} {name}" for k, name in enumerate(MODES))
            raise UsageError(f"{self._name}: junctions are {known}, not {mode:g}")
        return color(*BARK, grow(self._skeleton, Junctions(mode=MODES[int(mode)], bend=bend)))

    def junctions(self, values: Sequence[float]) -> Areas | None:
        from pcsg.blobtree.areas import junction_areas

        return junction_areas(self._skeleton)


_READ: WeakValueDictionary[tuple[object, ...], FileSource] = WeakValueDictionary()


@njit
def ray_at(p: Vec3) -> Ray:
    """Return a point as the origin of a ray, as questions about points have it."""
    return Ray(p.x, p.y, p.z, 0.0, 0.0, 0.0, 0.0, 0.0)


@njit
def ask_blob(
    asked: int,
    want: int,
    ray: Ray,
    args: Array,
    at: int,
    pool: Pool,
    out: Array,
    n: int,
    limit: int,
) -> int:
    """Ask the model of a leaf; its first integers are the address of who answers."""
    f, s, i = wide(args[at]), wide(args[at + 1]), wide(args[at + 2])
    where = join_address(pool[2][i], pool[2][i + 1])
    return ask(where, asked, want, ray, pool, f + 1, s, i + 2, out, n, limit)


@leaf
class Blob(Solid):
    """An implicit model: ``blob { ... }``, or ``blob("oak.lsys")``, the tree of a file.

    The points where a field of skeletons is 0.5 or more; see [blobtree.md](blobtree.md). The name
    of a file is relative to the grammar's. A number after that of an L-system is the seed of
    another tree of the kind. A skeleton (``.swc``, ``.json``) takes two: junctions are smooth (0),
    in contact (1, the default) or aged (2), and laterals are bent by an angle.

    In Python, ``blob(field)``, a field of `pcsg.blobtree`, or ``blob("oak.lsys")``.

    Surface coordinates: those of the primitive that contributes most, and of two that come next,
    so that pictures blend; for branches u goes round the axis, in turns, and v along it.
    """

    constants = (
        LeafConstant("model", "an expression of fields in braces, or an .lsys, .swc or .json file"),
    )
    apart = True

    @classmethod
    def read_constant(cls, text: str, folder: Path) -> BlobSource:
        from pcsg.blobtree.plant import read_text

        path = folder / text
        if path.suffix.lower() not in (".lsys", *SKELETON_ENDINGS):
            # Mistakes in models quote them: only what calls itself a model is read as one.
            raise UsageError(f"`{text}` is no model: the name of one ends in .lsys, .swc or .json")
        key: tuple[object, ...] = (path,)
        with suppress(OSError, ValueError):  # the reader tells what is wrong
            about = path.stat()
            key = path.resolve(), about.st_mtime_ns, about.st_size, text
        found = _READ.get(key)
        if found is None:
            if path.suffix.lower() in SKELETON_ENDINGS:
                found = SkeletonSource(read_skeleton_text(path), text)
            else:
                found = PlantSource(read_text(path), text)
            _READ[key] = found
        return found

    @classmethod
    def take_arguments(cls, args: Sequence[Any]) -> tuple[tuple[Constant, ...], Sequence[Any]]:
        from pcsg.blobtree.nodes import Field

        if args and isinstance(args[0], Field):
            return (FieldSource(args[0]),), args[1:]
        if args and isinstance(args[0], BlobSource):
            return (args[0],), args[1:]
        return super().take_arguments(args)

    @classmethod
    def parameters_of(cls, constants: Sequence[Constant]) -> tuple[LeafParameter, ...]:
        source = _source(constants)
        if isinstance(source, FileSource):
            given = zip(source.parameters, source.defaults, strict=True)
            return tuple(LeafParameter(name, default) for name, default in given)
        return tuple(LeafParameter(name) for name in source.parameters)

    @classmethod
    def make_model(cls, constants: Sequence[Constant], args: Sequence[float]) -> BlobModel:
        return _source(constants).model(args)

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        return ask_blob(INTERVALS, want, ray, args, at, pool, t, n, len(t))

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        out = reserve_floats(3)
        ask_blob(GRADIENT, 0, ray_at(p), args, at, pool, out, 0, 3)
        if out[0] == 0.0 and out[1] == 0.0 and out[2] == 0.0:
            return Vec3(0.0, 0.0, 1.0)
        return Vec3(-out[0], -out[1], -out[2])

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        out = reserve_floats(1)
        ask_blob(FIELD, 0, ray_at(p), args, at, pool, out, 0, 1)
        return bool(out[0] >= T)

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        out = reserve_floats(ATTRIBUTE_COLUMNS)
        ask_blob(DESCRIPTION, 0, ray_at(p), args, at, pool, out, 0, ATTRIBUTE_COLUMNS)
        return out[U], out[V]

    @staticmethod
    def other_uv(p: Vec3, args: Array, at: int, pool: Pool) -> OtherUv:
        out = reserve_floats(ATTRIBUTE_COLUMNS)
        ask_blob(DESCRIPTION, 0, ray_at(p), args, at, pool, out, 0, ATTRIBUTE_COLUMNS)
        return (
            out[OTHERS],
            out[OTHERS + 1],
            out[OTHERS + 2],
            out[OTHERS + 3],
            out[OTHERS + 4],
            out[OTHERS + 5],
        )

    @staticmethod
    def attributes(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float, float, float]:
        out = reserve_floats(ATTRIBUTE_COLUMNS)
        ask_blob(DESCRIPTION, 0, ray_at(p), args, at, pool, out, 0, ATTRIBUTE_COLUMNS)
        for k in range(ATTRIBUTE_COLUMNS):
            if math.isnan(out[k]):
                out[k] = -1.0
        # The share of bounds: bark is darker on ridges and scars.
        light = 1.0 - pool[0][wide(args[at])] * out[BOUND]
        return light * out[0], light * out[1], light * out[2], out[LABEL]


def _source(constants: Sequence[Constant]) -> BlobSource:
    (source,) = constants
    assert isinstance(source, BlobSource)
    return source
