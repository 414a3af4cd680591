"""``pcsg render``: a picture of a grammar."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from pcsg.commands.guard import INTERRUPTED, say
from pcsg.commands.options import parse_memory, parse_setting, parse_size
from pcsg.commands.scenes import open_scene
from pcsg.errors import EvaluationFault

if TYPE_CHECKING:
    from pcsg.render.job import Job, Options
    from pcsg.scene import Scene


@dataclass(frozen=True)
class RenderArguments:
    """The options of ``pcsg render`` as they were typed."""

    file: Path
    output: Path | None
    size: str
    samples: int
    assignments: Sequence[str]
    seed: int | None
    time: float | None
    settings: Mapping[str, str]
    aov: str
    threads: int | None
    include: Sequence[Path]
    max_memory: str | None
    engine: str
    json: bool
    quiet: bool
    verbose: bool


def run(arguments: RenderArguments) -> None:
    """Make the picture and write it.

    Everything that can be refused is refused before any work is done.
    """
    from pcsg.render.files import check_output
    from pcsg.render.image import ENDINGS, aov_path
    from pcsg.render.job import Job

    options = _options(arguments)
    options.validate()
    output = arguments.output or Path(arguments.file.stem + ".png")
    check_output(output, ENDINGS)
    layers = [name.strip() for name in arguments.aov.split(",") if name.strip()]
    for name in layers:
        check_output(aov_path(output, name), (".npy",))
    scene = open_scene(
        arguments.file,
        arguments.assignments,
        arguments.seed,
        arguments.time,
        arguments.include,
        arguments.max_memory,
        arguments.engine,
    )
    if not arguments.quiet:
        _announce_compilation(scene)
    job = Job(scene, options, {"pcsg:command": shlex.join(["pcsg", *sys.argv[1:]])})
    if arguments.verbose:
        camera = job.stage.camera
        eye, target = (",".join(f"{x:.6g}" for x in p) for p in (camera.eye, camera.target))
        say(f'--camera "eye={eye} target={target} fov={camera.fov:g}"')
    try:
        _run_with_progress(job, arguments.quiet)
    except KeyboardInterrupt:
        _save_part(job, output)
        raise typer.Exit(INTERRUPTED) from None
    except EvaluationFault:
        _save_part(job, output)
        raise
    files = job.image().save(output, layers)
    if arguments.json:
        typer.echo(json.dumps(_summary(job, files)))
    elif not arguments.quiet:
        _tell(job, output, arguments.verbose)


def _options(arguments: RenderArguments) -> Options:
    from pcsg.render.job import Options

    settings = {kind: parse_setting(kind, text) for kind, text in arguments.settings.items()}
    return Options(
        size=parse_size(arguments.size),
        samples=arguments.samples,
        seed=1 if arguments.seed is None else arguments.seed,
        threads=arguments.threads,
        max_memory=parse_memory(arguments.max_memory),
        overrides={kind: values for kind, values in settings.items() if values},
    )


def _announce_compilation(scene: Scene) -> None:
    """Say that the first picture after an installation takes its time."""
    from pcsg.jit import is_cached
    from pcsg.trace.batch import trace_batch
    from pcsg.trace.blocks_batch import find_batch

    if not is_cached(find_batch if scene.engine == "states" else trace_batch):
        say("compiling kernels, once per installation: about half a minute")


def _run_with_progress(job: Job, quiet: bool) -> None:
    if quiet or not sys.stderr.isatty():
        job.run()
        return
    from pcsg.render.progress import show_progress

    with show_progress() as report:
        job.run(report)


def _save_part(job: Job, output: Path) -> None:
    """Keep what there is of a picture that was not finished."""
    image = job.image()
    share = float(image.finished.mean())
    if share == 0:
        say("stopped before any pixel was done; no picture was written")
        return
    image.save(output)
    passes = job.progress
    state = f"pass {passes.pass_number} of {passes.passes}"
    missing = "" if share == 1 else f", {100 * share:.0f}% of the pixels (the rest is transparent)"
    say(f"stopped in {state}{missing}; the partial picture is {output}")


def _summary(job: Job, files: Sequence[Path]) -> dict[str, Any]:
    progress = job.progress
    pixels = job.options.size[0] * job.options.size[1]
    return {
        "files": [str(file) for file in files],
        "seconds": round(progress.seconds, 3),
        "rays": progress.rays,
        "rays_per_second": round(progress.rays / max(progress.seconds, 1e-9)),
        "samples_per_pixel": round(progress.samples / pixels, 3),
        **{name.removeprefix("pcsg:"): text for name, text in job.metadata.items()},
        "size": list(job.options.size),
    }


def _tell(job: Job, output: Path, verbose: bool) -> None:
    progress = job.progress
    width, height = job.options.size
    rate = progress.rays / max(progress.seconds, 1e-9)
    say(
        f"{output}: {width}x{height}, {progress.rays / 1e6:.3g} million rays"
        f" in {progress.seconds:.1f} s ({rate / 1e6:.2g} million/s)"
    )
    if verbose:
        say(f"{progress.samples / (width * height):.2f} samples per pixel on average")
