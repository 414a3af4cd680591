import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from spheres import Spheres

import pcsg
from pcsg.errors import UsageError
from pcsg.graph.settings import SETTINGS
from pcsg.render import framing
from pcsg.render.camera import Camera, basis
from pcsg.render.framing import MARGIN, corners, find_lowest, place, tame

AUTOMATIC = {key: k.default for key, k in SETTINGS["camera"].keys.items()}

inf = math.inf


def project(camera, points, aspect):
    """Return picture coordinates in [-1, 1] and depths of points."""
    right, up, forward = basis(camera.eye, camera.target, camera.up)
    local = (points - np.array(camera.eye)) @ np.stack([right, up, forward]).T
    tangent = math.tan(math.radians(camera.fov) / 2)
    return (
        local[:, :2] / local[:, 2:] / tangent / np.array([aspect, 1.0]),
        local[:, 2],
    )


numbers = st.floats(-100, 100)
sides = st.floats(1e-3, 1e3)


@given(
    st.tuples(numbers, numbers, numbers),
    st.tuples(sides, sides, sides),
    st.floats(0.2, 5),
    st.floats(5, 120),
)
def test_the_box_is_inside_and_fills_the_picture(low, size, aspect, fov):
    low = np.array(low)
    box = np.array([low, low + size])
    camera = place({**AUTOMATIC, "fov": fov}, box, aspect)
    at, depth = project(camera, corners(box), aspect)
    assert (depth > 0).all()
    limit = 1 - 2 * MARGIN
    assert np.abs(at).max() <= limit + 1e-6
    # Either it touches the margins of one axis on both sides, or the eye stands close before it.
    touches = (at.max(axis=0) > limit - 1e-6) & (at.min(axis=0) < -limit + 1e-6)
    assert touches.any() or depth.min() < 0.01 * max(size)


@given(st.floats(0.2, 5))
def test_the_target_is_kept(aspect):
    box = np.array([[-1.0, -2.0, 0.0], [1.0, 2.0, 5.0]])
    camera = place({**AUTOMATIC, "target": (0.0, 0.0, 1.0)}, box, aspect)
    at, _ = project(camera, np.array([[0.0, 0.0, 1.0]]), aspect)
    assert np.abs(at).max() < 1e-12
    at, depth = project(camera, corners(box), aspect)
    assert np.abs(at).max() == pytest.approx(1 - 2 * MARGIN)
    assert (depth > 0).all()


@pytest.mark.parametrize(
    "bounds",
    [
        [[inf] * 3, [-inf] * 3],
        [[0.0] * 3, [0.0] * 3],
        [[5.0, 5.0, 5.0], [5.0, 5.0, 5.0]],
        [[1e9, 1e9, 1e9], [1e9, 1e9, 1e9]],
        [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]],
        [[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]],
        [[-inf] * 3, [inf] * 3],
        [[-inf, -inf, -inf], [inf, inf, 0.0]],
        [[-inf, 0.0, 0.0], [inf, 2.0, 1.0]],
        [[1e-200] * 3, [2e-200] * 3],
        [[math.nan] * 3, [math.nan] * 3],
        [[-1e100] * 3, [1e100] * 3],
    ],
)
def test_degenerate_bounds_have_a_camera(bounds):
    box = tame(np.array(bounds))
    assert np.isfinite(box).all()
    assert (box[1] >= box[0]).all()
    camera = place(AUTOMATIC, np.array(bounds), 4 / 3)
    at, depth = project(camera, corners(box), 4 / 3)
    assert (depth > 0).all()
    assert np.abs(at).max() < 1


def test_an_up_along_the_view_is_replaced():
    right, up, forward = basis((0, 0, 5), (0, 0, 0), (0, 0, 1))
    axes = np.stack([right, up, forward])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)


def test_rays_go_through_the_picture():
    camera = Camera((0, -5, 0), (0, 0, 0), fov=90)
    origins, directions = camera.rays(np.array([1.0, 2.0, 0.0]), np.array([1.0, 1.0, 0.0]), (2, 2))
    np.testing.assert_allclose(origins, [[0, -5, 0]] * 3)
    np.testing.assert_allclose(directions[0], [0, 1, 0], atol=1e-15)
    assert directions[1, 0] == pytest.approx(math.sqrt(0.5))
    assert directions[2, 0] < 0 < directions[2, 2]
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)


def test_a_lens_keeps_the_plane_of_focus_sharp():
    camera = Camera((0, -5, 0), (0, 0, 0), aperture=1.0, focus=4.0)
    lens = np.random.default_rng(1).random((50, 2))
    origins, directions = camera.rays(np.full(50, 1.7), np.full(50, 0.4), (2, 2), lens)
    t = (-1.0 - origins[:, 1]) / directions[:, 1]
    points = origins + t[:, None] * directions
    np.testing.assert_allclose(points, np.broadcast_to(points[0], points.shape), atol=1e-12)
    assert np.ptp(origins[:, 0]) > 0.5


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"eye": (1, 2, 3), "target": (1, 2, 3)}, "same point"),
        ({"fov": 0.0}, "fov"),
        ({"fov": 180.0}, "fov"),
        ({"up": (0, 0, 0)}, "up"),
    ],
)
def test_impossible_cameras_are_refused(values, word):
    with pytest.raises(UsageError, match=word):
        place({**AUTOMATIC, **values}, np.array([[0.0] * 3, [1.0] * 3]), 1.0)


@pytest.mark.parametrize("aspect", [0.4, 1.0, 2.5])
def test_what_is_seen_is_framed_not_its_box(aspect):
    # A ball on a long pole, such as a tree: the lower corners of the box are empty.
    centers = [(0, 0, z / 4) for z in range(20)] + [(0.0, 0.0, 6.0)]
    scene = Spheres(centers, [0.2] * 20 + [2.0])
    camera = place(AUTOMATIC, scene.bounds, aspect, scene)
    rng = np.random.default_rng(1)
    surface = rng.normal(size=(21, 2000, 3))
    surface /= np.linalg.norm(surface, axis=2)[..., None]
    surface = surface * scene.radii[:, None, None] + scene.centers[:, None]
    at, depth = project(camera, surface.reshape(-1, 3), aspect)
    assert (depth > 0).all()
    assert np.abs(at).max() < 0.97
    k = 0 if np.ptp(at[:, 0]) > np.ptp(at[:, 1]) else 1
    assert np.ptp(at[:, k]) > 1.75
    assert abs(at[:, k].max() + at[:, k].min()) < 0.06


def test_nothing_in_the_box_frames_the_box():
    scene = Spheres([(0, 0, 0)], [1e-9])
    box = np.array([[-1.0] * 3, [1.0] * 3])
    assert place(AUTOMATIC, box, 1.0, scene) == place(AUTOMATIC, box, 1.0)


def test_thin_parts_that_stand_out_are_in_the_picture():
    # A needle of balls, thinner than what lies between two of the rays that look for things first.
    tips = [(3.0 + 0.01 * k, 1.0, 0.003) for k in range(200)]
    scene = Spheres([(0, 0, 0), *tips], [1.0] + [0.008] * 200)
    camera = place(AUTOMATIC, scene.bounds, 1.5, scene)
    at, depth = project(camera, np.array(tips), 1.5)
    assert (depth > 0).all() and np.abs(at).max() < 1.0 - MARGIN


@pytest.mark.parametrize(
    "shape", ["sphere", "move(0,0,-1) uscale(3) cylinder", "uscale(2) blob { point(1) }"]
)
def test_the_ground_is_where_the_things_end_and_not_their_box(shape):
    scene = pcsg.loads(f"move(1, 2, 3) ({shape} \\ move(0, 0, -50.1) uscale(50) box)")
    if shape == "sphere":
        assert scene.bounds[0, 2] == pytest.approx(2.0)
    assert find_lowest(scene.bounds, scene.tracer) == pytest.approx(2.9, abs=0.02)


def test_the_ground_is_below_a_thin_foot():
    foot = [(0.7, 0.21, -1.0 - 0.01 * k) for k in range(100)]
    scene = Spheres([(0, 0, 0), *foot], [1.0] + [0.005] * 100)
    box = scene.bounds - [[0.0, 0.0, 3.0], [0.0] * 3]
    assert find_lowest(box, scene) == pytest.approx(-1.995, abs=0.02)


def test_the_ground_of_an_exact_box_is_its_lower_side():
    scene = pcsg.loads("rotx(30) scale(1, 2, 3) cylinder | move(4, 0, 0) cone")
    assert find_lowest(scene.bounds, scene.tracer) == scene.bounds[0, 2]
    nothing = np.array([[inf] * 3, [-inf] * 3])
    assert find_lowest(nothing, Spheres([(9, 9, 9)], [1.0])) == -1.0


WIRES = (
    "sphere | move(0,0,1) scale(0.002,0.002,5) cylinder"
    " | roty(90) scale(0.0005,0.0005,7) cylinder | move(-4,3,0) scale(0.001,0.001,-5) cylinder"
)
"""A ball with wires that no ray of the search meets."""


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_wires_that_rays_miss_are_in_the_picture(projection):
    scene = pcsg.loads(WIRES)
    values = {**AUTOMATIC, "projection": projection}
    ends = np.array([[0, 0, 1], [0, 0, 6], [7, 0, 0], [-4, 3, 0], [-4, 3, -5]], dtype=float)
    missed = []
    for aspect in (0.5, 1.0, 2.0):
        camera = place(values, scene.bounds, aspect, scene.tracer, scene.reach)
        at = framing._project(camera, ends, aspect)
        assert 1 - 3 * MARGIN < np.abs(at).max() < 1 - MARGIN + 1e-3
        cut = place(values, scene.bounds, aspect, scene.tracer)
        missed.append(np.abs(framing._project(cut, ends, aspect)).max() > 1.0)
    assert any(missed)


def test_cameras_of_what_rays_find_stay_where_they_were():
    scene = pcsg.loads("sphere | move(3,0,0) box")
    with_reach = place(AUTOMATIC, scene.bounds, 1.0, scene.tracer, scene.reach)
    assert with_reach == place(AUTOMATIC, scene.bounds, 1.0, scene.tracer)


def test_the_ground_lies_below_a_wire_that_hangs_down():
    # A cut makes the box larger than the things are.
    scene = pcsg.loads(f"{WIRES} | (uscale(20) box \\ uscale(21) box)")
    assert find_lowest(scene.bounds, scene.tracer, scene.reach) == pytest.approx(-5.0, abs=1e-3)


def test_the_ground_lies_below_a_village_on_hills():
    scene = pcsg.loads(
        "{a = 0; n = 300} S\n"
        "S if(n > 1, 2, 1)\n"
        "1: S -> {x = 100*rand(a,1); y = 100*rand(a,2)} move(x, y, 12*sin(x/2)*cos(y/3)) house\n"
        "2: S -> {n = floor(n/2)} S | {a = a + floor(n/2); n = n - floor(n/2)} S\n"
        "house = move(0,0,1) box | move(0,0,2) cone\n"
    )
    lowest = find_lowest(scene.bounds, scene.tracer, scene.reach)
    assert lowest == pytest.approx(scene.bounds[0, 2], abs=0.005 * 100)
    image = pcsg.render(scene, (80, 60), 1, ground={})
    assert (image.leaf == -2).mean() > 0.3
