"""Intersections and differences of many solids, beside POV-Ray."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from benchmarks import povray
from benchmarks.rays import make_rays
from benchmarks.report import Effort, Row, Subject, best_times, ratio
from benchmarks.scenes import SCENES
from benchmarks.views import look_at

_BESIDE = ("sphere minus 1,000", "500 & 500 boxes")


def operations(effort: Effort) -> Iterator[Row]:
    rates: dict[str, float] = {}
    names = (*_BESIDE, *(f"Menger {n}" for n in range(1, 7)))
    for name in names[:1] if effort.tiny else names:
        scene = SCENES[name].load()
        rays = make_rays(scene, effort)
        theirs = None
        if name in _BESIDE and povray.is_there():
            told = povray.run(povray.write_scene(scene, look_at(scene.bounds)), effort.size // 2)
            theirs = told["rays"] / told["seconds"] / 1e6
        values = []
        for kind in ("coherent", "random"):
            scene.intersect(rays[kind][0][:64], rays[kind][1][:64])
            times = best_times({"ours": partial(scene.intersect, *rays[kind])}, effort.repeats)
            values.append(len(rays[kind][0]) / times["ours"] / 1e6)
        rates[name] = values[0]
        yield Row(
            name, (*values, theirs), ratio(values[0], theirs), 50 if name in _BESIDE else None
        )
    if "Menger 6" in rates:
        slower = rates["Menger 3"] / rates["Menger 6"]
        yield Row("Menger 6, time over Menger 3", (None, None, None), slower, 3.0, at_most=True)


OPERATIONS = Subject(
    "operations",
    "Intersections and differences",
    "Millions of rays per second of processor time, one thread. POV-Ray: camera and shadow rays of"
    " a picture, parsing and all. The ratio is ours over POV-Ray, coherent rays.",
    ("coherent", "random", "POV-Ray"),
    operations,
)
