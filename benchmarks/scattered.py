"""Scenes in which hardly any two solids are alike: scattered, cut out, written in a chain."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise

import numpy as np

from benchmarks.rays import make_rays
from benchmarks.report import Effort, Row, Subject, best_times
from benchmarks.scenes import GRAMMARS_HERE
from benchmarks.views import Floats
from pcsg.grammar import load_text
from pcsg.scene import Scene

SIZES = tuple(round(10 ** (2 + 4 * k / 19)) for k in range(20))
"""Numbers of balls, from a hundred to a million."""


def _text(name: str) -> str:
    return (GRAMMARS_HERE / f"{name}.pcsg").read_text(encoding="utf-8")


def _bites(text: str) -> Callable[[int], str]:
    def write(n: int) -> str:
        rng = np.random.default_rng(1)
        places = rng.uniform(-1.0, 1.0, (n, 3)).round(4).tolist()
        balls = [f"move({x},{y},{z}) uscale(0.02) sphere" for x, y, z in places]
        return text.format(" \\ ".join(balls), " | ".join(balls))

    return write


def _prepare(text: str, **values: float) -> tuple[Scene, float]:
    """Return a scene that has answered once, and processor seconds from its graph to the answer."""
    graph = load_text(text)
    start = time.process_time()
    scene = Scene(graph, values, threads=1)
    scene.intersect([[0.0, 0.0, 1e4]], [[0.0, 0.0, -1.0]])
    return scene, time.process_time() - start


def _rate(scene: Scene, rays: tuple[Floats, Floats], repeats: int) -> float:
    scene.intersect(rays[0][:64], rays[1][:64])
    times = best_times({"ours": partial(scene.intersect, *rays)}, repeats)
    return len(rays[0]) / times["ours"] / 1e6


def _measure(name: str, effort: Effort, text: str, **values: float) -> tuple[Row, float]:
    _prepare(text, **values)
    scene, seconds = _prepare(text, **values)
    rays = make_rays(scene, effort)
    coherent, random = (_rate(scene, rays[kind], effort.repeats) for kind in ("coherent", "random"))
    n = values.get("n", values.get("i", 0.0))
    each = scene.tracer.nbytes["blocks"] / n if n else None
    row = Row(name, (coherent, random, n / seconds / 1e6 if n else None, each))
    return row, coherent


def scattered(effort: Effort) -> Iterator[Row]:
    sizes = SIZES[:1] if effort.tiny else SIZES
    rates = []
    for n in sizes:
        row, rate = _measure(f"{n:,} balls", effort, _text("balls"), n=float(n))
        rates.append(rate)
        yield row
    if effort.tiny:
        return
    worst = max(max(a / b, b / a) for a, b in pairwise(rates))
    yield Row("the worst step from one size to the next", (None,) * 4, worst, 1.5, at_most=True)
    yield Row("1,000,000 balls, coherent", (None,) * 4, rates[-1], 1.5)
    for name, target in (("village", 1.0), ("cheese", 0.5)):
        row, rate = _measure(f"{name}, 10,000", effort, _text(name), n=10_000.0)
        yield Row(row.what, row.values, rate, target)
    _, tree = _measure("balls", effort, _text("balls"), n=10_000.0)
    row, chain = _measure("10,000 balls by a loop", effort, _text("chain"), i=10_000.0)
    yield Row(row.what + ", time over balls", row.values, tree / chain, 1.5, at_most=True)
    texts = (_bites("{{}} (box \\ {0})")(3_000), _bites("{{}} (box \\ ({1}))")(3_000))
    (row, a), (_, b) = (_measure("box less 3,000 balls, one by one", effort, t) for t in texts)
    yield Row(row.what + ", over their union", row.values, a / b, 0.8)
    yield from _questions(effort)


def _questions(effort: Effort) -> Iterator[Row]:
    """Points, and whole lines."""
    scene, _ = _prepare(_text("balls"), n=10_000.0)
    rng = np.random.default_rng(1)
    points = rng.uniform(*scene.bounds, (100_000, 3))
    ways = rng.normal(size=points.shape)
    scene.contains(points[:64])
    scene.spans(points[:64], ways[:64])
    contestants = {
        "contains": partial(scene.contains, points),
        "spans": partial(scene.spans, points, ways),
    }
    times = best_times(contestants, effort.repeats)
    for name, target in (("contains", 0.5), ("spans", 0.1)):
        rate = len(points) / times[name] / 1e6
        yield Row(f"10,000 balls, {name}", (None, rate, None, None), rate, target)


SCATTERED = Subject(
    "scattered",
    "Many solids, no two alike",
    "Millions of rays per second of processor time, one thread; millions of solids per second from"
    " the graph to the first answer; bytes of a solid. The ratio is what the row names, else"
    " millions of coherent rays per second.",
    ("coherent", "random", "prepared", "bytes"),
    scattered,
)
