"""What two versions of pcsg are compared by: tasks that take a moment each.

``python -m benchmarks.tasks [TASK...]`` times them with the pcsg that Python finds, and prints one
line of JSON for each: its name, and seconds or an error. Only public names of pcsg are used, and
those only within a task, so that a version that lacks some can do the others.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import pcsg
from benchmarks.report import measure_command
from benchmarks.scenes import GRAMMARS, HERE, SCENES, many_written, rough_ball
from benchmarks.views import look_at, picture_rays, random_rays

Work = Callable[[], object]
Rays = Literal["coherent", "random"]

ENOUGH = 0.4
"""Seconds after which a task is not run again."""


class Task(NamedTuple):
    """What is timed.

    Attributes
    ----------
    prepare
        Makes what is not timed, and returns the work that is.
    clock
        Tells seconds. None where the work tells its own: a command's processor time.
    """

    prepare: Callable[[], Work]
    clock: Callable[[], float] | None = time.process_time


def _rays(scene: Any, kind: Rays, count: int) -> Any:
    bounds = scene.bounds
    if kind == "coherent":
        return picture_rays(look_at(bounds), int(count**0.5))
    return random_rays(bounds, count)


def _ask(
    name: str, kind: Rays, question: str = "intersect", count: int = 1 << 17, **options: Any
) -> Task:
    """Rays into one of `SCENES`."""

    def prepare() -> Work:
        scene = SCENES[name].load(**options)
        return partial(getattr(scene, question), *_rays(scene, kind, count))

    return Task(prepare, time.perf_counter if "threads" in options else time.process_time)


def _file(name: str, kind: Rays, count: int) -> Task:
    """Rays into a file of the gallery."""

    def prepare() -> Work:
        scene = pcsg.load(GRAMMARS / name, threads=1)
        return partial(scene.intersect, *_rays(scene, kind, count))

    return Task(prepare)


def _mesh() -> Work:
    scene = pcsg.Scene(pcsg.mesh(*rough_ball(100)), threads=1)
    return partial(scene.intersect, *random_rays(scene.bounds, 1 << 17))


def _read(text: Callable[[], str]) -> Task:
    """From a grammar's text to its first ray."""

    def run() -> None:
        pcsg.loads(text(), threads=1).intersect([[0.0, 0.0, 9.0]], [[0.0, 0.0, -1.0]])

    return Task(lambda: run)


def _check() -> Work:
    """Every mistake of what a script has written."""
    from pcsg.grammar import load_text

    return partial(load_text, many_written(20_000))


def _grow() -> Work:
    """A growing tree at instants that nothing has kept."""
    instants = iter(15.6 + 0.01 * k for k in range(100))
    return lambda: pcsg.loads(f'tree("populus", {next(instants):.2f})', threads=1).bounds


def _cover() -> Work:
    """A mesh of a skeleton."""
    from pcsg.treemesh import tree_surface

    return partial(tree_surface, pcsg.load(HERE / "grammars" / "acer.pcsg").limbs().skeleton)


def _shine() -> Work:
    scene = pcsg.load(GRAMMARS / "mushrooms.pcsg", threads=1)
    return partial(pcsg.render, scene, size=(64, 48), samples=4, threads=1)


def _command(*words: str) -> Task:
    """Processor seconds of a command."""

    def run() -> float:
        with tempfile.TemporaryDirectory() as folder:
            last = ("-o", os.fspath(Path(folder) / "out.png")) if len(words) > 1 else ()
            return measure_command([sys.executable, "-m", "pcsg", *words, *last])[1]

    return Task(lambda: run, None)


TASKS: dict[str, Task] = {
    "first hits, Sierpinski 8, coherent": _ask("Sierpinski 8", "coherent", count=1 << 19),
    "first hits, Sierpinski 8, random": _ask("Sierpinski 8", "random", count=1 << 18),
    "first hits, tree, coherent": _ask("tree", "coherent"),
    "first hits, tree, random": _ask("tree", "random"),
    "first hits, fig 5a, random": _ask("fig 5a", "random", count=1 << 18),
    "first hits, two threads": _ask("Sierpinski 8", "coherent", count=1 << 19, threads=2),
    "any hit, tree, coherent": _ask("tree", "coherent", "occluded"),
    "any hit, fig 5a, random": _ask("fig 5a", "random", "occluded", 1 << 18),
    "operations, Menger 3, coherent": _ask("Menger 3", "coherent"),
    "operations, 500 & 500 boxes, random": _ask("500 & 500 boxes", "random"),
    "operations, sphere minus 1,000, coherent": _ask("sphere minus 1,000", "coherent"),
    "spans, Menger 2, random": _ask("Menger 2", "random", "spans", 1 << 14),
    "plant 12, random": _ask("plant 12", "random", count=1 << 16),
    "terrain 8, coherent": _ask("terrain 8", "coherent"),
    "suspended, terrain 14, coherent": _ask("terrain 14", "coherent", count=1 << 16),
    "cyclic, Sierpinski 6, random": _ask("Sierpinski 6", "random", count=1 << 16, engine="cyclic"),
    "cyclic, Menger 2, random": _ask("Menger 2", "random", count=1 << 15, engine="cyclic"),
    "blobs, poplar, coherent": _file("poplar.lsys", "coherent", 1 << 16),
    "blobs, plates, random": _file("blobtree/plates.pcsg", "random", 1 << 16),
    "mesh, 39,600 triangles, random": Task(_mesh),
    "reading, tree": _read(SCENES["tree"].text),
    "reading, 1,000 boxes": _read(SCENES["500 & 500 boxes"].text),
    "checking, 20,000 written solids": Task(_check),
    "growth, a poplar of 15 years": Task(_grow),
    "mesh of a tree": Task(_cover),
    "all light, mushrooms": Task(_shine),
    "start, pcsg --help": _command("--help"),
    "picture, warm, tree": _command(
        "render", str(GRAMMARS / "tree.pcsg"), "-q", "--size", "256x256", "--samples", "4"
    ),
}
"""By the name of its row."""


def seconds(task: Task, enough: float = ENOUGH) -> float:
    """Return the shortest time of a task; what it needs is there before."""
    work = task.prepare()
    clock = task.clock
    if clock is not None:
        work()
    best, spent = float("inf"), 0.0
    while spent < enough:
        start = time.perf_counter()
        if clock is None:
            taken = work()
            assert isinstance(taken, float)
        else:
            before = clock()
            work()
            taken = clock() - before
        spent += time.perf_counter() - start
        best = min(best, taken)
    return best


def main(names: list[str]) -> None:
    """Time tasks, all if none is named."""
    print(json.dumps({"pcsg": os.fspath(Path(pcsg.__file__).resolve().parent)}), flush=True)
    for name in names or TASKS:
        try:
            told: dict[str, object] = {"seconds": seconds(TASKS[name])}
        except Exception as error:  # whatever a version lacks, the other rows are wanted
            told = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps({"task": name, **told}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
