"""Where the camera stands for a growing tree."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pcsg.growth.model import GrowthModel
from pcsg.growth.state import State

AZIMUTH = 300.0
"""From where trees are looked at, in degrees from the x axis."""

FOV = 32.0


@dataclass(frozen=True)
class Camera:
    """A camera as the options of a picture name it."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float

    @property
    def keys(self) -> str:
        """As ``pcsg render --camera`` takes it."""
        eye, target = (",".join(f"{x:.6g}" for x in p) for p in (self.eye, self.target))
        return f"eye={eye} target={target} fov={self.fov:g}"


def frame_tree(state: State, aspect: float, margin: float = 1.12) -> Camera:
    """Return a camera at the height of a person or of the tree's middle, that shows all of it.

    Parameters
    ----------
    aspect
        Width over height of the picture.
    """
    p = state.nodes.position
    leaf = state.species.leaf.length
    height = state.height + leaf
    side = float(np.hypot(p[:, 0], p[:, 1]).max(initial=0.0)) + leaf
    half = 0.5 * margin * max(height * 1.06, 2.0 * side / aspect)
    distance = half / math.tan(math.radians(0.5 * FOV)) + 0.5 * side
    middle = 0.5 * height * 0.97
    angle = math.radians(AZIMUTH)
    eye_height = min(1.7, 0.75 * height) if height > 1.0 else 0.6 * height
    eye = (distance * math.cos(angle), distance * math.sin(angle), eye_height)
    return Camera(eye, (0.0, 0.0, middle), FOV)


def frame_junction(model: GrowthModel, born: int = 2, years: float = 10.0) -> tuple[Camera, float]:
    """Return a camera close to the lateral of a trunk's shoot that lives longest, and its birth.

    The picture is as wide as the junction is after some years. Birth is the time of bud burst.
    """
    laterals = model.orders[1]
    rows = np.flatnonzero(laterals.born == born)
    row = int(rows[np.argmax(laterals.death[rows] * 1000.0 + laterals.along[rows])])
    birth = born + model.species.season.burst
    state = model.at(min(birth + years, float(model.species.ymax)))
    key = model.keys[1][row]
    k = int(np.flatnonzero(state.branches.key[state.laterals.branch] == key)[0])
    lat = state.laterals
    place = state.nodes.position[lat.seat[k]]
    d, c = lat.bearer[k], lat.direction[k]
    r_p = float(lat.bearer_radius[k])
    sideways = np.cross(d, c)
    sideways /= np.linalg.norm(sideways)
    angle = math.radians(AZIMUTH)
    if sideways[0] * math.cos(angle) + sideways[1] * math.sin(angle) < 0.0:
        sideways = -sideways  # the sun stands behind the camera
    # From the side, a little from where the lateral points to, so that its axil is seen into.
    look = sideways + 0.45 * c / np.linalg.norm(c) + 0.15 * d
    look /= np.linalg.norm(look)
    target = place + 1.6 * r_p * (c - d * float(d @ c)) + 0.6 * r_p * d
    eye = target + look * (4.6 * r_p / math.tan(math.radians(0.5 * 30.0)))
    return Camera(tuple(eye.tolist()), tuple(target.tolist()), 30.0), birth
