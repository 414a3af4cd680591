"""The axiom's parameters and the scene's settings as numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from pcsg.errors import Diagnostic, GrammarError
from pcsg.graph.expr import Expr, parameters_of
from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.settings import ANGLES, SETTINGS, FileName, Setting, ValueKind
from pcsg.graph.tape import Fault, Program
from pcsg.vec import IDENTITY


def axiom_values(graph: Graph, values: Mapping[str, float]) -> dict[str, float]:
    """Return what the axiom's leading block assigns, with the globals that it reads.

    Raises
    ------
    GrammarError
        An assignment has no finite value.
    """
    block = graph.axiom_block
    known = {**GLOBALS, **values}
    for name, expr in block.assignments if block else ():
        known[name] = _evaluate(expr, known)
    return known


def setting_values(graph: Graph, kind: str, known: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the settings of a kind in the order of the text, defaults filled in.

    Parameters
    ----------
    known
        Values of the parameters that settings may read.

    Returns
    -------
    list of dict
        A number, a tuple of three numbers or a text for every key, None where it is automatic;
        ``name`` for named settings.

    Raises
    ------
    GrammarError
        A value is not finite or outside its range.
    """
    return [_values(setting, known) for setting in graph.settings_of(kind)]


def check_settings(graph: Graph, known: Mapping[str, float]) -> list[Diagnostic]:
    """Return what a picture would refuse of the settings.

    Parameters
    ----------
    known
        Values of the parameters that settings may read.
    """
    problems: list[Diagnostic] = []
    for setting in graph.settings:
        values = setting_defaults(setting.kind.name)
        for key in setting.values:
            try:
                values[key] = _value(setting, key, known)
            except GrammarError as error:
                problems += error.diagnostics
        problems += _check_together(setting, values)
    return problems


def _check_together(setting: Setting, values: Mapping[str, Any]) -> list[Diagnostic]:
    """Return what is wrong with values that are each in their range."""
    kind = setting.kind.name

    def tell(key: str, message: str, expected: str | None = None) -> Diagnostic:
        written = setting.values.get(key)
        first = written[0] if written and not isinstance(written, str) else None
        span = getattr(first, "span", None) or setting.span
        return Diagnostic("setting-range", message, span, expected=expected)

    problems = [
        tell(key, f"`{key}` of `{kind}` is the zero vector", "a direction")
        for key in ("up", "direction")
        if key in values and not any(values[key])
    ]
    if kind == "camera":
        if values["eye"] is not None and values["eye"] == values["target"]:
            problems.append(tell("target", "`eye` and `target` are the same point"))
        if (fault := check_camera(values)) is not None:
            problems.append(tell(fault.key, fault.message, fault.expected))
    if kind == "spot" and values["position"] == values["target"]:
        problems.append(tell("target", "`position` and `target` of a `spot` are the same point"))
    if kind == "texture":
        if values["along"] not in ("space", "uv") and values["kind"] != "gradient":
            message = f"a texture of kind `{values['kind']}` does not follow `{values['along']}`"
            problems.append(tell("along", message, "`space`, `uv`, or `kind = gradient`"))
        if values["palette"] is not None and values["kind"] in ("image", "normals"):
            problems.append(tell("palette", "a picture has colours of its own", "a pattern"))
    file = setting.values.get("file")
    if isinstance(file, FileName) and not file.path.is_file():
        problems.append(tell("file", f"there is no file `{file}`"))
    if values.get("kind") in ("image", "normals") and values.get("file") is None:
        problems.append(tell("kind", f"a {kind} of kind `{values['kind']}` needs a `file`"))
    return problems


class CameraFault(NamedTuple):
    """What is wrong with keys of a camera that are each in their range."""

    key: str
    message: str
    expected: str


def check_camera(values: Mapping[str, Any]) -> CameraFault | None:
    """Return what keys of a camera do not go together; None if they do."""
    projection, fov = values["projection"], values["fov"]
    most = ANGLES[projection][1]
    if fov is not None and fov > most:
        message = f"the `fov` of a camera is {fov:g}, with `projection = {projection}`"
        return CameraFault("fov", message, f"a number from 0.01 to {most:g}")
    if values["height"] is not None and projection != "orthographic":
        message = f"a picture with `projection = {projection}` has no `height`"
        return CameraFault("height", message, "`fov`, or `projection = orthographic`")
    return None


def setting_defaults(kind: str) -> dict[str, Any]:
    """Return the default of every key of a setting."""
    return {key: k.default for key, k in SETTINGS[kind].keys.items()}


def _values(setting: Setting, known: Mapping[str, float]) -> dict[str, Any]:
    found = setting_defaults(setting.kind.name)
    if setting.name is not None:
        found["name"] = setting.name
    for key in setting.values:
        found[key] = _value(setting, key, known)
    return found


def _value(setting: Setting, key: str, known: Mapping[str, float]) -> Any:
    """Return the value of a key that is written.

    Raises
    ------
    GrammarError
        It is not finite or outside its range.
    """
    written = setting.values[key]
    if isinstance(written, str):
        return str(written.path) if isinstance(written, FileName) else written
    numbers = tuple(_evaluate(expr, known) for expr in written)
    spec = setting.kind.keys[key]
    for x in numbers:
        if not spec.low <= x <= spec.high:
            message = f"`{key}` of `{setting.kind.name}` is {x:g}"
            span = getattr(written[0], "span", None) or setting.span
            expected = f"a number from {spec.low:g} to {spec.high:g}"
            raise GrammarError([Diagnostic("setting-range", message, span, expected=expected)])
    return numbers[0] if spec.kind is ValueKind.NUMBER else numbers


def _evaluate(expr: Expr, known: Mapping[str, float]) -> float:
    """Return the value of an expression over known parameters."""
    names = [name for name in parameters_of(expr) if name in known]  # there may be thousands
    # Where the axiom's block asks for the world, its frame is the world's.
    program = Program({name: k for k, name in enumerate(names)}, len(names))
    try:
        at = program.add([expr])
        return program.evaluate(at, [*(known[name] for name in names), *IDENTITY])[0]
    except Fault as fault:
        span = program.span(fault.instruction) or getattr(expr, "span", None)
        message = "the result is not a finite number"
    except KeyError as missing:
        span = getattr(expr, "span", None)
        message = f"parameter {missing.args[0]} has no value here"
    shown = ", ".join(f"{name} = {value:g}" for name, value in known.items() if value == value)
    raise GrammarError(
        [Diagnostic("not-finite", message, span, notes=((f"parameters: {shown}", None),))]
    )


def unit(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the unit vector of a direction, +z for zero."""
    largest = max(map(abs, direction))
    if largest == 0.0:
        return (0.0, 0.0, 1.0)
    x, y, z = (c / largest for c in direction)
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length)
