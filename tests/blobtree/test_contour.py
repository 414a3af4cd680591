"""Meshes of blobs are closed and lie on the surface."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from pcsg import blobtree as b

TILTED = [[0.8, 0.0, 0.6, 0.0], [0.0, 1.0, 0.0, 0.1], [-0.6, 0.0, 0.8, 0.0]]

pytest.importorskip("skimage", reason="contouring needs the extra `mesh`")


def test_a_ball() -> None:
    vertices, faces = b.contour(b.point(1.0), 40)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert np.all(counts == 2)
    assert len(vertices) - len(edges) // 2 + len(faces) == 2
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1.0, atol=1e-9)
    p = vertices[faces]
    volume = np.einsum("ij,ij->", p[:, 0], np.cross(p[:, 1], p[:, 2])) / 6.0
    assert volume == pytest.approx(4.0 / 3.0 * np.pi, rel=0.02)


def test_branches_in_contact_have_no_face_inside() -> None:
    fork = b.pcm(b.bend(25.0, b.cone(2.0, 0.4, 0.3)), b.bend(-25.0, b.cone(2.0, 0.4, 0.3)))
    model = b.Model(fork)
    vertices, faces = b.contour(model, 60)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert np.all(counts == 2)
    assert np.quantile(np.abs(model.field(vertices) - 0.5), 0.99) < 1e-9


def test_only_a_band_about_the_surface_takes_time_and_memory() -> None:
    # Blocks meet along seams in all directions; a grid of the whole would be 1.6 GB.
    model = b.Model(b.total(b.cone(9.0, 0.02, 0.01), b.place(TILTED, b.cone(9.0, 0.03, 0.01))))
    tracemalloc.start()
    vertices, faces = b.contour(model, 900)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 60e6
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert np.all(counts % 2 == 0)
    assert np.abs(model.field(vertices) - 0.5).max() < 1e-6
