"""Species: the numbers and curves of a growing tree, from JSON files.

The fields of the classes are the keys of a file, with their defaults (*Populus deltoides*) and
their ranges; a new key is one line here.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, GrammarError, SourceSpan, UsageError, suggest
from pcsg.growth.curves import KINDS, Curve
from pcsg.growth.document import Located, read_json
from pcsg.inputs import read_text


def _number(default: float, low: float, high: float, unit: str = "") -> Any:
    return field(default=default, metadata={"low": low, "high": high, "unit": unit})


def _span(low: float, high: float) -> Any:
    return field(default=(low, high), metadata={"low": 0.0, "high": 1.0, "pair": True})


@dataclass(frozen=True)
class Angles:
    """Branching angles in degrees: of short and long shoots, sagging with size; noise."""

    short: float = _number(80.0, 0.0, 180.0)
    long: float = _number(35.0, 0.0, 180.0)
    sag: float = _number(25.0, -90.0, 90.0)
    tropism: float = _number(0.35, 0.0, 1.0)
    noise: float = _number(3.0, 0.0, 45.0)
    azimuth_noise: float = _number(8.0, 0.0, 90.0)


@dataclass(frozen=True)
class Radius:
    """How thick limbs are, by the distance from the tip; `cap` bounds it by the bearer's."""

    rule: str = field(default="distance", metadata={"words": ("distance", "pipe")})
    r_tip: float = _number(0.0015, 1e-5, 1.0, "m")
    k: float = _number(0.0085, 0.0, 10.0)
    p: float = _number(1.12, 0.1, 4.0)
    cap: float = _number(0.8, 0.01, 1.0)


@dataclass(frozen=True)
class Season:
    """When things happen in the year, from winter (0) to winter (1)."""

    burst: float = _number(0.25, 0.0, 1.0)
    grow_end: float = _number(0.65, 0.0, 1.0)
    metamer: float = _number(0.45, 0.01, 1.0)
    leaf_end: float = _number(0.70, 0.0, 1.0)
    unfold: float = _number(0.25, 0.01, 1.0)
    colour: tuple[float, float] = _span(0.70, 0.82)
    fall: tuple[float, float] = _span(0.76, 0.90)
    buds: tuple[float, float] = _span(0.65, 0.75)
    shed: tuple[float, float] = _span(0.80, 1.0)
    evergreen: float = _number(0.0, 0.0, 10.0, "years")


@dataclass(frozen=True)
class LeafForm:
    """Leaves: blade and petiole in metres, angles in degrees."""

    length: float = _number(0.10, 0.0, 10.0, "m")
    width: float = _number(0.9, 0.01, 4.0)
    petiole: float = _number(0.05, 0.0, 10.0, "m")
    angle: float = _number(50.0, 0.0, 180.0)
    droop: float = _number(20.0, -90.0, 90.0)
    form: str = field(default="deltoid", metadata={"words": ("deltoid", "oval", "needle")})
    green: tuple[float, float, float] = field(default=(0.21, 0.37, 0.08), metadata={"rgb": True})
    autumn: tuple[float, float, float] = field(default=(0.80, 0.55, 0.06), metadata={"rgb": True})


@dataclass(frozen=True)
class Bud:
    """Buds: length in metres."""

    length: float = _number(0.012, 0.0, 1.0, "m")


@dataclass(frozen=True)
class Scar:
    """Bud scale scars: greatest amplitude, radius over the limb's, reach over the first year's."""

    amplitude: float = _number(0.9, 0.0, 0.9)
    radius: float = _number(1.2, 0.1, 4.0)
    reach: float = _number(1.0, 0.05, 4.0)
    lost: int = field(default=2, metadata={"low": 0, "high": 20})


@dataclass(frozen=True)
class Ridge:
    """Branch bark ridges: greatest amplitude, half length and reach over the radii."""

    amplitude: float = _number(0.9, 0.0, 0.9)
    length: float = _number(0.9, 0.1, 4.0)
    reach: float = _number(0.8, 0.05, 4.0)


@dataclass(frozen=True)
class Bark:
    """Colour of old and of young bark, linear red, green, blue."""

    old: tuple[float, float, float] = field(default=(0.23, 0.20, 0.16), metadata={"rgb": True})
    young: tuple[float, float, float] = field(default=(0.28, 0.24, 0.13), metadata={"rgb": True})


SEEDS = 2**53
"""Largest random seed: grammars give numbers in double precision."""

LARGEST_FILE = 2**20
"""Bytes of a file at most."""

CURVES: dict[str, tuple[tuple[float, float], ...]] = {
    "G_h": ((0, 0), (0.1, 0.10), (0.25, 0.32), (0.5, 0.64), (0.75, 0.86), (1, 1)),
    "G_s1": ((0, 0.16), (0.3, 0.20), (0.6, 0.18), (0.85, 0.12), (1, 0.05)),
    "G_s2": ((0, 0.48), (0.2, 0.52), (0.45, 0.47), (0.7, 0.33), (0.88, 0.17), (1, 0.04)),
    "G_bs": ((0, 0.80), (0.15, 0.95), (0.35, 1), (0.8, 1), (1, 0.92)),
    "G_ss": ((0, 0), (0.25, 0.103), (0.5, 0.327), (0.75, 0.619), (0.9, 0.783), (1, 0.86)),
    "G_a": (
        *((0, 1), (0.3, 1), (0.4, 2.2), (0.5, 3.9), (0.6, 6.6), (0.7, 12.1)),
        *((0.78, 19.8), (0.84, 26), (1, 40)),
    ),
    "G_m": ((0, 2), (0.05, 2.4), (0.15, 5.3), (0.35, 11), (0.7, 15), (1, 21)),
    "G_l": ((0, 0.35), (0.2, 0.8), (0.55, 1), (0.85, 0.8), (1, 0.45)),
    "G_o1": ((0, 0), (0.3, 4), (0.6, 12), (1, 28)),
    "G_o2": ((0, -2), (0.2, -13), (0.45, -11), (0.7, 4), (1, 30)),
}
"""Curves of a species and their defaults; headings in degrees, G_a in years, others are shares."""

LEAST_STEP = 1e-6
"""Between the points of a curve: nearer ones would make it a jump."""

STEPS = ("g_int", "g_leaf", "g_bud", "g_fall", "g_col")
"""Growth curves within a year, from (0, 0) to (1, 1); the step of fifth order by default."""

_CURVE_RANGES = {"G_o1": (-360.0, 360.0), "G_o2": (-360.0, 360.0), "G_a": (0.0, 1e4)}


def curve_range(name: str) -> tuple[float, float]:
    """Return the least and the greatest y of a curve."""
    return _CURVE_RANGES.get(name, (0.0, 1e3))


@dataclass(frozen=True)
class Species:
    """A species; lengths in metres.

    Attributes
    ----------
    curves
        `CURVES` and `STEPS`, by name; a step that is not given is missing.
    """

    species: str = field(default="populus_deltoides", metadata={"text": True})
    seed: int = field(default=1, metadata={"low": 0, "high": SEEDS})
    ymax: int = field(default=27, metadata={"low": 1, "high": 500})
    trunk_scale: float = _number(22.0, 1e-3, 1e4, "m")
    lmin: float = _number(0.02, 1e-6, 10.0, "m")
    smin: float = _number(0.367, 1e-3, 100.0)
    lsmax: float = _number(1.3, 1e-4, 1e3, "m")
    lmax: float = _number(12.0, 1e-3, 1e4, "m")
    order_max: int = field(default=7, metadata={"low": 0, "high": 20})
    phyllotaxis: float = _number(137.5, 0.0, 360.0, "degrees")
    min_separation: float = _number(40.0, 0.0, 90.0, "degrees")
    curves: Mapping[str, Curve] = field(default_factory=lambda: default_curves())
    angles: Angles = field(default_factory=Angles)
    radius: Radius = field(default_factory=Radius)
    season: Season = field(default_factory=Season)
    leaf: LeafForm = field(default_factory=LeafForm)
    bud: Bud = field(default_factory=Bud)
    scar: Scar = field(default_factory=Scar)
    ridge: Ridge = field(default_factory=Ridge)
    bark: Bark = field(default_factory=Bark)

    def to_json(self) -> str:
        """Return the species as the text of a file."""
        data = dataclasses.asdict(dataclasses.replace(self, curves={}))
        data["curves"] = {
            name: {"type": curve.kind, "points": [list(p) for p in curve.points]}
            for name, curve in self.curves.items()
        }
        return _pretty(data)


def default_curves() -> dict[str, Curve]:
    """Return the curves of *Populus deltoides*."""
    return {name: Curve.make(points) for name, points in CURVES.items()}


def shipped() -> tuple[str, ...]:
    """Return the names of the species that come with the package."""
    folder = resources.files("pcsg.growth") / "data"
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".json")))


def load_species(what: str | Path) -> Species:
    """Return a species from a file, or a shipped one by its name.

    Raises
    ------
    GrammarError
        Mistakes in the file, all at once.
    UsageError
        There is no such file or name.
    """
    name, text = species_text(what)
    return read_species(text, name)


def species_text(what: str | Path) -> tuple[str, str]:
    """Return the name and the text of a species' file, or of a shipped one.

    Raises
    ------
    UsageError
        There is no such file or name.
    """
    name = str(what)
    if name in shipped():
        file = resources.files("pcsg.growth") / "data" / f"{name}.json"
        return f"{name}.json", file.read_text("utf-8")
    if not Path(what).exists():
        hint = suggest(Path(name).name, shipped())
        known = f"there is no file `{name}`, and the species that come along are "
        raise UsageError(f"{known}{', '.join(shipped())}" + (f"; {hint}" if hint else ""))
    return name, read_text(what, "species", LARGEST_FILE)


def read_species(text: str, name: str = "<text>") -> Species:
    """Return a species from the text of a file.

    Raises
    ------
    GrammarError
        Mistakes, all at once.
    """
    reader = _Reader()
    data = read_json(text, name)
    found: Species = reader.read(Species, data)
    if not reader.problems:
        reader.check(found, data)
    if reader.problems:
        raise GrammarError(reader.problems)
    return found


class _Reader:
    """Reads dataclasses from located values and collects what is wrong."""

    def __init__(self) -> None:
        self.problems: list[Diagnostic] = []

    def complain(
        self, message: str, span: SourceSpan, expected: str, hint: str | None = None
    ) -> None:
        self.problems.append(diagnose("bad-species", message, span, expected=expected, hint=hint))

    def read(self, kind: Any, data: Located) -> Any:
        if not isinstance(data.value, dict):
            self.complain("this is no object", data.span, "`{ ... }` with keys")
            return kind()
        fields = {f.name: f for f in dataclasses.fields(kind)}
        values = {}
        for key, located in data.value.items():
            if key not in fields:
                self._unknown(key, data.keys[key], fields)
            elif key == "curves":
                values[key] = self._curves(located)
            elif dataclasses.is_dataclass(default := _default(fields[key])):
                values[key] = self.read(type(default), located)
            else:
                good, value = self._value(key, fields[key], located)
                if good:
                    values[key] = value
        return kind(**values)

    def _unknown(self, key: str, span: SourceSpan, known: Mapping[str, Any]) -> None:
        self.complain(
            f"there is no key `{key}`", span, f"one of {', '.join(known)}", suggest(key, known)
        )

    def _value(self, key: str, about: Any, data: Located) -> tuple[bool, Any]:
        facts, value = about.metadata, data.value
        if "text" in facts:
            good, expected = isinstance(value, str), "a text"
        elif "words" in facts:
            good, expected = value in facts["words"], f"one of {', '.join(facts['words'])}"
        elif "rgb" in facts:
            value = data.plain()
            good = (
                isinstance(value, list) and len(value) == 3 and all(_within(x, 0, 1) for x in value)
            )
            expected = "three numbers from 0 to 1: red, green, blue"
            value = tuple(value) if good else value
        elif "pair" in facts:
            value = data.plain()
            good = (
                isinstance(value, list) and len(value) == 2 and all(_within(x, 0, 1) for x in value)
            )
            good = good and value[0] < value[1]
            expected = "two numbers from 0 to 1, the earlier one first"
            value = tuple(map(float, value)) if good else value
        else:
            low, high, whole = facts["low"], facts["high"], isinstance(about.default, int)
            good = _within(value, low, high) and (not whole or value == int(value))
            unit = f" {facts['unit']}" if facts.get("unit") else ""
            expected = f"{'a whole' if whole else 'a'} number from {low:g} to {high:g}{unit}"
            value = (int(value) if whole else float(value)) if good else value
        if not good:
            self.complain(f"this cannot be `{key}`", data.span, expected)
        return good, value

    def _curves(self, data: Located) -> dict[str, Curve]:
        curves = default_curves()
        if not isinstance(data.value, dict):
            self.complain("this is no object", data.span, "`{ ... }` with curves by name")
            return curves
        for name, located in data.value.items():
            if name not in CURVES and name not in STEPS:
                self._unknown(name, data.keys[name], dict.fromkeys([*CURVES, *STEPS]))
            elif (curve := self._curve(name, located)) is not None:
                curves[name] = curve
        return curves

    def _curve(self, name: str, data: Located) -> Curve | None:
        before = len(self.problems)
        shape = '`{"type": "pchip", "points": [[0, ...], ..., [1, ...]]}`'
        if not isinstance(data.value, dict) or "points" not in data.value:
            self.complain(f"this is no curve `{name}`", data.span, shape)
            return None
        for key in data.value.keys() - {"type", "points"}:
            self._unknown(key, data.keys[key], {"type": 0, "points": 0})
        kind: Any = data.value["type"].plain() if "type" in data.value else "pchip"
        if kind not in KINDS:
            self.complain("no such type", data.value["type"].span, f"one of {', '.join(KINDS)}")
        points = data.value["points"]
        low, high = curve_range(name)
        if not isinstance(points.value, list) or len(points.value) < 2:
            self.complain(f"`{name}` needs two points at least", points.span, shape)
            return None
        last = -math.inf
        for k, point in enumerate(points.value):
            pair = point.plain()
            if not (isinstance(pair, list) and len(pair) == 2 and all(_is_number(v) for v in pair)):
                self.complain("this is no point", point.span, "a pair of numbers `[x, y]`")
                continue
            x, y = pair
            at_end = k in (0, len(points.value) - 1)
            if at_end and x != (1.0 if k else 0.0):
                self.complain(
                    f"the {'last' if k else 'first'} point is not at x = {1 if k else 0}",
                    point.span,
                    "curves reach from 0 to 1",
                )
            elif x < last + LEAST_STEP:
                self.complain("x does not increase", point.span, f"x above {last + LEAST_STEP:g}")
            if not low <= y <= high:
                self.complain(
                    f"y of `{name}` is out of range", point.span, f"from {low:g} to {high:g}"
                )
            if name in STEPS and at_end and y != (1.0 if k else 0.0):
                self.complain(f"`{name}` does not grow from 0 to 1", point.span, "(0, 0) to (1, 1)")
            last = max(last, x)
        return None if len(self.problems) > before else Curve.make(points.plain(), kind)

    def check(self, species: Species, data: Located) -> None:
        """Complain of values that do not fit together."""
        season = data.value.get("season", data)
        if not species.season.burst < species.season.grow_end:
            self.complain("shoots end before they begin", season.span, "burst before grow_end")
        for name in ("G_h", "G_s1", "G_s2", "G_ss", "G_bs"):
            if max(y for _, y in species.curves[name].points) <= 0.0:
                curve = data.value["curves"].value[name]
                self.complain(f"`{name}` is 0 everywhere", curve.span, "something that grows")


def _default(about: Any) -> Any:
    if about.default is not dataclasses.MISSING:
        return about.default
    return about.default_factory()


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _within(value: Any, low: float, high: float) -> bool:
    return _is_number(value) and low <= value <= high


def _pretty(data: Mapping[str, Any]) -> str:
    """Return JSON with one key a line, sections and curves on lines of their own."""

    def lines() -> Iterator[str]:
        for key, value in data.items():
            if key == "curves":
                inner = ",\n".join(
                    f"    {json.dumps(k)}: {json.dumps(v)}" for k, v in value.items()
                )
                yield f'  "curves": {{\n{inner}\n  }}'
            else:
                yield f"  {json.dumps(key)}: {json.dumps(value)}"

    return "{\n" + ",\n".join(lines()) + "\n}\n"
