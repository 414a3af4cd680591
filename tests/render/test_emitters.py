"""Things that shine: shadow rays to them against lamps of known light, and scattered rays alone."""

from dataclasses import replace

import numpy as np
import pytest

import pcsg
from pcsg.graph.shining import AXES, CENTER, COLUMNS, INVERSE, POWER, RADIUS, VOLUME
from pcsg.render.emitters import Emitters
from pcsg.render.job import Job
from pcsg.render.options import Options
from pcsg.render.sampler import sphere


def cover(center, radius, power, axes=None):
    """Return a ball, or the box of half axes (3, 3)."""
    row = np.zeros(COLUMNS)
    row[CENTER], row[RADIUS], row[POWER] = center, radius, power
    if axes is not None:
        row[RADIUS] = np.abs(axes).sum()
        row[VOLUME] = 8 * abs(np.linalg.det(axes))
        row[AXES:INVERSE] = np.ravel(axes)
        row[INVERSE:] = np.linalg.inv(np.transpose(axes)).ravel()
    return row


COVERS = np.array(
    [
        cover((0.0, 0.0, 3.0), 1.0, 5.0),
        cover((0.5, 0.2, 2.0), 0.3, 1.0),
        cover((-2.0, 1.0, 0.0), 1e-3, 0.2),
        cover((0.1, 0.0, 0.0), 0.5, 2.0),
        cover((0.3, 0.1, 2.2), 0.0, 3.0, [[1.0, 0.2, 0.0], [-0.2, 0.8, 0.1], [0.0, 0.02, 0.05]]),
        cover((3.0, 3.0, 1.0), 0.0, 3.0, [[0.5, 0.0, 0.0], [0.0, 0.0, 0.7], [0.0, 0.1, 0.0]]),
    ]
)
ROOM = """
    move(0, 0, -1) scale(5, 5, 1) material(floor) box
  | material(thing) move(-0.9, 0.2, 0.5) uscale(0.5) sphere
  | material(thing) move(0.9, -0.3, 0.4) scale(0.3, 0.3, 0.4) box
"""
LOOK = """
    material floor { color = (0.6, 0.5, 0.4); specular = 0 }
    material thing { color = (0.3, 0.5, 0.7); roughness = 0.4 }
    material lamp { emission = (9, 6, 3); color = (0, 0, 0); specular = 0 }
    sun { strength = 0 }
    sky { kind = none }
    camera { eye = (1, -5, 1.6); target = (0, 0, 0.3); fov = 34 }
"""
DARK = {"exposure": -10.0}
"""So dark that no sample is too bright to count."""

SHAPES = {
    "ball": "move(0.2, 0.3, 2.6) uscale(0.3) sphere",
    "tube": "move(-1.5, 0.3, 2.6) roty(90) scale(0.05, 0.05, 3) cylinder",
    "carved": "move(0.2, 0.3, 2.6) uscale(0.4) (box - sphere)",
    "panel": "move(0, 0, 4) scale(1.5, 1.5, 0.02) box",
    "sheet": "move(-1, -1, 3) uscale(2) tri1",
}


def picture(scene, samples, *, mode="path", asked=True, seed=1, size=(24, 18)):
    """Return the linear picture, with shadow rays to what shines or without."""
    job = Job(
        scene,
        Options(size=size, samples=samples, seed=seed, overrides={"film": {"mode": mode, **DARK}}),
    )
    job.film.unfinished = lambda taken: np.ones(job.film.count.shape, dtype=bool)
    assert job.stage.emitters is not None or not asked
    if not asked:
        job.integrator.stage = replace(job.stage, emitters=None)
    job.run()
    return job.image().rgb


@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (4.0, 3.0, 1.0), (0.2, 0.1, 2.1)])
def test_directions_have_the_density_that_is_told(position):
    """Means over drawn directions are integrals over all directions."""
    emitters = Emitters(COVERS)
    n = 1 << 16
    rng = np.random.default_rng(3)
    at = np.tile(np.array(position), (n, 1))
    aim = emitters.aim(at, rng.random((n, 2)))
    np.testing.assert_allclose(np.linalg.norm(aim.direction, axis=1), 1.0)
    np.testing.assert_allclose(emitters.density(at, aim.direction), aim.density)
    assert (aim.density > 0).all()
    evenly = sphere(
        rng.random((n, 2)),
    )
    share = 4 * np.pi * emitters.density(at, evenly)
    probes = [evenly[:, 0] > 0.3, evenly[:, 2] > 0.8, evenly[:, 1] * evenly[:, 2] > 0]
    drawn = [
        aim.direction[:, 0] > 0.3,
        aim.direction[:, 2] > 0.8,
        aim.direction[:, 1] * aim.direction[:, 2] > 0,
    ]
    for probe, found in zip(probes, drawn, strict=True):
        error = share.std() / np.sqrt(n)
        np.testing.assert_allclose((share * probe).mean(), found.mean(), atol=4 * error + 0.01)


def test_far_small_balls_are_met():
    emitters = Emitters(cover((1e4, 2e4, -3e4), 1e-3, 1.0)[None])
    at = np.random.default_rng(1).normal(size=(1000, 3))
    aim = emitters.aim(at, np.random.default_rng(2).random((1000, 2)))
    assert (aim.density > 0).mean() > 0.98


@pytest.mark.parametrize("mode", ["preview", "direct", "path"])
def test_a_shining_ball_is_like_a_light(mode):
    """A sphere of radiance L and radius r is a light of intensity pi r^2 L."""
    place = (0.2, 0.3, 2.6)
    shining = pcsg.loads(f"{{}} ({ROOM} | material(lamp) {SHAPES['ball']}) {LOOK}")
    strength = np.pi * 0.3**2
    light = pcsg.loads(
        f"{{}} ({ROOM}) {LOOK}"
        f" light {{ position = {place}; radius = 0.3; color = (9, 6, 3); strength = {strength} }}"
    )
    one = picture(shining, 64, mode=mode)
    job = Job(light, Options(size=(24, 18), samples=64, overrides={"film": {"mode": mode, **DARK}}))
    job.film.unfinished = lambda taken: np.ones(job.film.count.shape, dtype=bool)
    job.run()
    two = job.image().rgb
    # The lamp itself, which only one of them shows, is above the picture.
    np.testing.assert_allclose(one.mean(axis=(0, 1)), two.mean(axis=(0, 1)), rtol=0.02)
    assert np.abs(one - two).mean() < 0.05 * two.mean()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("mode", ["direct", "path"])
def test_asking_and_meeting_agree(shape, mode):
    scene = pcsg.loads(f"{{}} ({ROOM} | material(lamp) {SHAPES[shape]}) {LOOK}")
    asked = [picture(scene, 64, mode=mode, seed=seed) for seed in (1, 2)]
    alone = [picture(scene, 1024, mode=mode, asked=False, seed=seed) for seed in (3, 4)]
    mean = (alone[0] + alone[1]) / 2
    np.testing.assert_allclose((asked[0] + asked[1]).mean() / 2, mean.mean(), rtol=0.03)
    noisy = picture(scene, 64, mode=mode, asked=False, seed=5)
    # For the same number of samples the variance is a fraction.
    error = np.square(asked[0] - mean).mean(), np.square(noisy - mean).mean()
    assert error[0] < 0.5 * error[1]


def test_many_lamps_light_as_much_as_they_do_by_themselves():
    text = f"""{{n = 7; x = 0}} ({ROOM} | move(-2, 0.4, 2) T)
        T if(n > 0, 2, 1)
        1: T -> material(lamp) uscale(0.03) sphere
        2: T -> {{n = n-1}} (T | move(0.02*2^n, 0.01*n, 0) T)
        {LOOK}"""
    scene = pcsg.loads(text)
    asked = picture(scene, 64)
    alone = picture(scene, 1024, asked=False)
    np.testing.assert_allclose(asked.mean(), alone.mean(), rtol=0.03)
