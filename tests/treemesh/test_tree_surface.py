"""Surfaces: what has to be reached, on the three measured trees."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tree_shapes import SPECIES, forked_tree, species, wild_skeleton

from pcsg.errors import UsageError
from pcsg.treemesh import Skeleton, tree_surface
from pcsg.treemesh.field import build_field
from pcsg.treemesh.pruning import drop_hidden_twigs
from pcsg.treemesh.surface import QuadMesh, repose


@cache
def surface(name: str, kernel: str, max_aspect: float | None) -> QuadMesh:
    return tree_surface(species(name), kernel=kernel, max_aspect=max_aspect)


@cache
def report(name: str, kernel: str, max_aspect: float | None) -> dict[str, Any]:
    return surface(name, kernel, max_aspect).report()


KERNELS = ["cauchy", "quartic"]


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("name", SPECIES)
def test_acceptance(name: str, kernel: str) -> None:
    r = report(name, kernel, 4.0)
    assert r["quad_share"] == 1.0
    assert (r["closed"], r["oriented"], r["euler_characteristic"]) == (True, True, 2)
    assert r["residual"]["off"] == 0
    far = r["radius_error_away_from_ends"]
    assert far["median_size"] <= 0.01
    assert far["95%_size"] <= 0.12
    assert r["radius_error"]["median_size"] <= 0.03
    assert r["radius_error"]["95%_size"] <= 0.20
    assert r["valence_4_share"] >= 0.99
    assert r["smallest_angle"]["1%"] >= 40.0
    assert r["folded_share"] <= 0.003
    assert r["self_intersections"]["share_outside_forks_under_20_degrees"] <= 0.001
    assert r["edge_flow"]["median"] <= 2.0
    assert r["edge_flow"]["95%"] <= 8.0
    assert r["away_from_ends_share"] > 0.2  # or nothing was measured


@pytest.mark.parametrize("name", SPECIES)
def test_acceptance_of_the_sparse_cage(name: str) -> None:
    r = report(name, "cauchy", None)
    assert 55.0 <= r["quads_per_segment"] <= 95.0
    assert r["valence_4_share"] >= 0.97
    assert r["residual"]["off"] == 0


def test_segments_are_those_of_the_paper() -> None:
    assert [species(name).n_edges for name in SPECIES] == [129, 288, 290]


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), segments=st.integers(3, 60), quartic=st.booleans())
def test_anything_becomes_a_closed_surface(seed: int, segments: int, quartic: bool) -> None:
    skel = wild_skeleton(np.random.default_rng(seed), segments)
    surf = tree_surface(skel, kernel="quartic" if quartic else "cauchy")
    found = surf.report(cuts=False)
    assert (found["closed"], found["oriented"], found["euler_characteristic"]) == (True, True, 2)
    assert found["quad_share"] == 1.0
    assert np.isfinite(surf.positions).all()
    # What could not be projected stands at its radius and is told.
    off = found["residual"]["off"]
    assert any("could not be brought" in note for note in surf.notes) == (off > 0)


@pytest.mark.parametrize("kernel", KERNELS)
def test_vertices_lie_on_the_field(kernel: str) -> None:
    surf = surface("acer", kernel, 4.0)
    F, gradient = surf.field.evaluate(surf.verts, surf.owner)
    assert np.abs(F - 1.0).max() < 1e-3
    outward = -gradient / np.linalg.norm(gradient, axis=1)[:, None]
    assert np.einsum("ij,ij->i", outward, surf.normals).min() > 0.999999
    # And the normals are those of the mesh.
    a, b, c, d = (surf.verts[k] for k in surf.quads.T)
    face = np.cross(c - a, d - b)
    face /= np.linalg.norm(face, axis=1)[:, None]
    mean = surf.normals[surf.quads].mean(axis=1)
    mean /= np.linalg.norm(mean, axis=1)[:, None]
    assert np.median(np.einsum("ij,ij->i", face, mean)) > 0.999


def test_the_field_is_the_sum_of_its_segments() -> None:
    skel = forked_tree(np.random.default_rng(1), forks=1)
    found = build_field(skel, locality="all", kernel="quartic")
    points = skel.pos[skel.edges].mean(axis=1) + np.array([0.05, 0.02, 0.01])
    owner = np.zeros(len(points), dtype=np.int64)
    F, _ = found.evaluate(points, owner)
    t = (np.arange(20_000) + 0.5) / 20_000
    for p, value in zip(points, F, strict=True):
        total = 0.0
        for k in found.rows[found.ptr[0] : found.ptr[1]]:
            row = found.table[k]
            places = row[:3] + (t * row[6])[:, None] * row[3:6]
            r2 = ((places - p) ** 2).sum(axis=1)
            weight = row[7] + t * (row[8] - row[7])
            total += row[6] * float((weight * np.maximum(1 - r2 / row[9] ** 2, 0) ** 2).mean())
        assert value == pytest.approx(total, rel=1e-6)


def test_near_branches_keep_apart_unless_asked() -> None:
    right = [[0.6, 0, 1.2], [0.12, 0, 3], [1.2, 0, 1.8]]
    pos = np.array([[0, 0, 0], [0, 0, 1], *right, *(np.array(right) * [-1, 1, 1])])
    edges = [[0, 1], [1, 2], [2, 3], [2, 4], [1, 5], [5, 6], [5, 7]]
    skel = Skeleton.make(pos, np.full(8, 0.1), edges)
    apart = tree_surface(skel, kernel="quartic")
    assert np.abs(apart.verts[apart.verts[:, 2] > 2.8][:, 0]).min() > 0.02
    limbs = skel.limbs
    owner = limbs.limb_of[np.flatnonzero(limbs.edges == 2)]
    between = np.array([[0.0, 0.0, 2.9]])
    graph = build_field(skel, kernel="quartic")
    everything = build_field(skel, kernel="quartic", locality="all")
    one, both = (f.evaluate(between, owner)[0][0] for f in (graph, everything))
    assert both == pytest.approx(2.0 * one, rel=1e-9)


def test_twigs_inside_a_thicker_limb_are_dropped() -> None:
    pos = [[0, 0, 0], [0, 0, 1], [0, 0, 2], [0.15, 0, 1.05], [0.9, 0, 1.3]]
    edges = [[0, 1], [1, 2], [1, 3], [1, 4]]
    skel = Skeleton.make(pos, [0.3, 0.3, 0.3, 0.05, 0.05], edges)
    kept, dropped = drop_hidden_twigs(skel)
    assert dropped.tolist() == [2]
    assert (kept.n_edges, len(kept.joints)) == (3, 1)
    surf = tree_surface(skel)
    assert "1 segments end inside" in surf.notes[0]
    assert surf.report(cuts=False)["euler_characteristic"] == 2


def test_a_twig_of_a_hundredth_of_the_trunk() -> None:
    pos = [[0, 0, 0], [0, 0, 3], [0, 0, 6], [1.5, 0, 3.5], [2.5, 0, 4.5]]
    edges = [[0, 1], [1, 2], [1, 3], [3, 4]]
    surf = tree_surface(Skeleton.make(pos, [1, 1, 1, 0.01, 0.01], edges))
    r = surf.report()
    assert (r["closed"], r["euler_characteristic"], r["residual"]["off"]) == (True, 2, 0)
    twig = surf.verts[surf.verts[:, 0] > 1.7]
    axis = np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0)
    away = twig - [1.5, 0, 3.5]
    distance = np.linalg.norm(away - np.outer(away @ axis, axis), axis=1)
    assert np.median(distance) == pytest.approx(0.01, rel=0.1)


def test_texture_runs_round_and_along() -> None:
    skel = Skeleton.make([[0, 0, 0], [0, 0, 4]], [0.2, 0.2], [[0, 1]])
    surf = tree_surface(skel)
    corner = surf.verts[surf.quads]
    side = (corner[..., 2].min(axis=1) > 0.3) & (corner[..., 2].max(axis=1) < 3.7)
    uv, corner = surf.uv[side], corner[side]
    assert (uv[..., 0].min(), uv[..., 0].max()) == (0.0, 1.0)
    assert (np.ptp(uv[..., 0], axis=1) <= 0.0626).all()  # no quad spans the seam
    along = np.polyfit(corner[..., 2].ravel(), uv[..., 1].ravel(), 1)[0]
    assert along == pytest.approx(1.0 / (2 * np.pi * 0.2), rel=0.05)
    angle = np.arctan2(corner[..., 1], corner[..., 0]) / (2 * np.pi)
    turn = np.exp(2j * np.pi * (uv[..., 0] - angle))
    assert abs(turn.mean()) > 0.99  # one turn of u is one turn about the axis


def test_labels_go_with_their_limbs() -> None:
    pos = [[0, 0, 0], [0, 0, 1], [0.7, 0, 1.7], [-0.7, 0, 1.7]]
    skel = Skeleton.make(
        pos, [0.1, 0.1, 0.08, 0.08], [[0, 1], [1, 2], [1, 3]], tags={"label": [5, 6, 7]}
    )
    surf = tree_surface(skel)
    centre = surf.verts[surf.quads].mean(axis=1)
    assert set(surf.labels.tolist()) == {5, 6, 7}
    assert (surf.labels[centre[:, 2] < 0.7] == 5).all()
    assert (surf.labels[centre[:, 0] > 0.4] == 6).all()
    assert (surf.labels[centre[:, 0] < -0.4] == 7).all()


def test_frames_of_an_animation_share_their_quads() -> None:
    surf = surface("quercus", "cauchy", 4.0)
    skel = surf.skeleton
    for degrees in (5.0, 25.0):
        swing = np.radians(degrees) * skel.pos[:, 2] / skel.pos[:, 2].max()
        pos = skel.pos.copy()
        pos[:, 0] += np.sin(swing) * skel.pos[:, 2]
        moved = repose(surf, skel.replaced(pos=pos))
        assert np.array_equal(moved.quads, surf.quads)
        assert moved.report(cuts=False)["residual"]["off"] == 0
        assert np.abs(moved.verts - surf.verts).max() > 0.01
    with pytest.raises(UsageError, match="other edges"):
        repose(surf, skel.replaced(edges=skel.edges[::-1]))


def test_the_same_bits_again() -> None:
    again = tree_surface(species("quercus"), kernel="cauchy", max_aspect=4.0)
    assert np.array_equal(again.verts, surface("quercus", "cauchy", 4.0).verts)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kernel": "gauss"}, "unknown kernel `gauss`; one of cauchy, quartic"),
        ({"locality": "near"}, "unknown locality"),
        ({"kappa": 0.0}, "kappa"),
        ({"levels": 9}, "levels must lie between"),
        ({"fairness": 1}, "no option `fairness`"),
    ],
)
def test_options_are_checked(options: dict[str, Any], message: str) -> None:
    skel = Skeleton.make([[0, 0, 0], [0, 0, 4]], [0.2, 0.2], [[0, 1]])
    with pytest.raises(UsageError, match=message):
        tree_surface(skel, **options)


def test_a_limb_may_end_far_away_in_a_joint_that_swallows_it() -> None:
    places = [[0, 0, 0], [0, 0, 2], [0.5, 0, 4], [1.8, 0, 3.2], [2.7, 1e9, 4]]
    radii = [0.5, 0.45, 0.4, 1.51e8, 0.1]
    mesh = tree_surface(Skeleton.make(places, radii, [[0, 1], [1, 2], [1, 3], [3, 4]]))
    assert np.isfinite(mesh.verts).all()
