"""Rays through implicit models: a tree of 181,692 cones, and roots against the formulas."""

from __future__ import annotations

import heapq
import math
import random
import sys
import tempfile
import time
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks import povray
from benchmarks.report import Effort, Row, Subject, measure_command
from pcsg.blobtree.fields import REACH
from pcsg.blobtree.model import Model
from pcsg.blobtree.nodes import Cones
from pcsg.blobtree.tree import Junctions, grow
from pcsg.blobtree.turtle import Skeleton

CONES = 181_692
"""Of the papers' poplar of 27 years, which has 22,220 operators."""


def fork_tree(count: int, seed: int = 1) -> Skeleton:
    """Return a skeleton that forks again and again, thickest limbs first."""
    draw = random.Random(seed)
    rows: list[tuple[np.ndarray, np.ndarray, float, float, int, bool]] = []
    up = np.array([0.0, 0.0, 1.0])
    heap: list[tuple[float, int, np.ndarray, np.ndarray, int, float]] = [
        (-1.0, 0, np.zeros(3), up, -1, 0.0)
    ]
    ticket = 1
    while len(rows) < count:
        r, _, p, n, parent, phi = heapq.heappop(heap)
        rb = -r
        for k in range(min(draw.randint(1, 5), count - len(rows))):
            rt = rb * draw.uniform(0.985, 1.0)
            length = 2.9 * draw.uniform(0.85, 1.2) * rb**0.75
            end = p + length * n
            rows.append((p, end, rb, rt, parent, k == 0))
            parent, p, rb = len(rows) - 1, end, rt
            n = n + 0.1 * np.array([draw.gauss(0, 1) for _ in range(3)]) + 0.015 * up
            n /= np.linalg.norm(n)
        side = np.cross(n, [1.0, 0.0, 0.0] if abs(n[0]) < 0.8 else [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        other, share = np.cross(n, side), draw.uniform(0.5, 0.85)
        phi += math.radians(137.5)
        for f, turn in ((share, math.pi), (1.0 - share, 0.0)):
            angle = math.radians(draw.uniform(35, 65)) * (1.0 - f) * 1.4
            across = math.cos(phi + turn) * side + math.sin(phi + turn) * other
            q = math.cos(angle) * n + math.sin(angle) * across
            heapq.heappush(heap, (-rb * f ** (1 / 2.7), ticket, p, q, parent, phi))
            ticket += 1
    return Skeleton(
        np.array([x[0] for x in rows]),
        np.array([x[1] for x in rows]),
        np.array([x[2] for x in rows]),
        np.array([x[3] for x in rows]),
        np.array([x[4] for x in rows], np.int64),
        np.array([x[5] for x in rows]),
        np.zeros(len(rows), np.int64),
    )


def frame(model: Model, zoom: float) -> tuple[np.ndarray, float]:
    """Return the middle and the width of a picture."""
    low, high = model.support
    centre, width = 0.5 * (low + high), float((high - low).max()) / zoom
    if zoom > 1.0:
        centre[2] += 0.2 * (high[2] - low[2])
    return centre, width


def picture(model: Model, size: int, zoom: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rays of a picture from the side, of the whole or of a part of the crown."""
    low = model.support[0]
    centre, width = frame(model, zoom)
    s = (np.arange(size) + 0.5) / size - 0.5
    x, z = np.meshgrid(s * width, s * width)
    o = np.stack([x.ravel(), np.full(x.size, -2.0 * width), z.ravel()], axis=1) + centre
    o[:, 1] = low[1] - width
    return o, np.tile([0.0, 1.0, 0.0], (x.size, 1))


def shortened(s: Skeleton) -> Skeleton:
    """Return internodes that end 1.75 radii before the next one, so that their sum is no lump."""
    length = np.linalg.norm(s.end - s.start, axis=1)
    cut = np.zeros(len(length))
    borne = s.parent >= 0
    np.maximum.at(cut, s.parent[borne], 1.75 * s.base[borne])
    share = 1.0 - np.minimum(cut / length, 0.95)
    return s._replace(end=s.start + share[:, None] * (s.end - s.start))


def cylinders(skeleton: Skeleton) -> Model:
    """Return the sum of plain cylinders that `write_blob` writes, too."""
    axis = skeleton.end - skeleton.start
    return Model(Cones(skeleton.start, axis, 0.0 * skeleton.base, REACH * skeleton.base))


def _triple(p: np.ndarray) -> str:
    return "<" + ",".join(f"{x:.9g}" for x in p.tolist()) + ">"


def camera(model: Model, zoom: float) -> str:
    """Return the frame of `picture` for POV-Ray, and a material without light."""
    centre, width = frame(model, zoom)
    low = model.support[0]
    eye = np.array([centre[0], low[1] - width, centre[2]])
    return (
        "#version 3.7;\nglobal_settings { assumed_gamma 1 }\n"
        f"camera {{ orthographic location {_triple(eye)} direction y "
        f"right -x*{width:.9g} up z*{width:.9g} }}\n"
        "#default { finish { ambient 0 diffuse 0 emission 1 } pigment { color rgb 1 } }\n"
    )


def write_blob(skeleton: Skeleton) -> str:
    """Return POV-Ray's blob of plain cylinders: strength (1 - d^2 / R^2)^2, its own threshold."""
    # A lone cylinder keeps its radius: (1 - r^2 / R^2)^2 = 1/2.
    reach = 1.0 / math.sqrt(1.0 - math.sqrt(0.5))
    rows = [
        f"cylinder {{ {_triple(a)}, {_triple(b)}, {reach * r:.9g}, 1 }}"
        for a, b, r in zip(skeleton.start, skeleton.end, skeleton.base.tolist(), strict=True)
    ]
    return "blob { threshold 0.5\n" + "\n".join(rows) + "\n}\n"


CAPSULES = (
    ((0.0, 0.0, 0.0), (0.0, 0.0, 2.0), 0.4),
    ((0.0, 0.0, 2.0), (1.0, 0.3, 3.4), 0.3),
    ((0.0, 0.0, 2.0), (-0.9, 0.2, 3.5), 0.35),
)
"""Ends and radii: the sum of three fields."""


def capsules() -> Model:
    ends = np.array([[a, b] for a, b, _ in CAPSULES])
    radius = np.array([r for _, _, r in CAPSULES])
    return Model(Cones(ends[:, 0], ends[:, 1] - ends[:, 0], 0.0 * radius, REACH * radius))


def write_isosurface(model: Model) -> str:
    """Return the same field as an isosurface; its gradient's bound is the greatest slope's."""
    terms, slope = [], 0.0
    for a, b, r in CAPSULES:
        e = np.subtract(b, a)
        s = "+".join(
            f"(({c:.9g})*({axis}-({o:.9g})))"
            for c, axis, o in zip(e / (e @ e), "xyz", a, strict=True)
        )
        s = f"max(0,min(1,{s}))"
        d2 = "+".join(
            f"pow({axis}-({o:.9g})-({c:.9g})*{s},2)" for axis, o, c in zip("xyz", a, e, strict=True)
        )
        terms.append(f"pow(max(0,1-({d2})/{(REACH * r) ** 2:.9g}),3)")
        slope += 1.717 / (REACH * r)
    low, high = model.support
    return (
        f"isosurface {{ function {{ 0.5-({'+'.join(terms)}) }} contained_by {{ box "
        f"{{ {_triple(low)}, {_triple(high)} }} }} max_gradient {slope:.4g} accuracy 1e-5 }}\n"
    )


def pov_seconds(text: str, model: Model, zoom: float, size: int) -> float:
    """Return processor seconds for primary rays: less those of a picture of one pixel's side.

    Reading the scene takes most of both, so the least of three is taken of each.
    """
    scene = camera(model, zoom) + text
    whole, read = (min(povray.run(scene, n)["seconds"] for _ in range(3)) for n in (size, 2))
    return whole - read


def seconds_of(ask: Callable[..., object], *rays: np.ndarray) -> float:
    """Return processor seconds, the least of three."""
    times = []
    for _ in range(3):
        started = time.process_time()
        ask(*rays)
        times.append(time.process_time() - started)
    return min(times)


def rows(effort: Effort) -> Iterator[Row]:
    count = 300 if effort.tiny else CONES
    size = 32 if effort.tiny else 768
    skeleton = fork_tree(count)
    started = time.process_time()
    model = Model(grow(skeleton, Junctions(buds=False)))
    built = time.process_time() - started
    name = f"{model.primitives:,} cones, {model.operators:,} operators"
    model.intersect(*picture(model, 8, 1.0))
    model.shoot(*picture(model, 8, 1.0))
    for part, zoom in (("whole", 1.0), ("crown", 5.0)):
        rays = picture(model, size, zoom)
        first, every = (seconds_of(ask, *rays) for ask in (model.intersect, model.shoot))
        what = f"{name}, {part}, {size}x{size}: all over first"
        yield Row(what, (first, every, None), every / first, 1.5, at_most=True)
    if povray.is_there():
        yield from _beside_povray(skeleton, size)
    each = model.nbytes / model.primitives
    yield Row("bytes of a primitive", (each, None, None), each, 100.0, at_most=True)
    yield Row("seconds to build", (built, None, None))
    if not effort.tiny:
        command = [sys.executable, "-c", "from pcsg.blobtree.native import address; address()"]
        with tempfile.TemporaryDirectory() as cache:
            _clock, compiled, _peak = measure_command(command, XDG_CACHE_HOME=cache)
        row = (compiled, None, None)
        yield Row("seconds of a process that compiles all", row, compiled, 15.0, at_most=True)


def _beside_povray(skeleton: Skeleton, size: int) -> Iterator[Row]:
    skeleton = shortened(skeleton)
    model = cylinders(skeleton)
    blob = write_blob(skeleton)
    for part, zoom in (("whole", 1.0), ("crown", 5.0)):
        theirs = pov_seconds(blob, model, zoom, size)
        first = seconds_of(model.intersect, *picture(model, size, zoom))
        what = f"{model.primitives:,} summed cylinders, {part}: POV's `blob` over ours"
        yield Row(what, (first, None, theirs), theirs / max(first, 1e-9), 1.0)
    model = capsules()
    theirs = pov_seconds(write_isosurface(model), model, 1.0, size)
    first = seconds_of(model.intersect, *picture(model, size, 1.0))
    what = "three capsules: POV's `isosurface` over ours"
    yield Row(what, (first, None, theirs), theirs / max(first, 1e-9), 20.0)


BLOBS = Subject(
    "blobs",
    "Implicit trees",
    "One thread; processor seconds for all rays of a picture.",
    ("first hit", "all crossings", "POV-Ray"),
    rows,
)
