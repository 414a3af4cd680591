"""Skeletons of closed meshes, against the skeletons that these were made from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tree_shapes import axis_distances, forked_tree

from pcsg.treemesh import extract_skeleton, resample, restore_offsets, tree_surface
from pcsg.treemesh.contraction import (
    ContractionOptions,
    contract,
    cotangent_laplacian,
    face_areas,
    ring_areas,
    signed_volume,
)
from pcsg.treemesh.extraction import ExtractionOptions, skeleton_of_closed
from pcsg.treemesh.meshes import extract
from pcsg.treemesh.offsets import local_radii
from pcsg.treemesh.surgery import collapse

TETRA = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def test_laplacian_is_the_definition() -> None:
    rng = np.random.default_rng(4)
    verts = np.array([[1, 1, 1], [-1, -1, 1], [1, -1, -1], [-1, 1, -1.0]])
    verts += 0.1 * rng.normal(size=(4, 3))
    found = cotangent_laplacian(verts, TETRA).toarray()
    expected = np.zeros((4, 4))
    for face in TETRA:
        for k in range(3):
            a, b, c = (verts[face[(k + i) % 3]] for i in range(3))
            p, q = b - a, c - a
            cot = (p @ q) / np.linalg.norm(np.cross(p, q))
            i, j = face[(k + 1) % 3], face[(k + 2) % 3]
            expected[i, j] += cot / 2
            expected[j, i] += cot / 2
    expected[np.diag_indices(4)] = -expected.sum(axis=1)
    assert found == pytest.approx(expected, rel=1e-10)


def test_measures_of_a_tetrahedron() -> None:
    verts = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    assert signed_volume(verts, TETRA) == pytest.approx(1 / 6)
    assert signed_volume(verts, TETRA[:, ::-1]) == pytest.approx(-1 / 6)
    areas = face_areas(verts, TETRA)
    assert areas.tolist() == pytest.approx([0.5, 0.5, np.sqrt(3) / 2, 0.5])
    assert ring_areas(verts, TETRA)[0] == pytest.approx(1.5)


def test_contraction_takes_the_volume_and_keeps_the_limbs() -> None:
    surf = tree_surface(forked_tree(np.random.default_rng(2), forks=2))
    verts, faces = surf.verts, surf.triangles
    thin = contract(verts, faces)
    assert abs(signed_volume(thin, faces)) < 0.01 * signed_volume(verts, faces)
    away, radius = axis_distances(surf.skeleton, thin)
    assert np.median(away / radius) < 0.15
    once = contract(verts, faces, ContractionOptions(most=1))
    assert np.abs(once - verts).max() < np.abs(thin - verts).max()


def test_collapse_leaves_a_tree_and_a_partition() -> None:
    surf = tree_surface(forked_tree(np.random.default_rng(3), forks=3))
    thin = contract(surf.verts, surf.triangles)
    nodes, edges, node_of = collapse(thin, surf.triangles)
    assert len(edges) == len(nodes) - 1
    assert set(node_of.tolist()) == set(range(len(nodes)))  # every node has vertices
    assert (node_of[nodes] == np.arange(len(nodes))).all()
    degree = np.bincount(edges.ravel())
    assert (degree == 1).sum() == 5
    assert (degree >= 3).sum() == 3


def test_round_trips() -> None:
    offsets, thickness = [], []
    for seed in range(50):
        rng = np.random.default_rng(seed)
        true = forked_tree(rng, forks=int(rng.integers(1, 5)))
        surf = tree_surface(true, levels=1)
        found = skeleton_of_closed(surf.verts, surf.triangles)
        assert found.loops == 0
        assert len(found.tips) == len(true.tips)
        assert len(found.joints) == len(true.joints)
        away, radius = axis_distances(true, found.pos)
        offsets.append(away / radius)
        inner = found.degree == 2
        thickness.append(found.radius[inner] / radius[inner] - 1.0)
        assert found.mapping is not None
        assert sorted(np.concatenate(found.mapping).tolist()) == list(range(len(surf.verts)))
    assert np.median(np.concatenate(offsets)) <= 0.03
    assert abs(np.median(np.concatenate(thickness))) <= 0.05
    assert np.median(np.abs(np.concatenate(thickness))) <= 0.05


def test_offsets_bring_the_surface_back() -> None:
    true = tree_surface(forked_tree(np.random.default_rng(8), forks=4))
    rng = np.random.default_rng(0)
    bark = 0.03 * rng.normal(size=len(true.verts)) * local_radii(true)
    original = true.verts + bark[:, None] * true.normals, true.triangles
    skel = resample(extract_skeleton(original))
    surf = restore_offsets(tree_surface(skel), original)
    distance = surf.report(original, cuts=False)["distance"]
    before, after = distance["before_offsets"], distance["after_offsets"]
    assert before["mean_original_to_new_in_radii"] <= 0.25
    assert after["mean_new_to_original"] <= 0.3 * before["mean_new_to_original"]
    assert after["hausdorff"] <= 0.8 * before["hausdorff"]
    assert "offsets were found for" in surf.notes[-1]


def test_a_ball_is_a_short_axis() -> None:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2)
    skel = skeleton_of_closed(np.array(ball.vertices), np.array(ball.faces), ExtractionOptions())
    assert skel.n_edges <= 3
    assert np.linalg.norm(skel.pos, axis=1).max() < 0.8


def test_a_torus_keeps_its_handle() -> None:
    import trimesh

    ring = trimesh.creation.torus(2.0, 0.3, major_sections=48, minor_sections=12)
    skel = skeleton_of_closed(np.array(ring.vertices), np.array(ring.faces))
    assert skel.loops == 1
    assert len(skel.tips) == 0
    away = np.linalg.norm(skel.pos[:, :2], axis=1)
    assert np.median(away) == pytest.approx(2.0, rel=0.02)
    assert away == pytest.approx(2.0, rel=0.08)
    surf = tree_surface(resample(skel))
    assert surf.report(cuts=False)["euler_characteristic"] == 0


def test_what_the_file_leaves_out_is_among_the_notes(tmp_path: Path) -> None:
    corners = [(x, y, z) for z in (0, 9) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    faces = ["1 4 3 2", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8"]
    lines = [f"v {x} {y} {z} nan 0 0" for x, y, z in corners] + [f"f {face}" for face in faces]
    (tmp_path / "post.obj").write_text("\n".join(lines))
    found = extract(tmp_path / "post.obj")
    assert found.notes[0] == "left out: colours that are not finite (8, the first: line 1)"
