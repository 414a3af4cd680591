"""One picture in the making: passes over the film, batches of rays on a pool of threads.

Pass one takes one sample of every pixel, so that a picture of everything is there early. Each
further pass brings the pixels that differ from their neighbours, or are still noisy, to 4, 16,
64... samples (the paper's adaptive oversampling). Pixels go in batches of fixed composition; no
result depends on which thread computes it, or when.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.arguments import shown
from pcsg.errors import UsageError, printable
from pcsg.render.archive import Layout
from pcsg.render.film import Film
from pcsg.render.image import Image
from pcsg.render.integrators import Integrator, Purpose, Samples
from pcsg.render.metadata import describe
from pcsg.render.options import Options, processors
from pcsg.render.passes import Pass
from pcsg.render.path import Direct, Path
from pcsg.render.preview import Preview
from pcsg.render.sampler import Sampler
from pcsg.render.stage import Stage, build_stage
from pcsg.render.tracer import Floats, RenderScene
from pcsg.render.veiled import Veiled
from pcsg.trace.rays import SECONDS, Stopped, stoppable

_BLOCK = 64
"""Side of the squares of pixels that are visited one after the other."""

_GUESS = 0.35
"""Assumed part of the pixels that a pass hands on to the next, for the time that is left."""


MOST = 1e30
"""Of the light in a picture that is put aside: more is no number once it is shown."""


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
        Rays traced, of all kinds.
    seconds
        Since the start.
    """

    pass_number: int = 0
    passes: int = 0
    samples: int = 0
    expected: float = 0.0
    rays: int = 0
    seconds: float = 0.0


class _Clock:
    """Tells the time since the start, and when a pause is due."""

    def __init__(self, progress: Progress, pause: Callable[[], None] | None, every: float) -> None:
        self._progress, self._pause, self._every = progress, pause, every
        self._start = time.perf_counter() - progress.seconds
        self._last = time.perf_counter()

    @property
    def is_due(self) -> bool:
        return self._pause is not None and time.perf_counter() - self._last >= self._every

    def tick(self) -> None:
        self._progress.seconds = time.perf_counter() - self._start

    def pause(self) -> None:
        if self._pause is not None:
            self._pause()
        self._last = time.perf_counter()


MODES: dict[str, Callable[[Stage, Sampler], Integrator]] = {
    "preview": Preview,
    "direct": Direct,
    "path": Path,
}
"""Ways to follow light, by the name of the film's mode."""


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
    stage
        What `build_stage` returns for them, where it is known already.

    Attributes
    ----------
    within
        Seconds in which it stops; fewer cost time.
    """

    def __init__(
        self,
        scene: RenderScene,
        options: Options,
        metadata: Mapping[str, str] | None = None,
        stage: Stage | None = None,
    ) -> None:
        options = options.validate()
        self.options = options
        if stage is None:
            stage = build_stage(scene, options.size, options.overrides, options.detail)
        self.stage = stage
        first, last = options.film_rows
        rare = self.stage.mode == "path"
        size = options.size[0], last - first
        self.film = Film(size, self.stage.view, rare, judged=len(options.levels) > 1)
        self.progress = Progress(passes=len(options.levels))
        self.sampler = Sampler(options.size, options.samples, options.seed)
        self.integrator: Integrator = MODES[self.stage.mode](self.stage, self.sampler)
        if self.stage.fog is not None:
            self.integrator = Veiled(self.integrator, self.stage.fog)
        self.description = describe(scene, options)
        # Names of files need not be text, but what a picture's file says must be.
        more = {name: printable(text) for name, text in (metadata or {}).items()}
        self.metadata = {**self.description, **more}
        self.within = SECONDS
        self._stop = Event()
        self._taken = 0
        self._pass: Pass | None = None
        self._ended = False

    def run(
        self,
        report: Callable[[Progress], None] | None = None,
        pause: Callable[[], None] | None = None,
        every: float = 30.0,
    ) -> None:
        """Make the picture, or what is missing of it.

        Parameters
        ----------
        report
            Called in the calling thread after every batch.
        pause
            Called now and then while no batch is under way, so that the picture can be saved.
        every
            Seconds between two pauses.

        Raises
        ------
        EvaluationFault
            A ray met a fault in the grammar. What was done is kept.
        KeyboardInterrupt
            Likewise, within a second or so; batches that have begun are dropped.
        Stopped
            `stop` was called. What was done is kept.
        """
        clock = _Clock(self.progress, pause, every)
        threads = self.options.threads or processors()
        with ThreadPoolExecutor(threads, thread_name_prefix="pcsg") as pool:
            try:
                for number, level in enumerate(self.options.levels, 1):
                    if level <= self._taken:
                        continue
                    if self._pass is None:
                        self._pass = self._begin_pass(level)
                    if len(self._pass.pixels) == 0:
                        break
                    self._expect(number, self._pass)
                    self._run_pass(pool, self._pass, report, clock, threads)
                    self._taken, self._pass = level, None
                self._ended = True
            except BaseException:
                # Batches that wait are dropped; those that run end soon.
                self._stop.set()
                pool.shutdown(wait=True, cancel_futures=True)
                raise

    def stop(self) -> None:
        """Let `run` end soon with `Stopped`, for good; to be called from another thread."""
        self._stop.set()

    def image(self) -> Image:
        """Return the picture so far; pixels without samples are transparent."""
        film = self.film
        # What goes on would write to what it shares with the film.
        layers = film.layers if self._ended else film.copied_layers()
        top = self.options.film_rows[0]
        rows = slice(self.options.rows[0] - top, self.options.rows[1] - top)
        return Image(
            film.mean()[rows],
            layers.depth[rows],
            layers.normal[rows],
            layers.albedo[rows],
            layers.label[rows],
            layers.leaf[rows],
            film.count[rows] > 0,
            self.metadata,
            self.stage.view,
        )

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return all that is needed to go on later, by name. To be called when nothing runs."""
        # Batches that ended while the run was stopped are in the film, not in the progress.
        done = self.film.count.sum()
        state: dict[str, NDArray[np.generic]] = {
            **self.film.arrays(),
            "taken": np.array(self._taken),
            "work": np.array([done, self.progress.rays, self.progress.seconds]),
        }
        if self._pass is not None:
            state.update(pixels=self._pass.pixels, done=self._pass.done)
        return state

    def layout(self) -> dict[str, Layout]:
        """Return what the arrays of a state must be."""
        most = self.film.count.size
        return {
            **{name: Layout.of(values) for name, values in self.film.arrays().items()},
            "taken": Layout((), np.dtype(np.int64)),
            "work": Layout((3,), np.dtype(np.float64)),
            "pixels": Layout((-1,), np.dtype(np.int64), most, optional=True),
            "done": Layout((-1,), np.dtype(np.bool_), most, optional=True),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from a state; `run` does what is missing.

        Raises
        ------
        ValueError
            It is none that this picture can have been in.
        """
        self._check(state)
        for name, values in self.film.arrays().items():
            values[...] = state[name]
        self._taken = int(state["taken"])
        samples, rays, seconds = state["work"]
        self.progress.samples, self.progress.rays = int(samples), int(rays)
        self.progress.seconds = float(seconds)
        if "pixels" in state:
            level = next(k for k in self.options.levels if k > self._taken)
            self._pass = Pass(self._taken, level, state["pixels"], state["done"].copy())

    def _check(self, state: Mapping[str, NDArray[Any]]) -> None:
        taken, levels = int(state["taken"]), [0, *self.options.levels]
        if taken not in levels or not (state["work"] >= 0.0).all() or state["work"].max() > 1e18:
            raise ValueError("it has come as far as no picture does")
        if not ((state["count"] >= 0) & (state["count"] <= levels[-1])).all():
            raise ValueError("its pixels have numbers of samples that none has")
        check_light({name: state[name] for name in self.film.arrays()})
        for name in ("tone", "tone2"):  # of samples as displayed, which is about 1 at most
            if not ((state[name] >= 0.0) & (state[name] <= 4.0 * levels[-1])).all():
                raise ValueError(f"{name} is none")
        if ("pixels" in state) != ("done" in state):
            raise ValueError("half of a pass is missing")
        if "pixels" in state:
            pixels = state["pixels"]
            if taken == levels[-1] or not ((pixels >= 0) & (pixels < state["count"].size)).all():
                raise ValueError("its pass is none")
            level = levels[levels.index(taken) + 1]
            if Pass.of(taken, level, pixels).done.shape != state["done"].shape:
                raise ValueError("its pass is of other batches")

    def _begin_pass(self, level: int) -> Pass:
        """Return the pixels that need more samples, near ones next to each other."""
        width, height = self.film.size
        if self._taken == 0:
            chosen = np.arange(width * height)
        else:
            chosen = np.flatnonzero(self.film.unfinished(self._taken))
        y, x = np.divmod(chosen, width)
        block = (y // _BLOCK) * (width // _BLOCK + 1) + x // _BLOCK
        return Pass.of(self._taken, level, chosen[np.argsort(block, kind="stable")])

    def _expect(self, number: int, work: Pass) -> None:
        """Estimate how many camera rays are still to come."""
        levels = [0, *self.options.levels]
        rest, left = 0.0, float(work.pixels_left)
        for k in range(number, len(levels)):
            rest += left * (levels[k] - levels[k - 1])
            left *= _GUESS
        self.progress.pass_number = number
        self.progress.expected = self.progress.samples + rest

    def _run_pass(
        self,
        pool: ThreadPoolExecutor,
        work: Pass,
        report: Callable[[Progress], None] | None,
        clock: _Clock,
        threads: int,
    ) -> None:
        waiting = iter(np.flatnonzero(~work.done))
        running: set[Future[tuple[int, int]]] = set()
        while True:
            due = clock.is_due
            if due and not running:
                clock.pause()
                due = False
            # Only a few batches wait at a time, so that a stop is quick and memory small.
            while not due and len(running) < 2 * threads:
                if (batch := next(waiting, None)) is None:
                    break
                running.add(pool.submit(self._batch, work, int(batch)))
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                samples, rays = future.result()
                self.progress.samples += samples
                self.progress.rays += rays
            if self._stop.is_set():
                raise Stopped
            clock.tick()
            if report:
                report(self.progress)

    def _batch(self, work: Pass, batch: int) -> tuple[int, int]:
        """Take the samples of a batch of pixels; return the numbers of samples and rays."""
        if self._stop.is_set():
            return 0, 0
        pixels = work.batch(batch)
        k = work.level - work.taken
        width, top = self.options.size[0], self.options.film_rows[0]
        number = np.tile(np.arange(work.taken, work.level), len(pixels))
        y, x = np.divmod(np.repeat(pixels, k), width)
        samples = Samples(x, y + top, number)
        shift = self._in_filter(samples, k)
        lens = None
        if self.stage.camera.aperture > 0:
            lens = self.sampler.pairs(*samples, Purpose.LENS)
        camera, size = self.stage.camera, self.options.size
        at_x, at_y = x + 0.5 + shift[:, 0], samples.y + 0.5 + shift[:, 1]
        shown = camera.covers(at_x, at_y, size)
        if shown is not None:
            samples, at_x, at_y = samples.take(np.flatnonzero(shown)), at_x[shown], at_y[shown]
            lens = lens[shown] if lens is not None else None
        origins, directions = camera.rays(at_x, at_y, size, lens)
        try:
            with stoppable(self._stop, self.within):
                light = self.integrator.radiance(origins, directions, samples)
        except Stopped:
            return 0, 0
        rgb = light.rgb
        if shown is not None:
            rgb = np.zeros((len(number), 3))
            rgb[shown] = light.rgb
        self.film.add(pixels, rgb.reshape(-1, k, 3))
        if work.taken == 0:
            first = pixels if shown is None else pixels[shown]
            self.film.set_first(first, light.hits, light.albedo)
        work.done[batch] = True
        return len(number), light.rays

    def _in_filter(self, samples: Samples, k: int) -> Floats:
        """Return (N, 2) shifts from the pixel's centre, distributed as a tent of radius 1.

        There are k samples of every pixel.

        Each pixel's numbers are turned (on the torus) so that its first sample is its centre.
        """
        if samples.number.max(initial=0) == 0:
            return np.zeros((len(samples.x), 2))
        pairs = self.sampler.pairs(*samples, Purpose.PIXEL)
        x, y = samples.x[::k].copy(), samples.y[::k].copy()
        first = np.repeat(self.sampler.pairs(x, y, np.zeros_like(x), Purpose.PIXEL), k, axis=0)
        u = 2.0 * np.mod(pairs - first + 0.5, 1.0)
        return np.where(u < 1.0, np.sqrt(u) - 1.0, 1.0 - np.sqrt(np.maximum(2.0 - u, 0.0)))


def check_light(layers: Mapping[str, NDArray[Any]]) -> None:
    """Require that layers of a picture are numbers of sense; only what is far away is infinite.

    Raises
    ------
    ValueError
        One is not.
    """
    for name, values in layers.items():
        if np.issubdtype(values.dtype, np.floating):
            fine = ~np.isnan(values) if name == "depth" else np.abs(values) <= MOST
            if not fine.all():
                raise ValueError(f"{name} is not a number somewhere")


def render(
    scene: RenderScene,
    size: tuple[int, int] = (800, 600),
    samples: int = 16,
    seed: int = 1,
    *,
    threads: int | None = None,
    max_memory: int | None = None,
    detail: float = 0.5,
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
    detail
        Size in pixels below which refining stops; 0 never.
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
    known = ("camera", "sun", "sky", "ground", "fog", "film")
    for kind in settings:
        if kind not in known:
            raise UsageError(f"render() has no argument `{kind}`; settings are {', '.join(known)}")
    if progress is not None and not callable(progress):
        raise UsageError(f"progress is a function, not {shown(progress)}")
    if not hasattr(scene, "setting_values"):
        raise UsageError(f"render() takes a scene first, not {shown(scene)}")
    options = Options(size, samples, seed, threads, max_memory, settings, detail=detail)
    job = Job(scene, options)
    job.run(progress)
    return job.image()
