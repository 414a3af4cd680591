"""Meshes in scenes: both engines find what the oracle finds, triangle by triangle."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import oracle
import pytest
import strategies as cases
from agreement import ENGINES, Make
from hypothesis import assume, given
from hypothesis import strategies as st
from test_agreement import WINDOWS, judge_all

from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.build import C, S
from pcsg.graph.expr import P, if_
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Leaf
from pcsg.graph.operators import OPERATORS
from pcsg.graph.transforms import TRANSFORMS
from pcsg.leaf import LEAVES
from pcsg.leaf.mesh import Mesh, MeshModel, mesh_of_arrays
from pcsg.scene import Scene
from pcsg.trace.tracer import StatesTracer

both = pytest.mark.parametrize("make", ENGINES.values(), ids=ENGINES)

CUBE = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CORNERS = [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)]
ARROW = [(-1, -1, -1), (1, -1, -1), (0, 1, -1), (0, -0.5, 1)]
TWO = [*ARROW, *((x + 0.4, y - 0.2, z + 0.3) for x, y, z in ARROW)]
FOUR = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]

SAME: dict[str, MeshModel] = {
    "box": mesh_of_arrays(CUBE, CUBE_FACES),
    "tetrahedron": mesh_of_arrays(CORNERS, [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)]),
    "tri1": mesh_of_arrays([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]),
    "tri2": mesh_of_arrays([(0, 0, 0), (-1, 0, 0), (0, -1, 0)], [(0, 1, 2)]),
}
"""Meshes that are primitives."""

OTHERS: dict[str, MeshModel] = {
    "sphere": mesh_of_arrays(ARROW, FOUR),
    "cylinder": mesh_of_arrays(TWO, [*FOUR, *((a + 4, b + 4, c + 4) for a, b, c in FOUR)]),
    "cone": mesh_of_arrays(CUBE, CUBE_FACES[:-1]),
}
"""A closed mesh, one whose two parts overlap, and an open box, in place of primitives."""


def with_meshes(graph: Graph, instead: dict[str, MeshModel]) -> Graph:
    """Return a copy of a graph with meshes in place of primitives."""
    shared = (*OPERATORS, *TRANSFORMS.values(), *ATTRIBUTES.values())
    made = copy.deepcopy(graph, {id(x): x for x in shared})
    for node in made.nodes:
        if isinstance(node, Leaf) and node.solid.name in instead:
            node.constants = (instead[node.solid.name],)
            node.solid, node.args = Mesh, ()
    return made


def test_the_meshes_are_what_they_should_be() -> None:
    closed = {name for name, mesh in {**SAME, **OTHERS}.items() if mesh.closed}
    assert closed == {"box", "tetrahedron", "sphere", "cylinder"}


@both
@given(data=st.data())
def test_meshes_answer_as_the_primitives_they_are(make: Make, data: st.DataObject) -> None:
    graph = data.draw(cases.solid_graphs())
    assume(any(isinstance(n, Leaf) and n.solid.name in SAME for n in graph.nodes))
    rays = data.draw(cases.many_rays(graph))
    meshes = with_meshes(graph, SAME)
    judge_all(lambda g: make(meshes), graph, rays, [(0.0, np.inf), data.draw(WINDOWS)])


@both
@given(data=st.data())
def test_meshes_in_grammars(make: Make, data: st.DataObject) -> None:
    graph = with_meshes(data.draw(cases.graphs()), {**SAME, **OTHERS})
    assume(not any(isinstance(n, Leaf) and n.is_sheet for n in graph.nodes))
    assume(len(oracle.leaves(graph)) <= 60)
    rays = data.draw(cases.many_rays(graph, 6))
    judge_all(make, graph, rays, [(0.0, np.inf), data.draw(WINDOWS)])


@both
@given(data=st.data())
def test_points_in_meshes(make: Make, data: st.DataObject) -> None:
    graph = with_meshes(data.draw(cases.solid_graphs(sheets=False)), {**SAME, **OTHERS})
    assume(not any(isinstance(n, Leaf) and n.is_sheet for n in graph.nodes))
    coordinates = st.floats(-3, 3).map(lambda x: round(x, 3) + 1.7e-5)
    points = np.array(data.draw(st.lists(st.tuples(*[coordinates] * 3), min_size=1, max_size=20)))
    got = make(graph).contains(points)
    assert got.tolist() == [oracle.contains(graph, p) for p in points]


def test_a_mesh_with_more_crossings_than_a_ray_has_room_for() -> None:
    """Two hundred plates, one behind the other."""
    plates = np.concatenate([np.array(CUBE) * (1, 1, 0.25) + (0, 0, k) for k in range(200)])
    faces = [[v + 8 * k for v in face] for k in range(200) for face in CUBE_FACES]
    stack = Leaf(Mesh, (), (mesh_of_arrays(plates, faces),))
    for engine in ("cyclic", "states"):
        scene = Scene(stack - BALL, engine=engine)  # type: ignore[arg-type]
        spans = scene.spans([(0.1, 0.2, -5.0)], [(0.0, 0.0, 1.0)])
        # The ball takes the first plate away and bites into the second.
        assert np.allclose(spans.t_in[1:], np.arange(2, 200) + 5.0 - 0.25)
        assert np.allclose(spans.t_out, np.arange(1, 200) + 5.0 + 0.25)
        hits = scene.intersect([(0.1, 0.2, -5.0)], [(0.0, 0.0, 1.0)])
        assert hits.t[0] == spans.t_in[0] == pytest.approx(5.0 + 0.95**0.5)


BALL = Leaf(LEAVES["sphere"])


@pytest.mark.parametrize("engine", ["cyclic", "states"])
def test_a_recursive_grammar_of_meshes(engine: Any) -> None:
    module = S("M", if_(P.c > 0.0, 2.0, 1.0))
    rock = Leaf(Mesh, (), (OTHERS["sphere"],))
    module.rule(1, rock)
    smaller = C(c=P.c - 1.0)
    half = cases.prefix("uscale", 0.5) * module
    module.rule(
        2,
        rock
        | smaller * cases.prefix("move", 1.5, 0, 0) * half
        | smaller * cases.prefix("move", -1, 1.2, 0) * cases.prefix("rotz", 120) * half
        | smaller * cases.prefix("move", 0, 0, 1.4) * half,
    )
    graph = Graph(C(c=6.0) * module)
    scene = Scene(graph, engine=engine)
    assert scene.engine == engine
    rng = np.random.default_rng(5)
    target = rng.uniform(-1.5, 2.0, (60, 3))
    origins = np.tile((4.0, -6.0, 3.0), (60, 1))
    hits = scene.intersect(origins, target - origins)
    met = 0
    for o, d, t, leaf in zip(origins, target - origins, hits.t, hits.leaf, strict=True):
        expected = oracle.first(graph, o, d)
        assert (leaf < 0) == (expected is None)
        if expected is not None:
            assert t == pytest.approx(expected.t, rel=1e-9) and leaf == expected.leaf
            met += 1
    assert met > 20
    if isinstance(scene.tracer, StatesTracer):
        # However often it is instanced, the mesh is stored once.
        assert scene.tracer.nbytes["models"] == OTHERS["sphere"].data.nbytes
