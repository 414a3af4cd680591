"""Dense meshes: short edges collapse, and nothing is lost that a skeleton needs."""

from __future__ import annotations

import numpy as np
import pytest
from tree_shapes import axis_distances, forked_tree

from pcsg.errors import UsageError
from pcsg.treemesh import extraction, tree_surface
from pcsg.treemesh.contraction import signed_volume
from pcsg.treemesh.decimation import decimate
from pcsg.treemesh.skeleton import Floats, Ints


def half_edges(faces: Ints) -> set[tuple[int, int]]:
    pairs = np.stack([faces.ravel(), np.roll(faces, -1, axis=1).ravel()], axis=1).tolist()
    assert len({(a, b) for a, b in pairs}) == len(pairs)
    return {(a, b) for a, b in pairs}


def euler(verts: Floats, faces: Ints) -> int:
    return len(verts) - len(faces) // 2


@pytest.mark.parametrize("most", [1500, 700, 10])
def test_the_mesh_stays_closed_and_oriented(most: int) -> None:
    surf = tree_surface(forked_tree(np.random.default_rng(5), forks=4), levels=2)
    verts, faces = surf.verts, surf.triangles
    fewer, corners, into = decimate(verts, faces, most)
    ways = half_edges(corners)
    assert {(b, a) for a, b in ways} == ways
    assert euler(fewer, corners) == 2
    assert set(corners.ravel().tolist()) == set(into.tolist()) == set(range(len(fewer)))
    assert np.isfinite(fewer).all()
    if most > 10:
        assert len(fewer) == most
        assert signed_volume(fewer, corners) == pytest.approx(
            signed_volume(verts, faces), rel=0.05 if most == 1500 else 0.2
        )
        gap = np.linalg.norm(fewer[into] - verts, axis=1)
        assert gap.max() < 0.1  # the trunk's radius


def test_a_handle_is_kept() -> None:
    import trimesh

    ring = trimesh.creation.torus(2.0, 0.3, major_sections=64, minor_sections=24)
    verts, faces = np.array(ring.vertices), np.array(ring.faces, dtype=np.int64)
    fewer, corners, _ = decimate(verts, faces, 4)
    assert 4 < len(fewer) < 200  # a ring of three cannot close, the ring itself cannot either
    assert euler(fewer, corners) == 0


def test_a_mesh_with_few_vertices_is_left_as_it_is() -> None:
    surf = tree_surface(forked_tree(np.random.default_rng(1), forks=1), levels=1)
    verts, faces, into = decimate(surf.verts, surf.triangles, len(surf.verts))
    assert (verts == surf.verts).all()
    assert (faces == surf.triangles).all()
    assert (into == np.arange(len(verts))).all()


def test_the_skeleton_of_a_dense_mesh_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extraction, "DENSE", 1500)
    for seed in range(5):
        true = forked_tree(np.random.default_rng(seed), forks=4)
        surf = tree_surface(true, levels=2)
        assert len(surf.verts) > 2000
        found = extraction.skeleton_of_closed(surf.verts, surf.triangles)
        assert len(found.tips) == len(true.tips)
        assert len(found.joints) == len(true.joints)
        away, radius = axis_distances(true, found.pos)
        assert np.median(away / radius) < 0.04
        # Radii are measured on all vertices of the mesh, not only on those that are left.
        assert found.mapping is not None
        assert sorted(np.concatenate(found.mapping).tolist()) == list(range(len(surf.verts)))
        inner = found.degree == 2
        assert abs(np.median(found.radius[inner] / radius[inner] - 1.0)) < 0.05


def test_what_cannot_be_reduced_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    import trimesh

    monkeypatch.setattr(extraction, "DENSE", 4)
    monkeypatch.setattr(extraction, "MOST", 8)
    ring = trimesh.creation.torus(2.0, 0.3, major_sections=16, minor_sections=6)
    with pytest.raises(UsageError, match="limbs so fine that more than 8 must stay"):
        extraction.skeleton_of_closed(np.array(ring.vertices), np.array(ring.faces))
