"""Relief of the ring that bud scales leave between two shoots, as rays meet it."""

from __future__ import annotations

import numpy as np
import pytest

from pcsg.blobtree.model import Model
from pcsg.growth.model import GrowthModel
from pcsg.growth.wood import wood_field

SECTIONS, SIDES = 121, 12


def ring_relief(model: GrowthModel, age: float) -> tuple[float, float]:
    """Return how far the ring above the trunk's second shoot stands out, in radii; the radius.

    The median over directions, because laterals and their scars stand beside it.
    """
    state = model.at(2.0 + model.species.season.burst + age)
    joints = state.joints
    k = int(np.flatnonzero((joints.branch == 0) & (np.abs(joints.age - age) < 0.01))[0])
    place, r, axis = state.nodes.position[joints.node[k]], float(joints.radius[k]), joints.axis[k]
    side = np.cross(axis, [1.0, 0.1, 0.0])
    side /= np.linalg.norm(side)
    turn = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)[:, None]
    out = np.cos(turn) * side + np.sin(turn) * np.cross(axis, side)
    along = np.linspace(-2.5 * r, 2.5 * r, SECTIONS)[:, None, None]
    origins = place + along * axis + 4.0 * r * out
    directions = np.broadcast_to(-out, origins.shape).reshape(-1, 3)
    smooth, rough = (
        np.asarray(Model(wood_field(state, finest)).intersect(origins.reshape(-1, 3), directions))
        for finest in (1.0, 0.9 * r)
    )
    assert np.isfinite(rough).all()
    outline = np.median((smooth - rough).reshape(SECTIONS, SIDES), axis=1)
    return float(np.ptp(outline)) / r, r


def test_rings_of_bud_scales_fade_and_are_gone_after_eight_years() -> None:
    model = GrowthModel.load("populus")
    relief = {age: ring_relief(model, age)[0] for age in (1.0, 2.0, 3.0, 5.0, 8.0)}
    assert relief[1.0] == pytest.approx(0.066, abs=0.02)
    assert relief[1.0] > relief[2.0] > relief[3.0] > relief[5.0]
    assert relief[8.0] < 0.2 * relief[1.0]


def test_outlines_change_little_from_frame_to_frame() -> None:
    model = GrowthModel.load("populus")
    for age in (0.3, 0.9, 1.2, 2.2, 4.0):  # younger ones rise within a tenth of a year
        (relief, r), (later, grown) = (ring_relief(model, a) for a in (age, age + 1.0 / 24.0))
        assert abs(later * grown - relief * r) <= 0.005 * r
