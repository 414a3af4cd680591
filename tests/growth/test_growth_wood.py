"""The field of a tree's wood: radii, bulges, scars and ridges, continuity, normals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pcsg
from pcsg.blobtree.model import Model
from pcsg.growth.foliage import foliage_mesh
from pcsg.growth.model import GrowthModel
from pcsg.growth.pictures import frame_junction
from pcsg.growth.relief import apical_amplitude, lateral_amplitude, ridge_amplitude, ridge_growth
from pcsg.growth.state import State
from pcsg.growth.wood import find_pieces, wood_field


@pytest.fixture(scope="module")
def populus() -> GrowthModel:
    return GrowthModel.load("populus")


@pytest.fixture(scope="module")
def tree(populus: GrowthModel) -> tuple[State, Model]:
    state = populus.at(7.6)
    return state, state.blobtree()


def radii(model: Model, points: np.ndarray, out: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Return how far the surface is from points inside, in directions, where about is known."""
    far = 1.6 * about
    return far - np.asarray(model.intersect(points + far[:, None] * out, -out))


def test_limbs_have_their_radii_and_joints_do_not_bulge(populus: GrowthModel) -> None:
    state = populus.at(7.6)
    model = Model(wood_field(state, finest=1.0))  # scars apart
    p = find_pieces(state)
    seats = state.nodes.position[state.laterals.seat]
    bearers = np.zeros(len(state.branches.length))
    bearers[state.laterals.branch] = state.laterals.bearer_radius
    away = p.along > 3.0 * bearers[p.branch]
    ratios: list[float] = []
    for k in np.flatnonzero((p.base > 0.003) & (p.branch > 0) & away).tolist():
        axis = (p.end[k] - p.start[k]) / np.linalg.norm(p.end[k] - p.start[k])
        side = np.cross(axis, [0.3, 0.8, 0.5])
        side /= np.linalg.norm(side)
        for share in (0.02, 0.5, 0.98):
            at = p.start[k] + share * (p.end[k] - p.start[k])
            if np.linalg.norm(seats - at, axis=1).min() < 6.0 * p.base[k]:
                continue  # blends with laterals
            true = p.base[k] + share * (p.top[k] - p.base[k])
            out = np.stack([side, -side, np.cross(axis, side)])
            ratios += (radii(model, np.tile(at, (3, 1)), out, np.full(3, true)) / true).tolist()
    assert len(ratios) > 100
    assert np.quantile(ratios, 0.01) > 0.98
    assert np.quantile(ratios, 0.99) <= 1.046


def test_normals_are_those_of_the_field(tree: tuple[State, Model]) -> None:
    state, model = tree
    rng = np.random.default_rng(4)
    at = state.nodes.position[rng.integers(0, len(state.nodes.branch), 400)]
    d = rng.normal(size=at.shape)
    d /= np.linalg.norm(d, axis=1)[:, None]
    start = at - 2.0 * d
    t = np.asarray(model.intersect(start, d))
    met = np.isfinite(t)
    assert met.sum() > 100
    point = start[met] + t[met, None] * d[met]
    gradient = np.asarray(model.gradient(point))
    h = 1e-7
    numeric = np.stack(
        [
            (np.asarray(model.field(point + h * e)) - np.asarray(model.field(point - h * e)))
            / (2 * h)
            for e in np.eye(3)
        ],
        axis=1,
    )
    a = gradient / np.linalg.norm(gradient, axis=1)[:, None]
    b = numeric / np.linalg.norm(numeric, axis=1)[:, None]
    angle = np.linalg.norm(a - b, axis=1)
    assert np.quantile(angle, 0.98) < 1e-4  # creases of unions apart


def test_surfaces_move_as_the_tree_grows(populus: GrowthModel) -> None:
    rng = np.random.default_rng(2)
    first, second = populus.at(9.1), populus.at(9.1 + 1 / 24)  # before anything grows
    models = [Model(wood_field(s)) for s in (first, second)]
    p = find_pieces(first)
    chosen = rng.choice(np.flatnonzero(p.base > 0.006), 200)
    at = 0.5 * (p.start[chosen] + p.end[chosen])
    axis = p.end[chosen] - p.start[chosen]
    out = np.cross(axis, rng.normal(size=axis.shape))
    out /= np.linalg.norm(out, axis=1)[:, None]
    a, b = (radii(m, at, out, 0.5 * (p.base + p.top)[chosen]) for m in models)
    assert (np.abs(a - b) <= 0.005 * p.base[chosen]).mean() >= 0.99


def test_amplitudes_follow_the_table() -> None:
    age = np.linspace(0.0, 12.0, 241)
    apical, lateral = apical_amplitude(0.9, age), lateral_amplitude(0.9, age)
    ridge, reach = ridge_amplitude(0.9, age), ridge_growth(age)
    for a in (apical, lateral, ridge):
        assert a[0] == 0.0 and (a >= 0.0).all() and (a <= 0.9).all()
    assert apical[20] > 0.85 and apical[age >= 8.0].max() == 0.0
    assert apical[160] < 0.2 * apical[20]
    assert lateral[20] == pytest.approx(0.9) and lateral[age >= 7.0].max() == 0.0
    assert (np.diff(ridge) >= 0.0).all() and ridge[-1] == pytest.approx(0.9)
    assert (np.diff(reach) >= 0.0).all() and reach[-1] == 1.0


def test_a_ridge_deepens_with_age(populus: GrowthModel) -> None:
    """The bottom of the axil of one lateral, in radii of its bearer: lower, as its ridge grows."""
    laterals = populus.orders[1]
    row = int(np.argmax(np.where(laterals.born == 2, laterals.lengths[:, 12], 0.0)))
    depths = []
    for age in (2, 4, 6, 8, 10):
        state = populus.at(2.25 + age)
        k = int(
            np.flatnonzero(state.branches.key[state.laterals.branch] == populus.keys[1][row])[0]
        )
        lat = state.laterals
        d, c = lat.bearer[k], lat.direction[k]
        place, r = state.nodes.position[lat.seat[k]], float(lat.bearer_radius[k])
        cos = float(d @ c)
        sine = np.sqrt(1.0 - cos * cos)
        # Where both cylinders meet in the upper angle.
        corner = d * ((float(lat.radius[k]) + r * cos) / sine) + (c - d * cos) / sine * r
        way = corner / np.linalg.norm(corner)
        smooth = Model(wood_field(state, finest=1.0))
        rough = Model(wood_field(state))
        start = place + 1.8 * corner
        met = [float(np.asarray(m.intersect(start[None], -way[None]))[0]) for m in (smooth, rough)]
        depths.append((met[1] - met[0]) / r)
    assert depths[0] < depths[2] < depths[4]
    assert depths[4] > 0.05


def test_leaves_are_sheets_of_the_right_size(populus: GrowthModel) -> None:
    state = populus.at(3.68)
    mesh = foliage_mesh(state)
    per_leaf = len(mesh.vertices) // len(state.leaves.size)
    verts = mesh.vertices.reshape(-1, per_leaf, 3)
    reach = np.linalg.norm(verts - state.leaves.position[:, None], axis=2).max(axis=1)
    form = state.species.leaf
    expected = state.leaves.size * (1.0 + form.petiole / form.length)
    assert (reach <= 1.1 * expected).all() and (reach >= 0.9 * expected).all()
    assert mesh.corner_colors is not None
    assert mesh.corner_colors[:, 1].mean() > mesh.corner_colors[:, 0].mean()
    winter = foliage_mesh(populus.at(3.1))
    assert len(winter.triangles) == 1 and np.ptp(winter.vertices) < 1e-5


def test_bark_is_darker_on_a_ridge(populus: GrowthModel) -> None:
    camera, birth = frame_junction(populus, born=3)
    scene = pcsg.loads(f'tree_wood("populus", {birth + 10.0})')
    eye, target = np.array(camera.eye), np.array(camera.target)
    rng = np.random.default_rng(1)
    aim = target + 0.12 * rng.normal(size=(4_000, 3))
    hits = scene.intersect(np.tile(eye, (len(aim), 1)), aim - eye)
    bark = populus.species.bark
    shares = hits.color[hits.mask, 0] / min(bark.old[0], bark.young[0])
    assert np.median(shares) > 0.97  # away from junctions
    assert shares.min() < 0.75
    assert shares.min() >= 0.4 - 1e-9


def test_buds_stand_on_winter_twigs(populus: GrowthModel) -> None:
    state = populus.at(3.95)
    model = Model(wood_field(state))
    buds = state.buds
    assert len(buds.size) > 50
    tip = buds.position + 0.7 * buds.size[:, None] * buds.axis
    assert (np.asarray(model.field(tip)) >= 0.5).mean() > 0.99
    beyond = buds.position + 1.3 * buds.size[:, None] * buds.axis
    assert (np.asarray(model.field(beyond)) < 0.5).mean() > 0.9
    without = Model(
        wood_field(replace(state, buds=type(buds)(*(x[:0] for x in vars(buds).values()))))
    )
    assert model.primitives == without.primitives + len(buds.size)
