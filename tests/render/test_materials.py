import numpy as np
import pytest
from PIL import Image as Pillow
from spheres import Spheres

from pcsg.graph.settings import SETTINGS
from pcsg.render.materials import Materials
from pcsg.render.textures import KINDS, Textures

MATERIAL = {key: k.default for key, k in SETTINGS["material"].keys.items()}
TEXTURE = {key: k.default for key, k in SETTINGS["texture"].keys.items()}


def gather(scene, materials, textures=()):
    numbers = {t["name"]: k for k, t in enumerate(textures)}
    table = Materials(materials, numbers, Textures.of(textures), scene.sheets)
    directions = np.array([[0.0, 1.0, 0.0], [0.3, 1.0, 0.0], [5.0, 1.0, 0.0]])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origins = np.tile([0.0, -5.0, 1.0], (3, 1))
    hits = scene.intersect(origins, directions, 0.0, np.inf)
    at = np.flatnonzero(np.isfinite(hits.t))
    return table.gather(hits, at, directions[at], scene)


def test_attributes_override_materials():
    red = {**MATERIAL, "color": (1.0, 0.0, 0.0), "roughness": 0.2}
    found = gather(Spheres(material=0, color=(-1.0,) * 3), [red])
    np.testing.assert_allclose(found.matter.color, [[1, 0, 0]] * len(found.matter.color))
    np.testing.assert_allclose(found.matter.roughness, 0.2)
    found = gather(Spheres(material=0, color=(0.0, 1.0, 0.0)), [red])
    np.testing.assert_allclose(found.matter.color, [[0, 1, 0]] * len(found.matter.color))
    found = gather(Spheres(color=(-1.0,) * 3), [red])
    np.testing.assert_allclose(found.matter.color, 0.7)


def test_normals_face_the_viewer():
    found = gather(Spheres(centers=[(0, 0, 1)], radii=[20.0]), [])
    assert (np.einsum("ij,ij->i", found.matter.normal, found.matter.viewer) > 0).all()


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("image", "normals")])
def test_patterns_are_between_their_colours_and_vary(kind):
    textures = Textures.of([{**TEXTURE, "kind": kind, "scale": 0.7}])
    points = np.random.default_rng(5).uniform(-4, 4, (500, 3))
    zero = np.zeros(500, dtype=np.int64)
    amounts = textures.amounts(zero, points, np.zeros((500, 2)), np.ones(500))
    assert ((amounts >= 0) & (amounts <= 1)).all()
    assert np.std(amounts) > 0.05
    np.testing.assert_allclose(
        textures.amounts(zero, 3 * points, np.zeros((500, 2)), np.full(500, 3.0)), amounts
    )


def test_bumps_bend_normals_but_not_the_geometry():
    bark = {**TEXTURE, "name": "bark", "kind": "bark"}
    rough = {**MATERIAL, "texture": "bark", "bump": 0.2}
    found = gather(Spheres(material=0), [rough], [bark])
    assert (np.abs(found.matter.normal - found.matter.facing) > 1e-6).any()
    np.testing.assert_allclose(np.linalg.norm(found.matter.normal, axis=1), 1)
    assert (np.einsum("ij,ij->i", found.matter.normal, found.matter.viewer) > 0).all()
    flat = gather(Spheres(material=0), [{**rough, "bump": 0.0}], [bark])
    assert (flat.matter.normal == flat.matter.facing).all()


@pytest.mark.parametrize("kind", ["noise", "checker", "image"])
def test_a_texture_is_multiplied_by_the_color_of_its_material(kind, tmp_path):
    pixels = np.full((2, 2, 3), (200, 120, 60), dtype=np.uint8)
    Pillow.fromarray(pixels).save(tmp_path / "p.png")
    texture = {**TEXTURE, "name": "t", "kind": kind, "file": str(tmp_path / "p.png")}
    textured = {**MATERIAL, "texture": "t"}
    found, tinted = (
        gather(
            Spheres(material=0, color=(-1.0,) * 3), [{**textured, **more}], [texture]
        ).matter.color
        for more in ({}, {"color": (1.0, 0.5, 0.0)})
    )
    np.testing.assert_allclose(tinted, found * (1.0, 0.5, 0.0))
    assert (found.max(axis=0) > 0.04).all()
    # `color(...)` takes the place of the material's colour, textured or not.
    green = Spheres(material=0, color=(0.0, 1.0, 0.0))
    nearer, as_before = (
        gather(green, [{**textured, **more}], [texture]).matter.color
        for more in ({"color": (1.0, 0.5, 0.0)}, {})
    )
    np.testing.assert_array_equal(nearer, as_before)


NO_OTHERS = np.zeros((2, 3))


class Plane(Spheres):
    """A plane z = 0 whose coordinates are half of x and a third of y."""

    others = NO_OTHERS

    def intersect(self, origins, directions, t_min, t_max):
        hits = super().intersect(origins, directions, t_min, t_max)
        t = -origins[:, 2] / directions[:, 2]
        position = origins + t[:, None] * directions
        n = len(t)
        return type(hits)(
            t=t,
            leaf=np.zeros(n, np.int64),
            normal=np.tile([0.0, 0.0, 1.0], (n, 1)),
            position=position,
            uv=position[:, :2] / [2.0, 3.0],
            other_uv=np.tile(self.others, (n, 1, 1)),
            label=hits.label,
            color=np.full((n, 3), -1.0),
            material=np.zeros(n, np.int64),
            texture=np.full(n, -1),
            texture_scale=np.ones(n),
        )


def plane(tmp_path, pixels, others=NO_OTHERS, **material):
    Pillow.fromarray(pixels).save(tmp_path / "p.png")
    kind = material.pop("kind", "image")
    texture = {**TEXTURE, "name": "t", "kind": kind, "file": str(tmp_path / "p.png")}
    rows = [{**MATERIAL, "texture": "t", **material}]
    scene = Plane()
    scene.others = others
    table = Materials(rows, {"t": 0}, Textures.of([texture]), scene.sheets)
    origins = np.array([[0.1, 0.2, 4.0], [0.9, 1.9, 4.0]])
    directions = np.tile([0.0, 0.0, -1.0], (2, 1))
    hits = scene.intersect(origins, directions, 0.0, np.inf)
    return table.gather(hits, np.arange(2), directions, scene)


def test_pictures_lie_on_surface_coordinates_upright(tmp_path):
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[1, 0] = 255, 0, 0  # lower left: small u and v
    pixels[0, 0] = 0, 255, 0  # upper left
    found = plane(tmp_path, np.repeat(np.repeat(pixels, 50, axis=0), 50, axis=1))
    np.testing.assert_allclose(found.matter.color, [[1, 0, 0], [0, 1, 0]], atol=1e-9)


def test_pictures_of_parts_that_blend_are_mixed(tmp_path):
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[1, 0], pixels[0, 0], pixels[1, 1] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    large = np.repeat(np.repeat(pixels, 50, axis=0), 50, axis=1)
    # A third of the whole is what lies at the lower right, a quarter what lies above it.
    found = plane(tmp_path, large, others=[(0.8, 0.2, 1 / 3), (0.8, 0.7, 1 / 4)])
    expected = [[5 / 12, 0, 1 / 3], [0, 5 / 12, 1 / 3]]
    np.testing.assert_allclose(found.matter.color, expected, atol=1e-9)


def test_reliefs_of_parts_that_blend_end_where_these_change_places(tmp_path):
    ramp = np.repeat(np.linspace(0, 255, 256).astype(np.uint8)[None], 256, axis=0)
    pixels = np.repeat(ramp[..., None], 3, axis=2)
    slopes = []
    for shares in ((0.0, 0.0), (0.3, 0.1), (0.4, 0.2)):
        others = [(0.3, 0.3, share) for share in shares]
        normal = plane(tmp_path, pixels, others=others, bump=0.3).matter.normal
        slopes.append(-normal[:, 0] / normal[:, 2])
    np.testing.assert_allclose(slopes[1], 0.5 * slopes[0], rtol=1e-6)
    np.testing.assert_allclose(slopes[2], 0.0, atol=1e-12)
    assert (slopes[0] > 0.01).all()


def test_the_relief_of_a_picture_tilts_normals_by_its_slope(tmp_path):
    ramp = np.repeat(np.linspace(0, 255, 256).astype(np.uint8)[None], 256, axis=0)
    pixels = np.repeat(ramp[..., None], 3, axis=2)
    found = plane(tmp_path, pixels, bump=0.3)
    # Higher along u: the normal leans back along x. Linear light of a ramp in sRGB.
    normal = found.matter.normal
    u, step = np.array([0.05, 0.45]), 1 / 256
    decode = lambda v: ((v + 0.055) / 1.055) ** 2.4  # noqa: E731
    slope = 0.3 * (decode(u + step) - decode(u - step)) / (2 * step) / 2
    np.testing.assert_allclose(-normal[:, 0] / normal[:, 2], slope, rtol=0.05)
    np.testing.assert_allclose(normal[:, 1], 0, atol=1e-3)


def test_pictures_of_normals_say_them(tmp_path):
    tilt = np.array([0.6, 0.0, 0.8])
    pixels = np.tile(np.round((tilt + 1) / 2 * 255).astype(np.uint8), (8, 8, 1))
    found = plane(tmp_path, pixels, kind="normals", bump=1.0)
    np.testing.assert_allclose(found.matter.normal, [tilt, tilt], atol=0.01)
