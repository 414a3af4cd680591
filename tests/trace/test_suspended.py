"""States that are suspended and expanded where rays come by: all finds are those of the oracle."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
import strategies as cases
from afar import brightness, seen_from_afar
from agreement import Judge, cast, make_suspended
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

from pcsg.errors import EvaluationFault, UsageError
from pcsg.grammar import load_file, load_text
from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.parametric_bounds import bound_rules
from pcsg.graph.ranges import Ranges
from pcsg.scene import Scene
from pcsg.trace.expand import suspended
from pcsg.trace.expand.partial import NotSuspended
from pcsg.trace.tracer import StatesTracer
from pcsg.trace.walker import Walker

GRAMMARS = Path(__file__).parents[2] / "grammars"

CARVED = """
{n = %d; s = SEED} PLANT
PLANT if(n > 0, 2, 1)
1: PLANT -> label(n) ((scale(0.3,0.3,0.5) box) \\ (move(0,0,0.3) uscale(rand(s,8)/4 + 0.1) sphere))
2: PLANT -> (scale(0.08,0.08,1) cylinder \\ move(0.05,0,0.3+rand(s,6)/2) uscale(0.05) sphere)
   | color(rand(s, 7), 0.2, 0.1) {n = n-1} move(0,0,1) (
       {s = rand(s,1)} rotz(360*rand(s,3)) rotx(15 + 35*rand(s,4)) uscale(0.7 + 0.1*rand(s,5)) PLANT
     | ({s = rand(s,2)} rotz(360*rand(s,3)) rotx(-15 - 35*rand(s,4)) uscale(0.7) PLANT)
       \\ move(0,0,0.2) uscale(rand(s,9)/5) sphere )
"""


PLANT = """
{n = %d; s = SEED} PLANT
PLANT if(n > 0, 2 + (n < 5)*floor(1.3*rand(s, 9)), 1)
1: PLANT -> limb | move(0,0,1) color(0.2, rand(s, 7), 0.1) label(n) leaf
2: PLANT -> limb | {n = n-1} move(0,0,1) (
       {s = rand(s,1)} rotz(360*rand(s,3)) rotx(15 + 35*rand(s,4)) uscale(0.7 + 0.1*rand(s,5)) PLANT
     | {s = rand(s,2)} rotz(360*rand(s,3)) rotx(-15 - 35*rand(s,4)) uscale(0.7) PLANT )
3: PLANT -> {n = n-1} ( scale(0.1,0.1,1) cone(rand(s, 1)) | move(0,0,1) rot(40*s, 1,s,0) PLANT )
limb = scale(0.06, 0.06, 1) cylinder | move(0,0,1) uscale(0.06) sphere
leaf = scale(0.12, 0.05, 0.5) move(0,0,1) (sphere & move(0.3,0,0) sphere)
"""
"""Unions of modules; its leaves and limbs are the same everywhere."""


def plant(order: int) -> Graph:
    return load_text(PLANT % order)


def carved(order: int) -> Graph:
    return load_text(CARVED % order)


def opened(order: int) -> Graph:
    """Return the same, but no branch is cut: recursion does not end under operations."""
    return load_text((CARVED % order).replace("\\ move(0,0,0.2) uscale(rand(s,9)/5) sphere", ""))


def rays_about(n: int, seed: int = 3) -> tuple[Any, Any]:
    """Return rays from all around towards a plant."""
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(n, 3))
    origins *= 9.0 / np.linalg.norm(origins, axis=1)[:, None]
    targets = rng.normal(size=(n, 3)) * (1.0, 1.0, 1.2) + (0.0, 0.0, 1.8)
    return origins, targets - origins


@settings(max_examples=settings().max_examples // 3)
@given(data=st.data())
def test_grammars(data: st.DataObject) -> None:
    graph = data.draw(cases.graphs())
    assume(len(oracle.leaves(graph)) <= 150)
    rays = data.draw(cases.many_rays(graph))
    try:
        tracer = make_suspended(
            graph, block_memory=data.draw(st.sampled_from([0, 10_000, 1 << 20]))
        )
    except NotSuspended as reason:
        event(str(reason))
        return
    judge = Judge(tracer, graph)
    found = cast(tracer, rays)
    blocked = tracer.occluded([o for o, _ in rays], [d for _, d in rays])
    assert (blocked == (found.leaf >= 0)).all()
    for i, ray in enumerate(rays):
        judge.hit(ray, found, i)


def same_bits(a: Any, b: Any) -> bool:
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=True) for f in fields(a)
    )


def test_answers_do_not_depend_on_threads_or_on_what_is_in_the_cache(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    graph, rays = carved(9), rays_about(20_000)
    tracer = make_suspended(graph, threads=1, block_memory=20_000)
    first = tracer.intersect(*rays)
    assert 0.05 < first.mask.mean() < 0.95
    assert tracer.counts["expansions"] > 1_000
    # Once more, with whatever is there now, and backwards.
    assert same_bits(first, tracer.intersect(*rays))
    back = tracer.intersect(rays[0][::-1], rays[1][::-1])
    assert (back.t[::-1] == first.t).all() and (back.color[::-1] == first.color).all()
    assert (tracer.occluded(*rays) == first.mask).all()
    monkeypatch.setattr(suspended, "CACHE_ROWS", 64)
    small = make_suspended(graph, threads=2, block_memory=20_000)
    assert same_bits(first, small.intersect(*rays))
    assert small.counts["expansions"] > 2 * tracer.counts["expansions"]


def test_answers_hardly_depend_on_memory() -> None:
    graph, rays = carved(8), rays_about(20_000)
    found = [make_suspended(graph, block_memory=m).intersect(*rays) for m in (0, 100_000, 1 << 24)]
    for other in found[1:]:
        assert (found[0].mask == other.mask).all() and (found[0].leaf == other.leaf).all()
        met = other.mask
        np.testing.assert_allclose(found[0].t[met], other.t[met], rtol=1e-12)


def terrain(order: int) -> Graph:
    return load_file(GRAMMARS / "terrain.pcsg").override({"cnt": float(order)})


@pytest.mark.parametrize("block_memory", [0, 50_000])
@pytest.mark.parametrize(
    "graph", [carved(6), plant(7), terrain(5)], ids=["carved", "plant", "terrain"]
)
def test_rays_find_what_the_walker_does(graph: Graph, block_memory: int) -> None:
    tracer, walker = make_suspended(graph, block_memory=block_memory), Walker(graph)
    origins, directions = rays_about(3_000)
    if "z1" in graph.slots:
        origins, directions = origins * 0.2 + (0.5, 0.5, 0.0), directions * (0.1, 0.1, 0.2)
    outside = walker.intersect(origins, directions)
    # Half of the rays start within solids.
    inside = np.flatnonzero(outside.mask)
    origins[inside[::2]] = (outside.position + 1e-3 * directions)[inside[::2]]
    a, b = tracer.intersect(origins, directions), walker.intersect(origins, directions)
    assert b.mask.sum() > 200
    assert (a.leaf == b.leaf).all() and (a.label == b.label).all()
    met = b.mask
    np.testing.assert_allclose(a.t[met], b.t[met], rtol=1e-9, atol=1e-9)
    assert abs(a.normal - b.normal).max() < 1e-6
    assert (a.color == b.color).all() and abs(a.uv - b.uv)[met].max() < 1e-5
    assert (tracer.occluded(origins, directions) == met).all()


def test_a_scene_of_too_many_carved_states_is_not_walked() -> None:
    scene = Scene(carved(16), block_memory=1 << 20)
    assert isinstance(scene.tracer, StatesTracer) and scene.engine == "states"
    hits = scene.intersect(*rays_about(500))
    assert 0.05 < hits.mask.mean() < 0.95
    stats = scene.stats()
    assert stats["suspended"] > 100 and stats["expansions"] > 100
    assert stats["bytes"]["blocks"] <= 2 << 20
    assert isinstance(Scene(carved(16), engine="cyclic").tracer, Walker)


def test_what_cannot_be_suspended_is_walked_and_says_why() -> None:
    # A half-space at every place has no bounds, and there is no end of them.
    text = "{n=1} A\nA 1 + (n < 0)\n2: A -> box\n" + (
        "1: A -> (sphere & move(n,0,0) halfspace) | halfspace | {n=n+1} move(1,0,0) A\n"
    )
    scene = Scene(load_text(text), block_memory=0)
    assert isinstance(scene.tracer, Walker)
    with pytest.raises(UsageError, match="without bounds"):
        Scene(load_text(text), engine="states", block_memory=0)


def test_what_leads_back_to_itself_is_walked_and_says_why() -> None:
    text = "{c=1} S\nS 1 + c\n1: S -> sphere\n" + (
        "2: S -> box | {c=2} uscale(0.5) S\n3: S -> {c=1} move(1,0,0) S\n"
    )
    assert isinstance(Scene(load_text(text)).tracer, Walker)
    with pytest.raises(UsageError, match="leads back to itself with the same values"):
        Scene(load_text(text), engine="states")


def test_the_frame_of_the_world_is_passed_on() -> None:
    text = """{n = 14} A
A if(n > 0, 2, 1)
1: A -> color(abs(worldx(0,0,0))/8, 0.5, 0) sphere
2: A -> {n = n-1} (move(1+worldz(0,0,0)/9,0,0) rotz(50) uscale(0.7) A | move(0,0,1) rotx(40) A)
"""
    graph = load_text(text)
    tracer, walker = make_suspended(graph), Walker(graph)
    rays = rays_about(200)
    a, b = tracer.intersect(*rays), walker.intersect(*rays)
    assert b.mask.any() and (a.leaf == b.leaf).all()
    np.testing.assert_allclose(a.color, b.color, rtol=1e-12)


def test_a_fault_is_told_by_the_walker() -> None:
    text = (CARVED % 12).replace("0.7 + 0.1*rand(s,5)", "if(n < 3, 1/(floor(9*rand(s,5))), 0.8)")
    tracer = make_suspended(load_text(text))
    with pytest.raises(EvaluationFault, match="PLANT"):
        tracer.intersect(*rays_about(4_000))


def test_a_fault_in_a_colour_is_told() -> None:
    text = (PLANT % 9).replace("color(0.2, rand(s, 7), 0.1)", "color(0.2, 1/(0*s), 0.1)")
    with pytest.raises(EvaluationFault, match="not a finite number"):
        make_suspended(load_text(text)).intersect(*rays_about(2_000))


def test_a_terrain_has_few_entries_and_boxes_that_follow_its_corners() -> None:
    graph = terrain(10)
    ranges = Ranges(graph, True)
    assert ranges.run(GLOBALS)
    found = bound_rules(ranges)
    assert len(found) == 24
    heights = tuple(graph.slots[name] for name in ("z1", "z2", "z3"))
    sides = {key: bounds.sides.sides for (key, _), bounds in found.items()}
    triangles = {key: own for key, own in sides.items() if own[5].group}
    # The largest have corners that are known.
    assert len(triangles) == 20
    for (_, (order,)), own in triangles.items():
        assert own[2].group == own[5].group == heights
        # A single displacement can be 0.6 * 0.47^k upwards and no more than half of it downwards.
        assert own[5].shift < 1.2 * 0.47 ** (10 - order)


def test_what_is_smaller_than_a_pixel_covers_as_much_as_it_does() -> None:
    origins, directions, footprint = seen_from_afar(8, (0.0, 0.0, 2.0), 0.12, 40_000)
    tracer = make_suspended(opened(10), threads=1, block_memory=400_000)
    whole = tracer.intersect(origins, directions)
    ended = tracer.intersect(origins, directions, footprint=footprint)
    assert (whole.leaf != ended.leaf).mean() > 0.05 * whole.mask.mean()  # it did end somewhere
    assert whole.mask.mean() == pytest.approx(ended.mask.mean(), rel=0.1)
    assert brightness(whole) == pytest.approx(brightness(ended), rel=0.1)
    whole_green, ended_green = (h.color[h.mask, 1].mean() for h in (whole, ended))
    assert whole_green == pytest.approx(ended_green, rel=0.1)
    blocked = tracer.occluded(origins, directions, footprint=footprint)
    assert blocked.mean() == pytest.approx(whole.mask.mean(), rel=0.1)
    again = make_suspended(opened(10), threads=2, block_memory=400_000)
    assert same_bits(ended, again.intersect(origins, directions, footprint=footprint))


def test_a_surface_ends_in_its_terminating_rule() -> None:
    graph = terrain(9)
    origins, directions, footprint = seen_from_afar(40, (0.5, 0.5, 0.1), 0.03, 40_000)
    tracer = make_suspended(graph, block_memory=1 << 20)
    whole = tracer.intersect(origins, directions)
    made = tracer.counts["expansions"]
    ended = tracer.intersect(origins, directions, footprint=footprint)
    assert tracer.counts["expansions"] - made < made / 2
    assert whole.mask.mean() == pytest.approx(ended.mask.mean(), rel=0.02)
    both = whole.mask & ended.mask
    # Outlines apart, it is the same surface.
    assert np.quantile(np.abs(whole.t[both] - ended.t[both]), 0.95) < 0.02
    assert brightness(whole) == pytest.approx(brightness(ended), rel=0.05)
    assert whole.color[both].mean(0) == pytest.approx(ended.color[both].mean(0), rel=0.1)
