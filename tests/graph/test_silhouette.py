"""How far scenes reach in any direction."""

from __future__ import annotations

import math

import numpy as np
import pytest

import pcsg

RNG = np.random.default_rng(1)
DIRECTIONS = RNG.normal(size=(20, 3))
LENGTHS = np.linalg.norm(DIRECTIONS, axis=1)


def reach(text: str) -> np.ndarray:
    return pcsg.loads(text).reach(DIRECTIONS)


def test_balls_reach_as_far_as_their_radii() -> None:
    found = reach("sphere | move(1, 2, 3) uscale(2) sphere")
    expected = np.maximum(LENGTHS, DIRECTIONS @ [1, 2, 3] + 2 * LENGTHS)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_a_turned_wire_reaches_no_farther_than_its_ends() -> None:
    found = reach("roty(90) rotz(30) scale(1e-6, 1e-6, 5) cylinder")
    np.testing.assert_allclose(found, np.maximum(DIRECTIONS @ [5, 0, 0], 0), atol=1e-4)


def test_what_is_cut_does_not_count() -> None:
    np.testing.assert_allclose(reach("sphere | (uscale(9) box \\ uscale(10) box)"), LENGTHS)
    assert (reach("uscale(9) box & sphere") == -math.inf).all()


def test_what_has_no_bounds_does_not_count() -> None:
    np.testing.assert_allclose(reach("sphere | halfspace"), LENGTHS, rtol=1e-3)
    assert (reach("halfspace") == -math.inf).all()


def test_models_that_have_only_a_box_do_not_count() -> None:
    assert (reach("blob { segment(3, 0.5) }") == -math.inf).all()


def test_recursion_is_followed() -> None:
    rule = (
        "{n = 12} A\nA if(n > 0, 1, 2)\n"
        "1: A -> sphere | move(3, 0, 0) {n = n - 1} A\n2: A -> sphere"
    )
    np.testing.assert_allclose(
        reach(rule), np.maximum(DIRECTIONS @ [36, 0, 0], 0) + LENGTHS, rtol=1e-3
    )


@pytest.mark.parametrize("engine", ["states", "cyclic"])
def test_engines_agree(engine) -> None:
    scene = pcsg.loads("sphere | move(1, 2, 3) uscale(2) sphere", engine=engine)
    assert (scene.reach(DIRECTIONS) == reach("sphere | move(1, 2, 3) uscale(2) sphere")).all()
