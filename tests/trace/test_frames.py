"""What is small and far from where its frame begins has a frame of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pcsg
from pcsg.trace.groups import INSTANCE
from pcsg.trace.tracer import StatesTracer

HALVES = """
HALF if(n > 1, 2, 1)
1: HALF -> move(rand(a,1), rand(a,2), rand(a,3)) uscale(0.02*(0.5 + rand(a,4))) sphere
2: HALF -> {n = floor(n/2)} HALF | {a = a + floor(n/2); n = n - floor(n/2)} HALF
"""
"""Balls in a box from 0 to 1."""

N = 2_500


def make(axiom: str, rules: str = "") -> pcsg.Scene:
    return pcsg.loads(f"{{a = 0; n = {N}}} ({axiom})\n{rules}\n{HALVES}")


def tracer_of(scene: pcsg.Scene) -> StatesTracer:
    tracer = scene.tracer
    assert isinstance(tracer, StatesTracer)
    return tracer


def lines_through(corner: Any, size: float, n: int) -> tuple[Any, Any]:
    """Return rays that begin outside a box and go through it."""
    rng = np.random.default_rng(2)
    targets = np.asarray(corner) + size * rng.random((n, 3))
    ways = rng.normal(size=(n, 3))
    ways *= 3.0 * size / np.linalg.norm(ways, axis=1)[:, None]
    return targets - ways, ways


def visits(scene: pcsg.Scene, rays: tuple[Any, Any]) -> float:
    before = tracer_of(scene).profile
    scene.intersect(*rays)
    after = tracer_of(scene).profile
    total = [p["rays"] * (p["blocks"] + p["leaves"]) for p in (before, after)]
    return (total[1] - total[0]) / len(rays[0])


@pytest.mark.parametrize(
    ("axiom", "corner", "size"),
    [
        ("sphere | move(100,100,100) uscale(1e-4) HALF", (100.0, 100.0, 100.0), 1e-4),
        ("sphere | uscale(1e-3) move(1e5,1e5,0) HALF", (100.0, 100.0, 0.0), 1e-3),
        ("move(3e8,1e8,0) HALF", (3e8, 1e8, 0.0), 1.0),
        ("sphere | move(1e5,0,0) (sphere | move(9e3,9,9) uscale(0.01) HALF)", (109e3, 9, 9), 0.01),
    ],
)
def test_rays_visit_as_little_as_anywhere(axiom: str, corner: Any, size: float) -> None:
    near = visits(make("HALF"), lines_through(np.zeros(3), 1.0, 500))
    assert visits(make(axiom), lines_through(corner, size, 500)) < 1.3 * near + 2.0


def test_places_in_the_world_may_be_large_numbers() -> None:
    rules = HALVES.replace("move(rand(a,1), rand(a,2),", "move(5e6 + rand(a,1), 3e6 + rand(a,2),")
    scene = pcsg.loads(f"{{a = 0; n = {N}}} HALF\n{rules}")
    rays = lines_through((5e6, 3e6, 0.0), 1.0, 500)
    assert (
        visits(scene, rays) < 1.3 * visits(make("HALF"), lines_through(np.zeros(3), 1.0, 500)) + 2
    )
    found = scene.intersect(*rays)
    walked = tracer_of(scene).walker.intersect(*rays)
    assert np.array_equal(found.leaf, walked.leaf) and found.mask.mean() > 0.5
    np.testing.assert_allclose(found.t, walked.t, atol=1e-9)
    assert np.abs(scene.bounds - [[5e6, 3e6, 0.0], [5e6 + 1, 3e6 + 1, 1.0]]).max() < 0.04


def test_few_solids_may_be_far_away_too() -> None:
    balls = HALVES.replace("move(rand(a,1),", "move(7e8 + rand(a,1),")
    far = pcsg.loads(f"{{a = 0; n = 700}} HALF\n{balls}")
    assert far.states.finite
    rays = lines_through((7e8, 0.0, 0.0), 1.0, 300)
    near = pcsg.loads(f"{{a = 0; n = 700}} HALF\n{HALVES}")
    assert visits(far, rays) < 1.3 * visits(near, lines_through(np.zeros(3), 1.0, 300)) + 2.0
    found, walked = far.intersect(*rays), tracer_of(far).walker.intersect(*rays)
    assert np.array_equal(found.leaf, walked.leaf) and found.mask.any()
    assert far.stats()["primitives"] == 700


@pytest.mark.parametrize(
    ("axiom", "corner", "size"),
    [
        ("sphere | move(100,0,9) uscale(1e-3) rotz(33) HALF", (100.0, 0.0, 9.0), 1e-3),
        ("sphere | move(1e5,0,0) (box \\ move(0.5,-0.5,-0.5) HALF)", (1e5, -0.5, -0.5), 1.0),
        ("sphere | move(1e5,0,0) (HALF & uscale(0.7) sphere)", (1e5, 0.0, 0.0), 1.0),
        ("PAIR | move(0,5e4,0) PAIR", (7e4, 5e4, 0.0), 1.0),
        ("move(9e6,0,0) (HALF \\ move(0.5,0,0) halfspace)", (9e6, 0.0, 0.0), 1.0),
        (
            "sphere | move(1e6,0,0) rotz(9) uscale(0.1) (HALF | move(3e4,0,0) HALF)",
            (1e6, 0, 0),
            0.1,
        ),
    ],
)
def test_answers_are_those_of_the_graph(axiom: str, corner: Any, size: float) -> None:
    scene = make(axiom, "PAIR 1\n1: PAIR -> sphere | move(7e4,0,0) HALF")
    tracer = tracer_of(scene)
    assert ((tracer.blocks.refs & 7) == INSTANCE).any()
    rays = lines_through(corner, size, 250)
    found, walked = scene.intersect(*rays), tracer.walker.intersect(*rays)
    assert np.array_equal(found.leaf, walked.leaf) and found.mask.any()
    np.testing.assert_allclose(found.t, walked.t, atol=1e-6)
    np.testing.assert_allclose(found.normal, walked.normal, atol=1e-5)
    assert np.array_equal(scene.occluded(*rays), walked.mask)
    points = rays[0] + 0.9 * rays[1] + 0.01 * size
    assert np.array_equal(scene.contains(points), tracer.walker.contains(points))


def test_numbers_at_the_end_of_their_range_are_no_matter() -> None:
    row = " | ".join(f"move({k},0,0) sphere" for k in range(40))
    for way in ("uscale(1e-200) uscale(1e-120)", "uscale(1e200) uscale(1e200)", "move(1e300,0,0)"):
        scene = pcsg.loads(f"{{}} {way} M\nM 1\n1: M -> {row}")
        assert scene.intersect([[0.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]]).t.shape == (1,)


def test_what_is_near_stands_in_one_frame() -> None:
    for axiom in ("HALF", "sphere | move(100,100,100) HALF", "move(50,0,0) HALF"):
        blocks = tracer_of(make(axiom)).blocks
        assert not ((blocks.refs & 7) == INSTANCE).any()
