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
from agreement import Judge, cast, make_lazy
from hypothesis import assume, event, given
from hypothesis import strategies as st

from pcsg.errors import EvaluationFault, UsageError
from pcsg.grammar import load_file, load_text
from pcsg.graph import recipes as recipes_module
from pcsg.graph.graph import Graph
from pcsg.graph.recipes import EntryPart, NoRecipe, make_recipes
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
    is_static = recipes_module._Maker._is_static
    if data.draw(st.booleans(), "everything by recipes"):
        recipes_module._Maker._is_static = lambda *_: False  # type: ignore[method-assign]
    try:
        tracer = make_lazy(graph, block_memory=data.draw(st.sampled_from([0, 10_000, 1 << 20])))
    except NoRecipe as reason:
        event(str(reason))
        return
    finally:
        recipes_module._Maker._is_static = is_static  # type: ignore[method-assign]
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
    scene = Scene(plant(12))
    assert isinstance(scene.tracer, LazyTracer) and scene.engine == "states"
    stats = scene.stats()
    assert stats["states"] is None and stats["stored_states"] > 1_000
    assert stats["bytes"]["store"] <= 17 << 20
    assert isinstance(Scene(plant(12), engine="cyclic").tracer, Walker)


def test_what_cannot_be_made_on_demand_is_walked_and_says_why() -> None:
    text = PLANT.replace("color(0.2", "(box & uscale(rand(s,8)+0.5) sphere) | color(0.2") % 13
    scene = Scene(load_text(text))
    assert isinstance(scene.tracer, Walker)
    with pytest.raises(UsageError, match="an operation"):
        Scene(load_text(text), engine="states")


def test_faults_in_states_made_on_demand_are_told_by_the_walker() -> None:
    text = PLANT.replace("0.7 + 0.1*rand(s,5)", "if(n < 2, 1/(floor(9*rand(s,5))), 0.8)") % 12
    tracer = make_lazy(load_text(text), block_memory=0)
    with pytest.raises(EvaluationFault, match="PLANT"):
        tracer.intersect(*rays_about(4_000))


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
