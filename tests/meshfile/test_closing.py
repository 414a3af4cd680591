"""Meshes that are closed once corners are joined and facets turned, and those that stay open."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pcsg.meshfile.closing import Closing, close, order_of

FOUR = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)])
CORNERS = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
SCALES = (1.0, 1e-9, 1e9, 1e-200, 2.0**-60)


def torus(n: int, m: int) -> tuple[Any, Any]:
    a, b = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    u, v = 2 * np.pi * a / n, 2 * np.pi * b / m
    points = np.stack([(2 + np.cos(v)) * np.cos(u), (2 + np.cos(v)) * np.sin(u), np.sin(v)], axis=1)
    at = lambda i, j: (i % n) * m + j % m  # noqa: E731
    quads = [
        (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)) for i, j in zip(a, b, strict=True)
    ]
    return points, np.array([t for p, q, r, s in quads for t in ((p, q, r), (p, r, s))])


def soup(points: Any, triangles: Any) -> tuple[Any, Any]:
    """Return a mesh whose triangles have corners of their own."""
    return points[triangles].reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def volume(points: Any, triangles: Any, found: Closing) -> float:
    kept = np.where(found.turned[:, None], triangles[:, ::-1], triangles)[~found.dropped]
    a, b, c = (points[found.twin[kept[:, k]]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize("scale", [s for s in SCALES if s > 1e-100])
@given(seed=st.integers(0, 10**6), share=st.sampled_from([0.0, 0.05, 0.5]))
def test_rounded_corners_and_turned_facets_are_mended(
    scale: float, seed: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    points, triangles = torus(9, 6)
    right = volume(points, triangles, close(points, triangles))
    points, triangles = soup(points, triangles)
    points = scale * (points + rng.uniform(-1.0, 1.0, points.shape) * 1e-7)
    turned = rng.uniform(size=len(triangles)) < share
    triangles[turned] = triangles[turned][:, ::-1]
    found = close(points, triangles)
    assert found.closed and not len(found.open_edges)
    assert abs(volume(points, triangles, found)) == pytest.approx(right * scale**3, rel=1e-5)
    assert any("joined" in note for note in found.notes)


def test_corners_farther_apart_are_not_joined() -> None:
    points, triangles = soup(CORNERS, FOUR)
    points[4] += 1e-5
    _, number = np.unique(points, axis=0, return_inverse=True)
    triangles = number.ravel()[triangles]
    points = np.unique(points, axis=0)
    found = close(points, triangles)
    assert not found.closed
    assert (found.twin == np.arange(len(points))).all() and not found.turned.any()
    # The two sides of the gap.
    assert 2 <= len(found.open_edges) <= 4


@pytest.mark.parametrize("scale", SCALES)
def test_an_open_mesh_tells_its_edges(scale: float) -> None:
    found = close(CORNERS * scale, FOUR[1:])
    assert not found.closed and found.notes == ()
    assert {frozenset(e) for e in found.open_edges.tolist()} == {
        frozenset(e) for e in ((0, 1), (1, 2), (0, 2))
    }


@pytest.mark.parametrize("flips", list(product([False, True], repeat=4)))
def test_facets_are_turned_and_the_majority_decides(flips: Any) -> None:
    faces = np.where(np.array(flips)[:, None], FOUR[:, ::-1], FOUR)
    found = close(CORNERS, faces)
    assert found.closed
    # All that are turned alike stay; of others the outside is out.
    inside_out = all(flips)
    assert volume(CORNERS, faces, found) == pytest.approx(-1 / 6 if inside_out else 1 / 6)


def test_a_cavity_stays_one() -> None:
    points = np.concatenate([CORNERS, 0.1 + 0.2 * CORNERS])
    hollow = np.concatenate([FOUR, FOUR[:, ::-1] + 4])
    assert volume(points, hollow, close(points, hollow)) == pytest.approx((1 - 0.2**3) / 6)
    # One facet of another part is wrong: the cavity is not what that decides.
    points = np.concatenate([points, CORNERS + 5.0])
    faces = np.concatenate([hollow, FOUR[:1, ::-1] + 8, FOUR[1:] + 8])
    found = close(points, faces)
    assert found.closed and found.turned.sum() == 1
    assert volume(points, faces, found) == pytest.approx((2 - 0.2**3) / 6)


@pytest.mark.parametrize("scale", SCALES)
def test_faces_that_stand_both_ways_are_a_sheet(scale: float) -> None:
    for faces in (FOUR[:1], FOUR[:2], FOUR[1:], FOUR):
        both = np.concatenate([faces, faces[:, ::-1]])
        for order in (np.arange(len(both)), np.random.default_rng(1).permutation(len(both))):
            found = close(CORNERS * scale, both[order])
            assert not found.closed
            assert (~found.dropped).sum() == len(faces)
    # The same face twice, turned alike, is a sheet too.
    assert not close(CORNERS, np.concatenate([FOUR[:1], FOUR[:1]])).closed


def test_solids_that_share_a_wall_are_solid() -> None:
    points = np.concatenate([CORNERS, [(1.0, 1.0, 1.0)]])
    # The second lies behind the slanted face 1, 2, 3 of the first.
    second = [(1, 3, 2), (1, 2, 4), (2, 3, 4), (3, 1, 4)]
    assert close(points, np.concatenate([FOUR, second])).closed


def test_repeated_facets_count_once() -> None:
    found = close(CORNERS, np.concatenate([FOUR, FOUR[:2]]))
    assert found.closed and found.dropped.sum() == 2
    assert found.notes == ("left out: facets that stand there twice or have no area (2 of 6)",)


@pytest.mark.parametrize("scale", SCALES)
def test_what_is_flat_bounds_nothing(scale: float) -> None:
    flat = CORNERS.copy()
    flat[3] = (0.7, 0.9, 0.0)
    assert not close(flat * scale, FOUR).closed
    flat[3, 2] = 1e-9
    assert close(flat * scale, FOUR).closed


def test_a_surface_with_one_side_cannot_be_turned() -> None:
    """The projective plane of six vertices."""
    faces = ("124", "235", "341", "452", "513", "126", "236", "346", "456", "516")
    found = close(
        np.random.default_rng(0).normal(size=(6, 3)),
        np.array([[int(c) - 1 for c in face] for face in faces]),
    )
    assert not found.closed and len(found.open_edges)


def test_a_small_part_does_not_vanish_in_a_large_box() -> None:
    points = np.concatenate([CORNERS * 1e9, CORNERS + 5e8])
    found = close(points, np.concatenate([FOUR, FOUR[:1] + 4]))
    assert not found.closed


@pytest.mark.parametrize("most", [50, 2**62])
def test_equal_numbers_stay_in_their_order(most: int) -> None:
    keys = np.random.default_rng(1).integers(0, 50, 400)
    assert order_of(keys, most).tolist() == np.argsort(keys, kind="stable").tolist()
    assert order_of(keys[:0], most).tolist() == []
