"""The terrain is crack-free: no ray aimed at an edge or a corner slips through."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pcsg

FILE = Path(__file__).parent.parent / "grammars" / "terrain.pcsg"
ORDER = 6


def test_no_ray_slips_through_edges_and_corners() -> None:
    scene = pcsg.load(FILE, cnt=ORDER)
    n = 2**ORDER
    rng = np.random.default_rng(6)
    # Corners, and places along the horizontal, vertical and diagonal edges, off the border.
    i, j = np.meshgrid(np.arange(1, n), np.arange(1, n))
    corners = np.column_stack([i.ravel(), j.ravel()]) / n
    along = rng.random((len(corners), 1)) / n
    edges = [corners - along * d for d in ((1, 0), (0, 1), (1, -1))]
    places = np.concatenate([corners, *edges])
    places = places[((places > 0.0) & (places < 1.0)).all(axis=1)]
    assert len(places) > 15_000
    above = np.column_stack([places, np.full(len(places), 10.0)])
    straight = scene.intersect(above, [0.0, 0.0, -1.0])
    assert straight.mask.all()

    # Slanting rays from above, through the very points where the straight ones met the ground.
    # Whatever else they meet on the way, they end below it.
    aims = straight.position
    steep = rng.normal(size=(len(aims), 3)) * (0.02, 0.02, 0.0) + (0.0, 0.0, 1.0)
    for aim in (aims, np.repeat(aims[:200], 20, axis=0)):
        slant = steep[rng.integers(0, len(steep), len(aim))]
        hits = scene.intersect(aim + 3.0 * slant, -slant)
        end = (aim - 3.0 * slant)[:, :2]
        inside = ((end > 0.0) & (end < 1.0)).all(axis=1)
        start = (aim + 3.0 * slant)[:, :2]
        inside &= ((start > 0.0) & (start < 1.0)).all(axis=1)
        assert inside.sum() > len(aim) // 3
        assert hits.mask[inside].all()
        assert (hits.t[inside] <= 3.0 + 1e-6).all()
