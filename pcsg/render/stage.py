"""Everything that a picture needs besides the rays: the scene's settings made into objects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pcsg.arguments import shown
from pcsg.errors import UsageError, suggest
from pcsg.graph.settings import SETTINGS, check_value
from pcsg.render.camera import Camera, Widths
from pcsg.render.cutouts import Cutouts, CutTracer
from pcsg.render.daylight import PhysicalSky, sunlight
from pcsg.render.emitters import Emitters, make_emitters
from pcsg.render.fog import Fog, make_fog
from pcsg.render.framing import find_lowest, place, tame
from pcsg.render.lights import Light, make_balls, make_sun, sun_direction
from pcsg.render.materials import Materials
from pcsg.render.sky import DARK, Sky, make_sky
from pcsg.render.spots import make_spots
from pcsg.render.textures import Textures
from pcsg.render.tracer import (
    DetailedTracer,
    GroundedTracer,
    RenderScene,
    Tracer,
    WideTracer,
)
from pcsg.render.view import View

HAZE = 6.0
"""Distance at which the ground has faded into the sky, in those of the camera's target. The world
does not change with what stands in it: a growing tree must not move the horizon."""

SOFT = 0.02
"""Width per distance of the rays that ask how much of the sky is open."""

Overrides = Mapping[str, Mapping[str, Any]]
"""Values by kind of setting and key that replace the grammar's."""


@dataclass(frozen=True)
class Stage:
    """A scene ready to be pictured.

    Attributes
    ----------
    tracer
        The scene with its ground.
    things
        The scene without its ground, as light from all sides sees it: not in every detail.
    extent
        Greatest side of the bounds: what is far and near in this scene.
    lights
        Sun, balls, points and spots.
    sources
        All that shines from outside the scene: the lights, and the sky if there is one.
    emitters
        Where things of the scene shine; None where nothing does, or it cannot be told.
    sky
        The sky; a dark one if there is none.
    sun_is_seen
        Whether the camera sees the sun's disc.
    ground
        Whether there is a ground plane.
    haze
        Distance at which it has faded into the sky.
    fog
        The fog; None if the air is clear.
    mode, bounces
        How light is followed, over how many surfaces.
    view
        How it is shown.
    """

    tracer: Tracer
    things: Tracer
    camera: Camera
    lights: tuple[Light, ...]
    sources: tuple[Light, ...]
    emitters: Emitters | None
    sky: Sky
    sun_is_seen: bool
    materials: Materials
    extent: float
    ground: bool
    haze: float
    fog: Fog | None
    mode: str
    bounces: int
    view: View

    def seen_by(self, camera: Camera, height: int, detail: float = 0.0) -> Stage:
        """Return the same stage as another camera sees it, in a picture of that many rows.

        Nothing is looked for anew: it takes no time.
        """
        grounded = self.tracer if isinstance(self.tracer, GroundedTracer) else None
        tracer: Any = self.tracer if grounded is None else grounded.inner
        if isinstance(tracer, DetailedTracer):
            tracer = tracer.inner
        fine = _fine(camera, height, detail)
        seen = _detailed(tracer, camera, fine)
        return replace(
            self,
            camera=camera,
            tracer=seen if grounded is None else grounded.around(seen),
            things=_detailed(tracer, camera, fine, max(fine.spread, SOFT)),
        )


def build_stage(
    scene: RenderScene, size: tuple[int, int], overrides: Overrides, detail: float = 0.0
) -> Stage:
    """Return the stage of a scene for a picture of a size.

    Parameters
    ----------
    detail
        Size in pixels below which refining stops; 0 never.

    Raises
    ------
    UsageError
        A value is none that can be rendered.
    """
    width, height = size
    bounds = np.asarray(scene.bounds, dtype=float)
    box = tame(bounds)
    textures = Textures.of(scene.setting_values("texture"), scene.setting_values("palette"))
    materials = Materials(
        scene.setting_values("material"), scene.setting_numbers("texture"), textures, scene.sheets
    )
    camera = place(
        _values(scene, "camera", overrides), bounds, width / height, scene.tracer, scene.reach
    )
    sun_values, sky_values = (_values(scene, kind, overrides) for kind in ("sun", "sky"))
    sky = make_sky(sky_values, sun_direction(sun_values))
    physical = isinstance(sky, PhysicalSky)
    dimmed = (1.0, 1.0, 1.0)
    if isinstance(sky, PhysicalSky):
        dimmed = sunlight(sky.sun[2], sky.turbidity)
    sun = make_sun(sun_values, dimmed)
    balls = make_balls(scene.setting_values("light"))
    spots = make_spots(scene.setting_values("spot"))
    film = _values(scene, "film", overrides)
    fine = _fine(camera, height, detail)
    cutouts = Cutouts(
        scene.setting_values("material"),
        scene.setting_numbers("texture"),
        textures,
        scene.setting_values("texture"),
    )
    solid = CutTracer(scene.tracer, cutouts) if cutouts.exist else scene.tracer
    tracer = _detailed(solid, camera, fine)
    things = _detailed(solid, camera, fine, max(fine.spread, SOFT))
    grounded = bool(scene.setting_values("ground")) or "ground" in overrides
    extent = float((box[1] - box[0]).max())
    values = _values(scene, "ground", overrides)
    z = values["z"]
    haze = values["haze"] or HAZE * math.dist(camera.eye, camera.target)
    if grounded:
        if z is None:
            z = find_lowest(bounds, scene.tracer, scene.reach) - 1e-6 * extent
        number = _material_number(scene, values["material"])
        tracer = GroundedTracer(tracer, float(z), number)
    lights: tuple[Light, ...] = (*((sun,) if sun else ()), *balls, *spots)
    fog = None
    if scene.setting_values("fog") or "fog" in overrides:
        fog = make_fog(_values(scene, "fog", overrides), sky or DARK, z if grounded else None)
    return Stage(
        tracer=tracer,
        things=things,
        camera=camera,
        lights=lights,
        sources=(*lights, *((sky,) if sky else ())),
        emitters=make_emitters(scene.shining_covers(materials.strengths())),
        sky=sky or DARK,
        sun_is_seen=physical,
        materials=materials,
        extent=extent,
        ground=grounded,
        haze=haze,
        fog=fog,
        mode=film["mode"],
        bounces=round(film["bounces"]),
        view=View(film["view"], float(film["exposure"])),
    )


def _fine(camera: Camera, height: int, detail: float) -> Widths:
    """Return the widths of what is not looked into."""
    return Widths(*(detail * width for width in camera.widths(height)))


def _detailed(tracer: Tracer, camera: Camera, pixel: Widths, spread: float | None = None) -> Tracer:
    """Return a tracer that does not look into what looks smaller."""
    if not max(pixel) > 0.0 or not isinstance(tracer, WideTracer):
        return tracer
    return DetailedTracer(tracer, camera.eye, pixel, spread)


def _values(scene: RenderScene, kind: str, overrides: Overrides) -> dict[str, Any]:
    """Return the values of a setting that stands once: override, grammar, default."""
    values = {key: k.default for key, k in SETTINGS[kind].keys.items()}
    for written in scene.setting_values(kind):
        values.update(written)
    given = overrides.get(kind, {})
    if not isinstance(given, Mapping):
        raise UsageError(f"`{kind}` takes a dictionary of keys and values, not {shown(given)}")
    for key, value in given.items():
        values[key] = check_value(kind, key, value)
    return values


def _material_number(scene: RenderScene, name: str | None) -> int:
    if name is None:
        return -1
    numbers = scene.setting_numbers("material")
    if name not in numbers:
        hint = suggest(name, numbers)
        raise UsageError(f"the scene has no material `{name}`" + (f"; {hint}" if hint else ""))
    return numbers[name]
