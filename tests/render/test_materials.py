import numpy as np
import pytest
from spheres import Spheres

from pcsg.graph.settings import SETTINGS
from pcsg.render.materials import Materials, Surface
from pcsg.render.sampler import Sampler, cosine_hemisphere
from pcsg.render.textures import KINDS, Textures

MATERIAL = {key: k.default for key, k in SETTINGS["material"].keys.items()}
TEXTURE = {key: k.default for key, k in SETTINGS["texture"].keys.items()}


def surface(n, *, roughness=0.5, metallic=0.0, specular=0.5, translucency=0.0, color=1.0, tilt=0.0):
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    viewer = np.tile([np.sin(tilt), 0.0, np.cos(tilt)], (n, 1))
    full = np.ones(n)
    return Surface(
        np.zeros((n, 3)),
        up,
        up,
        viewer,
        np.full((n, 3), color),
        np.zeros((n, 3)),
        roughness * full,
        metallic * full,
        specular * full,
        translucency * full,
    )


@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("tilt", [0.0, 0.8])
def test_gloss_gives_no_more_than_it_gets(metallic, roughness, tilt):
    n = 4096
    zeros = np.zeros(n, dtype=np.int64)
    pairs = Sampler((1, 1), n, 1).pairs(zeros, zeros, np.arange(n), 0)
    s = surface(
        n, roughness=roughness, metallic=metallic, color=0.0 if not metallic else 1.0, tilt=tilt
    )
    towards = cosine_hemisphere(pairs, s.normal)
    # The density of the directions is cos / pi.
    cos = np.maximum(towards[:, 2], 1e-6)
    total = (s.reflect(towards)[:, 0] * np.pi / cos).mean()
    assert 0 < total <= 1.02


def test_a_matt_surface_is_lambert():
    s = surface(1, specular=0.0, color=0.5)
    np.testing.assert_allclose(s.reflect(np.array([[0.6, 0.0, 0.8]])), 0.5 * 0.8 / np.pi)


def test_light_from_behind_needs_translucency():
    behind = np.array([[0.0, 0.6, -0.8]])
    assert (surface(1).reflect(behind) == 0).all()
    leaf = surface(1, translucency=0.4, color=0.5)
    np.testing.assert_allclose(leaf.reflect(behind), 0.4 * 0.5 * 0.8 / np.pi)


def gather(scene, materials, textures=()):
    numbers = {t["name"]: k for k, t in enumerate(textures)}
    table = Materials(materials, numbers, Textures.of(textures))
    directions = np.array([[0.0, 1.0, 0.0], [0.3, 1.0, 0.0], [5.0, 1.0, 0.0]])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origins = np.tile([0.0, -5.0, 1.0], (3, 1))
    hits = scene.intersect(origins, directions, 0.0, np.inf)
    at = np.flatnonzero(np.isfinite(hits.t))
    return table.gather(hits, at, directions)


def test_attributes_override_materials():
    red = {**MATERIAL, "color": (1.0, 0.0, 0.0), "roughness": 0.2}
    found = gather(Spheres(material=0, color=(-1.0,) * 3), [red])
    np.testing.assert_allclose(found.color, [[1, 0, 0]] * len(found.color))
    np.testing.assert_allclose(found.roughness, 0.2)
    found = gather(Spheres(material=0, color=(0.0, 1.0, 0.0)), [red])
    np.testing.assert_allclose(found.color, [[0, 1, 0]] * len(found.color))
    found = gather(Spheres(color=(-1.0,) * 3), [red])
    np.testing.assert_allclose(found.color, 0.7)


def test_normals_face_the_viewer():
    found = gather(Spheres(centers=[(0, 0, 1)], radii=[20.0]), [])
    assert (np.einsum("ij,ij->i", found.normal, found.viewer) > 0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_patterns_are_between_their_colours_and_vary(kind):
    textures = Textures.of([{**TEXTURE, "kind": kind, "scale": 0.7}])
    points = np.random.default_rng(5).uniform(-4, 4, (500, 3))
    zero = np.zeros(500, dtype=np.int64)
    amounts = textures.amounts(zero, points, np.ones(500))
    assert ((amounts >= 0) & (amounts <= 1)).all()
    assert np.std(amounts) > 0.05
    np.testing.assert_allclose(textures.amounts(zero, 3 * points, np.full(500, 3.0)), amounts)


def test_bumps_bend_normals_but_not_the_geometry():
    bark = {**TEXTURE, "name": "bark", "kind": "bark"}
    rough = {**MATERIAL, "texture": "bark", "bump": 0.2}
    found = gather(Spheres(material=0), [rough], [bark])
    assert (np.abs(found.normal - found.facing) > 1e-6).any()
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1)
    assert (np.einsum("ij,ij->i", found.normal, found.viewer) > 0).all()
    flat = gather(Spheres(material=0), [{**rough, "bump": 0.0}], [bark])
    assert (flat.normal == flat.facing).all()
