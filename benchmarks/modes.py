"""The three ways to follow light, on one picture: what a ray costs with all that belongs to it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import pcsg
from benchmarks.report import Effort, Row, Subject
from pcsg.graph.shining import CENTER, COLUMNS, POWER, RADIUS
from pcsg.render.albedo import albedo_tables
from pcsg.render.bsdf import Matter, scatter_batch
from pcsg.render.emitters import Emitters
from pcsg.render.job import Job
from pcsg.render.options import Options
from pcsg.render.sampler import Sampler

GRAMMARS = Path(__file__).parents[1] / "grammars"


def rows(effort: Effort) -> Iterator[Row]:
    scene = pcsg.load(GRAMMARS / "tree.pcsg", parameters={"cnt": 3.0} if effort.tiny else {})
    size = (effort.size // 2, effort.size // 2)
    for mode in ("preview", "direct", "path"):
        best, job = np.inf, None
        for _ in range(min(effort.repeats, 2)):
            job = Job(scene, Options(size=size, samples=4, overrides={"film": {"mode": mode}}))
            job.run()
            best = min(best, job.progress.seconds)
        assert job is not None
        yield Row(f"tree, {mode}", (job.progress.rays / best / 1e6, best))
    yield Row("drawing and weighing a direction", (_scattered(effort) / 1e6, None))
    for count in (1, 64):
        yield Row(f"aiming at one of {count} shining things", (_aimed(effort, count) / 1e6, None))
    yield Row("a pair of numbers", (_numbers(effort) / 1e6, None))


def _best(work: object, effort: Effort) -> float:
    assert callable(work)
    work()
    times = []
    for _ in range(effort.repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def _scattered(effort: Effort) -> float:
    n = effort.rays
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    half = np.full(n, 0.5)
    matter = Matter(
        up, up, up, np.full((n, 3), 0.5), half, half, half, half, half, 3 * half, half > 1
    )
    pairs = np.random.default_rng(1).random((n, 2))
    room = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    tables = albedo_tables()
    return n / _best(lambda: scatter_batch(matter, tables, True, pairs, pairs, *room), effort)


def _aimed(effort: Effort, count: int) -> float:
    n, rng = effort.rays, np.random.default_rng(1)
    covers = np.zeros((count, COLUMNS))
    covers[:, CENTER] = rng.random((count, 3))
    covers[:, RADIUS], covers[:, POWER] = 0.01, 1.0
    emitters, at, pairs = Emitters(covers), rng.random((n, 3)), rng.random((n, 2))
    return n / _best(lambda: emitters.aim(at, pairs), effort)


def _numbers(effort: Effort) -> float:
    n = effort.rays
    x = np.arange(n) % 512
    sampler = Sampler((512, 512), 16, 1)
    return n / _best(lambda: sampler.pairs(x, x, x % 16, 3), effort)


MODES = Subject(
    "modes",
    "Light",
    "Million rays, or draws, a second; seconds of the picture. The modes are compared, not peers.",
    ("million/s", "seconds"),
    rows,
)
