"""The pipe model: cross-sections are those of the leaves that limbs have ever carried."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pcsg.growth.model import GrowthModel
from pcsg.growth.species import Radius, Species


@pytest.fixture(scope="module")
def piped() -> GrowthModel:
    return GrowthModel(replace(Species(), radius=Radius(rule="pipe", cap=1.0)))


def test_leaves_are_counted_as_the_rule_says(piped: GrowthModel) -> None:
    """By hand: all branches of nine years, dead ones too, and what they had in each."""
    year = 9
    total = 0
    for order in piped.orders:
        for k in range(len(order)):
            last = min(year, int(order.death[k]))
            total += int(order.metamers[k, : last + 1].sum())
    foot = piped.at(float(year)).nodes.radius[0]
    assert foot == pytest.approx(piped.species.radius.r_tip * np.sqrt(total), rel=1e-12)
    assert piped.carried[0][0, year] == total


def test_cross_sections_add_up(piped: GrowthModel) -> None:
    state = piped.at(10.0)
    n, lat = state.nodes, state.laterals
    square = (n.radius / piped.species.radius.r_tip) ** 2
    # From a node to the next one of its branch: its own leaf, and what its laterals carry; those
    # that are lost, or fade at this moment, are in it, too.
    lost = np.zeros(len(square))
    np.add.at(lost, lat.seat, square[state.branches.first[lat.branch]])
    inner = np.flatnonzero((n.year[:-1] > 0) & (n.branch[1:] == n.branch[:-1]))
    step = square[inner] - square[inner + 1]
    assert (step >= 1.0 + lost[inner] - 1e-6).all()


def test_radii_are_continuous_and_never_shrink(piped: GrowthModel) -> None:
    before, after = piped.at(8.0), piped.at(8.0 + 1e-9)
    assert np.abs(before.nodes.radius - after.nodes.radius).max() <= 1e-9
    last = 0.0
    for t in np.linspace(5.0, 7.0, 49):
        foot = float(piped.at(float(t)).nodes.radius[0])
        assert last - 1e-12 <= foot <= last + (0.004 if last else 1.0)
        last = foot


def test_limbs_are_no_thicker_than_the_cap_allows() -> None:
    model = GrowthModel(replace(Species(), radius=Radius(rule="pipe", cap=0.7)))
    lat = model.at(11.7).laterals
    assert (lat.radius <= 0.7 * lat.bearer_radius + 1e-12).all()
    assert (lat.first_radius <= lat.radius + 1e-12).all()
