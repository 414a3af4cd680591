"""Gradients, cells, palettes, turbulence, and patterns that follow the surface."""

from __future__ import annotations

import math

import numpy as np
import pytest

import pcsg
from pcsg.errors import GrammarError
from pcsg.graph.evaluate import check_settings, setting_defaults
from pcsg.render.noise import fill_cells, stir
from pcsg.render.textures import Textures

TEXTURE = setting_defaults("texture")
RNG = np.random.default_rng(1)


def amounts(points, uv=None, size=1.0, **keys) -> np.ndarray:
    textures = Textures.of([{**TEXTURE, **keys}])
    points = np.array(points, dtype=float).reshape(-1, 3)
    n = len(points)
    uv = np.zeros((n, 2)) if uv is None else np.array(uv, dtype=float).reshape(-1, 2)
    return textures.amounts(np.zeros(n, dtype=np.int64), points, uv, np.full(n, size))


@pytest.mark.parametrize(("along", "axis"), [("x", 0), ("y", 1), ("z", 2), ("space", 2)])
def test_a_gradient_goes_from_0_to_1_over_its_scale_along_an_axis(along, axis) -> None:
    points = np.zeros((5, 3))
    points[:, axis] = [-1.0, 0.0, 0.5, 2.0, 3.0]
    found = amounts(points, kind="gradient", along=along, scale=2.0)
    np.testing.assert_allclose(found, [0, 0, 0.25, 1, 1])


@pytest.mark.parametrize(("along", "axis"), [("u", 0), ("v", 1), ("uv", 1)])
def test_a_gradient_may_follow_surface_coordinates(along, axis) -> None:
    uv = np.zeros((3, 2))
    uv[:, axis] = [0.0, 0.3, 0.9]
    points = RNG.normal(size=(3, 3))
    found = amounts(points, uv, kind="gradient", along=along, scale=0.5, size=2.0)
    np.testing.assert_allclose(found, [0, 0.3, 0.9])


def test_cells_are_distances_to_the_nearest_of_points_at_random() -> None:
    points = RNG.uniform(-3, 3, (4000, 3))
    values = np.empty(4000)
    fill_cells(points, values)
    assert values.min() < 0.1
    assert values.max() <= 1.0
    # No distance grows faster than what is walked.
    moved, step = np.empty(4000), 0.05 * RNG.normal(size=(4000, 3))
    fill_cells(points + step, moved)
    assert (np.abs(moved - values) <= np.linalg.norm(step, axis=1) + 1e-12).all()
    # One point in a unit cube: few places are within 0.2 of one, 4/3 pi 0.2^3 of all.
    assert (values < 0.2).mean() == pytest.approx(4 / 3 * math.pi * 0.008, abs=0.012)


def test_turbulence_moves_a_pattern_and_none_leaves_it() -> None:
    points = RNG.normal(size=(200, 3))
    plain = amounts(points, kind="checker")
    assert (amounts(points, kind="checker", turbulence=0.0) == plain).all()
    assert (amounts(points, kind="checker", turbulence=0.5) != plain).any()
    there = points.copy()
    stir(there, np.full(200, 0.5))
    np.testing.assert_array_equal(
        amounts(there, kind="checker"), amounts(points, kind="checker", turbulence=0.5)
    )
    assert 0.02 < np.abs(there - points).mean() < 0.5


def test_patterns_on_the_surface_close_where_u_does() -> None:
    uv = np.array([[0.0, 0.3], [1.0, 0.3], [0.25, 0.3]])
    points = RNG.normal(size=(3, 3))
    first, last, other = amounts(points, uv, kind="noise", along="uv", scale=0.1)
    assert first == pytest.approx(last)
    assert first != other
    # A quarter of a tube whose circumference is 1.
    place = [[0, 1 / (2 * math.pi), 0.3]]
    assert other == pytest.approx(amounts(place, kind="noise", scale=0.1)[0])
    checker = amounts(points, uv + 0.01, kind="checker", along="uv", scale=0.25)
    np.testing.assert_array_equal(checker, [1, 1, 0])


def test_a_palette_takes_the_place_of_two_colours() -> None:
    palette = {"name": "p", "stops": (0.0, 0.0, 0.2, 0.4, 0.5, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0)}
    textures = Textures.of([{**TEXTURE, "kind": "gradient", "palette": "p"}], [palette])
    points = np.array([[0, 0, 0], [0, 0, 0.25], [0, 0, 0.5], [0, 0, 2.0]])
    zero = np.zeros(4, dtype=np.int64)
    found = textures.colors(zero, points, np.zeros((4, 2)), np.ones(4))
    np.testing.assert_allclose(found, [[0, 0.2, 0.4], [0.5, 0.1, 0.2], [1, 0, 0], [1, 1, 1]])


SCENE = """
texture(fade) scale(1, 1, 2) cylinder
texture fade { kind = gradient; along = v; palette = p }
palette p { stops = ((0, "#ff0000"), (1, "#0000ff")) }
"""


def test_pictures_show_palettes_and_colours_tint_them() -> None:
    camera = {"eye": (0, -9, 1), "target": (0, 0, 1), "projection": "orthographic", "height": 2.4}
    scene = pcsg.loads(SCENE)
    image = pcsg.render(scene, (12, 24), 1, camera=camera)
    low, high = image.albedo[20, 6], image.albedo[3, 6]
    assert low[0] > 0.8 > 0.2 > low[2]
    assert high[2] > 0.8 > 0.2 > high[0]
    tinted = SCENE.replace("texture(fade)", "color(0.5, 1, 1) texture(fade)")
    other = pcsg.render(pcsg.loads(tinted), (12, 24), 1, camera=camera)
    np.testing.assert_allclose(other.albedo, image.albedo * [0.5, 1, 1], atol=1e-6)
    again = pcsg.render(pcsg.loads(scene.to_pcsg()), (12, 24), 1, camera=camera)
    np.testing.assert_array_equal(again.rgb, image.rgb)


def test_a_relief_on_the_surface_sinks_along_it() -> None:
    textures = Textures.of([{**TEXTURE, "kind": "gradient", "along": "v", "scale": 0.5}])
    slopes = textures.slopes(0, np.array([[0.2, 0.3]]), np.ones(1))
    np.testing.assert_allclose(slopes, [[0.0, -1.0]], atol=1e-9)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("kind = wood; along = z", "does not follow `z`"),
        ("kind = image; palette = p", "colours of its own"),
    ],
)
def test_what_does_not_go_together_is_told(keys, words) -> None:
    palette = 'palette p { stops = ((0, "red"), (1, "blue")) }'
    scene = pcsg.loads(f"sphere\ntexture t {{ {keys} }}\n{palette}")
    found = check_settings(scene.graph, scene.values)
    assert any(words in problem.message for problem in found)


def test_an_unknown_palette_is_told_with_what_may_be_meant() -> None:
    with pytest.raises(GrammarError, match="did you mean `barks`"):
        pcsg.loads('sphere\ntexture t { palette = bark }\npalette barks { stops = ((0, "red")) }')
