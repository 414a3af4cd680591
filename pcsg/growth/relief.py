"""Bark: bud scale scars and branch bark ridges, by bounds that age.

Galbraith, Muendermann, Wyvill 2004, section 7.3: about a junction a bounding field mixes precise
contact into the sum. Rings about young shoots narrow and vanish, a ridge in the upper angle of a
lateral grows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.fields import REACH
from pcsg.blobtree.nodes import Field, disc, place, segment, weight
from pcsg.growth.curves import smooth_step
from pcsg.growth.state import State

Floats = NDArray[np.float64]

_LEAST = 0.01
"""Amplitudes below this show nothing."""


@dataclass(frozen=True)
class Relief:
    """A bound, and between what it mixes in contact.

    Attributes
    ----------
    partners
        For each of both: a branch, and the part of it that may matter, in arc lengths.
    united
        Whether both are parts of one branch, whose union the wood holds, and not their sum.
    """

    bound: Field
    partners: tuple[tuple[int, float, float], tuple[int, float, float]]
    united: bool


def apical_amplitude(amplitude: float, age: Floats) -> Floats:
    """Return the amplitude of the scar between two shoots of one branch."""
    fades = 1.0 - smooth_step((age - 0.5) / 7.5)
    return np.asarray(amplitude * fades * smooth_step(age / 0.1))


def lateral_amplitude(amplitude: float, age: Floats) -> Floats:
    """Return the amplitude of the scar about a lateral."""
    fades = 1.0 - smooth_step((age - 1.5) / 5.5)
    return np.asarray(amplitude * fades * smooth_step(age / 0.1))


def ridge_amplitude(amplitude: float, age: Floats) -> Floats:
    """Return the amplitude of the bark ridge of a lateral."""
    return np.asarray(amplitude * smooth_step((age - 1.0) / 5.0))


def ridge_growth(age: Floats) -> Floats:
    """Return how much of its reach a bark ridge has."""
    return np.asarray(smooth_step((age - 0.5) / 6.5))


def find_relief(state: State, finest: float) -> list[Relief]:
    """Return the bounds of all junctions of limbs that are not thinner than `finest`."""
    return [*_of_joints(state, finest), *_of_laterals(state, finest)]


def _of_joints(state: State, finest: float) -> list[Relief]:
    j, scar = state.joints, state.species.scar
    amplitude = apical_amplitude(scar.amplitude, j.age)
    found = []
    for k in np.flatnonzero((amplitude > _LEAST) & (j.radius >= finest)).tolist():
        r, reach = float(j.radius[k]), scar.reach * float(j.first_radius[k])
        frame = frame_of(j.axis[k], state.nodes.position[j.node[k]])
        bound = weight(float(amplitude[k]), place(frame, disc(scar.radius * r, reach / REACH)))
        along, branch = float(state.nodes.along[j.node[k]]), int(j.branch[k])
        far = 2.0 * r + reach
        partners = ((branch, along - far, along - 1e-9), (branch, along + 1e-9, along + far))
        found.append(Relief(bound, partners, True))
    return found


def _of_laterals(state: State, finest: float) -> list[Relief]:
    lat, scar, ridge = state.laterals, state.species.scar, state.species.ridge
    scars = lateral_amplitude(scar.amplitude, lat.age)
    ridges = ridge_amplitude(ridge.amplitude, lat.age)
    reaches = ridge_growth(lat.age)
    found = []
    for k in np.flatnonzero(lat.radius >= finest).tolist():
        branch, seat = int(lat.branch[k]), int(lat.seat[k])
        bearer, along = int(state.branches.parent[branch]), float(state.nodes.along[seat])
        d, c, place_ = lat.bearer[k], lat.direction[k], state.nodes.position[seat]
        r_p, r_c = float(lat.bearer_radius[k]), float(lat.radius[k])
        cos = float(np.clip(d @ c, -0.95, 0.98))
        sine = math.sqrt(1.0 - cos * cos)
        far = 3.0 * (r_p + r_c) / sine
        partners = ((bearer, along - far, along + far), (branch, 0.0, far))
        if scars[k] > _LEAST:
            frame = frame_of(c, place_ + c * (r_p / sine))
            reach = scar.reach * float(lat.first_radius[k])
            bound = weight(float(scars[k]), place(frame, disc(scar.radius * r_c, reach / REACH)))
            found.append(Relief(bound, partners, False))
        if ridges[k] > _LEAST:
            normal = np.cross(d, c)
            normal /= max(float(np.linalg.norm(normal)), 1e-9)
            outward = c - d * cos
            outward /= max(float(np.linalg.norm(outward)), 1e-9)
            middle = place_ + d * ((r_c + r_p * cos) / sine) + outward * r_p
            half = ridge.length * r_p
            reach = ridge.reach * (r_c + r_p) * float(reaches[k])
            frame = frame_of(normal, middle - half * normal)
            bound = weight(float(ridges[k]), place(frame, segment(2.0 * half, reach / REACH)))
            found.append(Relief(bound, partners, False))
    return found


def frame_of(axis: Floats, origin: Floats) -> Floats:
    """Return a frame (3, 4) with z along a unit axis."""
    side = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.8 else np.array([0.0, 1.0, 0.0])
    x = np.cross(side, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis, origin], axis=1)
