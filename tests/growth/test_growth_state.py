"""The tree at any time: continuous in time, and shaped as the specification says."""

from __future__ import annotations

import numpy as np
import pytest

from pcsg.errors import UsageError
from pcsg.growth.model import GrowthModel
from pcsg.growth.state import State


@pytest.fixture(scope="module")
def populus() -> GrowthModel:
    return GrowthModel.load("populus")


@pytest.fixture(scope="module")
def old(populus: GrowthModel) -> State:
    return populus.at(26.7)


def named_nodes(state: State) -> dict[tuple[int, int], tuple[np.ndarray, float]]:
    """Return places and radii by branch and number of the node, which do not change with time."""
    found = {}
    b, n = state.branches, state.nodes
    for k in range(len(b.key)):
        for i in range(int(b.count[k])):
            row = int(b.first[k]) + i
            found[int(b.key[k]), i] = (n.position[row], float(n.radius[row]))
    return found


def largest_change(model: GrowthModel, t: float, dt: float) -> tuple[float, float]:
    a, b = named_nodes(model.at(t)), named_nodes(model.at(t + dt))
    moved = max(float(np.linalg.norm(a[k][0] - b[k][0])) for k in a.keys() & b.keys())
    widened = max(abs(a[k][1] - b[k][1]) for k in a.keys() & b.keys())
    return moved, widened


@pytest.mark.parametrize("year", [8.45, 12.45, 12.85])
def test_changes_shrink_with_the_time_between(populus: GrowthModel, year: float) -> None:
    for dt in (1 / 96, 1 / 192):
        whole, half = [], []
        for k in range(6):
            t = year + k / 480
            whole.append(largest_change(populus, t, dt))
            half.append(largest_change(populus, t, dt / 2))
        for w, h in zip(np.max(whole, axis=0), np.max(half, axis=0), strict=True):
            assert h <= 0.6 * w + 1e-12


@pytest.mark.parametrize("year", [5, 12, 20])
def test_nothing_jumps_at_the_turn_of_the_year(populus: GrowthModel, year: int) -> None:
    a, b = named_nodes(populus.at(float(year))), named_nodes(populus.at(year + 1e-9))
    assert a.keys() == b.keys()
    assert max(float(np.abs(a[k][0] - b[k][0]).max()) for k in a) <= 1e-9
    assert max(abs(a[k][1] - b[k][1]) for k in a) <= 1e-9


def test_bounds_of_changes_from_frame_to_frame(populus: GrowthModel) -> None:
    for t in (12.4, 12.5, 15.45, 12.86):
        moved, widened = largest_change(populus, t, 1 / 24)
        assert moved <= 0.4
        assert widened <= (0.04 if t % 1.0 > 0.8 else 0.004)


def test_a_tree_of_another_seed_has_the_same_branches(populus: GrowthModel) -> None:
    other = GrowthModel.load("populus", seed=5)
    a, b = populus.at(9.5), other.at(9.5)
    assert (a.branches.count == b.branches.count).all()
    assert np.abs(a.nodes.position - b.nodes.position).max() > 0.05
    again = GrowthModel.load("populus").at(9.5)
    assert (a.nodes.position == again.nodes.position).all()


def test_arrays_fit_together(old: State) -> None:
    b, n = old.branches, old.nodes
    assert (b.first == np.concatenate([[0], np.cumsum(b.count)[:-1]])).all()
    assert (n.branch == np.repeat(np.arange(len(b.count)), b.count)).all()
    assert (b.count >= 2).all()
    assert (b.parent[1:] < np.arange(1, len(b.parent))).all()
    assert (n.branch[b.seat[1:]] == b.parent[1:]).all()
    # Bases lie on their seats; internodes are as long as their arc lengths say.
    assert np.abs(n.position[b.first[1:]] - n.position[b.seat[1:]]).max() < 1e-12
    inner = np.flatnonzero(n.year > 0)
    step = np.linalg.norm(n.position[inner] - n.position[inner - 1], axis=1)
    assert step == pytest.approx(n.along[inner] - n.along[inner - 1], abs=1e-9)
    assert np.linalg.norm(n.direction, axis=1) == pytest.approx(1.0, abs=1e-9)
    assert (n.radius > 0.0).all()


def test_limbs_are_thinner_than_their_bearers_and_taper(old: State) -> None:
    lat, n = old.laterals, old.nodes
    alive = old.branches.factor[lat.branch] == 1.0
    assert (lat.radius <= 0.8 * lat.bearer_radius + 1e-12)[alive].all()
    same = n.branch[1:] == n.branch[:-1]
    assert (np.diff(n.radius)[same] <= 1e-12).all()


def test_living_branches_are_longer_than_their_bearers_are_thick(populus: GrowthModel) -> None:
    state = populus.at(27.0 - 0.21)  # before branches are shed
    lat = state.laterals
    length = state.branches.length[lat.branch]
    assert (length > lat.bearer_radius + 0.010).mean() >= 0.99


def test_angles_of_first_year_laterals(populus: GrowthModel) -> None:
    state = populus.at(11.75)  # in the twelfth year
    lat, b = state.laterals, state.branches
    young = b.born[lat.branch] == 11
    cos = np.einsum("ij,ij->i", lat.bearer[young], b.start[lat.branch[young]])
    angle, length = np.degrees(np.arccos(cos)), b.length[lat.branch[young]]
    assert angle.min() >= 30.0 and angle.max() <= 85.0
    long, short = length > np.quantile(length, 0.8), length <= np.quantile(length, 0.2)
    assert angle[long].mean() < angle[short].mean() - 5.0


def test_long_branches_are_s_shaped(populus: GrowthModel) -> None:
    good = 0
    total = 0
    for seed in range(1, 6):
        state = GrowthModel.load("populus", seed=seed).at(27.0 - 0.25)
        b, n = state.branches, state.nodes
        for k in np.flatnonzero((b.order == 1) & (b.length > 8.0)).tolist():
            rows = np.arange(b.first[k], b.first[k] + b.count[k])
            d = n.direction[b.seat[k]]
            up = d - b.start[k] * float(d @ b.start[k])
            up /= np.linalg.norm(up)
            off = (n.position[rows] - n.position[rows[0]]) @ up
            early = off[n.along[rows] < 0.5 * b.length[k]].min()
            total += 1
            good += early < 0.0 and float(n.direction[rows[-1]] @ up) > 0.0
    assert total >= 50
    assert good >= 0.8 * total


def test_short_inner_branches_are_gone(old: State) -> None:
    b = old.branches
    trunk = float(b.length[0])
    low = (b.order == 1) & (old.nodes.along[np.maximum(b.seat, 0)] < trunk / 3)
    assert low.any()
    assert (b.length[low] > 2.0).all()


def test_silhouettes(populus: GrowthModel) -> None:
    expected = {4: (0.30, 0.78), 11: (0.38, 0.33), 19: (0.54, 0.38), 27: (0.72, 0.33)}
    for year, (ratio, place) in expected.items():
        ratios, places = [], []
        for seed in range(1, 6):
            state = GrowthModel.load("populus", seed=seed).at(float(year))
            p = state.nodes.position
            across = [p[:, :2] @ [np.cos(a), np.sin(a)] for a in np.linspace(0, np.pi, 24)]
            ratios.append(max(float(np.ptp(x)) for x in across) / state.height)
            out = np.hypot(p[:, 0], p[:, 1])
            places.append(float(p[np.argmax(out), 2]) / state.height)
        assert np.mean(ratios) == pytest.approx(ratio, rel=0.15)
        assert np.mean(places) == pytest.approx(place, abs=0.2)


def test_leaves_come_and_go(populus: GrowthModel) -> None:
    leaves = [populus.at(11 + tau).leaves for tau in (0.2, 0.4, 0.6, 0.72, 0.78, 0.84, 0.95)]
    counts = [len(x.size) for x in leaves]
    assert counts[0] == counts[-1] == 0
    assert counts[1] < counts[2] <= counts[3]
    assert counts[4] > counts[5]
    assert leaves[2].autumn.max() == 0.0 and leaves[4].autumn.mean() > 0.4
    assert leaves[3].size.max() <= populus.species.leaf.length + 1e-12


def test_times_outside_are_refused(populus: GrowthModel) -> None:
    for t in (0.0, -1.0, 27.5):
        with pytest.raises(UsageError, match="27"):
            populus.at(t)
    with pytest.raises(UsageError):
        populus.counts(28)


@pytest.mark.parametrize("name", ["populus", "spruce", "birch"])
def test_every_shipped_species_has_a_skeleton(name: str) -> None:
    model = GrowthModel.load(name)
    state = model.at(6.4)
    skeleton = state.skeleton()
    assert skeleton.n_edges == len(state.nodes.branch) - len(state.branches.count)
    assert skeleton.loops == 0
