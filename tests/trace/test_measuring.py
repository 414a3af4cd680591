"""Counts, volumes and areas without rays, and points on surfaces, beside closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import pcsg
from pcsg.errors import UsageError
from pcsg.leaf.faces import draw_points, faces_of
from pcsg.leaf.registry import LEAVES

FOREST = """{n = 40} FOREST
FOREST if(n <= 0, 1, 2)
1: FOREST -> label(3) uscale(0.5) TREE
2: FOREST -> {n = n - 1} (FOREST | move(2^n, 0, 0) rotz(30) FOREST)
TREE = label(7) scale(1, 2, 1) disc | move(0, 0, 1) label(8) scale(1, 1, 3) sphere | cylinder
"""


def prolate(c: float) -> float:
    """Return the area of a spheroid with axes 1, 1, c."""
    e = math.sqrt(1.0 - 1.0 / c**2)
    return 2.0 * math.pi * (1.0 + c / e * math.asin(e))


def test_a_forest_of_a_trillion_trees_is_summed_exactly() -> None:
    scene = pcsg.loads(FOREST)
    trees = 2**40
    assert scene.measure("count") == (3 * trees, 0.0)
    assert scene.measure("count", "label")[7].value == trees
    area = scene.measure("area", "label")
    expected = {7: 0.5 * math.pi, 8: 0.25 * prolate(3.0), 3: math.pi}
    for label, each in expected.items():
        assert area[label].se == 0.0
        assert area[label].value == pytest.approx(trees * each, rel=1e-9)
    volume = scene.measure("volume")
    assert volume.value == pytest.approx(trees * 0.125 * 5.0 * math.pi, rel=1e-12)


def test_counts_beyond_double_precision_are_exact() -> None:
    scene = pcsg.loads(FOREST, n=70)
    assert scene.measure("count").value == 3 * 2**70


def test_maps_that_stretch_above_states_are_sampled() -> None:
    body = "rotx(30) disc | rotx(70) label(2) scale(1, 1, 2) sphere"
    scene = pcsg.loads(f"scale(1, 2, 3) A\nA 1\n1: A -> {body}")
    written = pcsg.loads(" | ".join(f"scale(1, 2, 3) {part}" for part in body.split(" | ")))
    for key, exact in written.measure("area", "label").items():
        found = scene.measure("area", "label")[key]
        assert 0.0 < found.se < 0.01 * exact.value
        assert abs(found.value - exact.value) < 4.0 * found.se


@pytest.mark.parametrize(
    ("name", "args", "area", "volume"),
    [
        ("disc", (), math.pi, 0.0),
        ("rectangle", (), 4.0, 0.0),
        ("tri1", (), 0.5, 0.0),
        ("sphere", (), 4.0 * math.pi, 4.0 * math.pi / 3.0),
        ("box", (), 24.0, 8.0),
        ("cylinder", (), 4.0 * math.pi, math.pi),
        ("cone", (0.0,), math.pi * (1.0 + math.sqrt(2.0)), math.pi / 3.0),
        ("torus", (0.25,), math.pi**2, math.pi**2 / 8.0),
        ("tetrahedron", (), 8.0 * math.sqrt(3.0), 8.0 / 3.0),
    ],
)
def test_primitives_have_the_areas_and_volumes_of_their_formulas(
    name: str, args: tuple[float, ...], area: float, volume: float
) -> None:
    faces = faces_of(LEAVES[name], (), args)
    assert faces.area == pytest.approx(area, rel=1e-12)
    assert faces.volume == pytest.approx(volume, rel=1e-12)
    # Points are spread as the area is: their normals have the same mean square.
    drawn = draw_points(LEAVES[name], (), args, np.random.default_rng(1).random((50_000, 3)))
    vectors = faces.vectors[faces.vectors.any(axis=1)]
    sizes = np.linalg.norm(vectors, axis=1)
    expected = np.einsum("k,ki,kj->ij", 1.0 / sizes, vectors, vectors) / sizes.sum()
    assert np.allclose(drawn.normals.T @ drawn.normals / 50_000, expected, atol=0.01)
    assert np.allclose(np.linalg.norm(drawn.normals, axis=1), 1.0)


def test_a_mesh_is_measured_by_its_triangles() -> None:
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    scene = pcsg.Scene(pcsg.uscale(2) * pcsg.mesh(corners, faces))
    assert scene.measure("area").value == pytest.approx(4.0 * (1.5 + math.sqrt(3.0) / 2.0))
    assert scene.measure("volume").value == pytest.approx(8.0 / 6.0)


def test_points_are_spread_by_area_and_lie_on_surfaces() -> None:
    scene = pcsg.loads(
        """for(k, 0, 30) move(20 * k, 0, 0) rotx(7 * k) uscale(1 + k / 50) PLANT
PLANT 1
1: PLANT -> label(7) scale(1, 2, 1) disc | move(0, 0, 9) label(8) scale(1, 1, 3) sphere | PLANT2
PLANT2 1
1: PLANT2 -> move(0, 9, 0) label(3) cone(0.2)"""
    )
    found = scene.sample(20_000, seed=2)
    shares = {key: area.value for key, area in scene.measure("area", "label").items()}
    total = sum(shares.values())
    assert abs(found.area.value - total) < 4.0 * found.area.se + 1e-9
    for label, area in shares.items():
        p = area / total
        assert abs((found.label == label).mean() - p) < 4.0 * math.sqrt(p * (1 - p) / 20_000)
    # A ray along the normal, from a little outside, meets the surface there.
    here = found.points + 1e-3 * found.normals
    hits = scene.intersect(here, -found.normals)
    assert (np.abs(hits.t - 1e-3) < 1e-9).mean() > 0.99


def test_equal_seeds_give_equal_points() -> None:
    scene = pcsg.loads(FOREST)
    assert np.array_equal(scene.sample(100, seed=1).points, scene.sample(100, seed=1).points)
    assert not np.array_equal(scene.sample(100, seed=1).points, scene.sample(100, seed=2).points)


def test_what_cannot_be_measured_is_told() -> None:
    for text in ("sphere \\ box", "halfspace", "empty"):
        with pytest.raises(UsageError):
            pcsg.loads(text).sample(10)
    with pytest.raises(UsageError, match="rays"):
        pcsg.loads("sphere & box").measure("area")
    assert pcsg.loads("sphere & box").measure("count").value == 2
    with pytest.raises(UsageError, match="area, volume, count"):
        pcsg.loads("sphere").measure("size")  # type: ignore[call-overload]


def test_measuring_before_and_after_rays_is_the_same() -> None:
    scene = pcsg.Scene(pcsg.scatter(pcsg.disc(), {"x": 3.0 * np.arange(3_000.0)}))
    area = scene.measure("area")
    scene.intersect([[0, 0, 5]], [[0, 0, -1]])
    assert scene.measure("area", "label")[-1] == area
    assert len(scene.sample(10).points) == 10
