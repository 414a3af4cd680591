"""Rays that touch a solid in a point, and solids thinner than the tolerance: one meaning."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from agreement import ENGINES, make_suspended

import pcsg
from pcsg.grammar import load_text

TOUCHES = {
    "union": ("roty(30) tetrahedron | move(5,0,0) sphere", (-4, -1, 1), (1, 0, 0)),
    "small difference": (
        r"move(0,0,-1) roty(30) tetrahedron \ move(1,-2,-1) rotx(30) box", (-3, -1, 0), (1, 0, 0),
    ),
    "an edge": (
        r"move(1,1,0) uscale(0.5) cylinder \ move(2,1,1) rotz(90) cylinder",
        (-5.5, -2.5, 7.5), (2, 1, -2),
    ),
    "many operands": (
        r"""move(0,-1,-1) roty(30) tetrahedron
            \ (move(-2,-1,-1) cylinder & move(0,-2,2) box & move(-2,0,-1) tetrahedron
               | move(-1,0,-2) sphere & move(-2,2,0) cylinder)
            \ (move(1,2,-2) tetrahedron \ move(0,-1,2) sphere | move(-2,-1,-1) roty(45) box)""",
        (-2, 1, 0), (2, -2, 0),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TOUCHES)
def test_a_ray_that_touches_an_edge_misses_it_in_every_engine(name: str) -> None:
    text, o, d = TOUCHES[name]
    assert oracle.first(load_text(text), o, d, t_max=5.0) is None
    for engine in ("states", "cyclic"):
        scene = pcsg.loads(text, engine=engine)
        assert not np.isfinite(scene.intersect([o], [d], t_max=5.0).t[0])
        assert not scene.occluded([o], [d], t_max=5.0)[0]
        spans = scene.spans([o], [d])
        assert (spans.t_out - spans.t_in > 1e-9).all()


THIN = r"{} (A \ move(5,0,0) sphere)" + "\n1: A -> scale(1,1,SIZE) cylinder | move(0,0,-9) sphere"
SMALL = r"scale(1,1,SIZE) cylinder \ move(5,0,0) sphere | move(0,0,-9) sphere"


@pytest.mark.parametrize("text", [THIN, SMALL, SMALL.replace("| move", "| (move") + ")"])
@pytest.mark.parametrize("size", [1e-9, 1e-11, 1e-13])
def test_what_is_thinner_than_the_tolerance_is_seen_where_it_stands_alone(
    text: str, size: float
) -> None:
    text = text.replace("SIZE", repr(size))
    o = np.random.default_rng(2).uniform((-0.5, -0.5, 2.5), (0.3, 0.5, 3.5), (50, 3))
    d = np.array([0.1, 0.0, -1.0])
    tracers = [pcsg.loads(text, engine=engine) for engine in ("states", "cyclic")]
    if "A ->" in text:
        tracers.append(make_suspended(load_text(text)))
    for tracer in tracers:
        np.testing.assert_allclose(
            tracer.intersect(o, d).t, o[:, 2] - size, rtol=1e-12, err_msg=str(tracer)
        )
        assert tracer.occluded(o, d, t_max=5.0).all()
    assert oracle.first(load_text(text), o[0], d).t == pytest.approx(o[0, 2] - size)


@pytest.mark.parametrize("engine", ["states", "cyclic"])
def test_engines_agree_on_a_lattice_of_rays(engine: str) -> None:
    """Corners and edges of turned solids, met exactly but for rounding."""
    text = r"""{} ((roty(30) tetrahedron \ move(1,-2,-1) rotx(30) box)
        | move(3,0,0) (rotz(45) box & rotx(90) uscale(1.5) tetrahedron)
        | move(0,3,0) (rotx(45) box \ move(1,0,0) roty(30) cylinder))"""
    rng = np.random.default_rng(7)
    o = rng.integers(-8, 9, (20_000, 3)) * 0.5
    d = rng.integers(-2, 3, (20_000, 3)).astype(float)
    d[~d.any(axis=1)] = (1.0, 0.0, 0.0)
    scene = pcsg.loads(text, engine=engine)
    found = scene.intersect(o, d)
    assert (scene.occluded(o, d) == found.mask).all()
    spans = scene.spans(o, d)
    # Some are tangents of curved faces; none is what rounding makes of a corner.
    assert (spans.t_out - spans.t_in > 1e-12).all()
    rays = np.repeat(np.arange(len(o)), np.diff(spans.offsets))
    first = np.full(len(o), np.inf)
    ends = np.concatenate([spans.t_in, spans.t_out])
    both = np.concatenate([rays, rays])
    np.minimum.at(first, both[ends >= 0.0], ends[ends >= 0.0])
    # Where a ray starts on a face, or runs along one, rounding may decide.
    wrong = ~np.isclose(found.t, first, rtol=1e-9, atol=1e-9)
    assert (wrong & (np.abs(first) > 1e-9) & (np.abs(found.t) > 1e-9)).sum() <= 4


SHEET = "move(-2,-2,1) uscale(5) tri1"
STACKED = "cylinder | move(0,0,1) cylinder"


@pytest.mark.parametrize("text", [f"{SHEET} | {STACKED}", f"{STACKED} | {SHEET}"])
@pytest.mark.parametrize("engine", ENGINES)
def test_of_a_sheet_between_two_solids_the_text_tells_whether_it_is_seen_from_within(
    text: str, engine: str
) -> None:
    o, d = (0.1, 0.2, 0.5), (0.02, 0.03, 1.0)
    expected = oracle.first(load_text(text), o, d)
    assert expected is not None
    tracer = ENGINES[engine](load_text(text))
    hits = tracer.intersect([o], [d])
    assert (hits.t[0], hits.leaf[0]) == (expected.t, expected.leaf)


@pytest.mark.parametrize("sheet_first", [True, False])
@pytest.mark.parametrize("engine", ENGINES)
def test_a_union_with_what_is_not_met_leaves_the_order_of_what_coincides(
    sheet_first: bool, engine: str
) -> None:
    sheet, solid = "move(-2,-2,0) uscale(5) tri1", "cylinder"
    pair = f"{sheet} | {solid}" if sheet_first else f"{solid} | {sheet}"
    o, d = (0.1, 0.2, -3.0), (0.02, 0.03, 1.0)
    events = {}
    for rest in ("", " | move(9,9,9) sphere"):
        graph = load_text(pair + rest)
        events[rest] = [(e.t, e.kind) for e in oracle.events(graph, o, d)]
        first = oracle.first(graph, o, d)
        hits = ENGINES[engine](graph).intersect([o], [d])
        assert first is not None
        assert hits.leaf[0] == first.leaf
    assert events[""] == events[" | move(9,9,9) sphere"]
    assert [kind for _, kind in events[""][:2]] == ["sheet", "enter"][:: 1 if sheet_first else -1]
