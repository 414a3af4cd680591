"""Rays through implicit models: a tree of 181,692 cones, and roots against the formulas."""

from __future__ import annotations

import heapq
import math
import random
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.report import Effort, Row, Subject
from pcsg.blobtree.model import Model
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
        for k in range(min(draw.randint(5, 17), count - len(rows))):
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


def picture(model: Model, size: int, zoom: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rays of a picture from the side, of the whole or of a part of the crown."""
    low, high = model.support
    centre, width = 0.5 * (low + high), float((high - low).max()) / zoom
    if zoom > 1.0:
        centre[2] += 0.2 * (high[2] - low[2])
    s = (np.arange(size) + 0.5) / size - 0.5
    x, z = np.meshgrid(s * width, s * width)
    o = np.stack([x.ravel(), np.full(x.size, -2.0 * width), z.ravel()], axis=1) + centre
    o[:, 1] = low[1] - width
    return o, np.tile([0.0, 1.0, 0.0], (x.size, 1))


def rows(effort: Effort) -> Iterator[Row]:
    count = 300 if effort.tiny else CONES
    size = 32 if effort.tiny else 768
    started = time.perf_counter()
    model = Model(grow(fork_tree(count), Junctions(buds=False)))
    built = time.perf_counter() - started
    name = f"{model.primitives:,} cones, {model.operators:,} operators"
    model.intersect(*picture(model, 8, 1.0))
    model.shoot(*picture(model, 8, 1.0))
    for part, zoom in (("whole", 1.0), ("crown", 5.0)):
        o, d = picture(model, size, zoom)
        times = []
        for ask in (model.intersect, model.shoot):
            started = time.perf_counter()
            ask(o, d)
            times.append(time.perf_counter() - started)
        yield Row(
            f"{name}, {part}, seconds at {size}x{size}: all over first",
            (times[0], times[1]),
            times[1] / times[0],
            1.5,
            at_most=True,
        )
    each = model.nbytes / model.primitives
    yield Row("bytes of a primitive", (each, None), each, 100.0, at_most=True)
    yield Row("seconds to build", (built, None))


BLOBS = Subject(
    "blobs",
    "Implicit trees",
    "One thread; seconds for all rays of a picture.",
    ("first hit", "all crossings"),
    rows,
)
