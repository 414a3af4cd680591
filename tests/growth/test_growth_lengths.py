"""Structure by year: the counts of the specification, and what every species must keep to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pcsg.growth.curves import Curve
from pcsg.growth.lengths import grow_orders, is_allowed
from pcsg.growth.model import GrowthModel
from pcsg.growth.species import CURVES, Species

TABLE = {
    1: (1, 24, 1, 12, 12, (1,)),
    2: (6, 99, 7, 53, 41, (1, 5)),
    3: (18, 278, 25, 157, 104, (1, 12, 5)),
    5: (75, 1_045, 132, 645, 326, (1, 25, 47, 2)),
    8: (373, 4_324, 697, 2_755, 1_197, (1, 46, 234, 92)),
    10: (755, 8_342, 1_503, 5_389, 2_199, (1, 55, 407, 292)),
    12: (1_342, 14_209, 2_767, 9_217, 3_651, (1, 60, 602, 606, 73)),
    15: (2_827, 28_099, 5_969, 18_195, 7_078, (1, 65, 866, 1316, 579)),
    18: (5_305, 51_839, 11_555, 33_712, 12_823, (1, 74, 1157, 2359, 1676, 38)),
    21: (8_997, 83_112, 19_489, 53_483, 20_633, (1, 75, 1353, 3428, 3274, 866)),
    24: (14_089, 122_437, 30_046, 77_228, 31_121, (1, 75, 1439, 4396, 5187, 2970, 21)),
    27: (22_120, 181_864, 46_168, 112_586, 47_159, (1, 77, 1554, 5611, 7681, 5993, 1203)),
}


@pytest.fixture(scope="module")
def populus() -> GrowthModel:
    return GrowthModel.load("populus")


@pytest.mark.parametrize("year", TABLE)
def test_counts_are_those_of_the_specification(populus: GrowthModel, year: int) -> None:
    c = populus.counts(year)
    branches = tuple(n for n in c.branches if n)
    assert TABLE[year] == (c.operators, c.primitives, c.shoots, c.internodes, c.leaves, branches)


def test_beside_the_paper(populus: GrowthModel) -> None:
    c = populus.counts(27)
    assert abs(c.primitives / 181_692 - 1) <= 0.02
    assert abs(c.operators / 22_220 - 1) <= 0.03


def test_allowed_numbers_of_metamers() -> None:
    allowed = [m for m in range(1, 33) if is_allowed(Species(), m)]
    assert allowed == [
        *(1, 2, 3, 4, 7, 10, 11, 12, 15, 16, 17, 18, 19, 20, 23, 24, 25, 28, 31, 32),
    ]


def test_the_top_lateral_is_the_longest(populus: GrowthModel) -> None:
    shoots = 0
    for order in populus.orders[1:]:
        first = order.lengths[np.arange(len(order)), order.born + 1]
        rank = np.lexsort((order.along, order.born, order.parent))
        same = (np.diff(order.parent[rank]) == 0) & (np.diff(order.born[rank]) == 0)
        assert (np.diff(first[rank])[same] >= -1e-12).all()
        shoots += int((np.diff(np.flatnonzero(np.diff(np.append(same, False)) != 0)) > 0).sum())
    assert shoots > 1_000


@st.composite
def species(draw: st.DrawFn) -> Species:
    def curve(points: tuple[tuple[float, float], ...]) -> Curve:
        factor = draw(st.floats(0.5, 1.3))
        kind = draw(st.sampled_from(["pchip", "linear", "bspline"]))
        return Curve.make([(x, y * factor) for x, y in points], kind)

    curves = {name: curve(points) for name, points in CURVES.items()}
    return replace(
        Species(),
        ymax=draw(st.integers(2, 9)),
        trunk_scale=draw(st.floats(1.0, 15.0)),
        lmin=draw(st.floats(0.005, 0.05)),
        smin=draw(st.floats(0.35, 0.6)),
        curves=curves,
    )


@given(species())
@settings(max_examples=25)
def test_every_species_grows(one: Species) -> None:
    orders = grow_orders(one)
    year = np.arange(one.ymax + 1)
    for k, order in enumerate(orders):
        grown = np.diff(order.lengths, axis=1)
        after = order.born[:, None] < year[1:]
        assert (grown[after] >= one.lmin - 1e-12).all()  # condition (5)
        assert (grown[~after] == 0.0).all()
        assert all(is_allowed(one, m) for m in np.unique(order.metamers[order.metamers > 0]))
        assert ((order.metamers > 0) == (order.born[:, None] < year)).all()
        if k:
            below = orders[k - 1]
            assert (order.scale >= one.smin).all()
            assert (order.death <= below.death[order.parent]).all()
            assert (order.born < order.death).all()
            assert (order.born > below.born[order.parent]).all()
            assert (order.place <= below.lengths[order.parent, order.born]).all()
