"""All crossings of a ray, in order, with everything about their surfaces."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import pcsg
from pcsg.errors import UsageError

ENGINES = pytest.mark.parametrize("engine", ["states", "cyclic"])

ROW = "{n = 3} A\nA if(n > 0, 2, 1)\n1: A -> empty\n" + (
    "2: A -> label(n) color(n/4,0,0) sphere | {n = n-1} move(4,0,0) A"
)


@ENGINES
def test_a_row_of_balls(engine: Any) -> None:
    scene = pcsg.loads(ROW, engine=engine)
    found = scene.intersect_all(
        [[-5, 0, 0], [-5, 9, 0], [20, 0, 0]], [[1, 0, 0], [1, 0, 0], [-2, 0, 0]]
    )
    assert found.offsets.tolist() == [0, 6, 6, 12]
    np.testing.assert_allclose(found.t[:6], [4, 6, 8, 10, 12, 14])
    assert found.label.tolist() == [3, 3, 2, 2, 1, 1, 1, 1, 2, 2, 3, 3]
    assert found.entering.tolist() == [True, False] * 6
    assert found.ray.tolist() == [0] * 6 + [2] * 6
    assert not found.sheet.any()
    np.testing.assert_allclose(found.normal[:2], [[-1, 0, 0], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(found.color[:, 0], found.label / 4)
    np.testing.assert_allclose(found.position[7], [7, 0, 0])
    assert scene.graph.nodes[found.leaf[0]].solid.name == "sphere"  # type: ignore[attr-defined]


@ENGINES
def test_limits_are_closed_and_a_start_inside_leaves_first(engine: Any) -> None:
    scene = pcsg.loads(ROW, engine=engine)
    found = scene.intersect_all([[0, 0, 0]] * 3, [1, 0, 0], [0.0, 1.0, -1.0], [5.0, 3.0, 0.5])
    assert [
        found.t[a:b].tolist() for a, b in zip(found.offsets, found.offsets[1:], strict=False)
    ] == [
        [1, 3, 5],
        [1, 3],
        [-1],
    ]
    assert found.entering.tolist() == [False, True, False, False, True, True]


@ENGINES
def test_sheets_and_what_is_cut_away(engine: Any) -> None:
    text = "label(1) box \\ label(7) uscale(0.5) box | move(0,0,3) label(9) uscale(4) tri1"
    scene = pcsg.loads(text, engine=engine)
    found = scene.intersect_all([0.2, 0.3, 9], [0, 0, -1])
    np.testing.assert_allclose(found.t, [6, 8, 8.5, 9.5, 10])
    assert found.label.tolist() == [9, 1, 7, 7, 1]
    assert found.sheet.tolist() == [True, False, False, False, False]
    assert found.entering.tolist() == [False, True, False, True, False]
    np.testing.assert_allclose(np.abs(found.normal[:, 2]), 1.0)
    assert (found.normal[1:, 2] > 0).tolist() == [True, False, True, False]


@ENGINES
def test_the_first_crossing_is_the_hit(engine: Any) -> None:
    scene = pcsg.load("grammars/fig5a.pcsg", engine=engine)
    rng = np.random.default_rng(2)
    lower, upper = scene.bounds
    target = rng.uniform(lower, upper, (300, 3))
    origins = target + rng.normal(size=(300, 3)) * 20
    hits = scene.intersect(origins, target - origins)
    found = scene.intersect_all(origins, target - origins)
    counts = np.diff(found.offsets)
    assert ((counts > 0) == hits.mask).all()
    first = found.offsets[:-1][hits.mask]
    for name in ("t", "position", "normal", "leaf", "label", "uv"):
        np.testing.assert_allclose(
            getattr(found, name)[first], getattr(hits, name)[hits.mask], rtol=1e-9, atol=1e-9
        )
    # The spans are the same stretches.
    spans = scene.spans(origins, target - origins)
    ahead = spans.t_in[spans.t_in >= 0]
    np.testing.assert_allclose(found.t[found.entering | found.sheet], ahead)


@ENGINES
def test_spans_have_labels(engine: Any) -> None:
    scene = pcsg.loads(
        "label(1) sphere | label(2) move(1,0,0) sphere | label(5) move(-9,0,0) halfspace",
        engine=engine,
    )
    spans = scene.spans([0, 0, 0.0], [1, 0, 0.0])
    assert spans.t_in.shape == spans.label_in.shape == spans.leaf_out.shape
    inside = [(a, b) for a, b in zip(spans.label_in, spans.label_out, strict=True)]
    assert (1, 2) in inside or inside == [(5, 5)]


def test_many_crossings_of_few_rays() -> None:
    scene = pcsg.loads(
        "{n=400} A\nA if(n>0,2,1)\n1: A -> empty\n2: A -> sphere | {n=n-1} move(3,0,0) A"
    )
    found = scene.intersect_all([[-5, 0, 0]] * 40, [1, 0, 0])
    assert found.offsets.tolist() == list(range(0, 32001, 800))
    assert (np.diff(found.t[:800]) > 0).all()
    assert len(scene.intersect_all(np.zeros((0, 3)), np.zeros((0, 3)))) == 0


def test_wrong_rays() -> None:
    scene = pcsg.loads("sphere")
    with pytest.raises(UsageError):
        scene.intersect_all([0, 0, math.nan], [0, 0, 1])
    with pytest.raises(UsageError):
        scene.intersect_all([0, 0, 1], [0, 0, 0])
