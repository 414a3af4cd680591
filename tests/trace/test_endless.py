"""Rays that would never end are told as a fault of the grammar."""

from __future__ import annotations

import pytest

from pcsg.errors import EvaluationFault
from pcsg.grammar import load_text
from pcsg.scene import Scene
from pcsg.trace.traversal import MOST_BLOCKS

CROWD = (
    "{n = 40} S\nS if(n > 0, 2, 1)\n1: S -> sphere\n"
    "2: S -> {n = n-1} (uscale(0.9999) S | uscale(0.9998) S)"
)
"""A million million balls in one place."""


@pytest.mark.parametrize("engine", ["cyclic", "auto"])
def test_a_ray_among_endless_copies_is_told(engine: str) -> None:
    scene = Scene(load_text(CROWD), engine=engine, threads=1)
    # Within all boxes, but beside all balls.
    with pytest.raises(EvaluationFault, match="long-ray") as caught:
        scene.intersect([[0.9, 0.9, -5.0]], [[0.0, 0.0, 1.0]])
    assert "module `S`" in str(caught.value) and "S:2" in str(caught.value)


def test_rays_behind_one_that_has_looked_too_far_stop_at_once() -> None:
    scene = Scene(load_text(CROWD), engine="states", threads=1)
    with pytest.raises(EvaluationFault, match="long-ray"):
        scene.intersect([[0.9, 0.9, -5.0]] * 20, [[0.0, 0.0, 1.0]])
    assert 20 * scene.tracer.profile["blocks"] < 1.1 * MOST_BLOCKS
