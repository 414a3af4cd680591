"""Leaves with data: models that depend on parameters, in both engines, and their limits.

The leaf of these tests is the mesh leaf with a number: a prism of that height. It shares the
kernels of `mesh`, so nothing is compiled for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from agreement import ENGINES

from pcsg import Scene
from pcsg.errors import EvaluationFault, GrammarError, UsageError
from pcsg.graph import unroll
from pcsg.graph.bounds import hyper_boxes
from pcsg.graph.build import CONSTRUCTORS, C, S
from pcsg.graph.expr import Expr, P, as_expr, call, if_
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Leaf, Node, Selection
from pcsg.graph.unroll import enumerate_states
from pcsg.leaf.mesh import Mesh, MeshModel, mesh_of_arrays
from pcsg.leaf.registry import Constant, LeafParameter
from pcsg.trace.pool import pool_of
from pcsg.trace.walker import Walker

SQUARE = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
FACES = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


def prism(height: float) -> MeshModel:
    corners = [(x, y, z) for z in (0.0, height) for x, y in SQUARE]
    return mesh_of_arrays(corners, FACES)


class Prism(Mesh):
    """The square of side 2, from z = 0 to a height."""

    parameters = (LeafParameter("height", low=0.0),)

    @classmethod
    def sheet_of(cls, constants: Sequence[Constant]) -> bool:
        return False

    @classmethod
    def primitives_of(cls, constants: Sequence[Constant]) -> int:
        return 1

    @classmethod
    def make_model(cls, constants: Sequence[Constant], args: Sequence[float]) -> MeshModel:
        if args[0] == 77.0:
            raise UsageError("a height of 77 is not for this test")
        return prism(args[0])


SOME = prism(1.0)


def leaf(height: Expr | float) -> Leaf:
    return Leaf(Prism, (as_expr(height),), (SOME,))


def prefix(name: str, *args: Any) -> Any:
    return CONSTRUCTORS[name](*args)  # type: ignore[operator]


def box(height: float) -> Node:
    unit = prefix("scale", 1.0, 1.0, height / 2.0)
    made: Node = prefix("move", 0.0, 0.0, height / 2.0) * unit * CONSTRUCTORS["box"].as_node()  # type: ignore[attr-defined]
    return made


def tower(step: Any, count: int, solid: Any = leaf) -> Graph:
    """Return prisms of heights step(c) side by side, c from `count` down to 0."""
    module = S("ROW", if_(P.c > 0.0, 2.0, 1.0))
    module.rule(1, solid(step(P.c)))
    module.rule(2, solid(step(P.c)) | C(c=P.c - 1.0) * prefix("move", 3.0, 0.0, 0.0) * module)
    return Graph(C(c=float(count)) * module)


def rays(count: int, seed: int, width: float) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    origins = rng.uniform((-2.0, -3.0, -1.0), (width, 3.0, 5.0), (count, 3))
    directions = rng.normal(size=(count, 3))
    directions[::3] = (0.0, 1.0, 0.0)
    return origins, directions


@pytest.mark.parametrize("engine", ENGINES)
def test_models_follow_their_parameters(engine: str) -> None:
    graph = tower(lambda c: 0.5 + 0.25 * c * c, 6)
    same = Graph(prefix("move", 0.0, 0.0, 0.0) * box(0.5))
    for c in range(7):
        placed = prefix("move", 3.0 * (6 - c), 0.0, 0.0) * box(0.5 + 0.25 * c * c)
        same = Graph(placed) if c == 0 else Graph(same.root | placed)
    tracer, other = ENGINES[engine](graph), ENGINES[engine](same)
    origins, directions = rays(3000, 1, 21.0)
    hits, expected = tracer.intersect(origins, directions), other.intersect(origins, directions)
    assert (hits.mask == expected.mask).all() and hits.mask.sum() > 500
    met = hits.mask
    assert np.allclose(hits.t[met], expected.t[met], rtol=1e-12, atol=1e-12)
    assert np.allclose(hits.normal, expected.normal, atol=1e-12)
    assert (tracer.contains(origins) == other.contains(origins)).all()
    assert (tracer.occluded(origins, directions) == hits.mask).all()
    assert len(pool_of(graph)._models) == 7


def test_boxes_are_those_of_the_models() -> None:
    graph = tower(lambda c: 1.0 + c, 3)
    found = hyper_boxes(graph)
    assert found.kind == "exact"
    assert found.scene.lower == pytest.approx((-1.0, -1.0, 0.0), abs=1e-7)
    assert found.scene.upper == pytest.approx((10.0, 1.0, 4.0), abs=1e-7)
    leaf_box = found.boxes[next(k for k, n in enumerate(graph.nodes) if isinstance(n, Leaf))]
    assert leaf_box[5] >= 1.0


@pytest.mark.parametrize("engine", ["cyclic", "states"])
def test_models_in_operations(engine: Any) -> None:
    graph = tower(lambda c: 1.0 + c, 2)
    ball = prefix("move", 0.0, 0.0, 3.0) * prefix("uscale", 0.8) * CONSTRUCTORS["sphere"].as_node()  # type: ignore[attr-defined]
    boxes = box(3.0) | prefix("move", 3, 0, 0) * box(2.0) | prefix("move", 6, 0, 0) * box(1.0)
    for made, same in ((graph.root - ball, boxes - ball), (graph.root & ball, boxes & ball)):
        scene, other = Scene(made, engine=engine), Scene(same, engine=engine)
        origins, directions = rays(2000, 2, 8.0)
        hits, expected = scene.intersect(origins, directions), other.intersect(origins, directions)
        assert (hits.mask == expected.mask).all() and hits.mask.sum() > 20
        assert np.allclose(hits.normal, expected.normal, atol=1e-12)
        a, b = scene.spans(origins, directions), other.spans(origins, directions)
        assert (a.offsets == b.offsets).all()
        assert np.allclose(a.t_in, b.t_in) and np.allclose(a.t_out, b.t_out)


def codes(graph: Graph) -> list[str]:
    return [d.code for d in enumerate_states(graph).diagnostics]


def test_at_most_64_models() -> None:
    assert codes(tower(lambda c: 1.0 + c, 63)) == []
    found = enumerate_states(tower(lambda c: 1.0 + c, 64)).diagnostics
    assert {d.code for d in found} == {"too-many-models"}
    text = found[0].render()
    assert "its parameters take more than 64 different values" in text
    assert "round a parameter" in text and "ROW:2" in text
    # Rounded as the message says, they are few again.
    rounded = tower(lambda c: 1.0 + call("round", c / 8.0), 200)
    assert codes(rounded) == []
    with pytest.raises(GrammarError, match="too-many-models"):
        Scene(tower(lambda c: 1.0 + c, 64))


def test_models_share_a_budget_of_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unroll, "MODELS_BYTES", 4 * prism(1.0).data.nbytes)
    assert codes(tower(lambda c: 1.0 + c, 3)) == []
    assert codes(tower(lambda c: 1.0 + c, 4))[:1] == ["too-many-models"]


def test_constant_models_are_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unroll, "MODELS_LIMIT", 0)
    assert codes(tower(lambda c: 1.0, 3)) == []
    assert codes(tower(lambda c: 1.0 + c, 3)) != []


def test_models_whose_parameters_cannot_be_enumerated() -> None:
    def endless(height: Any) -> Graph:
        module = S("M", if_(call("abs", call("worldx", 0, 0, 0)) > 1e6, 1.0, 2.0))
        module.rule(1, leaf(height(P.c)))
        again = C(c=P.c + 1.0) * prefix("move", 1.0, 0.0, 0.0) * module
        module.rule(2, again | leaf(height(P.c)))
        return Graph(C(c=0.0) * module)

    found = enumerate_states(endless(lambda c: 1.0 + c % 3.0), budget=50)
    assert not found.finite
    assert [d.code for d in found.unknown_models] == ["too-many-models"] * 2
    assert "more values than can be enumerated" in found.unknown_models[0].message
    assert enumerate_states(endless(lambda c: 1.0), budget=50).unknown_models == []
    with pytest.raises(GrammarError, match="too-many-models"):
        Scene(endless(lambda c: 1.0 + c % 3.0), block_memory=0)


def test_what_a_model_refuses_is_a_fault_of_its_line() -> None:
    (found,) = enumerate_states(Graph(leaf(77.0))).diagnostics
    assert (found.code, "a height of 77 is not for this test" in found.message) == (
        "bad-argument",
        True,
    )
    (found,) = enumerate_states(Graph(C(c=-1.0) * leaf(P.c))).diagnostics
    assert found.code == "bad-argument" and "height = -1, legal is 0 <= height" in found.message


def test_the_walker_tells_of_values_without_a_model() -> None:
    module: Selection = S("M").rule(1, leaf(P.c))
    graph = Graph(C(c=2.0) * module)
    walker = Walker(
        graph,
        boxes=np.tile([-9.0] * 3 + [9.0] * 3, (3, 1)),
        states=enumerate_states(Graph(leaf(1.0))),
    )
    with pytest.raises(EvaluationFault, match="no model for height = 2"):
        walker.intersect([[0.0, 0.0, 9.0]], [[0.0, 0.0, -1.0]])
