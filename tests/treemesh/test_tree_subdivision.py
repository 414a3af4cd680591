"""Catmull-Clark against a naive oracle that follows the definition face by face."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tree_shapes import wild_skeleton

from pcsg.errors import UsageError
from pcsg.treemesh.cage import build_cage
from pcsg.treemesh.subdivision import find_topology, plan_level, plan_levels, subdivide


def naive(verts: np.ndarray, faces: list[list[int]]) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Return the points by the formula with Fbar and Rbar, and quads as sets of places."""
    face_point = [np.mean([verts[v] for v in face], axis=0) for face in faces]
    edge_faces: dict[frozenset[int], list[int]] = {}
    vertex_faces: dict[int, list[int]] = {}
    for f, face in enumerate(faces):
        for k, v in enumerate(face):
            edge_faces.setdefault(frozenset((v, face[(k + 1) % len(face)])), []).append(f)
            vertex_faces.setdefault(v, []).append(f)
    edge_point = {}
    for edge, (f, g) in edge_faces.items():
        a, b = edge
        edge_point[edge] = (verts[a] + verts[b] + face_point[f] + face_point[g]) / 4
    vertex_point = {}
    for v, own in vertex_faces.items():
        n = len(own)
        fbar = np.mean([face_point[f] for f in own], axis=0)
        middles = [np.mean([verts[w] for w in e], axis=0) for e in edge_faces if v in e]
        vertex_point[v] = (fbar + 2 * np.mean(middles, axis=0) + (n - 3) * verts[v]) / n
    places = [*[vertex_point[v] for v in range(len(verts))], *edge_point.values(), *face_point]
    quads = []
    for f, face in enumerate(faces):
        for k, v in enumerate(face):
            ahead, back = face[(k + 1) % len(face)], face[k - 1]
            quads.append(
                (
                    vertex_point[v],
                    edge_point[frozenset((v, ahead))],
                    face_point[f],
                    edge_point[frozenset((v, back))],
                )
            )
    return np.array(places), [np.array(q) for q in quads]  # type: ignore[misc]


@given(seed=st.integers(0, 10**6), segments=st.integers(2, 6))
def test_one_step_is_the_definition(seed: int, segments: int) -> None:
    mesh = build_cage(wild_skeleton(np.random.default_rng(seed), segments), None).mesh
    faces = [mesh.flat[a:b].tolist() for a, b in zip(mesh.ptr, mesh.ptr[1:], strict=False)]
    _, quads = naive(mesh.verts, faces)
    level = plan_level(mesh.flat, mesh.ptr, len(mesh.verts))
    found = level.apply(mesh.verts)[level.quads]
    assert found == pytest.approx(np.array(quads), abs=1e-12)
    t = level.topology
    assert len(level.apply(mesh.verts)) == t.n_verts + t.n_edges + t.n_faces
    assert len(level.quads) == mesh.sizes.sum()


def test_a_cube_becomes_round() -> None:
    cube = np.array([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    flat, ptr = np.array(faces).ravel(), np.arange(0, 25, 4)
    levels = plan_levels(flat, ptr, 8, 4)
    verts = subdivide(cube, levels)
    radius = np.linalg.norm(verts, axis=1)
    assert radius.max() / radius.min() < 1.12
    assert verts.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    corners = levels[0].apply_corners(np.arange(48.0).reshape(24, 2))
    assert corners.shape == (24, 4, 2)
    assert corners[0].tolist() == [[0, 1], [1, 2], [3, 4], [3, 4]]


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ([[0, 1, 2]], "not closed"),
        ([[0, 1, 2], [0, 1, 2]], "not oriented"),
        ([[0, 1, 2], [2, 1, 0], [0, 1, 2], [2, 1, 0]], "not a manifold"),
    ],
)
def test_other_meshes_are_refused(faces: list[list[int]], message: str) -> None:
    flat = np.array(faces).ravel()
    with pytest.raises(UsageError, match=message):
        find_topology(flat, np.arange(0, flat.size + 1, 3), 3)
