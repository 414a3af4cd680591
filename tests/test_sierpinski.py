"""The number of rays that hit Sierpinski's tetrahedron, against brute force over all leaves."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

import pcsg
from pcsg.trace.tracer import Engine

FILE = Path(__file__).parent.parent / "grammars" / "sierpinski.pcsg"
CORNERS = np.array([(1.0, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)])
ORDER = 5
EYE = np.array([1.022846, -3.177154, -2.174512])


def pixel_corners(n: int) -> np.ndarray:
    """Return directions through the (n + 1)^2 corners of the pixels of a square picture."""
    target, up = np.array([-0.004103, -0.004103, 0.216539]), (-0.816497, -0.816497, 0.816497)
    forward = target - EYE
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    above = np.cross(right, forward)
    s = np.linspace(-1.0, 1.0, n + 1) * np.tan(np.radians(22.5))
    x, y = np.meshgrid(s, -s)
    d = forward + x.reshape(-1, 1) * right + y.reshape(-1, 1) * above
    directions: np.ndarray = d / np.linalg.norm(d, axis=1, keepdims=True)
    return directions


def hit_by_brute_force(directions: np.ndarray) -> np.ndarray:
    """Clip every ray against the four planes of every tetrahedron that it comes near."""
    hit = np.zeros(len(directions), bool)
    scale = 0.5**ORDER
    for path in product(CORNERS, repeat=ORDER):
        centre = sum(c * 0.5 ** (k + 1) for k, c in enumerate(path))
        o = EYE - centre
        along = directions @ o
        near = np.flatnonzero((o @ o - along**2 < 3.1 * scale**2) & ~hit)
        low, high = np.full(len(near), -np.inf), np.full(len(near), np.inf)
        for c in CORNERS:  # the plane opposite to corner c: -c . p <= scale
            rate = -(directions[near] @ c)
            with np.errstate(divide="ignore"):
                t = (scale + o @ c) / rate
            low = np.where(rate < 0.0, np.maximum(low, t), low)
            high = np.where(rate > 0.0, np.minimum(high, t), high)
        hit[near] |= low < high
    return hit


@pytest.mark.parametrize("engine", ["cyclic", "states"])
def test_hits_equal_brute_force(engine: Engine) -> None:
    directions = pixel_corners(512)
    assert directions.shape == (513 * 513, 3)
    scene = pcsg.load(FILE, c=ORDER, engine=engine)
    assert scene.stats()["primitives"] == 1024
    hits = scene.intersect(EYE, directions)
    expected = hit_by_brute_force(directions)
    assert expected.sum() > 40_000
    assert hits.mask.sum() == expected.sum()
    assert (hits.mask == expected).all()
