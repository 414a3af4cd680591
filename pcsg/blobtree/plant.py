"""Plants from the files of L-systems: wood with junctions, and leaves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.lsystem import LSystem
from pcsg.blobtree.lsystemfile import LARGEST_TEXT, read_lines
from pcsg.blobtree.lsystemtext import LSystemText, plain_lines, told
from pcsg.blobtree.nodes import Field, color, place, polygon, union
from pcsg.blobtree.plantsettings import Settings, read_settings
from pcsg.blobtree.tree import grow
from pcsg.blobtree.turtle import MOST_PARTS, Drawing, Pull, draw
from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, EnvironmentFault, Source, SourceSpan, UsageError
from pcsg.inputs import read_text as read_file

Array = NDArray[np.float64]

LARGEST_FILE = 4 * LARGEST_TEXT
"""Bytes of a file at most."""

MODULES_PER_PART = 20
"""A string may have this many modules for each part that a plant may have."""

MOST_CHANGED = 60
"""Constants that a user may change, the first ones of a file."""

LEAF_OUTLINE = np.array(
    [(0.0, 0.0), (0.30, -0.20), (0.62, -0.16), (1.0, 0.0), (0.62, 0.16), (0.30, 0.20)]
)
"""A leaf along x, of length 1."""


def read_text(path: Path) -> str:
    """Return the text of an L-system's file, after a look at its lines.

    Raises
    ------
    UsageError
        It cannot be read, or a line is not understood.
    """
    text = read_file(path, "L-system", LARGEST_FILE)
    _read(text, path.name, 0, {})
    return text


def lsystem_mistakes(text: str, name: str) -> list[Diagnostic]:
    """Return what is wrong with the text of an L-system, and what is worth a look."""
    found = _look(text, 0, {})[0]
    source = Source(name, plain_lines(text))
    codes = {"error": "bad-lsystem", "warning": "odd-lsystem"}
    return [
        diagnose(codes[r.severity], r.message, _line_span(source, r.line) if r.line else None)
        for r in sorted(found.remarks)
    ]


def _line_span(source: Source, number: int) -> SourceSpan:
    line = source.line(number)
    start = source.line_starts[number - 1] + len(line) - len(line.lstrip())
    return SourceSpan(source, start, start + len(line.strip()))


def numbers_of(text: str) -> dict[str, float]:
    """Return the constants of an L-system that are plain numbers: those that a user may change.

    There are none where the text cannot be read.
    """
    system = read_lines(text).system
    plain = ((name, about.number) for name, about in system.definitions.items())
    return {name: number for name, number in islice(plain, MOST_CHANGED) if number is not None}


def plant_of(
    text: str,
    name: str = "<text>",
    seed: int | None = None,
    constants: Mapping[str, float] | None = None,
) -> Field:
    """Return the field of the plant that an L-system's text describes.

    Parameters
    ----------
    constants
        Values in place of those of ``#define``.
    """
    with _told(name):
        return assemble(*_drawn(text, name, seed, constants or {}))


def drawing_of(
    text: str,
    name: str = "<text>",
    seed: int | None = None,
    constants: Mapping[str, float] | None = None,
) -> Drawing:
    """Return skeleton, leaves and polygons of the plant; arguments as for `plant_of`."""
    with _told(name):
        return _drawn(text, name, seed, constants or {})[0]


@contextmanager
def _told(name: str) -> Iterator[None]:
    try:
        yield
    except UsageError as error:
        told_already = str(error)
        if told_already.startswith(name):
            raise
        raise UsageError(f"{name}: {told_already}") from None
    except (ArithmeticError, ValueError) as error:
        raise UsageError(f"{name}: a number cannot be computed: {error}") from None
    except MemoryError:
        raise EnvironmentFault(f"{name}: not enough memory for its string") from None


def _look(
    text: str, seed: int, constants: Mapping[str, float]
) -> tuple[LSystemText, Settings | None]:
    """Return what a text says, with all that is wrong, and its settings if they are right."""
    found = read_lines(text, seed, constants)
    settings = read_settings(found)
    if settings is not None and settings.most is not None:
        found.system.most = max(found.system.most, MODULES_PER_PART * settings.most)
    return found, settings


def _read(
    text: str, name: str, seed: int, constants: Mapping[str, float]
) -> tuple[LSystem, Settings]:
    found, settings = _look(text, seed, constants)
    mistakes = found.mistakes()
    if mistakes or settings is None:
        raise UsageError(told(mistakes, text, name))
    return found.system, settings


def _drawn(
    text: str, name: str, seed: int | None, constants: Mapping[str, float]
) -> tuple[Drawing, Settings]:
    system, settings = _read(text, name, 0 if seed is None else seed, constants)
    if seed is None and settings.seed is not None:
        system, settings = _read(text, name, settings.seed, constants)
    said = system.constants.get
    most = MOST_PARTS if settings.most is None else settings.most
    pull = Pull(said("elasticity", 0.0), settings.tropism)
    string = system.interpret(system.derive())
    drawing = draw(
        string, said("angle", 30.0), said("width", 0.1), said("thinning", 0.7), most, pull
    )
    return drawing, settings


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
