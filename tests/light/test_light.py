"""Light in canopies beside closed forms; more rows stand in `benchmarks.validation`."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest

import pcsg
from benchmarks.stands import LEAF, slab
from pcsg import light
from pcsg.errors import UsageError
from pcsg.trace.measures import Measured


@pytest.fixture(scope="module")
def spherical() -> tuple[pcsg.Scene, tuple[float, ...]]:
    return slab("spherical", 2.0, 20_000)


@pytest.fixture(scope="module")
def horizontal() -> tuple[pcsg.Scene, tuple[float, ...]]:
    return slab("horizontal", 3.0, 20_000)


def near(found: Measured, expected: float, tolerance: float = 0.0) -> bool:
    return abs(found.value - expected) <= max(tolerance, 4.0 * found.se + 1e-9)


def test_gaps_of_leaves_at_random_follow_beer_and_lambert(spherical: tuple) -> None:
    scene, cell = spherical
    angles = [0.0, 30.0, 57.5]
    found = light.gap_fraction(scene, angles, periodic=cell, rays=20_000)
    expected = np.exp(-0.5 * 2.0 / np.cos(np.radians(angles)))
    assert (np.abs(found.P - expected) < 4.0 * found.se + 0.004).all()
    assert np.array_equal(found.P, light.gap_fraction(scene, angles, periodic=cell, rays=20_000).P)


def test_a_leaf_area_index_comes_back_from_its_gaps() -> None:
    angles = np.linspace(0.0, 85.0, 18)
    gaps = np.exp(-0.5 * 3.0 / np.cos(np.radians(angles)))
    assert light.lai(gaps, angles) == pytest.approx(3.0, rel=1e-3)
    assert light.lai(gaps, angles, "hinge") == pytest.approx(3.0, rel=2e-3)
    with pytest.raises(UsageError, match="rise"):
        light.lai([0.5, 0.5], [30, 20])


def test_projections_are_those_of_the_angle_distribution(spherical: tuple) -> None:
    scene, _ = spherical
    for found in light.projection(scene, [0.0, 57.5], n=50_000):
        assert near(found, 0.5, 0.006)
    edges, share = light.leaf_angles(scene, 3, n=50_000)
    assert edges.tolist() == [0, 30, 60, 90]
    assert np.allclose(share, -np.diff(np.cos(np.radians(edges))), atol=0.015)


def test_black_leaves_intercept_what_is_no_gap(spherical: tuple) -> None:
    scene, cell = spherical
    sun = light.sun(36, 180, 1000)
    found = light.interception(scene, sun, {"par": {LEAF: 0.0}}, periodic=cell, rays=20_000)["par"]
    incident = 1000 * math.cos(math.radians(36)) * (cell[2] - cell[0]) ** 2
    assert found.incident == pytest.approx(incident)
    share = Measured(found.absorbed[LEAF] / incident, found.se[LEAF] / incident)
    assert near(share, 0.70948, 0.007)
    area = scene.measure("area").value
    assert found.flux[LEAF] == pytest.approx(found.absorbed[LEAF] / area)
    assert near(found.balance, 1.0)


def test_a_uniform_sky_is_intercepted_from_all_sides(spherical: tuple) -> None:
    scene, cell = spherical
    found = light.interception(
        scene, light.sky("uniform", 200), {"par": {LEAF: 0.0}}, periodic=cell, rays=20_000
    )["par"]
    assert near(Measured(*(x / found.incident for x in found.soil)), 1.0 - 0.78062, 0.008)


@pytest.mark.parametrize("kind", ["uniform", "overcast", "clear", "array"])
def test_a_sky_gives_its_flux(kind: str) -> None:
    made = {
        "clear": lambda: light.sky("clear", 3.0, sun=light.sun(40)),
        "array": lambda: light.sky([[1.0, 3.0], [0.5, 0.0]], 3.0),
    }.get(kind, lambda: light.sky(kind, 3.0))()
    towards, weights = made.draw(np.random.default_rng(1).random((200_000, 2)))
    assert weights.mean() == pytest.approx(1.0, abs=4.0 * weights.std() / 200_000**0.5 + 1e-12)
    assert (towards[:, 2] > 0.0).all()


def test_horizontal_leaves_reflect_as_two_streams(horizontal: tuple) -> None:
    """With rho = tau = 1/2 a stack of leaf area L reflects L / (2 + L) and passes the rest."""
    scene, cell = horizontal
    found = light.interception(
        scene, light.sun(0), {"nir": {LEAF: (0.5, 0.5)}}, periodic=cell, rays=6_000
    )["nir"]
    assert near(Measured(*(x / found.incident for x in found.reflected)), 0.6)
    assert found.absorbed[LEAF] == pytest.approx(0.0, abs=1e-9)


def test_what_absorbs_nothing_gives_all_light_back(horizontal: tuple) -> None:
    scene, cell = horizontal
    bands = {"white": {LEAF: (0.5, 0.5), "soil": 1.0}, "grey": {LEAF: (0.3, 0.1), "soil": 0.5}}
    found = light.interception(scene, light.sun(0), bands, periodic=cell, rays=1_500)
    assert near(Measured(*(x / found["white"].incident for x in found["white"].reflected)), 1.0)
    assert near(found["grey"].balance, 1.0)
    assert "reflected" in str(found)
    assert {row["band"] for row in found.table()} == {"white", "grey"}


def test_views_and_the_albedo_agree_over_a_bare_soil() -> None:
    scene = pcsg.Scene(pcsg.move(0, 0, -5) * pcsg.uscale(1e-3) * pcsg.label(1) * pcsg.disc())
    found = light.brf(
        scene,
        light.sun(30),
        [(0, 0), (40, 90)],
        {"red": {1: 0.1, "soil": 0.2}},
        periodic=(-1, -1, 1, 1),
        rays=2_000,
    )
    assert np.allclose(found.brf, 0.2, atol=1e-4)
    assert found.albedo["red"].value == pytest.approx(0.2, abs=1e-4)


def test_reflectance_over_all_views_is_the_albedo(horizontal: tuple) -> None:
    scene, cell = horizontal
    views = [(z, a) for z in (20, 50, 75) for a in (0, 120, 240)]
    found = light.brf(
        scene, light.sun(20), views, {"nir": {LEAF: (0.3, 0.2)}}, periodic=cell, rays=600
    )
    weights = np.sin(2.0 * np.radians([z for z, _ in views]))
    mean = float((found.brf[:, 0] * weights).sum() / weights.sum())
    assert mean == pytest.approx(found.albedo["nir"].value, rel=0.1)
    assert found.absorption["nir"].value < 1.0 - found.albedo["nir"].value


def test_view_factors_of_plates() -> None:
    square = pcsg.move(0.5, 0.5, 0) * pcsg.uscale(0.5) * pcsg.rectangle()
    wall = pcsg.move(0, 0.5, 0.5) * pcsg.roty(90) * pcsg.uscale(0.5) * pcsg.rectangle()
    scene = pcsg.Scene(pcsg.label(1) * square | pcsg.label(2) * wall)
    found = light.exchange(scene, 1, rays=40_000)
    assert near(found[2], 0.20004, 0.001)
    assert sum(f.value for f in found.values()) == pytest.approx(1.0)


def test_a_fisheye_sees_what_rays_see(spherical: tuple) -> None:
    scene, cell = spherical
    found = light.hemispherical(scene, (0.3, 0.3, -0.001), 64, rings=3, periodic=cell)
    assert found.sky.shape == (64, 64)
    assert (np.diff(found.P) < 0.0).all()
    ball = pcsg.loads("move(5, 0, 5) sphere")  # in the east: left, seen from below
    picture = light.hemispherical(ball, (0, 0, 0), 64).sky
    rows, columns = np.nonzero(~picture[20:44, 8:56])
    assert len(rows) and columns.max() + 8 < 32


def test_bands_of_a_grammar_name_materials_and_labels(tmp_path: Path) -> None:
    text = """move(0, 0, 1) material(leaf) label(3) disc | move(0, 0, 2) label(4) disc
material leaf { }
material earth { }
ground { z = 0; material = earth }
band par { material = leaf; reflectance = 0.1; transmittance = 0.05 }
band par { label = 4; reflectance = 0.3 }
band par { material = earth; reflectance = 0.2 }
band nir { material = leaf; reflectance = 0.5 }
"""
    scene = pcsg.loads(text)
    assert pcsg.loads(scene.to_pcsg()).graph == scene.graph
    from pcsg.light.optics import read_optics

    optics = read_optics(scene, ["par", "nir"])
    assert optics.by_material[0].tolist() == [[0.1, 0.05], [0.5, 0.0]]
    assert optics.by_label[4].tolist() == [[0.3, 0.0], [0.0, 0.0]]
    assert optics.soil.tolist() == [0.2, 0.0]
    with pytest.raises(UsageError, match="no band `red`; it has par, nir"):
        read_optics(scene, "red")


def test_what_no_band_has_is_black_and_told() -> None:
    scene = pcsg.loads("label(2) disc")
    with pytest.warns(UserWarning, match="label 2 are black"):
        light.interception(scene, light.sun(10), {"par": {1: 0.5}}, rays=1_000)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        light.interception(scene, light.sun(10), {"par": {2: 0.5}}, rays=1_000)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda s: light.interception(s, [], {"par": {}}), "sources"),
        (lambda s: light.interception(s, light.sun(1), {}), "no band"),
        (lambda s: light.interception(s, light.sun(1), {"a": {1: (0.7, 0.7)}}), "add up to 1.4"),
        (lambda s: light.interception(s, light.sun(1), {"a": {"bark": 0.7}}), "no material"),
        (lambda s: light.gap_fraction(s, 90), "below 90"),
        (lambda s: light.sky("blue"), "unknown sky"),
        (lambda s: light.sky("clear"), "sun"),
        (lambda s: light.exchange(s, 9, rays=100), "label 9"),
        (lambda s: light.brf(s, light.sky(), [(0, 0)], {"a": {}}), "one sun"),
    ],
)
def test_mistakes_are_told(call: object, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        call(pcsg.loads("label(1) disc"))  # type: ignore[operator]
