"""Looks of surfaces as other programs have them: one colour, roughness, metal, glass."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pcsg.render.materials import DEFAULTS, PLAIN, UNTINTED
from pcsg.scene import Scene

Color = tuple[float, float, float]


class Look(NamedTuple):
    """What attributes say of a surface.

    Attributes
    ----------
    material, texture, label
        Numbers of settings, and the label; -1 for none.
    color
        None if there is none.
    """

    material: int = -1
    texture: int = -1
    label: int = -1
    color: Color | None = None


class Material(NamedTuple):
    """A look, worked out.

    Attributes
    ----------
    name
        The grammar's name of the material, and a number if it has several colours.
    color
        Linear. That of a pattern is the mean of its two colours.
    roughness, metallic, specular, transmission, ior, translucency : float
        As in the setting.
    emission
        Light given off.
    """

    name: str
    color: Color
    roughness: float
    metallic: float
    specular: float
    transmission: float
    ior: float
    translucency: float
    emission: Color


class Paintbox:
    """Works out looks.

    Parameters
    ----------
    scene
        Whose settings are meant.
    """

    def __init__(self, scene: Scene) -> None:
        self._materials = [{**DEFAULTS, **m} for m in scene.setting_values("material")]
        self._textures = scene.setting_values("texture")
        self._names = {k: name for name, k in scene.setting_numbers("material").items()}
        self._numbers = scene.setting_numbers("texture")
        self._used: dict[str, int] = {}
        self.notes: dict[str, None] = {}

    def material_named(self, name: str | None) -> Look:
        """Return the look of a surface with a material of the scene."""
        return Look(material=next((k for k, known in self._names.items() if known == name), -1))

    def mix(self, look: Look) -> Material:
        """Return a look as a material with a name of its own."""
        values: Mapping[str, Any] = DEFAULTS
        if look.material >= 0:
            values = self._materials[look.material]
        texture = look.texture
        if texture < 0 and values["texture"]:
            texture = self._numbers.get(values["texture"], -1)
        if values["bump"]:
            self.notes["reliefs were left out"] = None
        name = self._names.get(look.material, "plain")
        self._used[name] = self._used.get(name, 0) + 1
        count = self._used[name]
        return Material(
            name if count == 1 else f"{name}_{count}",
            self._color(look, values, texture),
            float(values["roughness"]),
            float(values["metallic"]),
            float(values["specular"]),
            float(values["transmission"]),
            float(values["ior"]),
            float(values["translucency"]),
            _triple(values["emission"]),
        )

    def _color(self, look: Look, values: Mapping[str, Any], texture: int) -> Color:
        if texture < 0:
            return look.color or _triple(values["color"] or PLAIN)
        pattern = self._textures[texture]
        if pattern["kind"] in ("image", "normals"):
            self.notes["pictures on surfaces were left out"] = None
            return look.color or _triple(values["color"] or PLAIN)
        self.notes["patterns became the mean of their two colours"] = None
        first = np.asarray(look.color or pattern["color"])
        mean = 0.5 * (first + np.asarray(pattern["color2"]))
        return _triple(mean * np.asarray(values["color"] or UNTINTED))


def _triple(v: Any) -> Color:
    return float(v[0]), float(v[1]), float(v[2])
