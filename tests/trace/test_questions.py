"""What is asked of operations, and how much of them is looked at."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import pcsg
from pcsg.trace import rays as batches
from pcsg.trace.tracer import Engine

GRAMMARS = Path(__file__).parent.parent.parent / "grammars"

ROW = " | ".join(f"move({k},0,0) uscale(0.4) sphere" for k in range(8))
OTHER = " | ".join(f"move({k + 0.3},0.1,0) uscale(0.3) box" for k in range(8))
BITES = f"(({OTHER}) & ({ROW} | move(0,0.2,0) box))"
NESTED = f"{{}} (scale(9,1,1) box \\ (({ROW}) \\ ({OTHER})) \\ {BITES})"


def rays_at(bounds: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    low, high = bounds
    origins = (low + high) / 2 + rng.normal(size=(n, 3)) * np.max(high - low)
    return origins, low + rng.random((n, 3)) * (high - low) - origins


def test_tunnels_are_not_searched_for_what_comes_next() -> None:
    """Seven times as many blocks are visited where all that is subtracted is looked through."""
    visits = []
    for n in (3.0, 5.0):
        scene = pcsg.load(GRAMMARS / "menger.pcsg", parameters={"n": n})
        scene.intersect(*rays_at(scene.bounds, 2_000))
        visits.append(scene.tracer.profile["blocks"])  # type: ignore[attr-defined]
    assert visits[1] < 2.5 * visits[0]


@pytest.mark.parametrize("text", [NESTED, f"{NESTED} & ({ROW} | scale(4,1,1) box)"])
def test_nested_differences_agree_in_both_ways_to_ask(text: str) -> None:
    walked, states = (pcsg.loads(text, engine=engine) for engine in ("cyclic", "states"))
    rays = rays_at(walked.bounds, 3_000)
    a, b = walked.intersect(*rays), states.intersect(*rays)
    assert a.mask.sum() > 200
    np.testing.assert_allclose(b.t, a.t, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(states.occluded(*rays), a.mask)


BALLS = " | ".join(f"move({3 * (k % 4)},{3 * (k // 4)},4) uscale(.8) sphere" for k in range(8))
DRUMS = " | ".join(f"move({3 * (k % 4)},{3 * (k // 4)},0) uscale(.8) cylinder" for k in range(8))
BESIDE = f"""{{}} ((A1 \\ move(.5,0,0) uscale(.7) box) | {DRUMS} | {BALLS})
1: A1 -> uscale(2) cylinder | move(4,2,2) uscale(2) sphere
"""
PUT_UP = """{} ((move(0,1,0) B \\ sphere) | uscale(1.2) sphere)
1: B -> box | move(0,0,5) sphere
"""
PUT_BACK = """{n=3} A
A if(n > 0, 2, 1)
1: A -> cylinder
2: A -> {} ((rotx(30) box & rotz(45) {n=n-1} A) | (box \\ rotx(30) box))
"""


@pytest.mark.parametrize(
    "text", [BESIDE, PUT_UP, PUT_BACK], ids=["beside", "put up", "cut off and put back"]
)
@pytest.mark.parametrize("inside", [False, True])
def test_what_stands_beside_an_operation_is_found(text: str, inside: bool) -> None:
    walked, states = (pcsg.loads(text, engine=engine) for engine in ("cyclic", "states"))
    origins, directions = rays_at(walked.bounds, 4_000)
    if inside:
        low, high = walked.bounds
        targets = origins + directions
        origins = low + np.random.default_rng(4).random(origins.shape) * (high - low)
        directions = targets - origins
    a, b = walked.intersect(origins, directions), states.intersect(origins, directions)
    np.testing.assert_allclose(b.t, a.t, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(b.leaf, a.leaf)
    np.testing.assert_allclose(b.normal, a.normal, atol=1e-6)
    np.testing.assert_array_equal(states.occluded(origins, directions), a.mask)


def test_an_operation_ends_though_something_begins_before() -> None:
    scene = pcsg.loads(PUT_UP, engine="states")
    assert scene.intersect([(-0.75, 1.0, -0.5)], [(1.0, 0.0, 0.0)]).t == [1.75]


BITTEN = "(B \\ box)", "(uscale(1.5) B \\ box)"


@pytest.mark.parametrize(
    "text",
    [
        "{} (move(0,0,1) tri1 | box)",
        "{} (box | move(0,0,1) tri1)",
        f"{{}} ({BITTEN[0]} | {BITTEN[1]})\n1: B -> uscale(3) sphere | move(9,0,0) sphere",
        f"{{}} ({BITTEN[1]} | {BITTEN[0]})\n1: B -> uscale(3) sphere | move(9,0,0) sphere",
    ],
)
def test_of_what_ends_where_a_ray_leaves_the_first_in_the_text_answers(text: str) -> None:
    walked, states = (pcsg.loads(text, engine=engine) for engine in ("cyclic", "states"))
    rng = np.random.default_rng(6)
    origins = rng.uniform(-2.0, 2.0, (500, 3))
    directions = rng.uniform(-1.0, 1.0, (500, 3)) - origins
    a, b = walked.intersect(origins, directions), states.intersect(origins, directions)
    assert a.mask.all()
    np.testing.assert_array_equal(b.leaf, a.leaf)
    np.testing.assert_allclose(b.normal, a.normal, atol=1e-6)


def test_threads_keep_their_working_space() -> None:
    scene = pcsg.loads("sphere")
    n = 3 * batches.CHUNK
    rays = np.tile([0.0, 0.0, -5.0], (n, 1)), np.tile([0.0, 0.0, 1.0], (n, 1))
    scene.tracer.threads = 2  # type: ignore[attr-defined]
    for _ in range(5):
        scene.intersect(*rays)
    assert len(scene.tracer._scratches) <= 2  # type: ignore[attr-defined]


@pytest.mark.parametrize("engine", ["cyclic", "states"])
def test_from_infinity_a_solid_without_end_hides_what_is_in_it(engine: Engine) -> None:
    scene = pcsg.loads("{} torus(0.2) | rotx(90) halfspace", engine=engine)
    ray = [[0.0, 0.0, 0.0]], [[0.5, 0.0, 0.0]], -math.inf, math.inf
    assert scene.intersect(*ray).leaf[0] == -1
    assert not scene.occluded(*ray)[0]


def test_a_long_chain_of_differences_is_one_hierarchy() -> None:
    rng = np.random.default_rng(6)
    balls = [f"move({x},{y},{z}) uscale(0.1) sphere" for x, y, z in rng.uniform(-1, 1, (120, 3))]
    chain, union = (
        pcsg.loads(f"{{}} (box \\ {text})")
        for text in (" \\ ".join(balls), f"({' | '.join(balls)})")
    )
    rays = rays_at(chain.bounds, 2_000)
    a, b = chain.intersect(*rays), union.intersect(*rays)
    assert np.array_equal(a.t, b.t) and np.array_equal(a.normal, b.normal) and a.mask.any()
    visits = [scene.tracer.profile["blocks"] for scene in (chain, union)]  # type: ignore[attr-defined]
    assert visits[0] < 1.2 * visits[1]
