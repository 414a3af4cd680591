"""Plants from the files of L-systems: wood with junctions, and leaves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.lsystem import LSystem, read_lsystem
from pcsg.blobtree.nodes import Field, color, place, polygon, union
from pcsg.blobtree.tree import CONTACT, Colour, Junctions, grow
from pcsg.blobtree.turtle import Drawing, draw
from pcsg.errors import EnvironmentFault, UsageError, suggest

Array = NDArray[np.float64]

BARK = (0.23, 0.17, 0.12)
LEAF = (0.16, 0.30, 0.06)

LEAF_OUTLINE = np.array(
    [(0.0, 0.0), (0.30, -0.20), (0.62, -0.16), (1.0, 0.0), (0.62, 0.16), (0.30, 0.20)]
)
"""A leaf along x, of length 1."""


@dataclass(frozen=True)
class Settings:
    """What the lines ``name: value`` of an L-system say.

    Attributes
    ----------
    bark, leaves
        Linear colours, one after the other as the turtle's ``'`` counts.
    seed
        None where it is not given.
    """

    junctions: Junctions
    bark: tuple[Colour, ...]
    leaves: tuple[Colour, ...]
    thickness: float
    seed: int | None


SETTINGS = ("junctions", "bark", "leaves", "bend", "tip", "printed", "seed", "thickness")


def read_plain(path: Path) -> str:
    """Return the text of a file that a grammar names.

    Raises
    ------
    UsageError
        It cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise UsageError(f"there is no file `{path.name}`") from None
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"cannot read `{path.name}`: {error}") from None


def read_text(path: Path) -> str:
    """Return the text of an L-system's file, after a look at its lines.

    Raises
    ------
    UsageError
        It cannot be read, or a line is not understood.
    """
    text = read_plain(path)
    with _told(path.name):
        read_settings(read_lsystem(text, path.name))
    return text


def plant_of(text: str, name: str = "<text>", seed: int | None = None) -> Field:
    """Return the field of the plant that an L-system's text describes."""
    with _told(name):
        return assemble(*_drawn(text, name, seed))


def drawing_of(text: str, name: str = "<text>", seed: int | None = None) -> Drawing:
    """Return skeleton, leaves and polygons of the plant that an L-system's text describes."""
    with _told(name):
        return _drawn(text, name, seed)[0]


@contextmanager
def _told(name: str) -> Iterator[None]:
    try:
        yield
    except UsageError as error:
        told = str(error)
        raise UsageError(told if told.startswith(name) else f"{name}: {told}") from None
    except (ArithmeticError, ValueError) as error:
        raise UsageError(f"{name}: a number cannot be computed: {error}") from None
    except MemoryError:
        raise EnvironmentFault(f"{name}: not enough memory for its string") from None


def _drawn(text: str, name: str, seed: int | None) -> tuple[Drawing, Settings]:
    system = read_lsystem(text, name, 0 if seed is None else seed)
    settings = read_settings(system)
    if seed is None and settings.seed is not None:
        system = read_lsystem(text, name, settings.seed)
    angle, width = system.constants.get("angle", 30.0), system.constants.get("width", 0.1)
    return draw(system.derive(), angle, width), settings


def read_settings(system: LSystem) -> Settings:
    """Return the settings of an L-system.

    Raises
    ------
    UsageError
        One is not known, or its value is not what it takes.
    """
    for name in system.settings:
        if name not in SETTINGS:
            hint = suggest(name, SETTINGS)
            known = hint or f"there are {', '.join(SETTINGS)}"
            raise UsageError(f"unknown setting `{name}`; {known}")

    def number(name: str, default: float) -> float:
        text = system.settings.get(name)
        found = (default,) if text is None else _numbers(text)
        if len(found) != 1:
            raise UsageError(f"`{name}:` takes a number, not `{text}`")
        return found[0]

    def colours(name: str, default: Colour) -> tuple[Colour, ...]:
        text = system.settings.get(name)
        found = default if text is None else _numbers(text)
        if not found or len(found) % 3:
            raise UsageError(f"`{name}:` takes three numbers for each colour, not `{text}`")
        return tuple((found[k], found[k + 1], found[k + 2]) for k in range(0, len(found), 3))

    junctions = Junctions(
        mode=system.settings.get("junctions", CONTACT),
        bend=number("bend", 0.0),
        tip=number("tip", 0.3),
        printed=number("printed", 0.0) != 0.0,
    )
    return Settings(
        junctions,
        colours("bark", BARK),
        colours("leaves", LEAF),
        number("thickness", 0.012),
        int(number("seed", 0.0)) if "seed" in system.settings else None,
    )


def _numbers(text: str) -> tuple[float, ...]:
    """Return the numbers in a text, none if anything else is there."""
    try:
        found = tuple(float(v) for v in text.replace(",", " ").split())
    except ValueError:
        return ()
    return found if all(map(math.isfinite, found)) else ()


def assemble(drawing: Drawing, settings: Settings) -> Field:
    """Return wood and leaves of what a turtle has drawn."""
    parts: list[Field] = []
    if len(drawing.skeleton.base):
        parts.append(grow(drawing.skeleton, settings.junctions, settings.bark))
    blades: list[list[Field]] = [[] for _ in settings.leaves]
    last = len(blades) - 1
    for at, frame, size, number in zip(*drawing.leaves, strict=True):
        if size > 0.0:
            blades[min(int(number), last)].append(_leaf(at, frame, size, settings.thickness))
    for corners, number in drawing.polygons:
        blades[min(number, last)] += _sheets(corners, settings.thickness)
    parts += [
        color(*c, union(*some)) for c, some in zip(settings.leaves, blades, strict=True) if some
    ]
    if not parts:
        raise UsageError("it draws nothing")
    return parts[0] if len(parts) == 1 else union(*parts)


def _leaf(at: Array, frame: Array, size: float, thickness: float) -> Field:
    matrix = np.concatenate([size * frame, at[:, None]], axis=1)
    return place(matrix, polygon(LEAF_OUTLINE, thickness))


def _sheets(corners: Array, thickness: float) -> list[Field]:
    """Return triangles that fill a polygon whose corners see its first one."""
    out: list[Field] = []
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    for b, c in pairwise(corners[1:]):
        a = corners[0]
        u = b - a
        normal = np.cross(u, c - a)
        area = float(np.linalg.norm(normal))
        if area < 1e-9 * size * size:
            continue
        x, z = u / np.linalg.norm(u), normal / area
        frame = np.stack([x, np.cross(z, x), z, a], axis=1)
        flat = [(0.0, 0.0), (float(u @ x), 0.0), (float((c - a) @ x), float((c - a) @ frame[:, 1]))]
        out.append(place(frame, polygon(flat, thickness * size)))
    return out
