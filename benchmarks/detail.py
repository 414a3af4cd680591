"""States that are suspended, and recursion that ends below a pixel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.report import Effort, Row, Subject, best_times
from benchmarks.scenes import SCENES
from benchmarks.views import look_at, picture_rays, random_rays
from pcsg.trace.coverage import Footprint

_MEMORY = 16 << 20
_TARGETS = {"terrain 8": 2.0, "terrain 10": 0.8, "terrain 14": 0.3, "terrain 20": 0.15}
_TERRAIN_BOX = np.array([[0.0, 0.0, -0.1], [1.0, 1.0, 0.3]])


def _view(scene: Any, name: str, side: int) -> tuple[Any, Any, Footprint]:
    """Return the rays of a picture, and their footprint."""
    # Intervals know a terrain's height badly.
    view = look_at(_TERRAIN_BOX if name.startswith("terrain") else scene.bounds)
    rays = picture_rays(view, side)
    n = len(rays[0])
    spread = 2.0 * np.tan(np.radians(view.fov) / 2.0) / side
    return *rays, Footprint(np.zeros(n), np.full(n, spread))


def _rate(effort: Effort, run: Any, n: int) -> float:
    run()
    return n / best_times({"ours": run}, effort.repeats)["ours"] / 1e6


def suspended(effort: Effort) -> Iterator[Row]:
    targets = {"plant 12": None, **_TARGETS}
    seconds: dict[str, float] = {}
    for name in ("plant 12",) if effort.tiny else targets:
        scene = replace(SCENES[name], block_memory=_MEMORY).load()
        origins, directions, footprint = _view(scene, name, effort.size // 2)
        n = len(origins)
        whole = _rate(effort, partial(scene.tracer.intersect, origins, directions), n)
        expansions = scene.tracer.profile["expansions"]
        ended = partial(scene.tracer.intersect, origins, directions, footprint=footprint)
        rate = _rate(effort, ended, n)
        box = _TERRAIN_BOX if name.startswith("terrain") else scene.bounds
        scattered = random_rays(box, max(64, effort.rays // 8))
        random = _rate(effort, partial(scene.tracer.intersect, *scattered), len(scattered[0]))
        mb = sum(scene.tracer.nbytes.values()) / 1e6
        seconds[name] = 1.0 / rate
        yield Row(name, (whole, rate, random, expansions, mb), whole, targets[name])
    if "terrain 20" in seconds:
        ratio = seconds["terrain 20"] / seconds["terrain 10"]
        yield Row("terrain 20 over 10, ended, time", (None,) * 5, ratio, 1.2, at_most=True)
    name = "terrain 3" if effort.tiny else "terrain 10"
    few = random_rays(_TERRAIN_BOX, 64 if effort.tiny else 512)
    many = random_rays(_TERRAIN_BOX, 64 if effort.tiny else 16_384)
    walker = SCENES[name].load(engine="cyclic")
    states = replace(SCENES[name], block_memory=_MEMORY).load()
    walked = _rate(Effort(repeats=1), partial(walker.intersect, *few), len(few[0]))
    made = _rate(effort, partial(states.intersect, *many), len(many[0]))
    yield Row(f"{name}, random, over the walker", (None, None, made, None, None), made / walked, 40)


def detail(effort: Effort) -> Iterator[Row]:
    rates = {}
    for order in (8,) if effort.tiny else (8, 20, 40):
        name = f"Sierpinski {order}"
        scene = SCENES[name].load()
        origins, directions, footprint = _view(scene, name, effort.size)
        n = len(origins)
        tracer = scene.tracer
        whole, ended = (
            partial(tracer.intersect, origins, directions, footprint=f) for f in (None, footprint)
        )
        rates[order] = _rate(effort, ended, n), _rate(effort, whole, n)
        a, b = whole(), ended()
        light = np.array([0.4, -0.6, 0.7])
        bright = [float(np.clip(h.normal @ light, 0.0, None).mean()) for h in (a, b)]
        density = float(b.mask.mean() / a.mask.mean())
        values = (*rates[order][::-1], float(a.mask.mean()), density, bright[1] / bright[0])
        target = 2.5 if order == 40 else None
        yield Row(name, values, rates[order][0] / rates[order][1], target)
    if 40 in rates:
        ratio = rates[8][0] / rates[40][0]
        yield Row("order 40 over 8, ended, time", (None,) * 5, ratio, 1.3, at_most=True)


SUSPENDED = Subject(
    "suspended",
    "Suspended states",
    "Millions of rays per second of processor time, one thread, with 16 MB for states: coherent"
    " rays through everything, and ended below a pixel; random ones through everything; states that"
    " a coherent ray expands; megabytes. The target is for coherent rays through everything.",
    ("coherent", "ended", "random", "expansions", "MB"),
    suspended,
)
DETAIL = Subject(
    "detail",
    "Ends below a pixel",
    "Millions of rays per second, coherent, through everything and ended below a pixel of a picture"
    " of 512 pixels; part of the rays that hit; density and brightness of the ended picture over"
    " the whole one. The ratio is the gain in speed.",
    ("whole", "ended", "hit", "density", "brightness"),
    detail,
)
