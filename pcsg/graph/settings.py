"""Scene settings: which exist, their keys, and their defaults.

Values are constant expressions over the axiom's parameters; the renderer reads them evaluated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, TypedDict

from pcsg.errors import SourceSpan, UsageError, suggest
from pcsg.graph.expr import Expr

AUTO = "auto"
"""Written in place of a value that is found automatically."""


class ValueKind(Enum):
    """What a key takes."""

    NUMBER = "a number"
    VECTOR = "three numbers (x, y, z)"
    COLOR = "a colour: (r, g, b), linear, or a name or digits in quotes"
    STOPS = "stops ((x, colour), ...) with growing x"
    WORD = "one of the words"
    NAME = "a name"
    FILE = "the name of a file in quotes"


class FileName(str):
    """The name of a file as a grammar writes it; as a text, no more than that.

    Attributes
    ----------
    folder
        What it is relative to.
    """

    folder: str

    def __new__(cls, name: str, folder: str = "") -> FileName:
        """Return the name of a file in a folder, by default the working directory."""
        made = super().__new__(cls, name)
        made.folder = folder
        return made

    @property
    def path(self) -> Path:
        """Where the file is."""
        return Path(self.folder) / self


@dataclass(frozen=True)
class Key:
    """A key of a setting.

    Attributes
    ----------
    kind
        What it takes.
    default
        A number, a tuple of three, a word; None if automatic.
    summary
        For the reference page.
    words
        Legal words of a WORD.
    refers_to
        The kind of setting that a NAME names.
    low, high
        Legal range of numbers.
    """

    kind: ValueKind
    default: float | tuple[float, float, float] | str | None
    summary: str
    words: tuple[str, ...] = ()
    refers_to: str | None = None
    low: float = -float("inf")
    high: float = float("inf")


@dataclass(frozen=True)
class SettingKind:
    """A kind of setting: ``name { key = value; ... }``.

    Attributes
    ----------
    named
        Written ``kind NAME { ... }``.
    several
        May stand more than once.
    repeated
        May stand more than once under one name.
    """

    name: str
    summary: str
    keys: Mapping[str, Key]
    named: bool = False
    several: bool = False
    repeated: bool = False

    def __reduce__(self) -> tuple[Any, ...]:
        return setting_named, (self.name,)  # there is one of each


def setting_named(name: str) -> SettingKind:
    """Return a kind of setting by its name."""
    return SETTINGS[name]


FAR = 1e30
"""Farthest that places of a setting may be from the origin; pictures square lengths."""

BRIGHT = 1e9
"""Largest strength of light; pictures add up light in single precision."""


ANGLES = {
    "perspective": (35.0, 179.0),
    "orthographic": (35.0, 179.0),
    "fisheye": (180.0, 360.0),
    "panorama": (180.0, 180.0),
}
"""Ways to make a picture of what is around the eye: the angle of view in degrees that each has by
itself, and the largest one."""


LARGEST_COLOR = 1e6
"""Of the parts of colours; those of the attribute `color` count as no more than that."""


class _Range(TypedDict):
    low: float
    high: float


_FAR = _Range(low=-FAR, high=FAR)
_COLORS = _Range(low=0.0, high=LARGEST_COLOR)
_TURNS = _Range(low=-1e9, high=1e9)

_N, _V, _C = ValueKind.NUMBER, ValueKind.VECTOR, ValueKind.COLOR

SETTINGS = {
    kind.name: kind
    for kind in (
        SettingKind(
            "camera",
            "Where the picture is taken from.",
            {
                "eye": Key(_V, None, "place of the camera; automatic: three quarters view", **_FAR),
                "target": Key(
                    _V, None, "the point looked at; automatic: centre of the bounds", **_FAR
                ),
                "up": Key(_V, (0.0, 0.0, 1.0), "direction that is up in the picture", **_FAR),
                "projection": Key(
                    ValueKind.WORD,
                    "perspective",
                    "how what is around the eye comes into the picture",
                    words=tuple(ANGLES),
                ),
                "fov": Key(
                    _N,
                    None,
                    "vertical angle of view in degrees; automatic: 35, fisheye and panorama 180",
                    low=0.01,
                    high=360.0,
                ),
                "height": Key(
                    _N,
                    None,
                    "of an orthographic picture; automatic: what fov shows at the target",
                    low=1.0 / FAR,
                    high=FAR,
                ),
                "aperture": Key(_N, 0.0, "diameter of the lens", low=0.0, high=FAR),
                "focus": Key(
                    _N, None, "distance in focus; automatic: that of the target", low=0.0, high=FAR
                ),
            },
        ),
        SettingKind(
            "sun",
            "Light from a direction.",
            {
                "direction": Key(_V, (0.4, -0.6, 0.7), "towards the sun", **_FAR),
                "color": Key(_C, (1.0, 0.96, 0.9), "its colour", **_COLORS),
                "strength": Key(_N, 3.0, "its brightness", low=0.0, high=BRIGHT),
                "angle": Key(_N, 0.53, "its full diameter in degrees", low=0.0, high=180.0),
            },
        ),
        SettingKind(
            "light",
            "A light at a point.",
            {
                "position": Key(_V, (0.0, 0.0, 10.0), "where it is", **_FAR),
                "color": Key(_C, (1.0, 1.0, 1.0), "its colour", **_COLORS),
                "strength": Key(_N, 1.0, "its power", low=0.0, high=BRIGHT),
                "radius": Key(_N, 0.0, "its size", low=0.0, high=FAR),
            },
            several=True,
        ),
        SettingKind(
            "spot",
            "A lamp that shines into a cone.",
            {
                "position": Key(_V, (0.0, 0.0, 10.0), "where the lamp is", **_FAR),
                "target": Key(_V, (0.0, 0.0, 0.0), "the point that it is turned to", **_FAR),
                "color": Key(_C, (1.0, 1.0, 1.0), "colour of its light", **_COLORS),
                "strength": Key(_N, 1.0, "its power in the middle", low=0.0, high=BRIGHT),
                "radius": Key(_N, 0.0, "size of the lamp", low=0.0, high=FAR),
                "angle": Key(_N, 60.0, "full angle of its cone in degrees", low=0.01, high=360.0),
                "soft": Key(
                    _N,
                    0.2,
                    "part of the angle over which it fades: 0 sharp to 1",
                    low=0.0,
                    high=1.0,
                ),
            },
            several=True,
        ),
        SettingKind(
            "sky",
            "Light from all around, and the background.",
            {
                "kind": Key(
                    ValueKind.WORD,
                    "gradient",
                    "which model",
                    words=("gradient", "physical", "image", "none"),
                ),
                "zenith": Key(_C, (0.14, 0.25, 0.44), "colour overhead", **_COLORS),
                "horizon": Key(_C, (0.52, 0.60, 0.68), "colour at the horizon", **_COLORS),
                "file": Key(ValueKind.FILE, None, "picture of kind image: .hdr, .exr or .png"),
                "strength": Key(_N, 1.0, "its brightness", low=0.0, high=BRIGHT),
                "turbidity": Key(_N, 3.0, "haze of kind physical", low=1.7, high=10.0),
                "turn": Key(_N, 0.0, "degrees by which a picture is turned about z", **_TURNS),
            },
        ),
        SettingKind(
            "ground",
            "An infinite plane.",
            {
                "z": Key(_N, None, "its height; automatic: the lowest point of the scene", **_FAR),
                "material": Key(ValueKind.NAME, None, "its material", refers_to="material"),
                "haze": Key(
                    _N,
                    None,
                    "distance at which it fades into the sky; automatic: six times the target's",
                    low=1.0 / FAR,
                    high=FAR,
                ),
            },
        ),
        SettingKind(
            "fog",
            "Air that is not clear.",
            {
                "density": Key(
                    _N, 0.01, "part of the light that is lost per length", low=0.0, high=FAR
                ),
                "height": Key(
                    _N,
                    None,
                    "over which it thins to 1/e; automatic: it is the same everywhere",
                    low=1.0 / FAR,
                    high=FAR,
                ),
                "z": Key(_N, None, "where it begins to thin; automatic: the ground, or 0", **_FAR),
                "color": Key(_C, None, "its light; automatic: the sky's at the horizon", **_COLORS),
            },
        ),
        SettingKind(
            "band",
            "What surfaces do with light of some wavelengths, for `pcsg.light`.",
            {
                "material": Key(
                    ValueKind.NAME, None, "whose it is; automatic: by `label`", refers_to="material"
                ),
                "label": Key(
                    _N, None, "whose it is, where there is no material", low=0.0, high=2**31
                ),
                "reflectance": Key(
                    _N, 0.0, "share of light that is scattered back", low=0.0, high=1.0
                ),
                "transmittance": Key(_N, 0.0, "share that passes", low=0.0, high=1.0),
            },
            named=True,
            several=True,
            repeated=True,
        ),
        SettingKind(
            "material",
            "How a surface reflects light.",
            {
                "color": Key(
                    _C,
                    None,
                    "base colour, by which its texture is multiplied; automatic: (0.7, 0.7, 0.7), "
                    "and the texture as it is",
                    **_COLORS,
                ),
                "roughness": Key(_N, 0.6, "0 mirror to 1 matt", low=0.0, high=1.0),
                "metallic": Key(_N, 0.0, "0 dielectric to 1 metal", low=0.0, high=1.0),
                "specular": Key(_N, 0.5, "strength of the gloss", low=0.0, high=1.0),
                "transmission": Key(_N, 0.0, "0 opaque to 1 clear", low=0.0, high=1.0),
                "ior": Key(_N, 1.5, "index of refraction", low=1.0, high=100.0),
                "translucency": Key(_N, 0.0, "light that comes through a leaf", low=0.0, high=1.0),
                "emission": Key(_C, (0.0, 0.0, 0.0), "light given off", low=0.0, high=BRIGHT),
                "texture": Key(ValueKind.NAME, None, "its texture", refers_to="texture"),
                "relief": Key(
                    ValueKind.NAME,
                    None,
                    "texture of its relief; automatic: its texture",
                    refers_to="texture",
                ),
                "opacity": Key(
                    _N, 1.0, "part of the surface that is there: 0 none to 1", low=0.0, high=1.0
                ),
                "cutout": Key(
                    ValueKind.NAME,
                    None,
                    "texture that cuts holes: opacity of a picture, second colour of a pattern",
                    refers_to="texture",
                ),
                "bump": Key(_N, 0.0, "height of the relief", low=-1e6, high=1e6),
            },
            named=True,
            several=True,
        ),
        SettingKind(
            "texture",
            "A pattern of two colours, or a picture, that varies over a surface.",
            {
                "kind": Key(
                    ValueKind.WORD,
                    "noise",
                    "which pattern",
                    words=(
                        "noise",
                        "checker",
                        "marble",
                        "wood",
                        "bark",
                        "waves",
                        "image",
                        "normals",
                        "gradient",
                        "cells",
                    ),
                ),
                "color": Key(_C, (0.75, 0.7, 0.62), "first colour", **_COLORS),
                "color2": Key(_C, (0.35, 0.28, 0.2), "second colour", **_COLORS),
                "scale": Key(
                    _N,
                    1.0,
                    "size of the pattern in world units, of a picture in (u, v)",
                    low=1e-9,
                    high=FAR,
                ),
                "file": Key(ValueKind.FILE, None, "picture of the kinds image and normals"),
                "palette": Key(
                    ValueKind.NAME, None, "colours in place of the two", refers_to="palette"
                ),
                "along": Key(
                    ValueKind.WORD,
                    "space",
                    "what a pattern follows; a gradient also an axis or a coordinate",
                    words=("space", "uv", "x", "y", "z", "u", "v"),
                ),
                "turbulence": Key(
                    _N, 0.0, "how far a pattern is stirred, in periods", low=0.0, high=1e3
                ),
            },
            named=True,
            several=True,
        ),
        SettingKind(
            "palette",
            "A row of colours, blended between: `color(palette(NAME, x))`.",
            {
                "stops": Key(
                    ValueKind.STOPS, None, "numbers and their colours, from the first to the last"
                ),
            },
            named=True,
            several=True,
        ),
        SettingKind(
            "film",
            "How the picture is made and shown.",
            {
                "mode": Key(
                    ValueKind.WORD,
                    "preview",
                    "how light is followed",
                    words=("preview", "direct", "path"),
                ),
                "bounces": Key(_N, 8.0, "most surfaces that light meets", low=1.0, high=512.0),
                "exposure": Key(_N, 0.0, "in stops; 1 is twice as bright", low=-64.0, high=64.0),
                "view": Key(
                    ValueKind.WORD,
                    "standard",
                    "how light becomes colour",
                    words=("standard", "filmic"),
                ),
            },
        ),
    )
}


@dataclass(frozen=True, eq=False)
class Setting:
    """One setting as written.

    Attributes
    ----------
    values
        By key: one expression for a number, three for a vector, the text of a word or a name, and
        a `FileName` for a file.
    """

    kind: SettingKind
    name: str | None
    values: Mapping[str, tuple[Expr, ...] | str]
    span: SourceSpan | None = field(default=None, repr=False)


def check_value(kind: str, key: str, value: Any) -> Any:
    """Return a value that was given in Python for a key of a setting, in its proper form.

    Raises
    ------
    UsageError
        There is no such key, or the value is none for it.
    """
    keys = SETTINGS[kind].keys
    if key not in keys:
        hint = suggest(str(key), keys)
        raise UsageError(f"`{kind}` has no key `{key}`" + (f"; {hint}" if hint else ""))
    spec = keys[key]
    automatic = value is None or (isinstance(value, str) and value == AUTO)
    if automatic and spec.default is None:
        return None
    if spec.kind is ValueKind.FILE and isinstance(value, (str, Path)):
        return str(value)
    if spec.kind is ValueKind.NAME and isinstance(value, str):
        return value
    if spec.kind is ValueKind.WORD and isinstance(value, str) and value in spec.words:
        return value
    if spec.kind is ValueKind.WORD:
        raise UsageError(f"`{key}` of `{kind}` is one of {', '.join(spec.words)}, not {value!r}")
    if spec.kind in (ValueKind.NAME, ValueKind.FILE):
        raise UsageError(f"`{key}` of `{kind}` is {spec.kind.value}, not {value!r}")
    single = spec.kind is ValueKind.NUMBER
    try:
        numbers = tuple(float(x) for x in ((value,) if single else value))
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if len(numbers) != (1 if single else 3) or isinstance(value, str):
        raise UsageError(f"`{key}` of `{kind}` is {spec.kind.value}, not {value!r}")
    for x in numbers:
        if not spec.low <= x <= spec.high:
            legal = f"from {spec.low:g} to {spec.high:g}"
            raise UsageError(f"`{key}` of `{kind}` is a number {legal}, not {x:g}")
    return numbers[0] if single else numbers
