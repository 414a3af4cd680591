import numpy as np
import pytest

import pcsg
from pcsg.graph.derivation import find_derivation
from pcsg.vec import Vec3

SIERPINSKI = """
{c = 40} S
S if(c > 0, 2, 1)
1: S -> tetrahedron
2: S -> {c = c-1} ( move( 0.5,  0.5,  0.5) uscale(0.5) S | move(-0.5, -0.5,  0.5) uscale(0.5) S
                  | move( 0.5, -0.5, -0.5) uscale(0.5) S | move(-0.5,  0.5, -0.5) uscale(0.5) S )
"""


def derive(scene, origin, direction):
    hits = scene.intersect([origin], [direction])
    assert np.isfinite(hits.t[0])
    through = 1e-6 * hits.t[0] * hits.normal[0]
    found = find_derivation(
        scene.graph,
        scene.values,
        scene.boxes.boxes,
        int(hits.leaf[0]),
        Vec3(*hits.position[0]),
        Vec3(*through),
    )
    return hits, found


def test_the_same_primitive_is_found_as_among_all_of_them():
    scene = pcsg.loads(SIERPINSKI, c=4)
    (leaves,) = scene.leaves()
    rng = np.random.default_rng(1)
    origins = np.array([0.0, 0.0, 3.0]) + rng.normal(0, 0.2, (200, 3))
    targets = rng.uniform(-0.6, 0.6, (200, 3))
    hits = scene.intersect(origins, targets - origins)
    met = np.flatnonzero(np.isfinite(hits.t))[:20]
    assert len(met) == 20
    for k in met:
        found = derive(scene, origins[k], targets[k] - origins[k])[1]
        point = hits.position[k]
        own = [
            path
            for path, m in zip(leaves.path, leaves.matrix, strict=True)
            if (np.abs(np.linalg.solve(m[:, :3], point - m[:, 3])) <= 1 + 1e-6).all()
        ]
        assert found.path in own
        assert found.values == {}


def test_one_of_very_many_is_found():
    scene = pcsg.loads(SIERPINSKI)
    _, found = derive(scene, (0.9, 0.9, 3.0), (0.0, 0.0, -1.0))
    assert found.path == (*[("S", 2)] * 40, ("S", 1))


@pytest.mark.parametrize(
    ("text", "rule", "values"),
    [
        ("{n = 3} S\nS if(n > 2, 1, 2)\n1: S -> uscale(n) sphere\n2: S -> box", 1, {"n": 3.0}),
        ("{n = 3} S\n1: S -> (uscale(n) sphere \\ move(0,0,n) sphere)", 1, {"n": 3.0}),
        ("{n = 3} S\n1: S -> uscale(n) rectangle", 1, {"n": 3.0}),
    ],
    ids=["solid", "carved", "sheet"],
)
def test_rule_and_values_are_told(text, rule, values):
    _, found = derive(pcsg.loads(text), (0.1, 0.2, 9.0), (0.0, 0.0, -1.0))
    assert found.path == (("S", rule),)
    assert found.values == values


def test_a_search_without_end_is_given_up(monkeypatch):
    monkeypatch.setattr("pcsg.graph.derivation.MOST_STATES", 20)
    _, found = derive(pcsg.loads(SIERPINSKI), (0.9, 0.9, 3.0), (0.0, 0.0, -1.0))
    assert found is None
