"""Settings of plants: the lines ``name: value`` of an L-system."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from pcsg.blobtree.constants import CONSTANTS, constant_called
from pcsg.blobtree.lsystemtext import LSystemText
from pcsg.blobtree.tree import CONTACT, Colour, Junctions
from pcsg.blobtree.turtle import DOWN
from pcsg.errors import UsageError, suggest

BARK = (0.23, 0.17, 0.12)
LEAF = (0.16, 0.30, 0.06)


@dataclass(frozen=True)
class Settings:
    """What the lines ``name: value`` of an L-system say.

    Attributes
    ----------
    bark, leaves
        Linear colours, one after the other as the turtle's ``'`` counts.
    tropism
        Where internodes are pulled to.
    seed, most
        None where it is not given: of the chance; internodes, leaves and triangles at most.
    """

    junctions: Junctions
    bark: tuple[Colour, ...]
    leaves: tuple[Colour, ...]
    thickness: float
    tropism: tuple[float, float, float]
    seed: int | None
    most: int | None


SETTINGS = (
    *("junctions", "bark", "leaves", "bend", "tip", "printed", "seed", "thickness", "most"),
    "tropism",
)

LARGEST = 1e6
"""Of parts of other sizes."""

MOST = 1_000_000
"""Parts that a file may allow."""

T = TypeVar("T")


def read_settings(text: LSystemText) -> Settings | None:
    """Return the settings of an L-system; None after complaints about its lines."""
    before = len(text.mistakes())
    for name, (_, line) in text.settings.items():
        if name not in SETTINGS:
            text.complain(line, _unknown(name, text.settings[name][0]))

    def get(name: str, default: T, read: Callable[[str, str], T]) -> T:
        if name not in text.settings:
            return default
        value, line = text.settings[name]
        try:
            return read(name, value)
        except UsageError as error:
            text.complain(line, str(error))
            return default

    junctions = Junctions(
        mode=get("junctions", CONTACT, _mode),
        bend=get("bend", 0.0, _number),
        tip=get("tip", 0.3, _positive),
        printed=get("printed", 0.0, _number) != 0.0,
    )
    settings = Settings(
        junctions,
        get("bark", (BARK,), _colours),
        get("leaves", (LEAF,), _colours),
        get("thickness", 0.012, _positive),
        get("tropism", DOWN, _direction),
        get("seed", None, _whole),
        get("most", None, _few),
    )
    return settings if len(text.mistakes()) == before else None


def _unknown(name: str, value: str) -> str:
    if constant := constant_called(name):
        return f"`{name}` is no setting; write `#define {constant} {value}`"
    hint = suggest(name, SETTINGS) or suggest(name, CONSTANTS)
    known = hint or f"there are {', '.join(SETTINGS)}"
    return f"unknown setting `{name}`; {known}"


def _mode(name: str, text: str) -> str:
    return Junctions(mode=text).mode


def _number(name: str, text: str) -> float:
    found = _numbers(text)
    if len(found) != 1:
        raise UsageError(f"`{name}:` takes a number, not `{text}`")
    return found[0]


def _positive(name: str, text: str) -> float:
    found = _number(name, text)
    if not 0.0 < found <= LARGEST:
        raise UsageError(f"`{name}:` takes a number above 0 and up to {LARGEST:g}, not `{text}`")
    return found


def _whole(name: str, text: str) -> int | None:
    found = _number(name, text)
    if not 0.0 <= found < 2.0**53 or found != int(found):
        raise UsageError(f"`{name}:` takes a whole number from 0, not `{text}`")
    return int(found)


def _direction(name: str, text: str) -> tuple[float, float, float]:
    found = _numbers(text)
    if len(found) != 3 or not 0.0 < max(map(abs, found)) <= LARGEST:
        raise UsageError(f"`{name}:` takes three numbers, where to: `0 0 -1`, not `{text}`")
    return found[0], found[1], found[2]


def _few(name: str, text: str) -> int | None:
    found = _whole(name, text)
    if found is not None and found > MOST:
        raise UsageError(f"`{name}:` allows up to {MOST:,} parts, not {found:,}")
    return found


def _colours(name: str, text: str) -> tuple[Colour, ...]:
    found = _numbers(text)
    if not found or len(found) % 3:
        raise UsageError(f"`{name}:` takes three numbers for each colour, not `{text}`")
    return tuple((found[k], found[k + 1], found[k + 2]) for k in range(0, len(found), 3))


def _numbers(text: str) -> tuple[float, ...]:
    """Return the numbers in a text, none if anything else is there."""
    try:
        found = tuple(float(v) for v in text.replace(",", " ").split())
    except ValueError:
        return ()
    return found if all(map(math.isfinite, found)) else ()
