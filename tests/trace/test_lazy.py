"""States that are made on demand: what rays find is what the oracle finds, wherever states are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
import strategies as cases
from afar import brightness, seen_from_afar
from agreement import Judge, cast, make_lazy
from hypothesis import assume, event, given
from hypothesis import strategies as st

from pcsg.errors import EvaluationFault, UsageError
from pcsg.grammar import load_file, load_text
from pcsg.graph import binding
from pcsg.graph.binding import make_recipes
from pcsg.graph.graph import Graph
from pcsg.graph.recipes import EntryPart, NoRecipe
from pcsg.graph.sides import entry_sides
from pcsg.scene import Scene
from pcsg.trace.lazy import LazyTracer
from pcsg.trace.walker import Walker

GRAMMARS = Path(__file__).parents[2] / "grammars"

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


def plant(order: int) -> Graph:
    return load_text(PLANT % order)


def rays_about(n: int, seed: int = 3) -> tuple[Any, Any]:
    """Return rays from all around towards a plant."""
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(n, 3))
    origins *= 9.0 / np.linalg.norm(origins, axis=1)[:, None]
    targets = rng.normal(size=(n, 3)) * (1.0, 1.0, 1.2) + (0.0, 0.0, 1.8)
    return origins, targets - origins


@given(data=st.data())
def test_grammars(data: st.DataObject) -> None:
    graph = data.draw(cases.graphs(world=False, unions=True))
    assume(len(oracle.leaves(graph)) <= 150)
    rays = data.draw(cases.many_rays(graph))
    is_static = binding._Maker._is_static
    if data.draw(st.booleans(), "everything by recipes"):
        binding._Maker._is_static = lambda *_: False  # type: ignore[method-assign]
    try:
        tracer = make_lazy(graph, block_memory=data.draw(st.sampled_from([0, 10_000, 1 << 20])))
    except NoRecipe as reason:
        event(str(reason))
        return
    finally:
        binding._Maker._is_static = is_static  # type: ignore[method-assign]
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


def test_answers_do_not_depend_on_memory_or_threads() -> None:
    graph = plant(9)
    rays = rays_about(40_000)
    first = make_lazy(graph, threads=1).intersect(*rays)
    assert 0.05 < first.mask.mean() < 0.95
    for options in ({"block_memory": 0}, {"block_memory": 50_000, "threads": 2}):
        tracer = make_lazy(graph, **options)  # type: ignore[arg-type]
        assert same_bits(first, tracer.intersect(*rays))
        assert tracer.counts["expansions"] > 1_000
        # Once more, with whatever the caches hold now.
        assert same_bits(first, tracer.intersect(*rays))
        assert (tracer.occluded(*rays) == first.mask).all()


@pytest.mark.parametrize("name, values", [("plant", {}), ("terrain", {"cnt": 5.0})])
def test_as_the_walker(name: str, values: Mapping[str, float]) -> None:
    graph = plant(7) if name == "plant" else load_file(GRAMMARS / "terrain.pcsg").override(values)
    lazy, walker = make_lazy(graph, block_memory=100_000), Walker(graph)
    origins, directions = rays_about(1_500)
    if name == "terrain":
        origins, directions = origins * 0.2 + (0.5, 0.5, 0.0), directions * (0.1, 0.1, 0.2)
    a, b = lazy.intersect(origins, directions), walker.intersect(origins, directions)
    assert a.mask.sum() > 100
    assert (a.leaf == b.leaf).all() and (a.label == b.label).all()
    met = b.mask
    assert (abs(a.t[met] - b.t[met]) <= 1e-9 * np.maximum(1.0, b.t[met])).all()
    assert abs(a.normal - b.normal).max() < 1e-6
    assert abs(a.uv - b.uv)[met].max() < 1e-5
    assert (a.color == b.color).all()


def test_a_scene_takes_lazy_states_where_there_are_too_many() -> None:
    scene = Scene(plant(12), block_memory=1 << 20)
    assert isinstance(scene.tracer, LazyTracer) and scene.engine == "states"
    stats = scene.stats()
    assert stats["states"] > 2_000 and stats["stored_states"] > 100
    assert stats["bytes"]["store"] <= 2 << 20
    assert isinstance(Scene(plant(12), engine="cyclic").tracer, Walker)


def test_what_cannot_be_made_on_demand_is_walked_and_says_why() -> None:
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


def test_faults_in_states_made_on_demand_are_told_by_the_walker() -> None:
    text = PLANT.replace("0.7 + 0.1*rand(s,5)", "if(n < 2, 1/(floor(9*rand(s,5))), 0.8)") % 12
    tracer = make_lazy(load_text(text), block_memory=0)
    with pytest.raises(EvaluationFault, match="PLANT"):
        tracer.intersect(*rays_about(4_000))


def test_a_fault_in_a_colour_is_told_when_the_colour_is_seen() -> None:
    text = (PLANT % 9).replace("color(0.2, rand(s, 7), 0.1)", "color(0.2, 1/(0*s), 0.1)")
    tracer = make_lazy(load_text(text))
    rays = rays_about(2_000)
    assert tracer.occluded(*rays).any()  # whose colour nobody asks for
    with pytest.raises(EvaluationFault, match="not a finite number"):
        tracer.intersect(*rays)


def test_a_terrain_has_few_entries_and_boxes_that_follow_its_corners() -> None:
    graph = load_file(GRAMMARS / "terrain.pcsg").override({"cnt": 10.0})
    found = make_recipes(graph)
    assert len(found.entries) == 22
    sides = entry_sides(found, [])
    for entry, box in zip(found.entries[4:], sides[4:], strict=True):
        heights = tuple(k for k, name in enumerate(entry.inputs) if name in ("z1", "z2", "z3"))
        assert box.sides[2].group == box.sides[5].group == heights
        # A single displacement can be 0.6 * 0.47^k upwards and no more than half of it downwards.
        assert box.sides[5].shift < 1.2 * 0.47 ** (10 - entry.key[1][0])  # type: ignore[operator]


def test_what_does_not_depend_on_inputs_is_a_fixture() -> None:
    found = make_recipes(plant(12))
    assert found.fixtures  # the leaf, an operation
    for entry in found.entries[2:]:
        assert entry.inputs == ("s",)
        assert all(len(r.parts) <= 9 for r in entry.rules.values())
    kinds = {type(p) for e in found.entries for r in e.rules.values() for p in r.parts}
    assert EntryPart in kinds


@pytest.mark.parametrize("pixels", [24, 16])
def test_what_is_smaller_than_a_pixel_covers_as_much_as_it_does(pixels: int) -> None:
    graph = plant(10)
    origins, directions, footprint = seen_from_afar(pixels, (0.0, 0.0, 2.0), 0.12, 60_000)
    tracer = make_lazy(graph)
    whole = tracer.intersect(origins, directions)
    ended = tracer.intersect(origins, directions, footprint=footprint)
    assert (whole.leaf != ended.leaf).mean() > 0.05 * whole.mask.mean()  # it did end somewhere
    assert whole.mask.mean() == pytest.approx(ended.mask.mean(), rel=0.1)
    assert brightness(whole) == pytest.approx(brightness(ended), rel=0.1)
    assert whole.color[whole.mask].mean(0) == pytest.approx(
        ended.color[ended.mask].mean(0), rel=0.1
    )
    blocked = tracer.occluded(origins, directions, footprint=footprint)
    assert blocked.mean() == pytest.approx(whole.mask.mean(), rel=0.1)


def test_pictures_with_ends_do_not_depend_on_memory_or_threads() -> None:
    graph = plant(10)
    origins, directions, footprint = seen_from_afar(30, (0.0, 0.0, 2.0), 0.12, 60_000)
    first = make_lazy(graph, threads=1).intersect(origins, directions, footprint=footprint)
    again = make_lazy(graph, threads=2).intersect(origins, directions, footprint=footprint)
    assert same_bits(first, again)


def test_a_surface_ends_in_its_terminating_rule() -> None:
    graph = load_file(GRAMMARS / "terrain.pcsg").override({"cnt": 9.0})
    origins, directions, footprint = seen_from_afar(40, (0.5, 0.5, 0.1), 0.12, 60_000)
    directions = (directions - directions.mean(0)) * 0.25 + directions.mean(0)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    footprint = footprint._replace(spread=footprint.spread * 0.25)
    tracer = make_lazy(graph)
    whole = tracer.intersect(origins, directions)
    made = tracer.counts["expansions"]
    ended = tracer.intersect(origins, directions, footprint=footprint)
    assert tracer.counts["expansions"] - made < made / 4
    assert whole.mask.mean() == pytest.approx(ended.mask.mean(), rel=0.02)
    both = whole.mask & ended.mask
    # Outlines apart, it is the same surface.
    assert np.quantile(np.abs(whole.t[both] - ended.t[both]), 0.95) < 0.02
    assert brightness(whole) == pytest.approx(brightness(ended), rel=0.05)
    assert whole.color[both].mean(0) == pytest.approx(ended.color[both].mean(0), rel=0.1)
