"""``pcsg render``: a picture of a grammar."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from pcsg.commands.compiling import announce_compiling, tell_unkept
from pcsg.commands.guard import INTERRUPTED, say, show
from pcsg.commands.options import parse_memory, parse_setting, parse_size, parse_tile
from pcsg.commands.progress import show_preparation
from pcsg.commands.scenes import open_scene
from pcsg.errors import EnvironmentFault, EvaluationFault, UsageError

if TYPE_CHECKING:
    from pcsg.render.image import Image
    from pcsg.render.job import Job
    from pcsg.render.options import Options
    from pcsg.scene import Scene


CHECKPOINT = 30.0
"""Seconds between two checkpoints."""


@dataclass(frozen=True)
class RenderArguments:
    """The options of ``pcsg render`` as they were typed."""

    file: Path
    output: Path | None
    size: str
    samples: int
    assignments: Sequence[str] = ()
    seed: int | None = None
    time: float | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    aov: str = ""
    bits: int = 8
    denoise: bool = False
    tile: str | None = None
    resume: bool = False
    show_every: float | None = None
    threads: int | None = None
    include: Sequence[Path] = ()
    max_memory: str | None = None
    block_memory: str | None = None
    detail: float = 0.5
    engine: str = "auto"
    json: bool = False
    profile: bool = False
    quiet: bool = False
    verbose: bool = False


def run(arguments: RenderArguments) -> None:
    """Make the picture and write it.

    Everything that can be refused is refused before any work is done.
    """
    from pcsg.render.checkpoint import checkpoint_path, resume, tile_path, write_checkpoint
    from pcsg.render.image import check_picture
    from pcsg.render.job import Job

    options = _options(arguments)
    options.validate()
    output = arguments.output or Path(arguments.file.stem + ".png")
    layers = [name.strip() for name in arguments.aov.split(",") if name.strip()]
    check_picture(output, layers, arguments.bits)
    if arguments.denoise:
        from pcsg.render.denoise import load_denoiser

        load_denoiser()
    if arguments.show_every is not None and not arguments.show_every > 0:
        raise UsageError("--show-every takes a number of seconds above 0")
    scene = open_scene(
        arguments.file,
        arguments.assignments,
        arguments.seed,
        arguments.time,
        arguments.include,
        arguments.max_memory,
        arguments.block_memory,
        arguments.engine,
        arguments.quiet,
    )
    with show_preparation(arguments.file.name, arguments.quiet):
        kernel = scene.tracer.kernel
    if not arguments.quiet:
        announce_compiling(kernel, "about half a minute")
    job = Job(scene, options, {"pcsg:command": _command()})
    if arguments.verbose:
        say(f'--camera "{job.stage.camera.keys}"')
    where = output
    if options.tile is not None:
        where = tile_path(output, options.tile)
    kept = checkpoint_path(where)
    if arguments.resume and resume(job, kept) and not arguments.quiet:
        say(f"going on from {kept}")
    try:
        _run(job, arguments, output, kept)
    except (KeyboardInterrupt, EvaluationFault, EnvironmentFault) as stopped:
        write_checkpoint(job, kept)
        _save_part(job, output, kept)
        if isinstance(stopped, KeyboardInterrupt):
            raise typer.Exit(INTERRUPTED) from None
        raise
    files = _save(job, output, layers, arguments)
    kept.unlink(missing_ok=True)
    if arguments.profile:
        _tell_profile(scene)
    if arguments.json:
        show(json.dumps(_summary(job, files)))
    elif not arguments.quiet and files:
        _tell(job, files[0], arguments.verbose)
    if not arguments.quiet:
        tell_unkept()


def _command() -> str:
    """Return the command as it was typed, but for what does not change the picture."""
    words = [word for word in sys.argv[1:] if word != "--resume"]
    return shlex.join(["pcsg", *words])


def _run(job: Job, arguments: RenderArguments, output: Path, kept: Path) -> None:
    """Make the picture; show it, and keep a checkpoint, now and then."""
    from pcsg.render.checkpoint import write_checkpoint

    def pause() -> None:
        if arguments.show_every is not None and job.options.tile is None:
            job.image().save(output)
        write_checkpoint(job, kept)

    every = min(arguments.show_every or CHECKPOINT, CHECKPOINT)
    if arguments.quiet or not sys.stderr.isatty():
        job.run(None, pause, every)
        return
    from pcsg.render.progress import show_progress

    with show_progress() as report:
        job.run(report, pause, every)


def _options(arguments: RenderArguments) -> Options:
    from pcsg.render.options import Options

    settings = {kind: parse_setting(kind, text) for kind, text in arguments.settings.items()}
    return Options(
        size=parse_size(arguments.size),
        samples=arguments.samples,
        seed=1 if arguments.seed is None else arguments.seed,
        threads=arguments.threads,
        max_memory=parse_memory(arguments.max_memory),
        overrides={kind: values for kind, values in settings.items() if values},
        tile=parse_tile(arguments.tile),
        detail=arguments.detail,
    )


def _save(job: Job, output: Path, layers: Sequence[str], arguments: RenderArguments) -> list[Path]:
    """Write the picture, or the tile and, with the last one, the picture; return the files."""
    if job.options.tile is None:
        return _finished(job.image(), arguments).save(output, layers, arguments.bits)
    from pcsg.render.checkpoint import join_tiles, write_tile

    tile = write_tile(job, output)
    image, tiles = join_tiles(job, output)
    if image is None:
        return [tile]
    files = _finished(image, arguments).save(output, layers, arguments.bits)
    for path in tiles:
        path.unlink(missing_ok=True)
    return files


def _finished(image: Image, arguments: RenderArguments) -> Image:
    return image.denoised() if arguments.denoise else image


def _save_part(job: Job, output: Path, kept: Path) -> None:
    """Keep what there is of a picture that was not finished."""
    if job.options.tile is not None:
        say(f"stopped; --resume goes on from {kept}")
        return
    image = job.image()
    share = float(image.finished.mean())
    if share == 0:
        say("stopped before any pixel was done; no picture was written")
        return
    image.save(output)
    passes = job.progress
    state = f"pass {passes.pass_number} of {passes.passes}"
    missing = "" if share == 1 else f", {100 * share:.0f}% of the pixels (the rest is transparent)"
    say(f"stopped in {state}{missing}; the partial picture is {output}, --resume finishes it")


def _tell_profile(scene: Scene) -> None:
    """Say what a ray has visited, and of what."""
    from pcsg.trace.tracer import StatesTracer

    tracer = scene.tracer
    if not isinstance(tracer, StatesTracer):
        say("the engine `cyclic` keeps no profile")
        return
    profile = tracer.profile
    parts = [f"{value:.3g} {name}" for name, value in profile.items() if name != "rays"]
    say(f"{profile['rays']:,.0f} rays; on average a ray visits {', '.join(parts)}")
    counts = {**tracer.counts, "bytes": sum(tracer.nbytes.values())}
    say("of " + ", ".join(f"{n:,} {name.replace('_', ' ')}" for name, n in counts.items()))


def _summary(job: Job, files: Sequence[Path]) -> dict[str, Any]:
    progress = job.progress
    pixels = job.options.size[0] * job.options.size[1]
    return {
        "files": [str(file) for file in files],
        "seconds": round(progress.seconds, 3),
        "rays": progress.rays,
        "rays_per_second": round(progress.rays / max(progress.seconds, 1e-9)),
        "memory": _peak_memory(),
        "samples_per_pixel": round(progress.samples / pixels, 3),
        **{name.removeprefix("pcsg:"): text for name, text in job.metadata.items()},
        "size": list(job.options.size),
    }


def _peak_memory() -> int | None:
    """Return the most bytes that this process had in memory, None where that is not told."""
    try:
        import resource
    except ImportError:
        return None
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else 1024 * most


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
