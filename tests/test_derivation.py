"""What a ray met knows how the grammar derives it."""

from __future__ import annotations

import pytest

import pcsg
from pcsg.errors import UsageError

STAND = """{n = 30} STAND
STAND if(n <= 0, 1, 2)
1: STAND -> TREE
2: STAND -> {n = n - 1} (STAND | move(4 * 2^n, 0, 0) STAND)
TREE 1
1: TREE -> cylinder | {size = 0.5} move(0, 0, 2) SHOOT
SHOOT 1
1: SHOOT -> uscale(size) sphere
"""


def test_a_hit_among_a_billion_trees_tells_its_rules() -> None:
    scene = pcsg.loads(STAND)
    hits = scene.intersect([[4 * 12_345, 0, 9], [4 * 12_345, 0.9, 9], [2, 0, 9]], [[0, 0, -1]])
    assert hits.mask.tolist() == [True, True, False]
    found = scene.derivation(hits, 0)
    assert found is not None
    assert [name for name, _ in found.path] == ["STAND"] * 31 + ["TREE", "SHOOT"]
    assert found.path[30] == ("STAND", 1)
    assert found.values["size"] == 0.5
    trunk = scene.derivation(hits, 1)
    assert trunk is not None and trunk.path[-1] == ("TREE", 1)
    assert scene.derivation(hits, 2) is None
    with pytest.raises(UsageError):
        scene.derivation(hits, 3)


def test_a_periodic_hit_is_one_of_the_scene_s_own() -> None:
    scene = pcsg.loads("A\nA 1\n1: A -> move(0.5, 0.5, 0) uscale(0.4) sphere")
    hits = scene.intersect([[70.5, -3.5, 9]], [[0, 0, -1]], periodic=(0, 0, 1, 1))
    found = scene.derivation(hits, 0)
    assert found is not None and found.path == (("A", 1),)
