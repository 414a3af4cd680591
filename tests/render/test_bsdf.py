"""What surfaces do with light: conservation, reciprocity, and drawing that fits the formulas."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pcsg.render.albedo import albedo_tables
from pcsg.render.bsdf import Matter, _mix_at, _regain, scatter_batch
from pcsg.render.sampler import Sampler

KINDS = {
    "matt": {"specular": 0.0},
    "coated": {"specular": 0.5},
    "leaf": {"translucency": 0.4},
    "metal": {"metallic": 1.0},
    "half metal": {"metallic": 0.5},
    "glass": {"transmission": 1.0},
    "in glass": {"transmission": 1.0, "eta": 1 / 1.5},
    "half glass": {"transmission": 0.5},
    "pane": {"transmission": 1.0, "sheet": True},
}
TILTS = [0.0, 0.8, 1.4]


def matter(viewers, **changes):
    n = len(viewers)
    values = {
        "color": 1.0,
        "roughness": 0.5,
        "metallic": 0.0,
        "specular": 0.5,
        "transmission": 0.0,
        "translucency": 0.0,
        "eta": 1.5,
        "sheet": False,
        **changes,
    }
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    color = np.broadcast_to(np.asarray(values.pop("color"), float), (n, 3)).copy()
    columns = {name: np.full(n, value) for name, value in values.items()}
    return Matter(up, up, np.asarray(viewers, float), color, **columns)


def tilted(tilt, n):
    return np.tile([math.sin(tilt), 0.0, math.cos(tilt)], (n, 1))


def numbers(n):
    zeros = np.zeros(n, dtype=np.int64)
    sampler = Sampler((1, 1), n, 7)
    return [sampler.pairs(zeros, zeros, np.arange(n), k) for k in (0, 1)]


def draw(m):
    n = len(m.eta)
    towards, light, density = np.zeros((n, 3)), np.empty((n, 3)), np.empty(n)
    scatter_batch(m, albedo_tables(), True, *numbers(n), towards, light, density)
    return towards, light, density


def evaluate(m, towards):
    n = len(m.eta)
    none = np.empty((0, 2))
    light, density = np.empty((n, 3)), np.empty(n)
    scatter_batch(m, albedo_tables(), False, none, none, np.array(towards, float), light, density)
    return light, density


def reflected(m):
    """Return the share of white light from everywhere that reaches the viewer, per colour."""
    towards, light, density = draw(m)
    ok = density > 0
    share = np.zeros_like(light)
    share[ok] = light[ok] / density[ok, None]
    # Radiance is squeezed in denser matter; as power, nothing is lost.
    below = (towards[:, 2] < 0) & (m.translucency == 0) & ~m.sheet
    return np.where(below[:, None], share * (m.eta**2)[:, None], share).mean(axis=0)


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("kind", KINDS)
def test_white_surfaces_in_white_light_are_white(kind, roughness, tilt):
    found = reflected(matter(tilted(tilt, 1 << 16), roughness=roughness, **KINDS[kind]))
    # What rough glass loses is known from a coarse table.
    error = 0.02 if KINDS[kind].get("transmission") else 0.007
    np.testing.assert_allclose(found, 1.0, atol=error)


@pytest.mark.parametrize("ior", [1.05, 1.33, 2.4])
@pytest.mark.parametrize("inside", [False, True])
def test_nor_does_other_glass_lose_light(ior, inside):
    eta = 1 / ior if inside else ior
    for roughness in (0.3, 0.7):
        m = matter(tilted(0.5, 1 << 15), roughness=roughness, transmission=1.0, eta=eta)
        np.testing.assert_allclose(reflected(m), 1.0, atol=0.02)


@pytest.mark.parametrize("kind", KINDS)
def test_drawn_directions_have_their_density(kind):
    n = 1 << 14
    m = matter(tilted(0.7, n), roughness=0.6, color=(0.9, 0.5, 0.2), **KINDS[kind])
    towards, light, density = draw(m)
    u, turn = numbers(n)[0].T
    z = 1 - 2 * u
    radius = np.sqrt(1 - z * z)
    evenly = np.stack(
        [radius * np.cos(2 * np.pi * turn), radius * np.sin(2 * np.pi * turn), z], axis=1
    )
    flat, flat_density = evaluate(m, evenly)
    ok = density > 0
    # The mean of any function, once over drawn directions, once over all by their density.
    for weight in (lambda d: np.ones(len(d)), lambda d: d[:, 0], lambda d: (d[:, 2] > 0) * 1.0):
        by_drawing = (weight(towards) * ok).mean()
        assert by_drawing == pytest.approx(
            (weight(evenly) * flat_density).mean() * 4 * np.pi, abs=0.02
        )
    drawn = (light[ok] / density[ok, None]).sum(axis=0) / n
    np.testing.assert_allclose(drawn, flat.mean(axis=0) * 4 * np.pi, rtol=0.03, atol=0.003)


def direction(z, turn):
    radius = math.sqrt(1 - z * z)
    return [radius * math.cos(turn), radius * math.sin(turn), z]


@given(
    st.sampled_from([k for k in KINDS if k not in ("glass", "in glass", "half glass", "pane")]),
    st.floats(0, 1),
    st.floats(0.02, 1),
    st.floats(0.02, 1),
    st.floats(0, 6.28),
    st.booleans(),
)
def test_light_and_viewer_may_change_places(kind, roughness, first, second, turn, through):
    a, b = direction(first, 0.3), direction(second, turn)
    sign = -1.0 if through else 1.0
    kept = {"roughness": roughness, "color": (0.8, 0.4, 0.1), **KINDS[kind]}
    there, _ = evaluate(matter([a], **kept), [[b[0], b[1], sign * b[2]]])
    # From the other side, through and through is mirrored at the surface.
    back, _ = evaluate(matter([b], **kept), [[a[0], a[1], sign * a[2]]])
    np.testing.assert_allclose(there / second, back / first, rtol=1e-6, atol=1e-12)


@given(st.floats(0.1, 1), st.floats(0.1, 1), st.floats(0.1, 1), st.floats(0, 6.28))
def test_refraction_changes_places_with_the_square_of_the_index(rough, first, second, turn):
    a, b = direction(first, 0.3), direction(second, turn)
    glass = {"transmission": 1.0, "roughness": rough}
    into, _ = evaluate(matter([a], eta=1.5, **glass), [[b[0], b[1], -b[2]]])
    # The same pair of directions, looked at from the other side with z turned over.
    out, _ = evaluate(matter([b], eta=1 / 1.5, **glass), [[a[0], a[1], -a[2]]])
    # What is given back for what rough glass loses depends on the viewer only.
    gains = [
        _regain(_mix_at(matter([v], eta=eta, **glass), 0), albedo_tables(), v[2])
        for v, eta in ((a, 1.5), (b, 1 / 1.5))
    ]
    into, out = into / gains[0], out / gains[1]
    np.testing.assert_allclose(into / second * 1.5**2, out / first, rtol=1e-6, atol=1e-9)


def test_a_mirror_mirrors_and_glass_bends_by_snells_law():
    m = matter(tilted(0.6, 64), roughness=0.0, metallic=1.0)
    towards, _, density = draw(m)
    np.testing.assert_allclose(towards, [[-math.sin(0.6), 0, math.cos(0.6)]] * 64, atol=5e-3)
    m = matter(tilted(0.6, 512), roughness=0.0, transmission=1.0)
    towards, _, density = draw(m)
    below = towards[:, 2] < 0
    assert (density > 0).all()
    np.testing.assert_allclose(np.hypot(*towards[below, :2].T), math.sin(0.6) / 1.5, atol=2e-3)
    # Fresnel's equations at 0.6 rad: 4.4 % are mirrored.
    c, k = math.cos(0.6), math.sqrt(1 - (math.sin(0.6) / 1.5) ** 2)
    share = 0.5 * (((1.5 * c - k) / (1.5 * c + k)) ** 2 + ((c - 1.5 * k) / (c + 1.5 * k)) ** 2)
    assert (~below).mean() == pytest.approx(share, abs=0.003)


def test_beyond_the_critical_angle_all_is_mirrored():
    towards, _, density = draw(
        matter(tilted(0.9, 256), roughness=0.0, transmission=1.0, eta=1 / 1.5)
    )
    assert (towards[:, 2] > 0).all()
    assert (density > 0).all()


def test_a_matt_surface_is_lambert():
    light, density = evaluate(matter(tilted(0.3, 1), specular=0.0, color=0.5), [[0.6, 0.0, 0.8]])
    np.testing.assert_allclose(light, 0.5 * 0.8 / np.pi)
    np.testing.assert_allclose(density, 0.8 / np.pi)


def test_light_from_behind_needs_translucency():
    behind = [[0.0, 0.6, -0.8]]
    assert (evaluate(matter(tilted(0.0, 1)), behind)[0] == 0).all()
    leaf = matter(tilted(0.0, 1), specular=0.0, translucency=0.4, color=0.5)
    np.testing.assert_allclose(evaluate(leaf, behind)[0], 0.4 * 0.5 * 0.8 / np.pi)


def test_bumps_let_no_light_through_the_geometry():
    m = matter(tilted(0.0, 1), specular=0.0)
    bent = np.array([[0.8, 0.0, 0.6]])
    m = m._replace(normal=bent)
    below = np.array([[0.99, 0.0, -math.sqrt(1 - 0.99**2)]])
    assert (evaluate(m, below)[0] == 0).all()
