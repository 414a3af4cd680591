"""Packets of triangles: the same bits as one triangle after the other, at any size and place."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from pcsg import Scene, box, mesh, move, scale
from pcsg.geometry.packets import LANES, PACKET, pack_triangles
from pcsg.jit import plain
from pcsg.leaf.dispatch import leaf_crossings, leaf_normal, leaf_part_normal
from pcsg.leaf.mesh import Mesh, MeshModel, mesh_of_arrays
from pcsg.leaf.registry import ALL, ANY, FIRST
from pcsg.leaf.triangles import cross_triangle, make_shear
from pcsg.trace.pool import ModelPool
from pcsg.vec import Ray, Vec3

cross_one, shear_of = plain(cross_triangle), plain(make_shear)

SQUARE = ((0, 1, 2), (0, 2, 3))


def ball(n: int, seed: int) -> tuple[Any, Any]:
    """Return corners and triangles of a rough ball."""
    rng = np.random.default_rng(seed)
    polar, around = np.pi * np.arange(1, n) / n, np.pi * np.arange(2 * n) / n
    a, b = np.meshgrid(polar, around, indexing="ij")
    ring = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=-1)
    points = np.concatenate([[[0.0, 0.0, 1.0]], ring.reshape(-1, 3), [[0.0, 0.0, -1.0]]])
    points *= rng.uniform(0.7, 1.1, (len(points), 1))
    faces = []
    for j in range(2 * n):
        k = (j + 1) % (2 * n)
        faces += [
            (0, 1 + j, 1 + k),
            (len(points) - 1, 1 + (n - 2) * 2 * n + k, 1 + (n - 2) * 2 * n + j),
        ]
        for i in range(n - 2):
            at = 1 + 2 * n * i
            faces += [(at + j, at + 2 * n + j, at + 2 * n + k), (at + j, at + 2 * n + k, at + k)]
    return points, faces


class Probe:
    """A mesh in the pool, behind another one, so that nothing begins at zero."""

    def __init__(self, model: MeshModel) -> None:
        models = ModelPool([Mesh])
        models.place(mesh_of_arrays(np.eye(3), [[0, 1, 2]]))
        self.args = np.array(models.place(model))
        self.pool = models.pool
        self.model = model
        corners = model.polygons.vertices[model.triangles]
        self.corners = corners
        # Each triangle in a packet of its own.
        self.packets = pack_triangles(corners, np.arange(len(corners) + 1, dtype=np.int32))

    def cross(self, ray: Ray, want: int = ALL) -> tuple[list[float], float]:
        """Return the crossings, and what is left behind them."""
        t = np.full(2_000, np.nan)
        n = leaf_crossings(Mesh.kind, ray, want, self.args, 0, self.pool, t, 0)
        return t[:n].tolist(), float(t[n])

    def reference(self, ray: Ray) -> list[tuple[float, float]]:
        """Return t and direction of all triangles that are crossed, by one after the other."""
        shear = shear_of(ray)
        with np.errstate(all="ignore"):
            found = [
                cross_one(self.packets, np.uint64(PACKET * k), shear)
                for k in range(len(self.corners))
            ]
        return sorted((t, way) for t, way in found if way != 0.0)


def rays_at(corners: Any, count: int, far: float, seed: int) -> list[Ray]:
    """Return rays through a mesh: at random places, vertices, edges, and along axes."""
    rng = np.random.default_rng(seed)
    center = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
    size = np.ptp(corners, axis=(0, 1)).max()
    rays = []
    for k in range(count):
        triangle = corners[rng.integers(len(corners))]
        weights = [rng.dirichlet((1.0, 1.0, 1.0)), (1.0, 0.0, 0.0), (0.5, 0.5, 0.0)][k % 3]
        target = weights @ triangle
        away = rng.normal(size=3) if k % 4 else np.eye(3)[k // 4 % 3] * rng.choice([-1.0, 1.0])
        if k % 7 == 0:
            target = center + rng.uniform(-0.6, 0.6, 3) * size
        origin = target + far * size * away
        direction = target - origin if k % 4 else -away
        rays.append(Ray(*origin.tolist(), *direction.tolist(), 0.0, math.inf))
    return rays


PLACES = {
    "as it is": (1.0, (0.0, 0.0, 0.0), 3.0),
    "far from the origin": (1.0, (3e5, -5e6, 7e4), 3.0),
    "from far away": (1.0, (0.0, 0.0, 0.0), 1e7),
    "from nearby": (1.0, (0.0, 0.0, 0.0), 0.05),
    "tiny": (1e-25, (0.0, 0.0, 0.0), 3.0),
    "huge": (1e28, (0.0, 0.0, 0.0), 3.0),
}


@pytest.mark.parametrize("place", PLACES)
def test_every_crossing_is_that_of_a_single_triangle_to_the_last_bit(place: str) -> None:
    scale, offset, far = PLACES[place]
    points, faces = ball(6, 1)
    # A triangle is missing: crossings of a sheet are told one by one.
    probe = Probe(mesh_of_arrays(points * scale + offset, faces[1:]))
    assert not probe.model.closed
    for ray in rays_at(probe.corners, 42, far, 5):
        expected = [t for t, _ in probe.reference(ray)]
        size = np.abs(probe.corners).max() + max(map(abs, ray[:3]))
        apart = 8e-15 * size / max(map(abs, ray[3:6]))
        found = probe.cross(ray)[0]
        assert found[::2] == found[1::2]
        # Crossings in one place are told once.
        assert set(found) <= set(expected)
        assert all(min(abs(t - s) for s in found) <= apart for t in expected)
        ahead = [t for t in expected if t >= 0.0]
        assert probe.cross(ray, FIRST)[0][:1] == ahead[:1]
        assert bool(probe.cross(ray, ANY)[0]) == bool(ahead)


@pytest.mark.parametrize("place", PLACES)
def test_closed_meshes_are_entered_and_left_where_single_triangles_say(place: str) -> None:
    scale, offset, far = PLACES[place]
    points, faces = ball(5, 2)
    probe = Probe(mesh_of_arrays(points * scale + offset, faces))
    assert probe.model.closed
    for ray in rays_at(probe.corners, 42, far, 6):
        expected = probe.reference(ray)
        assert sum(way for _, way in expected) == 0.0
        found = probe.cross(ray)[0]
        assert len(found) % 2 == 0
        assert set(found) <= {t for t, _ in expected}
        if far > 1.0 and found:
            assert probe.cross(ray, FIRST)[0][0] == found[0]


@pytest.mark.parametrize("count", range(1, 2 * LANES + 2))
def test_packets_of_any_number_of_triangles(count: int) -> None:
    """Lanes without a triangle are never met."""
    corners = [(x, y, float(k)) for k in range(count) for x, y in ((0, 0), (1, 0), (0, 1))]
    probe = Probe(mesh_of_arrays(corners, np.arange(3 * count).reshape(-1, 3)))
    ray = Ray(0.25, 0.25, -1.0, 0.0, 0.0, 1.0, 0.0, math.inf)
    assert probe.cross(ray)[0][::2] == [1.0 + k for k in range(count)]
    beside = Ray(0.75, 0.75, -1.0, 0.0, 0.0, 1.0, 0.0, math.inf)
    assert probe.cross(beside)[0] == []


def test_a_ray_in_the_plane_of_a_square_slips_past_it() -> None:
    probe = Probe(mesh_of_arrays([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], SQUARE))
    ray = Ray(-1.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, math.inf)
    expected = [t for t, _ in probe.reference(ray)]
    assert set(probe.cross(ray)[0]) <= set(expected)


def test_the_part_that_is_left_behind_has_the_normal() -> None:
    points, faces = ball(8, 3)
    probe = Probe(mesh_of_arrays(points, faces))
    a, b, c = (probe.corners[:, k] for k in range(3))
    flats = np.cross(b - a, c - a)
    told = 0
    for ray in rays_at(probe.corners, 60, 3.0, 7):
        found, part = probe.cross(ray, FIRST)
        if not found:
            continue
        t = found[0]
        p = Vec3(ray.ox + t * ray.dx, ray.oy + t * ray.dy, ray.oz + t * ray.dz)
        told += part >= 0.0
        normal = np.array(leaf_part_normal(Mesh.kind, p, part, probe.args, 0, probe.pool))
        assert (flats == normal).all(axis=1).any()
        # A ray enters through a face that it comes towards, also on an edge.
        assert normal @ np.array(ray[3:6]) <= 1e-12 * np.linalg.norm(normal)
    assert told > 30


@pytest.mark.parametrize("part", [-1.0, 1e300, -1e300, math.nan, math.inf])
def test_a_part_that_is_none_is_looked_for(part: float) -> None:
    points, faces = ball(4, 3)
    probe = Probe(mesh_of_arrays(points, faces))
    for triangle in probe.corners[::5]:
        p = Vec3(*(np.array((0.2, 0.3, 0.5)) @ triangle))
        expected = leaf_normal(Mesh.kind, p, probe.args, 0, probe.pool)
        assert leaf_part_normal(Mesh.kind, p, part, probe.args, 0, probe.pool) == expected


@pytest.mark.parametrize("kind", ["mesh", "difference", "large difference", "beside"])
def test_normals_in_operations_and_from_within_are_those_of_the_walker(kind: str) -> None:
    rock = mesh(*ball(8, 3))
    spikes = [move(x, 0.9, 0.0) * scale(0.3, 0.3, 0.3) * rock for x in (-0.8, -0.4, 0.0, 0.4)]
    far = [move(x, 0.0, 0.0) * box() for x in (5.0, 8.0)]
    made = {
        "mesh": rock,
        "difference": rock - move(0.5, 0.0, 0.0) * rock,
        "large difference": rock
        - (spikes[0] | spikes[1] | spikes[2] | spikes[3] | far[0] | far[1]),
        # The first leaf that is found is not the first that is met.
        "beside": (rock - move(0.4, 0.0, 0.0) * rock) | move(0.2, 0.3, 0.1) * rock,
    }[kind]
    rng = np.random.default_rng(3)
    o = rng.normal(size=(300, 3))
    o *= (np.where(np.arange(300) % 2, 3.0, 0.3) / np.linalg.norm(o, axis=1))[:, None]
    d = rng.uniform(-0.5, 0.5, (300, 3)) - o
    fast, slow = (Scene(made, engine=e).intersect(o, d) for e in ("states", "cyclic"))
    assert (fast.mask == slow.mask).all() and fast.mask.sum() > 30
    assert np.allclose(fast.t[fast.mask], slow.t[fast.mask], rtol=1e-12)
    assert np.allclose(fast.normal, slow.normal, atol=1e-12)
