"""Pictures that are no central perspective: orthographic, fisheye, panorama."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from spheres import Spheres

import pcsg
from pcsg.errors import UsageError
from pcsg.graph.settings import ANGLES, SETTINGS
from pcsg.render.animation import turn_camera
from pcsg.render.camera import Camera
from pcsg.render.framing import MARGIN, corners, place
from pcsg.render.sky import ImageSky
from pcsg.render.stage import build_stage
from pcsg.render.tracer import DetailedTracer

AUTOMATIC = {key: k.default for key, k in SETTINGS["camera"].keys.items()}

ALONG_X = {"eye": (0.0, 0.0, 0.0), "target": (2.0, 0.0, 0.0)}


def rays_at(camera, *places, size=(4.0, 2.0), lens=None):
    x, y = np.array(places, dtype=float).T
    return camera.rays(x, y, size, lens)


def test_orthographic_rays_are_parallel_and_as_far_apart_as_pixels():
    camera = Camera(**ALONG_X, projection="orthographic", height=6.0)
    origins, directions = rays_at(camera, (2, 1), (0, 0), (4, 2))
    np.testing.assert_allclose(directions, [[1, 0, 0]] * 3, atol=1e-15)
    np.testing.assert_allclose(origins, [[0, 0, 0], [0, 6, 3], [0, -6, -3]], atol=1e-12)


def test_an_orthographic_picture_is_as_high_as_a_perspective_one_at_the_target():
    camera = Camera(**ALONG_X, fov=90.0, projection="orthographic")
    assert camera.tall == pytest.approx(4.0)


def test_angles_from_the_middle_of_a_fisheye_grow_evenly():
    camera = Camera(**ALONG_X, projection="fisheye")
    _, directions = rays_at(camera, (2, 1), (2, 0), (2, 0.5), (3, 1), (2.5, 1))
    root = math.sqrt(0.5)
    expected = [[1, 0, 0], [0, 0, 1], [root, 0, root], [0, -1, 0], [root, -root, 0]]
    np.testing.assert_allclose(directions, expected, atol=1e-15)


def test_a_fisheye_of_a_whole_round_shows_what_is_behind_at_its_edge():
    camera = Camera(**ALONG_X, fov=360.0, projection="fisheye")
    _, directions = rays_at(camera, (2, 0), (1, 1), (2, 2))
    np.testing.assert_allclose(directions, [[-1, 0, 0]] * 3, atol=1e-15)


def test_what_is_outside_of_a_fisheyes_disc_shows_nothing():
    camera = Camera(**ALONG_X, projection="fisheye")
    x, y = np.array([[2.0, 1.0], [0.9, 1.0], [2.8, 0.2], [2.5, 0.5]]).T
    assert camera.covers(x, y, (4.0, 2.0)).tolist() == [True, False, False, True]


def test_a_panorama_goes_once_around_and_stays_level():
    camera = Camera((0, 0, 0), (2, 0, -5), projection="panorama")
    _, directions = rays_at(camera, (2, 1), (1, 1), (3, 1), (0, 1), (2, 0), (2, 2), (2, 0.5))
    root = math.sqrt(0.5)
    expected = [
        [1, 0, 0],
        [0, 1, 0],
        [0, -1, 0],
        [-1, 0, 0],
        [0, 0, 1],
        [0, 0, -1],
        [root, 0, root],
    ]
    np.testing.assert_allclose(directions, expected, atol=1e-15)


def test_a_panorama_of_a_picture_of_the_sky_is_that_picture():
    pixels = np.random.default_rng(1).random((8, 16, 3)).astype(np.float32)
    y, x = (v.ravel() + 0.5 for v in np.mgrid[0:8, 0:16])
    _, directions = Camera(**ALONG_X, projection="panorama").rays(x, y, (16, 8))
    shown = ImageSky(pixels, 0.0).radiance(directions)
    np.testing.assert_allclose(shown.reshape(8, 16, 3), pixels, atol=1e-6)


def test_a_panorama_wider_than_once_around_has_empty_sides():
    camera = Camera(**ALONG_X, projection="panorama")
    assert camera.covers(np.array([0.5, 3.0]), np.ones(2), (6.0, 2.0)).tolist() == [False, True]


@given(st.tuples(*[st.floats(-5, 5)] * 3), st.sampled_from(list(ANGLES)))
def test_directions_have_unit_length_whatever_is_looked_at(target, projection):
    if not max(map(abs, target)) > 1e-6:
        return
    camera = Camera((0, 0, 0), target, projection=projection)
    _, directions = rays_at(camera, (2, 1), (1.2, 1.3), (2.9, 1), (2, 0.01))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)


@pytest.mark.parametrize("projection", ANGLES)
def test_pixels_are_as_wide_as_neighbouring_rays_are_apart(projection):
    camera = Camera(**ALONG_X, projection=projection)
    rows = 300
    origins, directions = rays_at(camera, (150, 150), (150, 151), size=(300, rows))
    fixed, spread = camera.widths(rows)
    for t in (0.0, 1.0, 40.0):
        apart = np.linalg.norm(np.diff(origins + t * directions, axis=0))
        assert fixed + spread * t == pytest.approx(apart, rel=1e-4, abs=1e-12)


@pytest.mark.parametrize("projection", ANGLES)
def test_a_lens_keeps_one_distance_sharp(projection):
    camera = Camera(**ALONG_X, aperture=0.5, focus=3.0, projection=projection)
    lens = np.random.default_rng(1).random((40, 2))
    x, y = np.full(40, 2.3), np.full(40, 0.8)
    sharp, towards = camera.rays(x[:1], y[:1], (4.0, 2.0))
    length = 3.0 / towards[0, 0] if projection in ("perspective", "orthographic") else 3.0
    point = sharp[0] + length * towards[0]
    origins, directions = camera.rays(x, y, (4.0, 2.0), lens)
    off = point - origins
    np.testing.assert_allclose(np.cross(off, directions), 0.0, atol=1e-12)
    assert np.ptp(origins, axis=0).max() > 0.3


def test_an_orthographic_picture_that_is_placed_by_itself_is_filled():
    box = np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 7.0]])
    for aspect in (0.3, 1.0, 3.0):
        camera = place({**AUTOMATIC, "projection": "orthographic"}, box, aspect)
        at, depth = positions(camera, corners(box), aspect)
        assert np.abs(at).max() == pytest.approx(1 - 2 * MARGIN)
        assert (depth > 0).all()
        target = {**AUTOMATIC, "projection": "orthographic", "target": (1.0, 0.0, 0.0)}
        at, depth = positions(place(target, box, aspect), corners(box), aspect)
        assert np.abs(at).max() == pytest.approx(1 - 2 * MARGIN)
        assert (depth > 0).all()


def positions(camera, points, aspect):
    """Return places in an orthographic picture, whose edges are at 1, and depths."""
    origins, directions = camera.rays(
        np.array([0.5, 1.5, 0.5]) * aspect, np.array([0.5, 0.5, 0.0]), (aspect, 1.0)
    )
    away = points - origins[0]
    right, up = origins[1:] - origins[0]
    half = np.array([right @ right / 2, up @ up])
    return away @ np.stack([right, up]).T / half, away @ directions[0]


def test_rays_of_an_orthographic_picture_are_as_wide_everywhere():
    camera = {"projection": "orthographic", "height": 4.0}
    stage = build_stage(pcsg.loads("sphere"), (10, 10), {"camera": camera}, detail=0.5)
    assert isinstance(stage.tracer, DetailedTracer)
    width, spread = stage.tracer._footprint(np.array([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0]]))
    np.testing.assert_allclose(width, 0.2)
    np.testing.assert_allclose(spread, 0.0)


def test_pictures_of_every_kind_are_made():
    scene = pcsg.loads("sphere | move(0,0,-9) uscale(8) box")
    for projection in ANGLES:
        image = pcsg.render(scene, (24, 12), 4, camera={"projection": projection})
        assert np.isfinite(image.rgb).all()
        assert (image.leaf >= 0).any()
        outside = image.rgb[6, 0]
        assert (outside == 0).all() == (projection == "fisheye")
        if projection == "fisheye":
            assert image.leaf[6, 0] == -1
            assert np.isinf(image.depth[6, 0])


def test_pictures_do_not_depend_on_threads():
    scene = pcsg.loads("sphere")
    options = {"camera": {"projection": "fisheye", "aperture": 0.1}}
    one, two = (pcsg.render(scene, (80, 40), 4, threads=n, **options) for n in (1, 2))
    assert (one.rgb == two.rgb).all()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"fov": 200.0},
            "200, with `projection = perspective`; expected a number from 0.01 to 179",
        ),
        ({"fov": 181.0, "projection": "panorama"}, "0.01 to 180"),
        ({"height": 2.0}, "no `height`; expected `fov`, or `projection = orthographic`"),
        ({"projection": "ortho"}, "one of perspective, orthographic, fisheye, panorama"),
    ],
)
def test_impossible_cameras_are_refused(values, words):
    with pytest.raises(UsageError, match=words):
        pcsg.render(pcsg.loads("sphere"), (8, 8), 1, camera=values)


def test_animations_turn_every_camera():
    scene = Spheres(camera=[{**AUTOMATIC, "projection": "orthographic"}])
    camera = build_stage(scene, (40, 30), {}).camera
    turned = Camera(**turn_camera(vars(camera).copy(), 90.0))
    assert turned.height == camera.height
    assert turned.projection == "orthographic"


def test_the_command_that_is_told_makes_the_same_camera():
    from pcsg.commands.options import parse_setting

    for projection in ANGLES:
        scene = Spheres(camera=[{**AUTOMATIC, "projection": projection}])
        camera = build_stage(scene, (40, 30), {}).camera
        keys = parse_setting("camera", camera.keys)
        again = build_stage(Spheres(), (40, 30), {"camera": keys}).camera
        np.testing.assert_allclose(again.eye, camera.eye, rtol=1e-5)
        assert again.projection == projection
        assert again.tall == pytest.approx(camera.tall, rel=1e-5)
