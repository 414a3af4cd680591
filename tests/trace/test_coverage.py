"""What is smaller than a pixel: as bright, as dense, and the same in every thread."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pcsg
from pcsg.trace import tracer as trace
from pcsg.trace.coverage import BINS, Footprint, direction_bin, rays_through
from pcsg.trace.tracer import RAYS_IN_ALL, StatesTracer

GRAMMARS = Path(__file__).parents[2] / "grammars"
SIDE = 192


def view(scene: Any, direction: tuple[float, float, float]) -> tuple[Any, Any, Footprint]:
    """Return the rays of a picture that the scene fills, and their footprint."""
    middle, half = scene.bounds.mean(axis=0), np.linalg.norm(np.diff(scene.bounds, axis=0)) / 2
    forward = np.array(direction) / np.linalg.norm(direction)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    y, x = np.divmod(np.arange(SIDE * SIDE), SIDE)
    tangent = 0.3
    place = (np.stack([x, y]) + 0.5) / SIDE * 2.0 - 1.0
    directions = forward + tangent * (place[0][:, None] * right + place[1][:, None] * up)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    n = len(directions)
    origins = np.tile(middle - 3.0 * half * forward, (n, 1))
    return origins, directions, Footprint(np.zeros(n), np.full(n, 2.0 * tangent / SIDE))


def brightness(hits: Any, direction: tuple[float, float, float]) -> float:
    light = np.array([0.37, -0.55, 0.2]) - direction
    return float(np.clip(hits.normal @ light, 0.0, None).mean())


def test_deep_fractals_keep_density_and_brightness() -> None:
    scene = pcsg.load(GRAMMARS / "sierpinski.pcsg", c=18)
    tracer = scene.tracer
    assert isinstance(tracer, StatesTracer)
    ratios = []
    # The last one is near the axis along which the fractal is opaque: the hardest.
    for direction in ((0.6, -0.7, -0.4), (-0.3, 0.8, -0.5), (0.2, 0.3, 0.9)):
        origins, directions, footprint = view(scene, direction)
        whole = tracer.intersect(origins, directions)
        ended = tracer.intersect(origins, directions, footprint=footprint)
        assert 0.02 < whole.mask.mean() < 0.5
        assert (whole.t != ended.t).sum() > 0.3 * whole.mask.sum()
        density = ended.mask.mean() / whole.mask.mean()
        ratios.append((density, brightness(ended, direction) / brightness(whole, direction)))
        blocked = tracer.occluded(origins, directions, footprint=footprint)
        assert blocked.mean() == pytest.approx(ended.mask.mean(), rel=0.05)
    assert np.abs(np.array(ratios) - 1.0).max() < 0.3
    assert np.abs(np.mean(ratios, axis=0) - 1.0).max() < 0.1


def test_ends_do_not_depend_on_threads_or_order() -> None:
    found = []
    for threads in (1, 2):
        scene = pcsg.load(GRAMMARS / "sierpinski.pcsg", c=14, threads=threads)
        origins, directions, footprint = view(scene, (0.6, -0.7, -0.4))
        order = np.arange(len(origins))[:: 1 if threads == 1 else -1]
        turned = Footprint(footprint.width[order], footprint.spread[order])
        hits = scene.tracer.intersect(origins[order], directions[order], footprint=turned)  # type: ignore[call-arg]
        found.append((hits.t[order], hits.normal[order], hits.leaf[order]))
    for a, b in zip(*found, strict=True):
        assert np.array_equal(a, b)


SCATTERED = """
{a = 0; n = 3000} HALF
HALF if(n > 1, 2, 1)
1: HALF -> move(9*rand(a,1), 9*rand(a,2), 9*rand(a,3)) uscale(0.1 + 0.1*rand(a,4)) sphere
2: HALF -> {n = floor(n/2)} HALF | {a = a + floor(n/2); n = n - floor(n/2)} HALF
"""


def test_without_instances_pictures_see_everything() -> None:
    scene = pcsg.loads(SCATTERED)
    origins, directions, _ = view(scene, (0.6, -0.7, -0.4))
    wide = Footprint(np.full(len(origins), 0.5), np.zeros(len(origins)))
    whole = scene.tracer.intersect(origins, directions)
    ended = scene.tracer.intersect(origins, directions, footprint=wide)  # type: ignore[call-arg]
    assert whole.mask.any() and np.array_equal(whole.t, ended.t)
    assert isinstance(scene.tracer, StatesTracer) and scene.tracer._ends is None


def test_measuring_takes_no_more_rays_than_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    # Each of 300 kinds of clusters stands twice, and they have more leaves than are opened.
    balls = " | ".join(f"move({k},0,0) sphere" for k in range(70))
    text = "{i = 300} LOOP\nLOOP 1 + (i > 0)\n1: LOOP -> empty\n2: LOOP -> {i = i-1} (LOOP"
    text += f" | move(0,i,0) ROW | move(0,i,9) ROW)\nROW 1\n1: ROW -> uscale(0.3+0.001*i) ({balls})"
    tracer = pcsg.loads(text, threads=1).tracer
    assert isinstance(tracer, StatesTracer)
    cast: list[int] = []

    def counted(*args: Any) -> Any:
        cast.append(len(args[0]))
        return rays_of(*args)

    rays_of = trace.shape_rays
    monkeypatch.setattr(trace, "shape_rays", counted)
    assert tracer._ends is not None
    assert 0.5 * RAYS_IN_ALL < sum(cast) <= RAYS_IN_ALL


def test_fields_of_directions_are_even() -> None:
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(3_000, 3))
    u, v = rng.random((2, len(directions)))
    bins = [direction_bin(*d, a, b) for d, a, b in zip(directions, u, v, strict=True)]
    counts = np.bincount(bins, minlength=BINS)
    assert (counts > 0).mean() > 0.9 and counts.max() < 30


def test_lines_through_a_box_meet_it() -> None:
    box = np.array([-1.0, 0.0, 2.0, 0.5, 0.01, 3.0])
    origins, directions, _ = rays_through(box, 2, np.random.default_rng(1))
    with np.errstate(divide="ignore"):
        a, b = (box[:3] - origins) / directions, (box[3:] - origins) / directions
    low, high = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    assert (low <= high + 1e-9).all() and (low > 0.0).all()
