"""Plants from the files of L-systems: wood with junctions, and leaves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.lsystem import LSystem, read_lsystem
from pcsg.blobtree.nodes import Field, color, place, polygon, union
from pcsg.blobtree.tree import Colour, Junctions, grow
from pcsg.blobtree.turtle import Drawing, draw
from pcsg.errors import EnvironmentFault, UsageError

Array = NDArray[np.float64]

BARK = (0.23, 0.17, 0.12)
LEAF = (0.16, 0.30, 0.06)

LEAF_OUTLINE = np.array(
    [(0.0, 0.0), (0.30, -0.20), (0.62, -0.16), (1.0, 0.0), (0.62, 0.16), (0.30, 0.20)]
)
"""A leaf along x, of length 1."""

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
    read_lsystem(text, path.name)
    return text


def plant_of(text: str, name: str = "<text>", seed: int | None = None) -> Field:
    """Return the field of the plant that an L-system's text describes."""
    with _told(name):
        return assemble(*_drawn(text, name, seed), name)


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


def _drawn(text: str, name: str, seed: int | None) -> tuple[Drawing, LSystem]:
    system = read_lsystem(text, name, 0 if seed is None else seed)
    unknown = [s for s in system.settings if s not in SETTINGS]
    if unknown:
        raise UsageError(f"unknown setting `{unknown[0]}`; there are {', '.join(SETTINGS)}")
    if seed is None and "seed" in system.settings:
        system = read_lsystem(text, name, int(_numbers(system, name, "seed", (0.0,))[0]))
    angle, width = system.constants.get("angle", 30.0), system.constants.get("width", 0.1)
    return draw(system.derive(), angle, width), system


def _numbers(
    system: LSystem, name: str, setting: str, default: tuple[float, ...]
) -> tuple[float, ...]:
    text = system.settings.get(setting)
    if text is None:
        return default
    try:
        values = tuple(float(v) for v in text.replace(",", " ").split())
    except ValueError:
        values = ()
    if len(values) != len(default):
        raise UsageError(f"{name}: `{setting}:` takes {len(default)} number(s), not `{text}`")
    return values


def _colours(system: LSystem, name: str, setting: str, default: Colour) -> list[Colour]:
    """Return the colours of a setting, one after the other as the turtle's ``'`` counts."""
    text = system.settings.get(setting)
    if text is None:
        return [default]
    count = len(text.replace(",", " ").split())
    if count == 0 or count % 3:
        raise UsageError(f"{name}: `{setting}:` takes three numbers for each colour, not `{text}`")
    values = _numbers(system, name, setting, (0.0,) * count)
    return [(values[k], values[k + 1], values[k + 2]) for k in range(0, count, 3)]


def assemble(drawing: Drawing, system: LSystem, name: str = "<text>") -> Field:
    """Return wood and leaves of what a turtle has drawn."""
    parts: list[Field] = []
    if len(drawing.skeleton.base):
        junctions = Junctions(
            mode=system.settings.get("junctions", "contact").strip(),
            bend=_numbers(system, name, "bend", (0.0,))[0],
            tip=_numbers(system, name, "tip", (0.3,))[0],
            printed=bool(_numbers(system, name, "printed", (0.0,))[0]),
        )
        parts.append(grow(drawing.skeleton, junctions, _colours(system, name, "bark", BARK)))
    palette = _colours(system, name, "leaves", LEAF)
    thickness = _numbers(system, name, "thickness", (0.012,))[0]
    blades: list[list[Field]] = [[] for _ in palette]
    last = len(palette) - 1
    for at, frame, size, number in zip(*drawing.leaves, strict=True):
        if size > 0.0:
            blades[min(int(number), last)].append(_leaf(at, frame, size, thickness))
    for corners, number in drawing.polygons:
        blades[min(number, last)] += _sheets(corners, thickness)
    parts += [color(*c, union(*some)) for c, some in zip(palette, blades, strict=True) if some]
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
