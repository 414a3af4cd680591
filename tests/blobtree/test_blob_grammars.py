"""Blobs in grammars: the fields that they derive, rays through them in both engines."""

from __future__ import annotations

import numpy as np
import pytest
from blob_models import random_rays
from count_roots import some_model

import pcsg
from pcsg import Scene, blob
from pcsg import blobtree as b
from pcsg.addresses import join_address, split_address
from pcsg.blobtree.model import Model
from pcsg.blobtree.native import address
from pcsg.errors import GrammarError
from pcsg.leaf.blob import Blob, FieldSource
from pcsg.leaf.dispatch import leaf_crossings
from pcsg.leaf.registry import ALL, ANY, FIRST
from pcsg.trace.pool import ModelPool
from pcsg.vec import Ray

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


@pytest.mark.parametrize("number", [0, 1, 2, 3])
def test_the_leaf_tells_of_its_first_interval_what_the_contract_says(number: int) -> None:
    field, _model = some_model(("pcm", "bend") if number % 2 else ("gbb",), number)
    pool = ModelPool([Blob])
    args = np.array(pool.place(FieldSource(field).model(())))
    o, d = random_rays(np.random.default_rng(number), _model, 300)
    rng = np.random.default_rng(20 + number)
    out = np.zeros(400)
    covered = 0

    def cross(k: int, want: int, low: float, high: float) -> np.ndarray:
        ray = Ray(*o[k].tolist(), *d[k].tolist(), low, high)
        n = leaf_crossings(Blob.kind, ray, want, args, 0, pool.pool, out, 0)
        return out[:n].copy().reshape(-1, 2)

    for k in range(len(o)):
        every = cross(k, ALL, -np.inf, np.inf)
        if len(every) == 0:
            continue
        knots = np.sort(rng.uniform(every[0, 0] - 0.3, every[-1, 1] + 0.3, 2))
        for low, high in (knots, (every[0].mean(), every[0].mean() + 1e-3), (knots[0], np.inf)):
            if np.abs(np.subtract.outer(every.ravel(), [low, high])).min() < 1e-6:
                continue
            wanted = every[(every[:, 1] >= low) & (every[:, 0] <= high)]
            for want in (FIRST, ANY):
                found = cross(k, want, low, high)
                found = found[(found[:, 1] >= low) & (found[:, 0] <= high)]
                assert (len(found) > 0) == (len(wanted) > 0)
                if len(wanted) == 0:
                    continue
                inside, leaves = wanted[0, 0] < low, wanted[0, 1] <= high
                covered += inside and not leaves
                assert (found[0, 0] < low) == inside
                assert not inside or (found[0, 1] <= high) == leaves
                if not inside and want == FIRST:
                    assert found[0, 0] == pytest.approx(wanted[0, 0], abs=1e-9)
                if inside and leaves:
                    assert found[0, 1] == pytest.approx(wanted[0, 1], abs=1e-9)
    assert covered > 10


@pytest.mark.parametrize("order", ["sphere | {}", "{} | sphere"])
@pytest.mark.parametrize(
    "model", ["blob { point(3) }", "blob { point(3) + move(1,0,0) segment(2,1) }"]
)
def test_from_inside_a_blob_nobody_sees_what_it_hides(order: str, model: str) -> None:
    text = order.format(model)
    rng = np.random.default_rng(4)
    o, d = rng.normal(size=(3000, 3)), rng.normal(size=(3000, 3))
    scene = pcsg.loads(text, engine="cyclic")
    spans = scene.spans(o, d)
    starts, ends = spans.offsets[:-1], spans.offsets[1:]
    expected = np.full(len(o), np.inf)
    for k, (a, b_) in enumerate(zip(starts, ends, strict=True)):
        t = np.sort(np.concatenate([spans.t_in[a:b_], spans.t_out[a:b_]]))
        expected[k] = t[t >= 0.0].min(initial=np.inf)
    assert scene.contains(o).mean() > 0.5
    for engine in ("cyclic", "states"):
        scene = pcsg.loads(text, engine=engine)
        np.testing.assert_allclose(scene.intersect(o, d).t, expected, rtol=1e-9, atol=1e-9)
        assert (scene.occluded(o, d) == np.isfinite(expected)).all()


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


@pytest.mark.parametrize("where", [0x7FFF_FFFF, 0xFFFF_FFFF, 2**53 + 1, 0x7FFF_89AB_CDEF_0123])
def test_addresses_are_kept_in_every_bit(where: int) -> None:
    lower, upper = split_address(where)
    assert join_address(lower, upper) == where


def test_models_hold_the_address_among_their_integers() -> None:
    model = Blob.make_model((FieldSource(b.point(1)),), ())
    np.testing.assert_array_equal(model.data.integers[:2], split_address(address()))
    assert model.data.integers.dtype == np.int32
    assert float(address()) not in model.data.doubles
