"""Blobs in grammars: the fields that they derive, rays through them in both engines."""

from __future__ import annotations

import numpy as np
import pytest

import pcsg
from pcsg import Scene, blob
from pcsg import blobtree as b
from pcsg.blobtree.model import Model
from pcsg.errors import GrammarError

AT = np.eye(3, 4)


def moved(x: float, y: float, z: float, child: b.Field) -> b.Field:
    m = AT.copy()
    m[:, 3] = x, y, z
    return b.place(m, child)


POINTS = np.random.default_rng(0).uniform(-1.5, 2.5, (3000, 3))

CASES: dict[str, tuple[str, b.Field]] = {
    "precedence": (
        "point(1) + move(1,0,0) point(1) & point(2) | move(0,0,1) segment(1,0.3)",
        b.union(
            b.point(1) + b.intersect(moved(1, 0, 0, b.point(1)), b.point(2)),
            moved(0, 0, 1, b.segment(1, 0.3)),
        ),
    ),
    "difference": (r"cone(1,0.5,0.3) \ point(0.4)", b.cone(1, 0.5, 0.3) - b.point(0.4)),
    "unary": (
        "disc(1,0.2) + weight(-0.5) move(0.5,0,0) bend(30) segment(1,0.2)",
        b.disc(1, 0.2) + b.weight(-0.5, moved(0.5, 0, 0, b.bend(30, b.segment(1, 0.2)))),
    ),
    "braces": (
        "gbb { point(0.8) } { pcm(0.3, 0.05) { point(1) , move(1,0,0) point(1) } }"
        " { ricci(2) { point(1) , move(1,0,0) point(1) } }",
        b.gbb(
            b.point(0.8),
            b.pcm(b.point(1), moved(1, 0, 0, b.point(1)), w=0.3, a0=0.05),
            b.ricci(2, b.point(1), moved(1, 0, 0, b.point(1))),
        ),
    ),
    "others": (
        "controlled { point(1) , move(1,0,0) point(0.6) } + twist(20) taper(1,0.5) box(1,1,1,0.1)",
        b.controlled(b.point(1), moved(1, 0, 0, b.point(0.6)))
        + b.twist(20, b.taper(1, 0.5, b.box(1, 1, 1, 0.1))),
    ),
    "convolution": ("convolution(1.5, 0.4, 0.2)", b.convolution_segment(1.5, 0.4, 0.2)),
}


@pytest.mark.parametrize("name", CASES)
def test_a_blob_is_the_field_that_python_builds(name: str) -> None:
    text, field = CASES[name]
    scene = pcsg.loads(f"{{}} blob {{ {text} }}")
    expected = Model(field).contains(POINTS)
    assert expected.any() and not expected.all()
    np.testing.assert_array_equal(scene.contains(POINTS), expected)


def test_modules_recurse_and_parameters_come_from_outside() -> None:
    text = """{n = 3; r = 0.4} blob { A }
    A if(n > 0, 2, 1)
    1: A -> point(r)
    2: A -> point(r) + move(0.7,0,0) {n = n-1; r = 0.9*r} A
    """
    parts = [moved(0.7 * k, 0, 0, b.point(0.4 * 0.9**k)) for k in range(4)]
    np.testing.assert_array_equal(
        pcsg.loads(text).contains(POINTS), Model(b.total(*parts)).contains(POINTS)
    )
    fewer = pcsg.loads(text, n=1.0)
    np.testing.assert_array_equal(
        fewer.contains(POINTS), Model(b.total(*parts[:2])).contains(POINTS)
    )


def test_attributed_modules_and_definitions() -> None:
    text = """{} blob { knob + A(2) }
    knob = point(0.5)
    a: A(c) : c > 0 -> move(0,0,0.8) (knob + A(c-1))
    b: A(c) : else -> knob
    """
    parts = [moved(0, 0, z, b.point(0.5)) for z in (0.0, 0.8, 1.6, 1.6)]
    np.testing.assert_array_equal(
        pcsg.loads(text).contains(POINTS), Model(b.total(*parts)).contains(POINTS)
    )


@pytest.mark.parametrize("engine", ["cyclic", "states"])
def test_blobs_are_cut_instanced_and_labelled(engine: str) -> None:
    text = r"""{n = 2} label(7) (R \ move(0,0,-3) scale(9,9,3) box)
    R if(n > 0, 2, 1)
    1: R -> blob { label(3) pcm { cone(1,0.5,0.4) , move(0.6,0,0) cone(1,0.5,0.4) } }
    2: R -> {n = n-1} (move(-1.4,0,0) R | move(1.4,0,0) R)
    """
    scene = pcsg.loads(text, engine=engine)
    model = Model(b.pcm(b.cone(1, 0.5, 0.4), moved(0.6, 0, 0, b.cone(1, 0.5, 0.4))))
    rng = np.random.default_rng(1)
    o = rng.uniform([-4, -4, 2], [4, 4, 10], (400, 3))
    d = rng.uniform([-4, -1, -0.5], [4, 1, 1.5], (400, 3)) - o
    hits = scene.intersect(o, d)
    expected = np.full(400, np.inf)
    for x in (-2.8, 0.0, 2.8):
        for _ in range(2 if x == 0.0 else 1):
            expected = np.minimum(expected, model.intersect(o - [x, 0, 0], d))
    z = o[:, 2] + np.where(np.isfinite(expected), expected, 0.0) * d[:, 2]
    above = np.isfinite(expected) & (z > 0.0)
    np.testing.assert_allclose(hits.t[above], expected[above], rtol=1e-9)
    assert above.sum() > 50
    # The innermost label wins, as everywhere.
    assert set(hits.label[above]) == {3}
    counts = np.diff(scene.spans(o, d).offsets)
    assert counts[above].min() >= 1


def test_normals_point_outwards_and_uv_are_finite() -> None:
    scene = Scene(blob(b.cone(1, 0.5, 0.3)))
    hits = scene.intersect([[-3, 0.1, 0.5], [0, 0, 4]], [[1, 0, 0], [0, 0, -1]])
    assert hits.normal[0, 0] < -0.9 and hits.normal[1, 2] > 0.99
    assert np.isfinite(hits.uv).all()


def test_faults_of_a_blob_tell_their_line() -> None:
    with pytest.raises(GrammarError, match="line 2"):
        pcsg.loads("{r = -1} A\n1: A -> blob { point(r) }")
    with pytest.raises(GrammarError, match="recurses"):
        pcsg.loads("{} blob { A }\nA 1\n1: A -> point(1) + move(1,0,0) A")
    with pytest.raises(GrammarError, match="too much"):
        pcsg.loads("{} blob { bend(120) segment(0.2, 0.3) }")


def test_names_of_fields_are_ordinary_names_elsewhere() -> None:
    scene = pcsg.loads("{segment = 2; bend = 1} point\npoint = uscale(segment*bend) sphere")
    np.testing.assert_allclose(scene.bounds, [[-2] * 3, [2] * 3])
