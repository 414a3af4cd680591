"""The primitives of a scene, one by one, in batches that nobody keeps."""

from __future__ import annotations

import tracemalloc
from itertools import islice

import numpy as np
import pytest

import pcsg
from pcsg.errors import UsageError

ROW = "{n = 3} A \\ uscale(9) box\nA if(n > 0, 2, 1)\n1: A -> move(0,0,1) cone(0.5)\n" + (
    "2: A -> label(n) sphere | {n = n-1} move(4,0,0) uscale(0.5) A"
)


def test_places_labels_and_paths() -> None:
    scene = pcsg.loads(ROW)
    (found,) = scene.leaves()
    assert len(found) == 5
    assert found.name == ("sphere", "sphere", "sphere", "cone", "box")
    assert found.label.tolist() == [3, 2, 1, -1, -1]
    np.testing.assert_allclose(found.matrix[:3, 0, 3], [0, 4, 6])
    np.testing.assert_allclose(
        found.matrix[3], [[0.125, 0, 0, 7], [0, 0.125, 0, 0], [0, 0, 0.125, 0.125]]
    )
    assert found.arguments[3] == (0.5,)
    assert found.path[3] == (("A", 2), ("A", 2), ("A", 2), ("A", 1))
    assert found.path[4] == ()
    assert found.carved.all()
    assert [scene.graph.nodes[k].solid.name for k in found.leaf] == list(found.name)  # type: ignore[attr-defined]


def test_batches_are_the_same_primitives() -> None:
    scene = pcsg.load("grammars/fig5a.pcsg")
    (whole,) = scene.leaves(1_000_000)
    parts = list(scene.leaves(7))
    assert len(whole) == scene.stats()["primitives"]
    assert {len(p) for p in parts[:-1]} == {7}
    np.testing.assert_array_equal(np.concatenate([p.matrix for p in parts]), whole.matrix)


def test_billions_take_no_memory() -> None:
    scene = pcsg.load("grammars/sierpinski.pcsg", c=40)  # 4^40 solids
    batches = scene.leaves(100)
    next(batches)
    tracemalloc.start()
    for batch in islice(batches, 50):
        assert len(batch) == 100
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2_000_000


def test_a_batch_has_a_size() -> None:
    with pytest.raises(UsageError, match="batch is a whole number"):
        pcsg.loads("sphere").leaves(0)
