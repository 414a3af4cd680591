"""The cage and its subdivision: closed, oriented, quads only, whatever the skeleton."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from tree_shapes import forked_tree, species, wild_skeleton

from pcsg.errors import UsageError
from pcsg.treemesh.cage import RHO, build_cage
from pcsg.treemesh.joints import hull_triangles, spread
from pcsg.treemesh.skeleton import Skeleton
from pcsg.treemesh.subdivision import find_topology, plan_levels, subdivide


def edges_of(flat: list[int], ptr: list[int]) -> dict[tuple[int, int], int]:
    """Directed edges of faces and how often each occurs, by hand."""
    found: dict[tuple[int, int], int] = {}
    for a, b in itertools.pairwise(ptr):
        face = flat[a:b]
        for k in range(len(face)):
            edge = face[k], face[(k + 1) % len(face)]
            found[edge] = found.get(edge, 0) + 1
    return found


def check_closed(flat: list[int], ptr: list[int], n_verts: int, euler: int) -> None:
    edges = edges_of(flat, ptr)
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    assert set(flat) == set(range(n_verts))
    assert n_verts - len(edges) // 2 + len(ptr) - 1 == euler


@settings(max_examples=200)
@given(
    seed=st.integers(0, 10**6),
    segments=st.one_of(st.integers(3, 40), st.sampled_from([150, 500])),
    sparse=st.booleans(),
)
@example(seed=2, segments=300, sparse=False)
def test_closed_for_any_tree(seed: int, segments: int, sparse: bool) -> None:
    skel = wild_skeleton(np.random.default_rng(seed), segments)
    cage = build_cage(skel, None if sparse else 4.0)
    mesh = cage.mesh
    check_closed(mesh.flat.tolist(), mesh.ptr.tolist(), len(mesh.verts), 2)
    assert np.isfinite(mesh.verts).all()
    levels = plan_levels(mesh.flat, mesh.ptr, len(mesh.verts), 2)
    last = levels[-1]
    quads = last.quads
    t = find_topology(quads.ravel(), np.arange(0, quads.size + 1, 4), int(quads.max()) + 1)
    assert (quads.shape[1], t.euler) == (4, 2)
    verts = subdivide(mesh.verts, levels)
    assert len(verts) == t.n_verts
    assert len(last.quads) == 4 * len(levels[0].quads)


@pytest.mark.parametrize("loops", [1, 3])
def test_a_graph_with_loops_has_handles(loops: int) -> None:
    angle = 2 * np.pi * np.arange(7) / 7
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    edges = [[k, (k + 1) % 7] for k in range(7)] + [[0, 3], [1, 5]][: loops - 1]
    skel = Skeleton.make(ring, np.full(7, 0.1), edges)
    assert skel.loops == loops
    mesh = build_cage(skel).mesh
    check_closed(mesh.flat.tolist(), mesh.ptr.tolist(), len(mesh.verts), 2 - 2 * loops)


@settings(max_examples=150)
@given(seed=st.integers(0, 10**6), limbs=st.integers(3, 7))
def test_every_square_is_a_facet_of_its_joint(seed: int, limbs: int) -> None:
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(limbs, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    u = np.cross(d, rng.normal(size=3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    tri = hull_triangles(d, d, u, rng.random(limbs) < 0.5)
    # A sphere with one square hole for each limb: 8 k - 4 triangles without 2 k.
    assert len(tri) == 6 * limbs - 4
    boundary = edges_of(tri.ravel().tolist(), list(range(0, tri.size + 1, 3)))
    open_edges = [e for e in boundary if (e[1], e[0]) not in boundary]
    assert len(open_edges) == 4 * limbs
    assert all(a // 4 == b // 4 for a, b in open_edges)


def test_coinciding_directions_are_turned_apart() -> None:
    d, alpha = spread(np.array([[0.0, 0, 1], [0, 0, 1], [0, 0, 1], [1, 0, 0]]))
    angle = np.degrees(np.arccos(np.clip(d @ d.T, -1, 1))) + 180 * np.eye(4)
    assert angle.min() > 3.9
    assert (2 * np.degrees(alpha) < angle.min(axis=1)).all()


def test_squares_stand_across_their_limbs() -> None:
    skel = Skeleton.make([[0, 0, 0], [0, 0, 3]], [0.5, 0.25], [[0, 1]])
    corners = build_cage(skel, None).mesh.verts.reshape(-1, 4, 3)
    assert corners[:, :, 2] == pytest.approx(np.repeat([[0.0], [3.0]], 4, axis=1))
    assert np.linalg.norm(corners[:, :, :2], axis=2) == pytest.approx(
        RHO * np.repeat([[0.5], [0.25]], 4, axis=1)
    )


@pytest.mark.parametrize("max_aspect", [2.0, 4.0])
def test_squares_are_no_farther_apart_than_asked(max_aspect: float) -> None:
    skel = forked_tree(np.random.default_rng(5))
    cage = build_cage(skel, max_aspect)
    centre = cage.mesh.verts.reshape(-1, 4, 3).mean(axis=1)
    radius = np.linalg.norm(cage.mesh.verts.reshape(-1, 4, 3)[:, 0] - centre, axis=1) / RHO
    same = np.diff(cage.stations.limb) == 0
    step = np.linalg.norm(np.diff(centre, axis=0), axis=1)
    thick = 0.5 * (radius[1:] + radius[:-1])
    assert (step[same] <= 1.02 * max_aspect * thick[same]).all()


def test_quads_between_two_limbs_are_preferred() -> None:
    cage = build_cage(species("quercus"), 4.0)
    triangles = (cage.mesh.sizes == 3).sum()
    assert set(cage.mesh.sizes.tolist()) <= {3, 4}
    assert triangles <= 2 * len(species("quercus").joints)


def test_options_are_checked() -> None:
    skel = forked_tree(np.random.default_rng(0))
    with pytest.raises(UsageError, match="max_aspect"):
        build_cage(skel, 0.0)
    mesh = build_cage(skel).mesh
    with pytest.raises(UsageError, match="levels"):
        plan_levels(mesh.flat, mesh.ptr, len(mesh.verts), 0)
