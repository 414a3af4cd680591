import numpy as np
import pytest
from spheres import Spheres

from pcsg.render.job import render
from pcsg.render.options import Options
from pcsg.render.progressive import DIVISORS, Progressive
from pcsg.render.stage import build_stage
from pcsg.trace.rays import Stopped

GROUND = {"z": None, "material": None}
SIZE = (90, 60)


def progressive(superseded=lambda: False, pace=4e-6):
    scene = Spheres(ground=[GROUND])
    return Progressive(scene, build_stage(scene, SIZE, {}), {}, superseded, 2, pace)


def test_pictures_get_finer_and_the_last_is_that_of_render():
    frames = []
    progressive(pace=1e-3).refine(Options(SIZE, 4), frames.append)
    divisors = [frame.divisor for frame in frames]
    assert divisors == sorted(divisors, reverse=True)
    assert divisors[0] > divisors[-1] == 1
    assert [frame.done for frame in frames] == [False] * (len(frames) - 1) + [True]
    assert np.array_equal(frames[-1].image.rgb, render(Spheres(ground=[GROUND]), SIZE, 4).rgb)


def test_a_glance_is_as_small_as_the_pace_asks():
    slow, fast = progressive(pace=1.0), progressive(pace=1e-9)
    assert slow.glance(Options(SIZE)).divisor == DIVISORS[-1]
    frame = fast.glance(Options(SIZE))
    assert frame.divisor == 1
    assert frame.image.rgb.shape == (60, 90, 3)
    assert fast.pace > 1e-9


def test_something_newer_stops_a_picture():
    with pytest.raises(Stopped):
        progressive(lambda: True).refine(Options(SIZE), lambda frame: None)


def test_an_interrupt_ends_a_job_that_runs():
    makes = progressive(pace=1e-9)

    def interrupt(progress):
        makes.interrupt()

    job = makes._begin(Options(SIZE, 4096))
    with pytest.raises(Stopped):
        job.run(interrupt)
    assert job.image().finished.any()


def test_a_stage_seen_from_elsewhere_is_the_one_built_there():
    scene = Spheres(ground=[GROUND])
    camera = {"eye": (9.0, 1.0, 4.0), "target": (0.0, 0.0, 1.0), "up": (0.0, 0.0, 1.0), "fov": 20.0}
    there = build_stage(scene, SIZE, {"camera": camera}, 0.5)
    moved = build_stage(scene, SIZE, {}).seen_by(there.camera, SIZE[1], 0.5)
    assert moved.camera == there.camera
    assert type(moved.tracer) is type(there.tracer)
    assert moved.tracer.z == there.tracer.z
    for name in ("extent", "sun_is_seen", "ground", "mode", "bounces", "view"):
        assert getattr(moved, name) == getattr(there, name)
