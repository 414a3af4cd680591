"""Where a scene shines: covers contain what they stand for, and know about how much it is."""

import math

import numpy as np
import pytest

import pcsg
from pcsg.graph import shining
from pcsg.graph.nodes import Leaf
from pcsg.graph.shining import AXES, CENTER, INVERSE, RADIUS, VOLUME, dark_nodes

LAMP = "material lamp { emission = (3, 6, 9) }  material dark { color = (1, 0, 0) }"
STRENGTHS = np.array([6.0, 0.0])


def covers(text, strengths=STRENGTHS):
    return pcsg.loads(f"{text} {LAMP}").shining_covers(strengths)


def test_a_sphere_is_its_own_ball():
    found = covers("{} (sphere | move(1, 2, 3) uscale(0.5) material(lamp) sphere)")
    np.testing.assert_allclose(found[:, :4], [[1, 2, 3, 0.5]])
    # The box about it has a surface of 6, and shows a quarter of that.
    np.testing.assert_allclose(found[0, 4], 6.0 * 6.0 / 4)


def test_dark_materials_send_nothing():
    assert covers("{} (sphere | material(dark) box)").size == 0
    assert covers("material(dark) sphere", np.array([0.0, 0.0])).size == 0


def test_the_inner_material_counts():
    assert len(covers("material(lamp) (material(dark) sphere | move(9, 0, 0) sphere)")) == 1


def test_long_things_are_cut():
    found = covers("material(lamp) move(0, 0, 4) scale(0.1, 0.1, 3) box")
    assert len(found) == 30
    np.testing.assert_allclose(found[:, 3], math.sqrt(3) * 0.1)
    np.testing.assert_allclose(found[:, 2].mean(), 4.0)


@pytest.mark.parametrize("shape", ["scale(2, 1.5, 0.01) box", "scale(1, 0.1, 1) sphere", "tri1"])
def test_flat_things_have_boxes(shape):
    """A box in its place: the matrix into its frame takes points of the surface to the unit box."""
    scene = pcsg.loads(f"material(lamp) move(1, 2, 3) rotx(30) rotz(50) {shape} {LAMP}")
    (found,) = scene.shining_covers(STRENGTHS)
    assert found[VOLUME] > 0
    axes, inverse = found[AXES:INVERSE].reshape(3, 3).T, found[INVERSE:].reshape(3, 3)
    np.testing.assert_allclose(inverse @ axes, np.eye(3), atol=1e-9)
    assert found[VOLUME] == pytest.approx(8 * abs(np.linalg.det(axes)))
    rng = np.random.default_rng(1)
    lower, upper = scene.bounds
    targets = lower + rng.random((500, 3)) * (upper - lower)
    origins = rng.normal(size=(500, 3)) * 9
    hits = scene.intersect(origins, targets - origins)
    at = hits.position[np.isfinite(hits.t)]
    assert len(at) > 50
    assert (np.abs((at - found[CENTER]) @ inverse.T) <= 1 + 1e-6).all()
    assert (np.linalg.norm(at - found[CENTER], axis=1) <= found[RADIUS]).all()


@pytest.mark.parametrize("most", [4, 32, 1000])
def test_a_cut_covers_all_that_shines(most, monkeypatch):
    """However few covers there are, every visible point of a shining thing lies in one."""
    monkeypatch.setattr(shining, "MOST_COVERS", most)
    text = """{n = 4} T
        T if(n > 0, 2, 1)
        1: T -> material(lamp) scale(0.4, 0.2, 0.3) sphere
        2: T -> scale(0.1, 0.1, 0.8) cylinder | {n = n-1} (
            move(0, 0, 1) rotx(40) uscale(0.7) T | move(0, 0, 1) rotz(130) rotx(-35) uscale(0.8) T)
    """
    scene = pcsg.loads(f"{text} {LAMP}")
    found = scene.shining_covers(STRENGTHS)
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
        monkeypatch.setattr(shining, "MOST_COVERS", most)
        powers.append(covers(text)[:, 4].sum())
    np.testing.assert_allclose(powers, powers[0])


def test_what_has_no_bounds_has_no_covers():
    assert covers("material(lamp) halfspace").size == 0
    assert len(covers("{} material(lamp) (halfspace | move(0, 0, 3) sphere)")) == 1


TERRAIN = """{{c = 9; x = 0; y = 0}} (LAND | move(0, 0, 3) {lamp})
    LAND if(c > 0, 2, 1)
    1: LAND -> color(rand(x, y), 0, 0) move(0, 0, rand(x, y)) box
    2: LAND -> {{c = c-1; x = 2*x}} (LAND | {{y = y + 1}} LAND
             | {{x = x + 1}} (LAND | {{y = 2*y}} LAND))
"""


def test_what_is_dark_is_not_looked_through():
    """A lamp over a land of too many states to be unrolled."""
    scene = pcsg.loads(TERRAIN.format(lamp="material(lamp) sphere") + LAMP)
    assert not scene.states.finite
    found = scene.shining_covers(STRENGTHS)
    np.testing.assert_allclose(found[:, CENTER], [[0, 0, 3]])
    names = {type(scene.graph.nodes[n]).__name__ for n in dark_nodes(scene.graph, STRENGTHS)}
    assert "Selection" in names


def test_dark_nodes_are_those_that_no_light_is_below():
    scene = pcsg.loads(
        f"""{{}} (T | material(lamp) T | material(lamp) material(dark) U | U)
        T if(SEED >= 0, 1, 1)
        1: T -> sphere | move(3, 0, 0) material(dark) box
        U if(SEED >= 0, 1, 1)
        1: U -> cylinder
        {LAMP}"""
    )
    dark, nodes = dark_nodes(scene.graph, STRENGTHS), scene.graph.nodes
    leaves = {node.solid.name: k in dark for k, node in enumerate(nodes) if isinstance(node, Leaf)}
    assert leaves == {"sphere": False, "box": True, "cylinder": True}
    assert 0 not in dark
