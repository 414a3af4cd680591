"""What a page wants to see, read from the messages that it sends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pcsg.errors import UsageError
from pcsg.graph.settings import check_value
from pcsg.graph.words import is_name

LARGEST_SIDE = 4096
"""Of a picture, in pixels."""

MOST_VALUES = 1000
"""Parameters that a page may set."""

MOST_SAMPLES = 4096

LARGEST_DRAFT = 1 << 20

LAYERS = ("picture", "depth", "normal", "albedo", "label", "leaf")
"""What a page may look at."""

_CAMERA = ("eye", "target", "up", "fov", "projection", "height")


@dataclass(frozen=True)
class Want:
    """The picture that a page wants.

    Attributes
    ----------
    values
        In place of those that the axiom assigns; SEED and TIME.
    camera
        Keys of the setting; empty for the grammar's own.
    size
        Width and height in pixels.
    moving
        Whether the picture has to be there at once, however coarse.
    mode
        How light is followed; None as the grammar says.
    layer
        One of `LAYERS`.
    samples
        Most samples per pixel.
    number
        The page's own, by which it knows the answer.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    camera: Mapping[str, Any] = field(default_factory=dict)
    size: tuple[int, int] = (640, 480)
    moving: bool = False
    mode: str | None = None
    layer: str = "picture"
    samples: int = 16
    number: int = 0


def read_want(data: Mapping[str, Any]) -> Want:
    """Return what a message asks for.

    Raises
    ------
    UsageError
        It is none that can be shown.
    """
    camera = data.get("camera") or {}
    if not isinstance(camera, Mapping) or not set(camera) <= set(_CAMERA):
        raise UsageError(f"a camera has the keys {', '.join(_CAMERA)}")
    mode, layer = data.get("mode"), data.get("layer", "picture")
    if mode is not None:
        check_value("film", "mode", mode)
    if layer not in LAYERS:
        raise UsageError(f"a layer is one of {', '.join(LAYERS)}")
    return Want(
        values=read_values(data.get("values") or {}),
        camera={key: check_value("camera", key, value) for key, value in camera.items()},
        size=read_size(data.get("size")),
        moving=data.get("moving") is True,
        mode=mode,
        layer=layer,
        samples=_whole(data.get("samples", 16), "samples", 1, MOST_SAMPLES),
        number=_whole(data.get("number", 0), "number", 0, 2**53),
    )


@dataclass(frozen=True)
class Question:
    """A click: a place in a picture, from (0, 0) to (1, 1), and which picture."""

    want: Want
    place: tuple[float, float]


def read_question(data: Mapping[str, Any]) -> Question:
    """Return what a click asks for; errors as for `read_want`."""
    return Question(read_want({**data, "type": "want"}), read_place(data))


MOST_TILES = 64


@dataclass(frozen=True)
class SheetWant:
    """A sheet of small pictures: the values of one parameter, all else as wanted."""

    want: Want
    name: str
    steps: tuple[float, ...]


def read_sheet(data: Mapping[str, Any]) -> SheetWant:
    """Return the sheet that is asked for; errors as for `read_want`."""
    name, steps = data.get("name"), data.get("steps")
    if not isinstance(name, str) or not isinstance(steps, list) or len(steps) > MOST_TILES:
        raise UsageError("a sheet has the name of a parameter and up to 64 values")
    values = [read_values({name: step})[name] for step in steps]
    return SheetWant(read_want(data), name, tuple(values))


def read_draft(data: Mapping[str, Any]) -> str:
    """Return a text that is to be shown before it is saved; errors as for `read_want`."""
    text = data.get("text")
    if not isinstance(text, str) or len(text) > LARGEST_DRAFT:
        raise UsageError(f"a draft is a text of at most {LARGEST_DRAFT >> 20} MB")
    return text


def read_values(data: Any) -> dict[str, float]:
    """Return values of parameters by their names; errors as for `read_want`."""
    if not isinstance(data, Mapping) or len(data) > MOST_VALUES:
        raise UsageError("values are numbers by the names of parameters")
    values = {}
    for name, value in data.items():
        good = isinstance(value, int | float) and not isinstance(value, bool)
        if not (is_name(name) and good and abs(value) <= 1e300):
            raise UsageError(f"the value of `{str(name)[:40]}` is no number")
        values[name] = float(value)
    return values


def read_size(data: Any) -> tuple[int, int]:
    """Return width and height; errors as for `read_want`."""
    if not isinstance(data, list | tuple) or len(data) != 2:
        raise UsageError("a size is width and height in pixels")
    width, height = (_whole(side, "a side of the picture", 1, LARGEST_SIDE) for side in data)
    return width, height


def read_place(data: Mapping[str, Any]) -> tuple[float, float]:
    """Return a place in the picture, from (0, 0) to (1, 1); errors as for `read_want`."""
    x, y = data.get("x"), data.get("y")
    for v in (x, y):
        if not isinstance(v, int | float) or not math.isfinite(v) or not 0.0 <= v <= 1.0:
            raise UsageError("a place in the picture is x and y from 0 to 1")
    return float(x), float(y)  # type: ignore[arg-type]  # the loop has looked at them


def _whole(value: Any, what: str, low: int, high: int) -> int:
    good = isinstance(value, int | float) and not isinstance(value, bool) and value == value
    if not (good and low <= value <= high):
        raise UsageError(f"{what} lies between {low} and {high}")
    return int(value + 0.5)
