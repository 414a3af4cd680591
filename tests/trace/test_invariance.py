"""Answers do not depend on the size of a scene, on the length of directions, or on where all is."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
import oracle
import pytest
from agreement import make_suspended
from hypothesis import given, settings
from hypothesis import strategies as st

import pcsg
from pcsg import Scene
from pcsg.grammar import load_text
from pcsg.graph.graph import Graph

Floats = Any

CUBES = 0.3333333333
"""A third, as one writes it: what should coincide does so to ten digits."""

SCENES = {
    "primitives": r"""{} SIZE (box \ uscale(1.2) sphere | move(3,0,0) rotx(20) cylinder
        | move(0,3,0) cone(0.3) | move(0,0,3) torus(0.3) | move(-3,0,0) tetrahedron
        | move(0,-3,0) tri1 | move(0,-3,1) rotx(40) tri2)""",
    "operations": r"""{n = 3} SIZE A
        A if(n > 0, 2, 1)
        1: A -> cylinder | sphere
        2: A -> {} ((rotx(30) box & rotz(45) uscale(0.9) {n = n-1} A) | (box \ rotx(30) box))""",
    "wide": r"""{} SIZE ((A \ box) | """
    + " | ".join(f"move({x},{y},0) uscale(0.4) sphere" for x in range(-2, 3) for y in range(-2, 3))
    + """)
        1: A -> move(0,0,0.5) cylinder | uscale(1.3) sphere""",
    "sponge": r"""{c = 3} SIZE (box \ M)
        M if(c > 0, 2, 1)
        1: M -> empty
        2: M -> {c = c-1} (scale(T,T,2) box | scale(T,2,T) box | scale(2,T,T) box
          | move(U,U,U) uscale(T) M | move(-U,U,U) uscale(T) M | move(U,-U,U) uscale(T) M
          | move(U,U,-U) uscale(T) M)""".replace("T", repr(CUBES)).replace("U", repr(2 * CUBES)),
    "sierpinski": """{c = 6} SIZE S
        S if(c > 0, 2, 1)
        1: S -> tetrahedron
        2: S -> {c = c-1} (move(0.5,0.5,0.5) uscale(0.5) S | move(-0.5,-0.5,0.5) uscale(0.5) S
          | move(0.5,-0.5,-0.5) uscale(0.5) S | move(-0.5,0.5,-0.5) uscale(0.5) S)""",
    "blob": r"""{} SIZE (blob { point(1.5) + move(1,0,0) segment(1,0.4) } \ move(1,0,0) sphere
        | uscale(0.3) box)""",
}
SUSPENDED = ("operations", "sponge", "sierpinski")
"""Those whose states are suspended, too."""

POWERS = (-60, -33, -1, 24, 60)


class Rays(NamedTuple):
    """Some of everything: from afar, from inside, on surfaces, along axes and over corners."""

    origins: Floats
    directions: Floats


def some_rays(seed: int = 0, n: int = 60) -> Rays:
    rng = np.random.default_rng(seed)
    afar = rng.normal(size=(n, 3)) * 6.0
    inside = rng.normal(size=(n, 3)) * 0.8
    lattice = rng.integers(-2, 3, (n, 3)) * 0.5
    origins = np.concatenate([afar, inside, lattice, lattice, 2000.0 * afar])
    directions = rng.normal(size=(5 * n, 3)) * 1.5 - origins
    directions[n : 2 * n] = rng.normal(size=(n, 3))
    directions[2 * n : 4 * n] = rng.integers(-1, 2, (2 * n, 3))
    directions[~directions.any(axis=1)] = (0.0, 1.0, 0.0)
    unit = rng.random(5 * n) < 0.5
    directions[unit] /= np.linalg.norm(directions[unit], axis=1)[:, None]
    return Rays(origins, directions)


RAYS = some_rays()


def graph_of(name: str, size: float) -> Graph:
    return load_text(SCENES[name].replace("SIZE", f"uscale({size!r})"))


def tracers(name: str, size: float) -> dict[str, Any]:
    """Return what answers, by the name of the engine."""
    made: dict[str, Any] = {
        engine: Scene(graph_of(name, size), engine=engine) for engine in ("states", "cyclic")
    }
    if name in SUSPENDED:
        made["suspended"] = make_suspended(graph_of(name, size), block_memory=50_000)
    return made


def answers(tracer: Any, rays: Rays, *limits: float) -> list[Floats]:
    """Return all that is asked: lengths first, then what has none."""
    o, d = rays
    hits = tracer.intersect(o, d, *limits)
    spans = tracer.spans(o, d)
    return [
        hits.t, spans.t_in, spans.t_out, hits.position,
        hits.leaf, hits.normal, hits.uv, spans.offsets,
        tracer.occluded(o, d, *limits), tracer.contains(o),
    ]  # fmt: skip


def compare(found: list[Floats], expected: list[Floats], t: float, length: float) -> None:
    """Require the same bits, but for powers of two."""
    factors = (t, t, t, length, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    for k, (a, b, factor) in enumerate(zip(found, expected, factors, strict=True)):
        np.testing.assert_array_equal(a, b if factor == 1.0 else b * factor, err_msg=f"answer {k}")


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_of_another_size_has_the_same_answers_in_every_bit(name: str) -> None:
    once = {engine: answers(tracer, RAYS) for engine, tracer in tracers(name, 1.0).items()}
    assert all(0.15 < np.isfinite(found[0]).mean() < 0.95 for found in once.values())
    for k in POWERS:
        size = 2.0**k
        grown = RAYS.origins * size
        for engine, tracer in tracers(name, size).items():
            compare(answers(tracer, Rays(grown, RAYS.directions * size)), once[engine], 1.0, size)
            compare(answers(tracer, Rays(grown, RAYS.directions)), once[engine], size, size)


@pytest.mark.parametrize("name", SCENES)
def test_directions_of_another_length_have_the_same_answers_in_every_bit(name: str) -> None:
    for tracer in tracers(name, 1.0).values():
        once, limited = answers(tracer, RAYS), answers(tracer, RAYS, 0.5, 3.0)
        for k in (*POWERS, 40):
            longer, shrunk = Rays(RAYS.origins, RAYS.directions * 2.0**k), 2.0**-k
            compare(answers(tracer, longer), once, shrunk, 1.0)
            compare(answers(tracer, longer, 0.5 * shrunk, 3.0 * shrunk), limited, shrunk, 1.0)


@pytest.mark.parametrize("name", [n for n in SCENES if n != "blob"])
@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e9])
def test_engines_and_oracle_agree_at_any_size(name: str, size: float) -> None:
    graph = graph_of(name, size)
    rng = np.random.default_rng(3)
    o = rng.normal(size=(300, 3)) * 3.0
    d = rng.normal(size=(300, 3)) - o
    d /= np.linalg.norm(d, axis=1)[:, None]
    o *= size
    found = {engine: tracer.intersect(o, d) for engine, tracer in tracers(name, size).items()}
    mask = found["cyclic"].mask
    assert mask.mean() > 0.15
    for hits in found.values():
        assert (hits.mask == mask).all()
        np.testing.assert_allclose(hits.t[mask], found["cyclic"].t[mask], rtol=1e-9)
    for k in range(25 if name != "sierpinski" else 0):
        expected = oracle.first(graph, o[k], d[k])
        t = math.inf if expected is None else expected.t
        assert found["states"].t[k] == pytest.approx(t, rel=1e-9)


def corner(order: int, size: float) -> str:
    """Sierpinski's tetrahedron of side 2 sqrt(2), with a corner at the world's origin."""
    return f"""{{c = {order}}} uscale({size!r}) S
        S if(c > 0, 2, 1)
        1: S -> move(-1,-1,-1) tetrahedron
        2: S -> {{c = c-1}} (uscale(0.5) S | move(-1,-1,0) uscale(0.5) S
          | move(0,-1,-1) uscale(0.5) S | move(-1,0,-1) uscale(0.5) S)"""


@pytest.mark.parametrize("k", [10, 52, 100])
@pytest.mark.parametrize("engine", ["states", "cyclic"])
def test_a_zoom_shows_the_same_however_deep(engine: Any, k: int) -> None:
    rng = np.random.default_rng(8)
    o, d = rng.uniform(-2.0, 0.0, (200, 3)), rng.normal(size=(200, 3))
    d[:60] = np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 10, axis=0)
    whole = pcsg.loads(corner(12, 1.0), engine=engine).intersect(o, d)
    # What is 2^k times as large, and what is as large, seen from 2^k times as near.
    large = pcsg.loads(corner(12 + k, 2.0**k), engine=engine).intersect(o, d)
    small = pcsg.loads(corner(12 + k, 1.0), engine=engine).intersect(o * 2.0**-k, d)
    seen = whole.mask
    assert 0.1 < seen.mean() < 0.95
    np.testing.assert_array_equal(large.t[seen], whole.t[seen])
    np.testing.assert_array_equal(large.normal[seen], whole.normal[seen])
    np.testing.assert_array_equal(small.t, large.t * 2.0**-k)
    np.testing.assert_array_equal(small.normal, large.normal)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("far", [1e3, 1e6, 1e9])
def test_rays_from_far_away_see_what_rays_from_nearby_see(name: str, far: float) -> None:
    rng = np.random.default_rng(9)
    o = rng.normal(size=(300, 3))
    o *= 12.0 / np.linalg.norm(o, axis=1)[:, None]
    d = rng.normal(size=(300, 3)) - o
    d /= np.linalg.norm(d, axis=1)[:, None]
    # Moved back by as much as leaves the line where it is, but for rounding.
    for tracer in tracers(name, 1.0).values():
        near, away = tracer.intersect(o, d), tracer.intersect(o - far * d, d)
        same = near.leaf == away.leaf
        assert same.mean() >= (1.0 if far < 1e8 else 0.98)
        mask = same & near.mask
        error = np.abs(away.t[mask] - far - near.t[mask])
        assert np.quantile(error, 0.97) <= 1e-12 * far + 1e-9


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_far_from_the_origin_is_cut_as_one_at_the_origin(name: str) -> None:
    rng = np.random.default_rng(10)
    o = rng.normal(size=(300, 3)) * 3.0
    d = rng.normal(size=(300, 3)) - o
    shift = np.array([2.0**20, -(2.0**21), 2.0**20])
    o = np.round(o * 2.0**20) / 2.0**20
    moved = SCENES[name].replace("SIZE", "move(1048576,-2097152,1048576)")
    for engine in ("states", "cyclic"):
        here = pcsg.loads(SCENES[name].replace("SIZE", "uscale(1)"), engine=engine).intersect(o, d)
        there = pcsg.loads(moved, engine=engine).intersect(o + shift, d)
        assert (here.leaf == there.leaf).mean() >= 0.99
        mask = here.mask & there.mask
        error = np.abs(here.t[mask] - there.t[mask])
        assert np.quantile(error, 0.97) <= 1e-8


AXES = list(itertools.permutations(range(3)))


@pytest.mark.parametrize("axes", AXES[1:], ids=str)
def test_axes_may_be_exchanged(axes: tuple[int, ...]) -> None:
    """Boxes and planes along the axes, whose arithmetic treats every axis alike."""
    rows = np.eye(3)[list(axes)]
    m = ",".join(f"{x:g}" for row in rows for x in (*row, 0.0))
    text = r"{} SIZE (box \ scale(0.5,0.7,2) box | move(0,0,0.5) scale(0.2,3,0.2) box)"
    turned = text.replace("SIZE", f"matrix({m})")
    o, d = RAYS
    for engine in ("states", "cyclic"):
        plain = pcsg.loads(text.replace("SIZE ", ""), engine=engine).intersect(o, d)
        other = pcsg.loads(turned, engine=engine).intersect(o @ rows.T, d @ rows.T)
        np.testing.assert_array_equal(other.t, plain.t)
        np.testing.assert_array_equal(other.leaf >= 0, plain.leaf >= 0)


CORNERS = [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)]


def test_meshes_of_another_size_have_the_same_answers() -> None:
    def made(size: float, engine: Any) -> Scene:
        solid = pcsg.mesh(CORNERS, [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
        return Scene(pcsg.uscale(size) * (solid - pcsg.uscale(0.6) * pcsg.sphere()), engine=engine)

    for engine in ("states", "cyclic"):
        once = answers(made(1.0, engine), RAYS)
        for k in POWERS:
            rays = Rays(RAYS.origins * 2.0**k, RAYS.directions)
            compare(answers(made(2.0**k, engine), rays), once, 2.0**k, 2.0**k)


@settings(max_examples=20)
@given(k=st.integers(-60, 60), direction=st.integers(-60, 60), seed=st.integers(0, 10**6))
def test_any_power_of_two(k: int, direction: int, seed: int) -> None:
    rays = some_rays(seed, 20)
    there = Rays(rays.origins * 2.0**k, rays.directions * 2.0**direction)
    for engine, tracer in tracers("operations", 2.0**k).items():
        once = answers(_ONCE[engine], rays)
        compare(answers(tracer, there), once, 2.0 ** (k - direction), 2.0**k)


_ONCE = tracers("operations", 1.0)
