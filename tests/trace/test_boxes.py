"""Boxes in single precision lose no surface: far origins, deep frames, flat and slanted rays."""

from __future__ import annotations

import numpy as np
import pytest

import pcsg

DUST = """{n=20} D
D if(n > 0, 2, 1)
1: D -> sphere
2: D -> {n=n-1} (move(1,0.25,0) uscale(0.5) D | move(-1,0.5,0.5) uscale(0.5) D)
"""
FLAT = """move(3,0,0) scale(5,5,1e-9) box | rot(30,1,1,0) scale(1,1,1e-12) cylinder
| move(1,2,3) uscale(1e-6) sphere | move(0,0,2e6) uscale(1e6) sphere
| move(-2,0,0) uscale(1e-3) scale(1,1,1e5) cylinder"""


def _aims(text: str) -> np.ndarray:
    """Return points on or in surfaces of a scene."""
    rng = np.random.default_rng(1)
    if text == DUST:
        aims = np.zeros((300, 3))
        for _ in range(20):
            aims = 0.5 * aims + rng.choice([(1.0, 0.25, 0.0), (-1.0, 0.5, 0.5)], 300)
        return aims
    origins = rng.normal(size=(300, 3)) * 4.0
    hits = pcsg.loads(text, engine="cyclic").intersect(origins, rng.normal(size=(300, 3)) - origins)
    assert hits.mask.sum() > 50
    return np.asarray(hits.position[hits.mask])


@pytest.mark.parametrize("text", [DUST, FLAT], ids=["deep", "flat"])
@pytest.mark.parametrize("distance", [1e-3, 1.0, 1e3, 1e6, 1e9])
@pytest.mark.parametrize("length", [1e-100, 1.0, 1e100])
def test_rays_at_surfaces(text: str, distance: float, length: float) -> None:
    aims = _aims(text)
    rng = np.random.default_rng(2)
    ways = rng.normal(size=aims.shape)
    ways[::3] *= (1.0, 0.0, 1e-30)
    ways[1::6] *= (0.0, 0.0, 1.0)
    ways[4::6] *= (1e-9, 1.0, 1e-12)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    origins = aims - distance * ways
    found, walked = (
        pcsg.loads(text, engine=engine).intersect(origins, length * ways)
        for engine in ("states", "cyclic")
    )
    np.testing.assert_array_equal(found.mask, walked.mask)
    hit = found.mask
    room = 1e-9 * (1.0 + distance) + 1e-14 * np.linalg.norm(aims[hit], axis=1)
    off = np.abs(found.t[hit] - walked.t[hit])
    assert (off <= room / length + 1e-7 * walked.t[hit]).all()
    assert found.mask.mean() > 0.3 or distance >= 1e9


def test_a_scene_without_end() -> None:
    scene = pcsg.loads("halfspace | move(0,0,5) sphere", engine="states")
    for far in (1.0, 1e30, 1e100):
        hits = scene.intersect((0.0, 0.0, far + 10.0), [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0)])
        assert hits.mask.tolist() == [True, False]
