"""Whoever reads states reads their table where they are many, with the answers of Python."""

from __future__ import annotations

import dataclasses
import re
from unittest import mock

import numpy as np
import pytest
import strategies as cases
from hypothesis import given, reject
from hypothesis import strategies as st

import pcsg
from pcsg.errors import UsageError
from pcsg.grammar import load_text
from pcsg.graph import leaves as by_python
from pcsg.graph import shining
from pcsg.graph.counts import count_primitives
from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.hulls import Hulls
from pcsg.graph.leaves import Leaves
from pcsg.graph.stats import take_census
from pcsg.graph.text import to_pcsg
from pcsg.graph.unroll import enumerate_states
from pcsg.trace.expand import census, light, placing, reading
from pcsg.trace.expand.expansion import Expansion
from pcsg.trace.expand.pack import pack_expansion
from pcsg.trace.pool import make_pool

LAMP = "material lamp { emission = (3, 6, 9) }"
CHAIN = """{{i = {n}}} LOOP
LOOP if(i > 0, 2, 1)
1: LOOP -> empty
2: LOOP -> {{i = i - 1}} ({thing} | LOOP)
"""
BUSHES = """
{a = 0; n = 60} HALF
HALF if(n > 1, 2, 1)
1: HALF -> move(500*rand(a,1), 500*rand(a,2), 0) rotz(360*rand(a,3)) {c = 7} BUSH
2: HALF -> {n = floor(n/2)} HALF | {a = a + floor(n/2); n = n - floor(n/2)} HALF
BUSH if(c > 0, 2, 1)
1: BUSH -> uscale(0.4) sphere
2: BUSH -> scale(0.1, 0.1, 1) cylinder
    | {c = c - 1} move(0,0,9) (rotx(35) uscale(0.9) BUSH | rotx(-30) rotz(80) uscale(0.8) BUSH)
"""
BALL = "move(100*rand(i,1), 100*rand(i,2), 100*rand(i,3)) label(i) sphere"


def expand(graph: Graph) -> Expansion:
    return Expansion(graph, GLOBALS, make_pool(graph), 1 << 30)


def assert_same(a: Leaves, b: Leaves) -> None:
    for field in dataclasses.fields(Leaves):
        ours, theirs = getattr(a, field.name), getattr(b, field.name)
        if isinstance(ours, np.ndarray):
            assert ours.tobytes() == theirs.tobytes(), field.name
        else:
            assert tuple(ours) == tuple(theirs), field.name


@given(data=st.data())
def test_primitives_are_those_of_python_bit_for_bit(data: st.DataObject) -> None:
    graph = data.draw(cases.graphs())
    size = data.draw(st.sampled_from([1, 7, 1_000]))
    ours = list(placing.batches_of_leaves(expand(graph), size))
    theirs = list(by_python.batches_of_leaves(enumerate_states(graph), size))
    assert len(ours) == len(theirs)
    for a, b in zip(ours, theirs, strict=True):
        assert_same(a, b)


@given(data=st.data())
def test_counts_are_those_of_python(data: st.DataObject) -> None:
    graph = data.draw(cases.graphs())
    states, found = enumerate_states(graph), expand(graph)
    assert found.n_states - 1 == states.count
    assert census.count_primitives(found) == count_primitives(graph)
    assert census.data_leaves(found) == take_census(graph, states=states).counts.leaves


def test_boxes_of_instances_are_as_tight_as_those_of_python() -> None:
    graph = load_text(BUSHES)
    states = enumerate_states(graph, budget=20_000)
    packed = pack_expansion(expand(graph))
    assert states.finite and packed.clusters > 1
    theirs = Hulls(states)
    np.testing.assert_allclose(packed.bounded.ravel(), theirs.box(theirs.parts[0]), rtol=1e-7)


@given(data=st.data(), most=st.sampled_from([2, 3, 64]))
def test_light_is_that_of_python_bit_for_bit(data: st.DataObject, most: int) -> None:
    try:
        text = to_pcsg(data.draw(cases.graphs()))
    except UsageError:
        # Not every graph that can be built in Python can be written.
        reject()
    text = re.sub(r"\b(sphere|cone)\b", r"material(lamp) \1", text)
    text = re.sub(r"\b(box|torus)\b", r"material(dim) \1", text)
    graph = load_text(f"{text}\n{LAMP} material dim {{ emission = (1, 0, 0) }}")
    strengths = [6.0, 1.0]
    with mock.patch.object(shining, "MOST_COVERS", most):
        theirs = shining.shining_covers(enumerate_states(graph), strengths)
        assert light.shining_covers(expand(graph), strengths).tobytes() == theirs.tobytes()
        dark = shining.dark_nodes(graph, strengths)
        some = Expansion(graph, GLOBALS, make_pool(graph), 1 << 30, without=dark)
        assert light.shining_covers(some, strengths).tobytes() == theirs.tobytes()


def test_a_rule_that_is_written_twice_keeps_its_number() -> None:
    graph = load_text("{c = 1} (A | {c = 2} A)\nA if(c > 1, 2, 1)\n1: A -> box\n2: A -> box")
    found = expand(graph)
    assert found.n_states - 1 == enumerate_states(graph).count == 2
    (batch,) = placing.batches_of_leaves(found, 10)
    assert list(batch.path) == [(("A", 1),), (("A", 2),)]


def test_statistics_of_many_states_are_exact() -> None:
    scene = pcsg.loads(CHAIN.format(n=3_000, thing=BALL))
    counts = scene.stats()
    assert counts["states"] == 3_001 and counts["primitives"] == 3_001 - 1
    assert counts["boxes"] == "exact"
    places = np.concatenate([batch.matrix for batch in scene.leaves()])[:-1, :, 3]
    reach = [places.min(axis=0) - 1.0, places.max(axis=0) + 1.0]
    np.testing.assert_allclose(counts["bounds"], reach, rtol=1e-6)
    assert counts == scene.stats()  # after the table has gone


def test_statistics_do_not_depend_on_memory() -> None:
    few, many = (
        pcsg.loads(CHAIN.format(n=3_000, thing=BALL), block_memory=m).stats() for m in (0, None)
    )
    assert few["engine"] == many["engine"] == "states"
    assert few["states"] == many["states"] and few["primitives"] == many["primitives"]


def test_states_that_are_too_many_are_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "EXPANSION_MEMORY", 1 << 20)
    graph = load_text(CHAIN.format(n=30_000, thing=BALL))
    reader = reading.StatesReader(graph, GLOBALS, enumerate_states(graph))
    assert reader.expand(1 << 20) is None
    monkeypatch.setattr(reader, "expand", None)
    assert reader.count() is None
    with pytest.raises(UsageError, match="too many states"):
        next(reader.leaves(10))


def test_more_primitives_than_doubles_can_count() -> None:
    # 2**60 leaves below each of 2,500 states of a chain.
    text = """{i = 2500; d = 0} LOOP
    LOOP if(i > 0, 2, 1)
    1: LOOP -> empty
    2: LOOP -> {i = i - 1} (move(i, 0, 0) {d = 60} T | LOOP)
    T if(d > 0, 2, 1)
    1: T -> sphere
    2: T -> {d = d - 1} (move(1, 0, 0) uscale(0.5) T | uscale(0.5) T)
    """
    assert census.count_primitives(expand(load_text(text))) == 2_500 * 2**60


def test_paths_of_a_deep_chain_take_no_memory() -> None:
    scene = pcsg.loads(CHAIN.format(n=20_000, thing=BALL))
    last = None
    for batch in scene.leaves(3_000):
        last = batch
    assert last is not None and last.name[-1] == "empty"
    path = last.path[len(last) - 1]
    assert len(path) == 20_001 and path[0] == ("LOOP", 2) and path[-1] == ("LOOP", 1)
    assert last.path[-2:][0] == path[:-1] and len(last.path[:7]) == 7


def test_limbs_of_many_states_are_those_of_few() -> None:
    stem = "move(0, 0, i) scale(0.1, 0.1, 1) cone(0.9)"
    few = pcsg.loads(CHAIN.format(n=1_500, thing=stem))
    many = pcsg.loads(CHAIN.format(n=3_000, thing=stem))
    assert few.states.finite and not many.states.finite
    assert len(many.limbs().skeleton.pos) == 2 * len(few.limbs().skeleton.pos) - 1
    with pytest.raises(UsageError, match="more than 2,000 primitives"):
        many.limbs(2_000)


@pytest.mark.parametrize("n", [2_500, 40_000])
def test_lamps_are_found_however_many_there_are(n: int) -> None:
    text = """{{a = 0; n = {n}}} HALF
    HALF if(n > 1, 2, 1)
    1: HALF -> move(100*rand(a,1), 100*rand(a,2), 100*rand(a,3)) material(lamp) uscale(0.1) sphere
    2: HALF -> {{n = floor(n/2)}} HALF | {{a = a + floor(n/2); n = n - floor(n/2)}} HALF
    """
    scene = pcsg.loads(text.format(n=n) + LAMP)
    found = scene.shining_covers(np.array([6.0]))
    assert len(found) == shining.MOST_COVERS
    # The box of a ball has six sides, and shows a quarter of its surface.
    np.testing.assert_allclose(found[:, shining.POWER].sum(), 6.0 * n * 0.01 * 24 / 4)


@pytest.mark.parametrize("n", [100, 6_000])
def test_lamps_that_are_written_one_by_one_are_grouped_by_place(n: int) -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 100, (n, 3)).round(3)
    lamps = [f"move({x},{y},{z}) uscale(0.1) sphere" for x, y, z in places.tolist()]
    scene = pcsg.loads("material(lamp) (" + " | ".join(lamps) + ") " + LAMP)
    found = scene.shining_covers(np.array([6.0]))
    assert len(found) == shining.MOST_COVERS
    np.testing.assert_allclose(found[:, shining.POWER].sum(), 6.0 * n * 0.01 * 24 / 4)
    away = np.linalg.norm(places[:, None] - found[None, :, :3], axis=2)
    assert (away <= found[:, shining.RADIUS]).any(axis=1).all()
    # A ball about everything has a radius of 87.
    assert found[:, shining.RADIUS].max() < 40
