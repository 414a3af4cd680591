"""Periodic rays meet what rays meet among copies."""

from __future__ import annotations

import numpy as np
import pytest

import pcsg
from pcsg.errors import UsageError
from pcsg.trace import periodic

CELL = (0.0, -1.0, 3.0, 1.0)


def overhanging(n: int = 12, sheets: bool = False) -> pcsg.Scene:
    rng = np.random.default_rng(5)
    places, normals = rng.uniform((0, -1, 0), (3, 1, 2), (n, 3)), rng.normal(size=(n, 3))
    table = dict(zip(("x", "y", "z", "nx", "ny", "nz"), [*places.T, *normals.T], strict=True))
    table["scale"] = rng.uniform(0.2, 1.0, n)
    body = pcsg.label(4) * pcsg.disc()
    if not sheets:
        body = body | pcsg.move(0, 0, 0.2) * pcsg.uscale(0.3) * pcsg.sphere()
    return pcsg.Scene(pcsg.scatter(body, table))


def copied(scene: pcsg.Scene, cells: int) -> pcsg.Scene:
    xs, ys = np.meshgrid(3.0 * np.arange(-cells, cells + 1), 2.0 * np.arange(-cells, cells + 1))
    return pcsg.Scene(pcsg.scatter(scene.graph.root, {"x": xs.ravel(), "y": ys.ravel()}))


def rays(n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(6)
    d = rng.normal(size=(n, 3))
    d[:, 2] = -np.abs(d[:, 2]) - 0.5
    return np.column_stack([rng.uniform(-2, 5, n), rng.uniform(-2, 3, n), np.full(n, 4.0)]), d


def test_a_periodic_scene_is_the_union_of_its_copies() -> None:
    scene = overhanging()
    o, d = rays(2_000)
    found = scene.intersect(o, d, periodic=CELL)
    expected = copied(scene, 14).intersect(o, d)
    assert 500 < expected.mask.sum() < 2_000
    assert np.array_equal(found.mask, expected.mask)
    for name in ("t", "position", "normal", "uv"):
        a, b = getattr(found, name), getattr(expected, name)
        assert np.allclose(a, b, rtol=1e-9, atol=1e-9), name
    assert np.array_equal(found.label, expected.label)
    assert np.array_equal(scene.occluded(o, d, periodic=CELL), expected.mask)


def test_limits_hold_along_the_whole_ray() -> None:
    scene = overhanging(sheets=True)
    o, d = rays(500)
    whole = scene.intersect(o, d, periodic=CELL).t
    beyond = np.where(np.isfinite(whole), whole, 1.0) * 1.0001 + 1e-6
    found = scene.intersect(o, d, beyond, periodic=CELL)
    expected = copied(scene, 14).intersect(o, d, beyond)
    assert np.allclose(found.t, expected.t, rtol=1e-9)
    assert not np.isfinite(scene.intersect(o, d, 0.0, 0.5 * whole, periodic=CELL).t).any()


def test_small_batches_give_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = overhanging()
    o, d = rays(500)
    whole = scene.intersect(o, d, periodic=CELL)
    monkeypatch.setattr(periodic, "BATCH", 37)
    parts = scene.intersect(o, d, periodic=CELL)
    assert np.array_equal(whole.t, parts.t)
    assert np.array_equal(whole.position, parts.position)


def test_an_unbounded_ground_is_met_everywhere() -> None:
    scene = pcsg.loads("halfspace | label(1) move(0.5, 0.5, 1) uscale(0.2) sphere")
    o = np.array([[0.5, 0.5, 5.0], [7.5, -3.5, 5.0], [7.0, 3.0, 5.0]])
    found = scene.intersect(o, [[0, 0, -1.0]], periodic=(0, 0, 1, 1))
    assert found.label.tolist() == [1, 1, -1]
    assert np.allclose(found.t, [3.8, 3.8, 5.0])


def test_a_level_ray_that_meets_nothing_ends() -> None:
    scene = pcsg.loads("move(0.5, 0.5, 0) uscale(0.2) sphere")
    found = scene.intersect([[0.0, 0.0, 0.1]], [[1.0, 0.0, 0.0]], periodic=(0, 0, 1, 1))
    assert not found.mask.any()


@pytest.mark.parametrize("cell", [(0, 0, 0, 1), (0, 0, 1), (0, 0, np.inf, 1), "cell"])
def test_what_is_no_cell_is_told(cell: object) -> None:
    with pytest.raises(UsageError, match="periodic"):
        pcsg.loads("sphere").intersect([[0, 0, 5]], [[0, 0, -1]], periodic=cell)
