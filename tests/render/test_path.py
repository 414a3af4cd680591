"""Light over surfaces, against what can be known without a renderer."""

import math
from dataclasses import replace

import numpy as np
import pytest
from spheres import Spheres

import pcsg
from pcsg.graph.settings import SETTINGS
from pcsg.render.job import Job
from pcsg.render.options import Options
from pcsg.render.sky import Sky

MATERIAL = {key: k.default for key, k in SETTINGS["material"].keys.items()}


def job(scene, *, samples=64, size=(16, 16), seed=1, **settings):
    made = Job(scene, Options(size=size, samples=samples, seed=seed, overrides=settings))
    made.film.unfinished = lambda taken: np.ones(made.film.count.shape, dtype=bool)
    return made


def furnace(scene, mode, samples=64, film=(), **settings):
    """Return the mean colour of what is met, in a white world."""
    made = job(
        scene, samples=samples, sun={"strength": 0.0}, film={"mode": mode, **dict(film)}, **settings
    )
    evenly = Everywhere()
    made.integrator.stage = replace(made.stage, sky=evenly, sources=(evenly,))
    made.run()
    image = made.image()
    assert np.isfinite(image.rgb).all()
    return image.rgb[np.isfinite(image.depth)].mean(axis=0)


class Everywhere(Sky):
    rows, columns = 1, 1

    def radiance(self, directions):
        return np.ones((len(directions), 3))


FURNACES = {
    "matt": {"specular": 0.0},
    "coated": {"roughness": 0.3},
    "metal": {"metallic": 1.0, "roughness": 0.7},
    "mirror": {"metallic": 1.0, "roughness": 0.0},
    "leaf": {"translucency": 0.5},
}


@pytest.mark.parametrize("kind", FURNACES)
def test_nothing_is_seen_of_a_white_ball_in_a_white_world(kind):
    scene = Spheres([(0, 0, 0)], [1.0], material=0, color=(1.0,) * 3)
    scene.settings["material"] = [{**MATERIAL, "name": "m", **FURNACES[kind]}]
    np.testing.assert_allclose(furnace(scene, "path"), 1.0, atol=0.012)


@pytest.mark.parametrize("roughness", [0.0, 0.5, 0.9])
def test_nor_of_glass(roughness):
    scene = pcsg.loads(
        "material(g) sphere"
        f" material g {{ transmission = 1; roughness = {roughness}; ior = 1.5; color = (1, 1, 1) }}"
    )
    found = furnace(scene, "path", film={"bounces": 30, "exposure": -6})
    np.testing.assert_allclose(found, 1.0, atol=0.02)


def test_white_things_lose_no_light_between_them():
    scene = Spheres(material=0, color=(1.0,) * 3)
    scene.settings["material"] = [{**MATERIAL, "name": "m", "specular": 0.0}]
    made = furnace(scene, "path")
    assert (made > 0.985).all()
    assert (made <= 1.003).all()


@pytest.mark.parametrize("mode", ["direct", "path"])
def test_the_sun_on_a_ball(mode):
    """Half the ball in sunlight: Lambert's law, summed over the disc that the camera sees."""
    scene = Spheres([(0, 0, 0)], [1.0], material=0, color=(0.6,) * 3)
    scene.settings["material"] = [{**MATERIAL, "name": "m", "specular": 0.0}]
    made = job(
        scene,
        size=(64, 64),
        samples=16,
        sky={"kind": "none"},
        sun={"direction": (0.0, 0.0, 1.0), "strength": 2.0, "color": (1, 1, 1), "angle": 0.0},
        camera={"eye": (0.0, 0.0, 2000.0), "target": (0.0, 0.0, 0.0), "up": (0, 1, 0), "fov": 0.06},
        film={"mode": mode},
    )
    made.run()
    across = 2 * 2000 * math.tan(math.radians(0.03))
    power = made.image().rgb.mean(axis=(0, 1)) * across**2
    # The integral of cos over the disc of a ball seen from above: 2 pi / 3.
    np.testing.assert_allclose(power, 2.0 * 0.6 / math.pi * 2 * math.pi / 3, rtol=0.01)


LIT = {
    "sun": {"sun": {"angle": 40.0}, "sky": {"kind": "none"}},
    "sky": {"sun": {"strength": 0.0}},
    "both": {"sun": {"angle": 30.0}},
    "physical": {"sun": {"angle": 30.0}, "sky": {"kind": "physical"}},
}


@pytest.mark.parametrize("lit", LIT)
@pytest.mark.parametrize("roughness", [0.1, 0.5])
def test_asking_lights_and_meeting_them_agree(lit, roughness, monkeypatch):
    """Both ways weighted, and scattered rays alone, which need no weights."""
    scene = Spheres(material=0, color=(0.7, 0.6, 0.5))
    scene.settings["material"] = [
        {**MATERIAL, "name": "m", "roughness": roughness, "metallic": 0.3}
    ]
    settings = {**LIT[lit], "film": {"mode": "direct"}}
    both = job(scene, samples=64, size=(24, 24), **settings)
    both.run()
    alone = job(scene, samples=256, size=(24, 24), **settings)
    integrator = alone.integrator
    monkeypatch.setattr(
        type(integrator),
        "_ask_lights",
        lambda self, surface, *rest: (np.zeros((len(surface.position), 3)), 0),
    )
    met = type(integrator)._met_lights
    monkeypatch.setattr(
        type(integrator),
        "_met_lights",
        lambda self, paths, t: met(self, paths._replace(chances=0 * paths.chances), t),
    )
    alone.run()
    seen = np.isfinite(both.image().depth)
    first, second = (made.image().rgb[seen].mean(axis=0) for made in (both, alone))
    np.testing.assert_allclose(first, second, rtol=0.03)


def test_one_light_by_chance_gives_what_all_give():
    scene = Spheres(material=0, color=(0.7, 0.6, 0.5))
    light = {key: k.default for key, k in SETTINGS["light"].keys.items()}
    scene.settings["material"] = [{**MATERIAL, "name": "m", "specular": 0.0}]
    scene.settings["light"] = [
        {**light, "position": p, "strength": 4.0, "radius": r}
        for p, r in (((3.0, -3.0, 4.0), 0.0), ((-3.0, -2.0, 3.0), 0.5), ((0.0, -4.0, 5.0), 0.1))
    ]
    images = []
    for many in (True, False):
        made = job(scene, samples=64, size=(24, 24), film={"mode": "direct"})
        if not many:
            made.integrator._asks_all = lambda depth: False
        made.run()
        images.append(made.image().rgb[np.isfinite(made.image().depth)].mean(axis=0))
    np.testing.assert_allclose(images[0], images[1], rtol=0.02)


LEAF = """
{{}} material(m) {solid}
material m {{ color = (1, 1, 1); specular = 0; translucency = 1 }}
sun {{ direction = (0, 0, 1); angle = 0; strength = 3.1415926; color = (1, 1, 1) }}
sky {{ kind = none }}
camera {{ eye = (0, 0, -50); target = (0, 0, 0); up = (0, 1, 0); fov = 0.5 }}
film {{ mode = {mode} }}
"""


@pytest.mark.parametrize("mode", ["preview", "direct", "path"])
@pytest.mark.parametrize(
    "solid", ["move(-0.4,-0.4,0) uscale(3) tri1", "scale(2,2,0.05) box", "scale(3,3,0.1) sphere"]
)
def test_light_shines_through_leaves_once_however_they_are_made(solid, mode):
    """Seen from below with the sun above: sheets and thin solids look the same."""
    scene = pcsg.loads(LEAF.format(solid=solid, mode=mode))
    image = pcsg.render(scene, size=(4, 4), samples=1)
    np.testing.assert_allclose(image.rgb, 1.0, rtol=0.01)


def test_threads_do_not_change_a_bit_of_a_path():
    scene = Spheres(ground=[{"z": None, "material": None}])
    images = [
        pcsg.render(scene, size=(60, 40), samples=16, threads=k, film={"mode": "path"})
        for k in (1, 3)
    ]
    assert np.array_equal(images[0].rgb, images[1].rgb)


def test_no_white_points_where_a_mirror_gathers_the_sun():
    scene = Spheres(
        [(0, 0, 1), (2.2, 0, 1)], [1.0, 1.0], material=0, ground=[{"z": 0.0, "material": "g"}]
    )
    scene.color = (-1.0,) * 3
    scene.settings["material"] = [
        {**MATERIAL, "name": "mirror", "metallic": 1.0, "roughness": 0.0, "color": (0.9,) * 3},
        {**MATERIAL, "name": "g", "specular": 0.0},
    ]
    made = job(scene, samples=16, size=(60, 45), film={"mode": "path"})
    made.run()
    rgb = made.image().rgb.max(axis=2)
    around = np.stack(
        [np.roll(rgb, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
    )
    lonely = (rgb > 3 * around.max(axis=0)) & (rgb > 1.5)
    assert not lonely[1:-1, 1:-1].any()


def test_direct_light_leaves_out_scattered_rays_that_find_nothing(monkeypatch):
    scene = Spheres(light=[{"position": (3.0, -3.0, 4.0), "color": (1.0,) * 3, "strength": 20.0}])
    scene.settings["light"][0]["radius"] = 0.0
    pictures, rays = [], []
    for _ in range(2):
        made = job(scene, samples=4, sky={"strength": 0.0}, film={"mode": "direct"})
        made.run()
        pictures.append(made.image().rgb)
        rays.append(made.progress.rays)
        # As if the point could be met by rays, which have to be traced then.
        monkeypatch.setattr("pcsg.render.lights.Ball.is_far", False)
    np.testing.assert_array_equal(pictures[0], pictures[1])
    assert pictures[0].max() > 0.1
    assert rays[0] < 0.9 * rays[1]
