"""Meshes of blobs are closed and lie on the surface."""

from __future__ import annotations

import numpy as np
import pytest

from pcsg import blobtree as b

pytest.importorskip("skimage", reason="contouring needs the extra `mesh`")


def test_a_ball() -> None:
    vertices, faces = b.contour(b.point(1.0), 40)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert np.all(counts == 2)
    assert len(vertices) - len(edges) // 2 + len(faces) == 2
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1.0, atol=0.02)
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
    assert np.abs(model.field(vertices) - 0.5).max() < 0.1
