"""A picture for somebody who waits: coarse at once, then finer, and stopped by what comes next.

Coarse pictures are small ones. The last step is the very job of ``pcsg render``, so that the
picture at rest has the same bits as the file that the command would write.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from threading import Timer
from typing import Any

from pcsg.render.image import Image
from pcsg.render.job import Job, Progress
from pcsg.render.options import Options
from pcsg.render.preview import Preview
from pcsg.render.stage import Stage, build_stage
from pcsg.render.tracer import RenderScene
from pcsg.trace.rays import Stopped

DIVISORS = (1, 2, 3, 4, 6, 8)
"""By which the sides of coarse pictures are smaller."""

MOVING = 1.0 / 15.0
"""Seconds that a picture may take while the camera moves."""

STEP = 0.12
"""Seconds from which on a finer picture is worth showing before the finest."""

STOP = 0.02
"""Seconds in which a picture ends for a newer one, about."""

FIRST_LOOK, LAST_LOOK = 0.2, 1.5
"""Seconds between two looks at the finest picture while it is made, at first and later."""

OVERHEAD = 0.012
"""Seconds that a picture takes however small it is."""

UNKNOWN_PACE = 4e-6
"""Seconds for a pixel where nothing has been measured yet."""


class Glance(Preview):
    """A preview with a single ray to the sky for every pixel."""

    first_rays = 1


@dataclass(frozen=True)
class Frame:
    """A picture on the way to a finished one.

    Attributes
    ----------
    image
        Of the size that was asked for, or smaller by `divisor`; may have unfinished pixels.
    stage
        What it shows.
    done
        Whether nothing finer follows.
    samples
        Camera rays for each pixel of the finest picture, on average.
    rays, seconds
        What it took so far.
    """

    image: Image
    stage: Stage
    divisor: int
    done: bool
    samples: float
    rays: int
    seconds: float


class Progressive:
    """Makes pictures of one scene after another view.

    Parameters
    ----------
    scene
        What to picture.
    stage
        The scene's stage, from any camera.
    overrides
        Settings in place of the grammar's, for the texts in the picture's file.
    superseded
        Returns whether something newer is wanted.
    threads
        How many; None for one per processor.
    pace
        Seconds that a pixel may take, as far as is known.

    Attributes
    ----------
    pace
        As measured since.
    """

    def __init__(
        self,
        scene: RenderScene,
        stage: Stage,
        overrides: Mapping[str, Mapping[str, Any]],
        superseded: Callable[[], bool],
        threads: int | None = None,
        pace: float = UNKNOWN_PACE,
    ) -> None:
        self._scene, self._stage, self._overrides = scene, stage, overrides
        self._superseded, self._threads = superseded, threads
        self.pace = pace
        self._job: Job | None = None

    def interrupt(self) -> None:
        """Let the picture in the making end soon; to be called from another thread."""
        if self._job is not None:
            self._job.stop()

    def glance(self, options: Options, divisor: int | None = None) -> Frame:
        """Return a coarse picture that takes about `MOVING`, or one of a divisor.

        Raises
        ------
        Stopped
            Something newer is wanted, and this took long.
        """
        if divisor is None:
            divisor = self._divisor(options, MOVING)
        width, height = (max(1, side // divisor) for side in options.size)
        small = replace(options, size=(width, height), samples=1)
        job = self._begin(small)
        job.integrator = Glance(job.stage, job.sampler)
        begin = time.perf_counter()
        try:
            job.run()
        except Stopped:
            # What was expected was too little, else nobody would have stopped it.
            self.pace *= 2.0
            raise
        taken = time.perf_counter() - begin
        spent = max(taken - OVERHEAD, 0.2 * taken)
        self.pace = 0.5 * self.pace + 0.5 * spent / (width * height)
        return Frame(job.image(), job.stage, divisor, False, 0.0, job.progress.rays, taken)

    def refine(self, options: Options, show: Callable[[Frame], None]) -> Job:
        """Make a picture, coarse first; returns the job of the finest.

        Parameters
        ----------
        show
            Gets every picture that is worth being shown.

        Raises
        ------
        Stopped
            Something newer is wanted.
        """
        divisor = self._divisor(options, STEP)
        while divisor > 1:
            show(self.glance(options, divisor))
            divisor = min(self._divisor(options, 4.0 * STEP), divisor // 2)
        job = self._begin(options)
        every, shown = FIRST_LOOK, time.perf_counter()

        def look(progress: Progress) -> None:
            nonlocal every, shown
            if time.perf_counter() - shown < every:
                return
            show(_finest(job, False))
            every, shown = min(1.5 * every, LAST_LOOK), time.perf_counter()

        job.run(look)
        show(_finest(job, True))
        return job

    def _begin(self, options: Options) -> Job:
        """Return the job of a picture; raises `Stopped` if something newer is wanted."""
        stage = self._stage.seen_by(self._stage.camera, options.size[1], options.detail)
        options = replace(options, overrides=self._overrides, threads=self._threads)
        job = self._job = Job(self._scene, options, stage=stage)
        job.within = STOP
        # Who wants something newer says so first and interrupts then: one of the two is seen.
        if self._superseded():
            raise Stopped
        return job

    def _divisor(self, options: Options, seconds: float) -> int:
        """Return the least divisor of a picture that takes no longer."""
        pixels = options.size[0] * options.size[1]
        fitting = (d for d in DIVISORS if OVERHEAD + self.pace * pixels / d**2 <= seconds)
        return next(fitting, DIVISORS[-1])

    def turn(self, stage: Stage, overrides: Mapping[str, Mapping[str, Any]]) -> None:
        """Picture the scene from another camera, or in another mode."""
        self._stage, self._overrides = stage, overrides


def _finest(job: Job, done: bool) -> Frame:
    progress = job.progress
    pixels = job.options.size[0] * job.options.size[1]
    return Frame(
        job.image(),
        job.stage,
        1,
        done,
        progress.samples / pixels,
        progress.rays,
        progress.seconds,
    )


def picture_within(
    scene: RenderScene, size: tuple[int, int] = (400, 300), seconds: float = 5.0
) -> Image:
    """Return a picture of a scene as fine as a time allows, once the scene is prepared.

    Where it is too short for a sample of every pixel, the picture is smaller.
    """
    stage = build_stage(scene, size, {})
    options = Options(size)
    coarse = Progressive(scene, stage, {}, lambda: False).glance(options, DIVISORS[-1])
    job = Job(scene, options, stage=stage.seen_by(stage.camera, size[1], options.detail))
    timer = Timer(seconds, job.stop)
    timer.start()
    try:
        job.run()
    except Stopped:
        pass
    finally:
        timer.cancel()
    image = job.image()
    return image if image.finished.all() else coarse.image
