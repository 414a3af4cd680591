"""Questions to meshes against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tree_shapes import species

from pcsg.treemesh import tree_surface
from pcsg.treemesh.nearest import MeshIndex, find_cuts, sample_surface


def soup(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    centre = rng.normal(size=(n, 1, 3))
    verts = (centre + 0.3 * rng.normal(size=(n, 3, 3))).reshape(-1, 3)
    return verts, np.arange(3 * n).reshape(-1, 3)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 60))
def test_closest_points(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    verts, faces = soup(rng, n)
    points = 1.5 * rng.normal(size=(40, 3))
    places, distance = MeshIndex(verts, faces).closest(points)
    assert distance == pytest.approx(np.linalg.norm(points - places, axis=1))
    # No sample of any triangle is nearer, and the nearest sample is hardly farther.
    s = np.linspace(0, 1, 24)
    u, v = (x.ravel() for x in np.meshgrid(s, s))
    u, v = u[u + v <= 1], v[u + v <= 1]
    a, b, c = (verts[k] for k in faces.T)
    grid = a[:, None] + u[:, None] * (b - a)[:, None] + v[:, None] * (c - a)[:, None]
    for p, d in zip(points, distance, strict=True):
        brute = np.linalg.norm(grid - p, axis=2).min()
        assert d <= brute + 1e-12
        assert brute <= d + 0.1


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 60))
def test_shooting(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    verts, faces = soup(rng, n)
    points = rng.normal(size=(60, 3))
    way = rng.normal(size=(60, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    limit = rng.uniform(0.2, 2.0, size=60)
    found = MeshIndex(verts, faces).shoot(points, way, limit)
    a, b, c = (verts[k] for k in faces.T)
    normal = np.cross(b - a, c - a)
    for p, d, most, t in zip(points, way, limit, found, strict=True):
        best = np.nan
        for k in range(n):
            if normal[k] @ d <= 0:
                continue
            hit = float(normal[k] @ (a[k] - p) / (normal[k] @ d))
            q = p + hit * d
            inside = all(
                np.cross(y - x, q - x) @ normal[k] >= 0
                for x, y in ((a[k], b[k]), (b[k], c[k]), (c[k], a[k]))
            )
            if inside and abs(hit) <= most and not abs(hit) >= abs(best):
                best = hit
        assert t == pytest.approx(best, nan_ok=True, abs=1e-9)


def test_cuts_are_found_and_only_they() -> None:
    surf = tree_surface(species("quercus"), levels=1)
    verts, quads, tri = surf.verts, surf.quads, surf.triangles
    assert find_cuts(verts, quads, tri)[0] == 0
    # A second copy, shifted: many of its quads cut the first.
    both = np.concatenate([verts, verts + np.array([0.03, 0.02, 0.0])])
    quads2 = np.concatenate([quads, quads + len(verts)])
    tri2 = np.concatenate([tri, tri + len(verts)])
    pairs, cutting = find_cuts(both, quads2, tri2)
    assert pairs > 100
    assert (cutting < len(quads)).any()
    assert (cutting >= len(quads)).any()
    far = np.concatenate([verts, verts + np.array([30.0, 0.0, 0.0])])
    assert find_cuts(far, quads2, tri2)[0] == 0


def test_two_crossing_quads_are_one_pair() -> None:
    verts = np.array(
        [
            [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
            [[0.5, 0.2, -1], [0.5, 0.8, -1], [0.5, 0.8, 1], [0.5, 0.2, 1]],
            [[3, 0, 0], [4, 0, 0], [4, 1, 0], [3, 1, 0]],
        ],
        dtype=float,
    ).reshape(-1, 3)
    quads = np.arange(12).reshape(-1, 4)
    tri = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    pairs, cutting = find_cuts(verts, quads, tri)
    assert cutting.tolist() == [0, 1]
    assert pairs >= 1


def test_samples_are_even() -> None:
    verts = np.array([[0, 0, 0], [3, 0, 0], [0, 1, 0], [3, 0, 0], [3, 1, 0], [0, 1, 0]], float)
    points = sample_surface(verts, np.array([[0, 1, 2], [3, 4, 5]]), per_face=2000)
    assert points.mean(axis=0) == pytest.approx([1.5, 0.5, 0.0], abs=0.05)
    assert points.std(axis=0)[:2] == pytest.approx([3 / np.sqrt(12), 1 / np.sqrt(12)], rel=0.05)
