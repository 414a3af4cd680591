"""Scenes, graphs, expressions, hits and pictures are copied and pickled by value."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pcsg
from pcsg.grammar import load_file, load_text
from pcsg.graph.expr import same
from pcsg.graph.graph import Graph
from pcsg.graph.operators import OPERATORS
from pcsg.graph.text import to_pcsg

GRAMMARS = Path(__file__).parents[1] / "grammars"


def by_pickle(x: Any) -> Any:
    return pickle.loads(pickle.dumps(x))


COPIES = pytest.mark.parametrize("copied", [copy.deepcopy, by_pickle], ids=["copy", "pickle"])
Copy = Callable[[Any], Any]

CUT = "{n = 3; r = 0.5} A\nA if(n > 0, 2, 1)\n1: A -> box \\ move(0.5,0.5,0.5) sphere\n" + (
    "2: A -> {n = n-1} (move(0,0,2) uscale(r) A | label(n) color(1,0,n) cone(0.5) & box)\n"
    "camera { eye = (r, 5, 2) }\n"
)


def rays(n: int = 300) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    origins = rng.normal(size=(n, 3)) * 3.0
    return origins, rng.uniform(-1, 1, (n, 3)) - origins


@COPIES
@pytest.mark.parametrize("engine", ["states", "cyclic"])
def test_a_copied_scene_answers_like_its_original(copied: Copy, engine: Any) -> None:
    scene = pcsg.loads(CUT, engine=engine, threads=1, n=2, SEED=3)
    before = scene.intersect(*rays())
    other = copied(scene)
    assert other.engine == engine
    assert other.values == scene.values
    assert other.parameters == {"SEED": 3.0, "TIME": 0.0, "n": 2.0, "r": 0.5}
    assert other.setting_values("camera") == scene.setting_values("camera")
    np.testing.assert_array_equal(other.bounds, scene.bounds)
    found = other.intersect(*rays())
    assert 50 < found.mask.sum() < 300
    for name, column in before.columns().items():
        np.testing.assert_array_equal(found.columns()[name], column)


def test_a_difference_stays_one() -> None:
    cut = copy.deepcopy(pcsg.Scene(pcsg.box - pcsg.move(1, 1, 1) * pcsg.uscale(3) * pcsg.sphere))
    np.testing.assert_allclose(cut.bounds, [[-1, -1, -1], [1, 1, 1]], rtol=1e-6)
    assert not cut.contains([[0, 0, 0]])[0]


@COPIES
@pytest.mark.parametrize("path", sorted(GRAMMARS.glob("*.pcsg")), ids=lambda p: p.stem)
def test_graphs_of_the_gallery(copied: Copy, path: Path) -> None:
    graph = load_file(path)
    other = copied(graph)
    assert other == graph
    assert not set(map(id, other.nodes)) & set(map(id, graph.nodes))
    assert to_pcsg(other) == to_pcsg(graph)


@COPIES
def test_blobs_and_meshes(copied: Copy) -> None:
    triangle = pcsg.mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    fields = pcsg.loads("{q=1} blob { point(q) | move(2,0,0) (point(1) & ball) }\nball = point(2)")
    tree = pcsg.Scene(pcsg.tree_wood("populus", 3.0))
    for scene in (pcsg.Scene(triangle), fields, tree):
        scene.intersect([[0.1, 0.1, 5]], [0, 0, -1])  # whatever is made on demand is there
        other = copied(scene)
        np.testing.assert_array_equal(other.bounds, scene.bounds)
        found = other.intersect([[0.1, 0.1, 5]], [0, 0, -1])
        assert found.t[0] == scene.intersect([[0.1, 0.1, 5]], [0, 0, -1]).t[0]
        assert other.source_hash == scene.source_hash


@COPIES
def test_nothing_recurses_on_the_nesting(copied: Copy) -> None:
    expr = pcsg.P.a
    for _ in range(5_000):
        expr = 1.0 + expr * 0.5
    assert same(copied(expr), expr)
    text = "{} " + "(sphere & (box | " * 1_000 + "box" + "))" * 1_000
    graph = load_text(text)
    assert copied(graph) == graph


@COPIES
def test_what_is_shared_stays_shared(copied: Copy) -> None:
    expr = pcsg.P.a
    for _ in range(60):
        expr = expr + expr  # written out it has 2^60 terms
    twin = copied(expr)
    assert twin.args[0] is twin.args[1]
    node = pcsg.sphere.as_node()
    other = copied(node | pcsg.move(1, 0, 0) * node)
    assert other.operands[1].successor is other.operands[0]


@COPIES
def test_everything_with_one_of_its_kind(copied: Copy) -> None:
    for operator in OPERATORS:
        assert copied(operator) is operator
    prefix = copied(pcsg.move(1, 2, 3) * pcsg.C(a=1) * pcsg.material("bark"))
    assert to_pcsg(Graph(prefix * pcsg.sphere)) == to_pcsg(
        Graph(pcsg.move(1, 2, 3) * pcsg.C(a=1) * pcsg.material("bark") * pcsg.sphere)
    )
    assert copied(pcsg.P) is pcsg.P
    assert copied(pcsg.sphere)().solid is pcsg.sphere.solid
    assert copied(pcsg.move)(1, 2, 3) * pcsg.sphere


@COPIES
def test_answers(copied: Copy) -> None:
    scene = pcsg.loads(CUT)
    hits, spans = scene.intersect(*rays()), scene.spans(*rays())
    for name, column in hits.columns().items():
        np.testing.assert_array_equal(getattr(copied(hits), name), column)
    for name in ("offsets", "t_in", "t_out"):
        np.testing.assert_array_equal(getattr(copied(spans), name), getattr(spans, name))
    image = pcsg.render(scene, size=(8, 6), samples=1)
    np.testing.assert_array_equal(copied(image).rgb, image.rgb)
    assert copied(image).metadata == image.metadata


def count_hits(scene: pcsg.Scene) -> int:
    return int(scene.intersect(*rays()).mask.sum())


def test_scenes_travel_to_new_processes() -> None:
    scene = pcsg.loads(CUT)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(count_hits, [scene, scene]) == [count_hits(scene)] * 2
