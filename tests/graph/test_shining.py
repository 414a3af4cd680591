"""Where a scene shines: the balls contain what they stand for, and know about how much it is."""

import math

import numpy as np
import pytest

import pcsg
from pcsg.graph import shining

LAMP = "material lamp { emission = (3, 6, 9) }  material dark { color = (1, 0, 0) }"
STRENGTHS = np.array([6.0, 0.0])


def balls(text, strengths=STRENGTHS):
    return pcsg.loads(f"{text} {LAMP}").shining_balls(strengths)


def test_a_sphere_is_its_own_ball():
    found = balls("{} (sphere | move(1, 2, 3) uscale(0.5) material(lamp) sphere)")
    np.testing.assert_allclose(found[:, :4], [[1, 2, 3, 0.5]])
    # The box about it has a surface of 6, and shows a quarter of that.
    np.testing.assert_allclose(found[0, 4], 6.0 * 6.0 / 4)


def test_dark_materials_send_nothing():
    assert balls("{} (sphere | material(dark) box)").shape == (0, 5)
    assert balls("material(dark) sphere", np.array([0.0, 0.0])).shape == (0, 5)


def test_the_inner_material_counts():
    assert len(balls("material(lamp) (material(dark) sphere | move(9, 0, 0) sphere)")) == 1


def test_long_things_are_cut():
    found = balls("material(lamp) move(0, 0, 4) scale(0.1, 0.1, 3) box")
    assert len(found) == 30
    np.testing.assert_allclose(found[:, 3], math.sqrt(3) * 0.1)
    np.testing.assert_allclose(found[:, 2].mean(), 4.0)
    flat = balls("material(lamp) scale(2, 2, 0.01) box")
    assert len(flat) == 1


@pytest.mark.parametrize("most", [4, 32, 1000])
def test_a_cut_covers_all_that_shines(most, monkeypatch):
    """However few balls there are, every visible point of a shining thing lies in one."""
    monkeypatch.setattr(shining, "MOST_BALLS", most)
    text = """{n = 4} T
        T if(n > 0, 2, 1)
        1: T -> material(lamp) scale(0.4, 0.2, 0.3) sphere
        2: T -> scale(0.1, 0.1, 0.8) cylinder | {n = n-1} (
            move(0, 0, 1) rotx(40) uscale(0.7) T | move(0, 0, 1) rotz(130) rotx(-35) uscale(0.8) T)
    """
    scene = pcsg.loads(f"{text} {LAMP}")
    found = scene.shining_balls(STRENGTHS)
    assert len(found) <= most + shining.MOST_PIECES
    rng = np.random.default_rng(1)
    origins = rng.normal(size=(4000, 3)) * 4
    targets = rng.uniform(*scene.bounds, size=(4000, 3))
    hits = scene.intersect(origins, targets - origins)
    at = hits.position[np.isfinite(hits.t) & (hits.material == 0)]
    assert len(at) > 100
    away = np.linalg.norm(at[:, None] - found[None, :, :3], axis=2)
    assert (away <= found[:, 3] * (1 + 1e-6)).any(axis=1).all()


def test_power_does_not_depend_on_the_cut(monkeypatch):
    text = """{n = 5} T
        T if(n > 0, 2, 1)
        1: T -> material(lamp) sphere
        2: T -> {n = n-1} (move(3, 0, 0) uscale(0.5) T | move(0, 3, 1) uscale(0.7) T)
    """
    powers = []
    for most in (1, 8, 1000):
        monkeypatch.setattr(shining, "MOST_BALLS", most)
        powers.append(balls(text)[:, 4].sum())
    np.testing.assert_allclose(powers, powers[0])


def test_what_has_no_bounds_has_no_balls():
    assert balls("material(lamp) halfspace").shape == (0, 5)
    assert len(balls("{} material(lamp) (halfspace | move(0, 0, 3) sphere)")) == 1
