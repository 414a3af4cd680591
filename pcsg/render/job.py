"""One picture in the making: passes over the film, batches of rays on a pool of threads.

Pass one takes one sample of every pixel, so that a picture of everything is there early. Each
further pass brings the pixels that differ from their neighbours, or are still noisy, to 4, 16,
64... samples (the paper's adaptive oversampling). Pixels go in batches of fixed composition; no
result depends on which thread computes it, or when.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from threading import Event
from typing import Any

import numpy as np

from pcsg.errors import EnvironmentFault, UsageError
from pcsg.render.film import BYTES_PER_PIXEL, Film
from pcsg.render.image import Image
from pcsg.render.integrators import Preview, Purpose, Samples
from pcsg.render.metadata import describe
from pcsg.render.sampler import MAX_SAMPLES, Sampler
from pcsg.render.stage import Overrides, build_stage
from pcsg.render.tracer import Floats, Ints, RenderScene

BATCH = 1 << 14
"""Camera rays per batch."""

_BLOCK = 64
"""Side of the squares of pixels that are visited one after the other."""

_GUESS = 0.35
"""Assumed part of the pixels that a pass hands on to the next, for the time that is left."""


@dataclass(frozen=True)
class Options:
    """How a picture is made.

    Attributes
    ----------
    size
        Width and height in pixels.
    samples
        Largest number of samples per pixel.
    seed
        Of the sampling; any integer.
    threads
        How many; None for one per processor.
    max_memory
        Bytes that the picture may take; None for half of the machine's.
    overrides
        Values in place of the grammar's settings, by kind and key.
    """

    size: tuple[int, int] = (800, 600)
    samples: int = 16
    seed: int = 1
    threads: int | None = None
    max_memory: int | None = None
    overrides: Overrides = field(default_factory=dict)

    def validate(self) -> None:
        """Raise an error if no picture can be made of these options.

        Raises
        ------
        UsageError
            A number is out of range.
        EnvironmentFault
            The picture does not fit into memory.
        """
        width, height = self.size
        if width < 1 or height < 1:
            raise UsageError(f"the size must be at least 1x1, not {width}x{height}")
        if not 1 <= self.samples <= MAX_SAMPLES:
            raise UsageError(f"samples must lie between 1 and {MAX_SAMPLES}, not {self.samples}")
        if self.threads is not None and self.threads < 1:
            raise UsageError(f"threads must be at least 1, not {self.threads}")
        needed = width * height * BYTES_PER_PIXEL
        limit = half_of_memory() if self.max_memory is None else self.max_memory
        if needed > limit:
            raise EnvironmentFault(
                f"a picture of {width}x{height} pixels needs {_bytes(needed)} of memory, but only"
                f" {_bytes(limit)} are allowed; a smaller --size or a larger --max-memory helps"
            )
        if max(self.size) > 1 << 20:
            raise UsageError(f"the size must be at most {1 << 20} pixels a side")

    @property
    def levels(self) -> list[int]:
        """Numbers of samples that the passes bring pixels to."""
        levels = [1]
        while levels[-1] < self.samples:
            levels.append(min(4 * levels[-1], self.samples))
        return levels


def half_of_memory() -> int:
    """Return half of the machine's memory in bytes; 2 GB where it does not tell."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (AttributeError, ValueError, OSError):
        return 2 << 30


def _bytes(n: float) -> str:
    for unit in ("bytes", "KB", "MB", "GB", "TB"):
        if n < 1000:
            return f"{n:.3g} {unit}"
        n /= 1000
    return f"{n:.3g} PB"


@dataclass
class Progress:
    """How far a job is.

    Attributes
    ----------
    pass_number, passes
        Which pass is running, from 1, of how many at most.
    samples
        Camera rays done.
    expected
        Camera rays in all, an estimate until the last pass has begun.
    rays
        Rays traced: camera, shadow and sky.
    seconds
        Since the start.
    """

    pass_number: int = 0
    passes: int = 0
    samples: int = 0
    expected: float = 0.0
    rays: int = 0
    seconds: float = 0.0


class Job:
    """A picture in the making.

    `image` may be called at any time, also after `run` was interrupted or has failed.

    Parameters
    ----------
    scene
        What to picture.
    options
        How.
    metadata
        Texts that go into the picture's file besides what describes scene and options.
    """

    def __init__(
        self, scene: RenderScene, options: Options, metadata: Mapping[str, str] | None = None
    ) -> None:
        options.validate()
        self.options = options
        self.stage = build_stage(scene, options.size, options.overrides)
        self.film = Film(options.size)
        self.progress = Progress(passes=len(options.levels))
        self.sampler = Sampler(options.size, options.samples, options.seed)
        self.integrator = Preview(self.stage, self.sampler)
        self.metadata = {**describe(scene, options), **(metadata or {})}
        self._stop = Event()

    def run(self, report: Callable[[Progress], None] | None = None) -> None:
        """Make the picture.

        Parameters
        ----------
        report
            Called in the calling thread after every batch.

        Raises
        ------
        EvaluationFault
            A ray met a fault in the grammar. What was done is kept.
        KeyboardInterrupt
            Likewise, within the time of a batch.
        """
        start = time.perf_counter()
        threads = self.options.threads or processors()
        taken = 0
        with ThreadPoolExecutor(threads, thread_name_prefix="pcsg") as pool:
            try:
                for number, level in enumerate(self.options.levels, 1):
                    pixels = self._pixels_for(taken)
                    if len(pixels) == 0:
                        break
                    self._expect(number, len(pixels))
                    self._run_pass(pool, pixels, taken, level, report, start, threads)
                    taken = level
            except BaseException:
                # Batches that wait are dropped; those that run end by themselves.
                self._stop.set()
                pool.shutdown(wait=True, cancel_futures=True)
                raise

    def image(self) -> Image:
        """Return the picture so far; pixels without samples are transparent."""
        film = self.film
        return Image(
            film.mean(),
            film.depth.copy(),
            film.normal.copy(),
            film.label.copy(),
            film.count > 0,
            self.metadata,
        )

    def _pixels_for(self, taken: int) -> Ints:
        """Return the pixels of the next pass, near ones next to each other."""
        width, height = self.options.size
        if taken == 0:
            chosen = np.arange(width * height)
        else:
            chosen = np.flatnonzero(self.film.unfinished(taken))
        y, x = np.divmod(chosen, width)
        block = (y // _BLOCK) * (width // _BLOCK + 1) + x // _BLOCK
        return chosen[np.argsort(block, kind="stable")]

    def _expect(self, number: int, pixels: int) -> None:
        """Estimate how many camera rays are still to come."""
        levels = [0, *self.options.levels]
        rest, left = 0.0, float(pixels)
        for k in range(number, len(levels)):
            rest += left * (levels[k] - levels[k - 1])
            left *= _GUESS
        self.progress.pass_number = number
        self.progress.expected = self.progress.samples + rest

    def _run_pass(
        self,
        pool: ThreadPoolExecutor,
        pixels: Ints,
        taken: int,
        level: int,
        report: Callable[[Progress], None] | None,
        start: float,
        threads: int,
    ) -> None:
        step = max(1, BATCH // (level - taken))
        batches = iter(range(0, len(pixels), step))
        running: set[Future[tuple[int, int]]] = set()
        while True:
            # Only a few batches wait at a time, so that a stop is quick and memory small.
            while len(running) < 2 * threads and (at := next(batches, None)) is not None:
                running.add(pool.submit(self._batch, pixels[at : at + step], taken, level))
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                samples, rays = future.result()
                self.progress.samples += samples
                self.progress.rays += rays
            self.progress.seconds = time.perf_counter() - start
            if report:
                report(self.progress)

    def _batch(self, pixels: Ints, taken: int, level: int) -> tuple[int, int]:
        """Take the samples [taken, level) of pixels; return the numbers of samples and rays."""
        if self._stop.is_set():
            return 0, 0
        k = level - taken
        width = self.options.size[0]
        number = np.tile(np.arange(taken, level), len(pixels))
        y, x = np.divmod(np.repeat(pixels, k), width)
        samples = Samples(x, y, number)
        shift = self._in_filter(samples)
        lens = None
        if self.stage.camera.aperture > 0:
            lens = self.sampler.pairs(*samples, Purpose.LENS)
        origins, directions = self.stage.camera.rays(
            x + 0.5 + shift[:, 0], y + 0.5 + shift[:, 1], self.options.size, lens
        )
        light = self.integrator.radiance(origins, directions, samples)
        self.film.add(pixels, light.rgb.reshape(-1, k, 3))
        if taken == 0:
            self.film.set_first(pixels, light.hits)
        return len(number), light.rays

    def _in_filter(self, samples: Samples) -> Floats:
        """Return (N, 2) shifts from the pixel's centre, distributed as a tent of radius 1.

        Each pixel's numbers are turned (on the torus) so that its first sample is its centre.
        """
        if samples.number.max(initial=0) == 0:
            return np.zeros((len(samples.x), 2))
        pairs = self.sampler.pairs(*samples, Purpose.PIXEL)
        first = self.sampler.pairs(
            samples.x, samples.y, np.zeros_like(samples.number), Purpose.PIXEL
        )
        u = 2.0 * np.mod(pairs - first + 0.5, 1.0)
        return np.where(u < 1.0, np.sqrt(u) - 1.0, 1.0 - np.sqrt(np.maximum(2.0 - u, 0.0)))


def processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def render(
    scene: RenderScene,
    size: tuple[int, int] = (800, 600),
    samples: int = 16,
    seed: int = 1,
    *,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    **settings: Mapping[str, Any],
) -> Image:
    """Return a picture of a scene.

    Parameters
    ----------
    scene
        What to picture.
    size
        Width and height in pixels.
    samples
        Largest number of samples per pixel; even areas take fewer.
    seed
        Of the sampling. The grammar's own randomness is the parameter SEED of the scene.
    threads
        How many; None for one per processor. The picture does not depend on it.
    max_memory
        Bytes that the picture may take; None for half of the machine's.
    progress
        Called now and then with a `Progress`.
    **settings
        Values in place of the grammar's, such as ``camera={"eye": (3, -5, 2)}``.

    Raises
    ------
    UsageError
        An argument is out of range, or a setting unknown.
    EvaluationFault
        A ray met a fault in the grammar.
    EnvironmentFault
        The picture does not fit into memory.
    """
    known = ("camera", "sun", "sky", "ground")
    for kind in settings:
        if kind not in known:
            raise UsageError(f"render() has no argument `{kind}`; settings are {', '.join(known)}")
    job = Job(scene, Options(size, samples, seed, threads, max_memory, settings))
    job.run(progress)
    return job.image()
