"""``pcsg animate``: a grammar whose parameters, time or camera change from frame to frame."""

from __future__ import annotations

import multiprocessing
import re
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pcsg.arguments import real
from pcsg.commands.files import check_there
from pcsg.commands.guard import say
from pcsg.commands.options import parse_memory, parse_number, parse_setting, parse_size
from pcsg.commands.parent import follow_pool
from pcsg.commands.scenes import tell_warnings
from pcsg.errors import EnvironmentFault, UsageError
from pcsg.graph.words import is_name

if TYPE_CHECKING:
    from pcsg.render.animation import Frames, Range
    from pcsg.scene import Scene
    from pcsg.trace.tracer import Engine


MOST_FRAMES = 100_000
"""Of one command: more than an hour."""

LEAST_FPS = 0.02
"""Frames in a second: the files of moving pictures have no room for longer times."""


@dataclass(frozen=True)
class AnimateArguments:
    """The options of ``pcsg animate`` as they were typed."""

    file: Path
    output: Path | None
    frames: str
    fps: float
    time: str | None
    orbit: float
    size: str
    samples: int
    assignments: Sequence[str]
    seed: int | None
    settings: Mapping[str, str]
    jobs: int | None
    include: Sequence[Path]
    max_memory: str | None
    engine: str
    resume: bool
    quiet: bool


@dataclass(frozen=True)
class Shot:
    """One frame, with all that a process needs to make it."""

    file: Path
    path: Path
    values: Mapping[str, float]
    include: Sequence[Path]
    engine: str
    size: tuple[int, int]
    samples: int
    seed: int
    threads: int
    max_memory: int | None
    overrides: Mapping[str, Mapping[str, Any]]
    resume: bool


def run(arguments: AnimateArguments) -> None:
    """Make the frames, several at a time, and join them."""
    from pcsg.render.animation import (
        check_animation,
        frame_path,
        frames_folder,
        is_pattern,
        join_frames,
    )

    check_there(arguments.file)
    frames = parse_frames(arguments.frames, arguments.fps)
    output = arguments.output or Path(arguments.file.stem + ".webp")
    check_animation(output)
    shots = _shots(arguments, frames, output)
    single = not is_pattern(output)
    _make(shots, arguments)
    if not single:
        _tell(arguments, f"{len(shots)} frames, {shots[0].path} to {shots[-1].path}")
        return
    paths = [frame_path(output, number) for number in frames.numbers]
    join_frames(output, paths, frames.per_second)
    for path in paths:
        path.unlink()
    if not any(frames_folder(output).iterdir()):
        frames_folder(output).rmdir()
    _tell(arguments, f"{output}: {len(paths)} frames, {frames.per_second:g} in a second")


def _tell(arguments: AnimateArguments, text: str) -> None:
    if not arguments.quiet:
        say(text)


def parse_frames(text: str, fps: float) -> Frames:
    """Return the frames of ``0..48``."""
    from pcsg.render.animation import Frames

    match = re.fullmatch(r"\s*(\d{1,7})\s*\.\.\s*(\d{1,7})\s*", text)
    if not match or int(match[2]) < int(match[1]):
        raise UsageError(f"--frames takes the first and the last one, such as 0..48, not `{text}`")
    if int(match[2]) - int(match[1]) >= MOST_FRAMES:
        raise UsageError(f"--frames takes at most {MOST_FRAMES:,} frames, not `{text}`")
    if not LEAST_FPS <= fps <= 1000:
        raise UsageError(f"--fps takes a number from {LEAST_FPS:g} to 1000, not {fps:g}")
    return Frames(int(match[1]), int(match[2]), fps)


def parse_range(text: str, what: str) -> Range:
    """Return the range of ``1..9``, ``0.5..2`` or a single number."""
    from pcsg.render.animation import Range

    first, sign, last = text.partition("..")
    if not sign:
        value = parse_number(text, what)
        return Range(value, value)
    whole = all(re.fullmatch(r"\s*[+-]?\d+\s*", part) for part in (first, last))
    return Range(parse_number(first, what), parse_number(last, what), whole)


def parse_ranges(texts: Sequence[str]) -> dict[str, Range]:
    """Return the ranges of ``name=first..last``; a later one wins."""
    found = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign or not is_name(name.strip()):
            raise UsageError(f"-D takes NAME=VALUE or NAME=FIRST..LAST, not `{text}`")
        found[name.strip()] = parse_range(value, f"-D {name.strip()}=")
    return found


def _shots(arguments: AnimateArguments, frames: Frames, output: Path) -> list[Shot]:
    """Return every frame; the camera is that of the last one, so that it stands still."""
    from pcsg.render.animation import frame_path, turn_camera
    from pcsg.render.options import Options, processors

    ranges = parse_ranges(arguments.assignments)
    time = None if arguments.time is None else parse_range(arguments.time, "--time")
    settings = {kind: parse_setting(kind, text) for kind, text in arguments.settings.items()}
    overrides: dict[str, Mapping[str, Any]] = {k: v for k, v in settings.items() if v}
    orbit = real(arguments.orbit, "--orbit", -1e9, 1e9)
    if arguments.jobs is not None and arguments.jobs < 1:
        raise UsageError(f"--jobs takes a number of at least 1, not {arguments.jobs}")
    jobs = _jobs(arguments, len(frames.numbers))
    size, memory = parse_size(arguments.size), parse_memory(arguments.max_memory)
    seed = 1 if arguments.seed is None else arguments.seed
    Options(size, arguments.samples, seed, max_memory=memory).validate()
    shots = []
    for number in frames.numbers:
        values = {name: r.at(frames.share(number)) for name, r in ranges.items()}
        if arguments.seed is not None:
            values.setdefault("SEED", float(arguments.seed))
        if time is not None:
            values["TIME"] = time.at(frames.share(number))
        else:
            values.setdefault("TIME", frames.seconds(number))
        shots.append(
            Shot(
                file=arguments.file,
                path=frame_path(output, number),
                values=values,
                include=arguments.include,
                engine=arguments.engine,
                size=size,
                samples=arguments.samples,
                seed=seed,
                threads=max(1, processors() // jobs),
                max_memory=memory,
                overrides=overrides,
                resume=arguments.resume,
            )
        )
    last = _open(shots[-1])
    tell_warnings(last)
    camera = _camera(last, shots[-1])
    return [
        replace(
            shot,
            overrides={
                **shot.overrides,
                "camera": turn_camera(camera, orbit * frames.turned(number)),
            },
        )
        for number, shot in zip(frames.numbers, shots, strict=True)
    ]


def _jobs(arguments: AnimateArguments, frames: int) -> int:
    """Return how many frames are made at a time."""
    from pcsg.render.options import processors

    return min(arguments.jobs or processors(), frames)


def _camera(scene: Scene, shot: Shot) -> dict[str, Any]:
    """Return the camera of a frame as a setting that leaves nothing open."""
    from pcsg.render.stage import build_stage

    camera = build_stage(scene, shot.size, shot.overrides).camera
    return asdict(camera)


def _open(shot: Shot) -> Scene:
    from pcsg.scene import load

    return load(
        shot.file,
        include=shot.include,
        parameters=shot.values,
        engine=cast("Engine", shot.engine),  # Scene checks it
        threads=shot.threads,
        max_memory=shot.max_memory,
    )


def _make(shots: Sequence[Shot], arguments: AnimateArguments) -> None:
    jobs = _jobs(arguments, len(shots))
    # The first frame compiles the kernels, which the others then find.
    make_shot(shots[0])
    done = 1
    # Started afresh: a process that is forked while threads run may hang.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=follow_pool) as pool:
        try:
            for future in as_completed([pool.submit(make_shot, shot) for shot in shots[1:]]):
                future.result()
                done += 1
                if not arguments.quiet and sys.stderr.isatty():
                    print(f"\r{done} of {len(shots)} frames", end="", file=sys.stderr, flush=True)
        except BaseException as error:
            # Frames that are done are kept; nobody waits for the others.
            for process in multiprocessing.active_children():
                process.terminate()
            pool.shutdown(cancel_futures=True)
            if isinstance(error, BrokenProcessPool):
                raise EnvironmentFault(
                    "a process that made a frame was killed, perhaps for want of memory;"
                    " fewer --jobs help, and --resume keeps what is done"
                ) from None
            raise
    if not arguments.quiet and sys.stderr.isatty():
        print(file=sys.stderr)


def make_shot(shot: Shot) -> None:
    """Make a frame, unless it is there and says that it is the same picture."""
    from pcsg.render.animation import texts_of
    from pcsg.render.job import Job
    from pcsg.render.options import Options

    scene = _open(shot)
    options = Options(
        size=shot.size,
        samples=shot.samples,
        seed=shot.seed,
        threads=shot.threads,
        max_memory=shot.max_memory,
        overrides=shot.overrides,
    )
    job = Job(scene, options)
    if shot.resume and texts_of(shot.path) == job.metadata:
        return
    job.run()
    # Only now: an animation that fails before leaves no empty folder.
    shot.path.parent.mkdir(exist_ok=True)
    job.image().save(shot.path)
