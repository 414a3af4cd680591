"""What is around the solids: camera, sun, lamps and sky; and the ground."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pcsg.export.looks import Color, Look, Paintbox
from pcsg.export.shapes import Floats, Shape
from pcsg.graph.evaluate import setting_defaults
from pcsg.render.camera import basis
from pcsg.render.framing import place, tame
from pcsg.render.lights import make_balls, make_sun
from pcsg.scene import Scene

ASPECT = 4.0 / 3.0
"""Width over height of a picture, as `pcsg render` has it."""

WIDE = 20.0
"""Side of the ground, in sizes of the scene."""


class Camera(NamedTuple):
    """A camera that looks along its own -z.

    Attributes
    ----------
    place : float64 (3, 4)
        Camera to world.
    angle
        Vertical angle of view in radians.
    near, far
        Distances between which the scene lies.
    """

    place: Floats
    angle: float
    near: float
    far: float


class Surroundings(NamedTuple):
    """What is around the solids.

    Attributes
    ----------
    camera
        None where the scene's makes no perspective picture.
    sun
        Where it stands (3, 4), light on a surface that faces it, and its diameter in degrees.
    balls
        Of every lamp: where it is, its light in all directions, and its radius.
    sky
        The mean colour of a sky of two colours, None for any other.
    notes
        What was left out.
    """

    camera: Camera | None
    sun: tuple[Floats, Color, float] | None
    balls: tuple[tuple[Color, Color, float], ...]
    sky: Color | None
    notes: tuple[str, ...]


def look_around(scene: Scene) -> Surroundings:
    """Return what is around a scene's solids."""
    notes: list[str] = []
    box = tame(scene.bounds)
    size = float(np.linalg.norm(box[1] - box[0]))
    values = scene.setting_values("camera")
    camera = None
    if values and values[0]["projection"] != "perspective":
        notes.append(f"the {values[0]['projection']} camera was left out")
    else:
        found = place(values[0] if values else setting_defaults("camera"), scene.bounds, ASPECT)
        right, up, forward = basis(found.eye, found.target, found.up)
        at = np.column_stack([right, up, -forward, found.eye])
        distance = float(np.linalg.norm(np.array(found.eye) - box.mean(axis=0)))
        camera = Camera(at, found.angle, 1e-3 * size, distance + WIDE * size)
    return Surroundings(camera, _sun(scene), _balls(scene), _sky(scene, notes), tuple(notes))


def _sun(scene: Scene) -> tuple[Floats, Color, float] | None:
    written = scene.setting_values("sun")
    sun = make_sun(written[0] if written else setting_defaults("sun"))
    if sun is None:
        return None
    z = np.array(sun.direction)
    other = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    x = np.cross(other, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z, np.zeros(3)]), sun.irradiance, sun.angle


def _balls(scene: Scene) -> tuple[tuple[Color, Color, float], ...]:
    balls = make_balls(scene.setting_values("light"))
    return tuple((ball.position, ball.intensity, ball.radius) for ball in balls)


def _sky(scene: Scene, notes: list[str]) -> Color | None:
    written = scene.setting_values("sky")
    values = written[0] if written else setting_defaults("sky")
    if values["kind"] == "none" or not values["strength"] > 0:
        return None
    if values["kind"] != "gradient":
        notes.append(f"the sky of the kind {values['kind']} was left out")
        return None
    mean = 0.5 * (np.array(values["zenith"]) + np.array(values["horizon"])) * values["strength"]
    red, green, blue = mean.tolist()
    return red, green, blue


def find_ground(scene: Scene) -> tuple[Shape, Look] | None:
    """Return a square in place of the scene's infinite ground, and its look."""
    written = scene.setting_values("ground")
    if not written:
        return None
    box = tame(scene.bounds)
    z = written[0]["z"]
    z = float(box[0, 2]) if z is None else float(z)
    reach = 0.5 * WIDE * float((box[1] - box[0]).max())
    x, y = 0.5 * (box[0] + box[1])[:2]
    corners = [(x + a * reach, y + b * reach, z) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    uv = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    look = Paintbox(scene).material_named(written[0]["material"])
    return Shape("ground", np.array(corners), up, uv, faces, True), look
