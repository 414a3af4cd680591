"""Scenes in which hardly any two solids are alike: scattered, cut out, written in a chain."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks import povray
from benchmarks.rays import make_rays
from benchmarks.report import Effort, Row, Subject, best_times, measure_command, ratio
from benchmarks.scenes import GRAMMARS_HERE
from benchmarks.views import Floats, look_at
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
    yield from _beside_povray(effort)
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


def _beside_povray(effort: Effort) -> Iterator[Row]:
    """The whole of two pictures, from the text on, in processor time of the whole process."""
    n = 100 if effort.tiny else 20_000
    boxes = _write_boxes(n)
    text = "{} (" + "\n | ".join(ours for ours, _ in boxes) + ")\n"
    view = look_at(np.array([[-50.0, -50.0, 0.0], [50.0, 50.0, 20.0]]))
    scene = povray.write_view(view, 4 / 3, (theirs for _, theirs in boxes))
    peer = povray.run(scene, 400, height=300, smooth=True)["seconds"] if povray.is_there() else None
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "written.pcsg", Path(folder) / "out.png"
        path.write_text(text, encoding="utf-8")
        checked = _processor("check", str(path))
        drawn = _processor(
            "render", str(path), "-q", "--size", "400x300", "--camera", view.option, "-o", str(out)
        )
    for what, seconds, target in (("checked", checked, 4.0), ("400x300 picture", drawn, 6.0)):
        values = (None, None, n / seconds / 1e6, None)
        name = f"{n:,} boxes written in a text, {what}, time over POV-Ray's"
        yield Row(name, values, ratio(seconds, peer), target, at_most=True)
    yield from _balls_beside_povray(effort)


def _balls_beside_povray(effort: Effort) -> Iterator[Row]:
    n, width = (100.0, 64) if effort.tiny else (10_000.0, 1600)
    scene = Scene(load_text(_text("balls")), {"n": n}, threads=1)
    view = look_at(scene.bounds)
    peer = None
    if povray.is_there():
        balls = (
            f"sphere {{ <{m[0, 3]:.9g},{m[1, 3]:.9g},{m[2, 3]:.9g}>, {m[0, 0]:.9g}"
            " pigment { color rgb 0.7 } }"
            for leaves in scene.leaves()
            for m in leaves.matrix
        )
        text = povray.write_view(view, 4 / 3, balls)
        peer = povray.run(text, width, height=3 * width // 4)["seconds"]
    with tempfile.TemporaryDirectory() as folder:
        # One light, as there: no light of the sky.
        path, out = Path(folder) / "balls.pcsg", Path(folder) / "out.png"
        path.write_text(_text("balls") + "\nsky { strength = 0 }\n", encoding="utf-8")
        seconds = _processor(
            *("render", str(path), "-q", f"-Dn={n}", "--samples", "1", "--mode", "direct"),
            *("--size", f"{width}x{3 * width // 4}", "--camera", view.option, "-o", str(out)),
        )
    values = (None, None, n / seconds / 1e6, None)
    name = f"{n:,.0f} balls, {width}x{3 * width // 4}, POV-Ray's time over ours"
    yield Row(name, values, ratio(peer, seconds), 2.0)


def _write_boxes(n: int) -> list[tuple[str, str]]:
    """Return coloured boxes as scripts write them, for us and for POV-Ray."""
    rng = np.random.default_rng(1)
    rows = rng.uniform(
        (0, 0, 0, -50, -50, 0, 0, 0.1, 0.1), (1, 1, 1, 50, 50, 20, 360, 1, 1), (n, 9)
    ).round(4)
    return [
        (
            f"color({r},{g},{b}) move({x},{y},{z}) rotz({a}) scale({u},{v},1) box",
            f"box {{ -1, 1 scale <{u},{v},1> rotate <0,0,{a}> translate <{x},{y},{z}>"
            f" pigment {{ color rgb <{r},{g},{b}> }} }}",
        )
        for r, g, b, x, y, z, a, u, v in rows.tolist()
    ]


def _processor(*arguments: str) -> float:
    """Return the processor seconds of a command, warm."""
    command = [sys.executable, "-m", "pcsg", *arguments]
    measure_command(command)
    return min(measure_command(command)[1] for _ in range(3))


def _questions(effort: Effort) -> Iterator[Row]:
    """Points, and whole lines."""
    for what, name in (("10,000 balls", "balls"), ("10,000 instances of a house", "houses")):
        yield from _question_rows(effort, what, name)


def _question_rows(effort: Effort, what: str, name: str) -> Iterator[Row]:
    scene, _ = _prepare(_text(name), n=10_000.0)
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
    for asked, target in (("contains", 0.5), ("spans", 0.1)):
        rate = len(points) / times[asked] / 1e6
        yield Row(f"{what}, {asked}", (None, rate, None, None), rate, target)


SCATTERED = Subject(
    "scattered",
    "Many solids, no two alike",
    "Millions of rays per second of processor time, one thread; millions of solids per second from"
    " the graph to the first answer; bytes of a solid. The ratio is what the row names, else"
    " millions of coherent rays per second.",
    ("coherent", "random", "prepared", "bytes"),
    scattered,
)
