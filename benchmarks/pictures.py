"""Whole pictures beside POV-Ray; the time to start; the memory of a process."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks import povray
from benchmarks.report import Effort, Row, Subject, measure_command, ratio
from benchmarks.scenes import SCENES, triangles_of
from benchmarks.views import look_at


def _render(folder: str, name: str, size: int, *more: str) -> list[str]:
    subject = SCENES[name]
    path = Path(folder) / "scene.pcsg"
    path.write_text(subject.text(), encoding="utf-8")
    values = [f"-D{key}={value}" for key, value in subject.values.items()]
    command = [sys.executable, "-m", "pcsg", "render", str(path), "-q", *values]
    return [*command, "--size", f"{size}x{size}", "-o", str(Path(folder) / "out.png"), *more]


def pictures(effort: Effort) -> Iterator[Row]:
    names = ("Sierpinski 8", "fig 5a", "terrain 8", "tree", "Sierpinski 40", "terrain 14")
    targets = {"Sierpinski 8": 5.0, "fig 5a": 50.0, "terrain 8": 5.0}
    for name in names[:1] if effort.tiny else names:
        scene = SCENES[name].load()
        view = look_at(scene.bounds)
        camera = ("--samples", "1", "--mode", "direct", "--camera", view.option)
        with tempfile.TemporaryDirectory() as folder:
            command = _render(folder, name, effort.size, *camera)
            measure_command(command)
            clock, processor, peak = measure_command(command)
        theirs = None
        if povray.is_there() and name in targets:
            triangles = None if scene.states.finite else triangles_of(name)
            text = povray.write_scene(scene, view, triangles)
            theirs = povray.run(text, effort.size)["seconds"]
        yield Row(
            name, (clock, processor, peak, theirs), ratio(theirs, processor), targets.get(name)
        )


def startup(effort: Effort) -> Iterator[Row]:
    pcsg = [sys.executable, "-m", "pcsg"]
    clock, processor, peak = min(measure_command([*pcsg, "--help"]) for _ in range(3))
    yield Row("pcsg --help", (clock, processor, peak), clock, 0.3, at_most=True)
    if effort.tiny:
        return
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as cache:
        command = _render(folder, "tree", effort.size)
        first = measure_command(command, XDG_CACHE_HOME=cache)
        yield Row("render the tree, first time", first, first[0], 30.0, at_most=True)
        again = min(measure_command(command, XDG_CACHE_HOME=cache) for _ in range(3))
        yield Row("render the tree, warm", again, again[0], 2.0, at_most=True)
        command = _render(folder, "Sierpinski 40", effort.size)
        measure_command(command, XDG_CACHE_HOME=cache)
        deep = measure_command(command, XDG_CACHE_HOME=cache)
        yield Row("Sierpinski 40, MB of the process", deep, deep[2], 300.0, at_most=True)


PICTURES = Subject(
    "pictures",
    "Whole pictures",
    "`pcsg render`, warm, 512 x 512, one sample, sun with shadow and sky, from start to file:"
    " seconds on the clock, processor seconds, peak megabytes; beside POV-Ray's processor seconds"
    " with one light and shadow (the terrain as triangles). The ratio is POV-Ray over ours,"
    " processor time.",
    ("clock", "processor", "MB", "POV-Ray"),
    pictures,
)
STARTUP = Subject(
    "start",
    "Start",
    "Seconds on the clock, processor seconds, peak megabytes of whole processes; *first time* with"
    " no kernel compiled. 512 x 512, default samples.",
    ("clock", "processor", "MB"),
    startup,
)
