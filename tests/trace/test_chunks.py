"""Chunks of rays: all are done once, the first fault is told, and interrupts are seen soon."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType

import numpy as np
import pytest

import pcsg
from pcsg.render.job import Job
from pcsg.render.options import Options
from pcsg.trace import rays as batches
from pcsg.trace.rays import Pace, Stopped, run_chunks, stoppable


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("n", [0, 1, 1_000, batches.CHUNK, batches.CHUNK + 1, 300_000])
def test_every_ray_is_done_once(threads: int, n: int) -> None:
    count = np.zeros(n, int)
    pace = Pace()

    def work(begin: int, end: int) -> None:
        count[begin:end] += 1

    for _ in range(3):
        run_chunks(n, threads, work, pace)
    assert (count == 3).all()


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_first_fault_is_told_and_nothing_runs_on(threads: int) -> None:
    done: list[int] = []

    def work(begin: int, end: int) -> None:
        for bad in (30_000, 70_000):
            if begin <= bad < end:
                time.sleep(0.01 if bad == 30_000 else 0.0)
                raise ValueError(bad)
        done.append(begin)

    for _ in range(5):
        with pytest.raises(ValueError, match="30000"):
            run_chunks(10 * batches.CHUNK, threads, work, Pace())
        count = len(done)
        run_chunks(2 * batches.CHUNK, threads, lambda begin, end: None, Pace())
        assert len(done) == count


def test_chunks_grow_as_long_as_they_are_short() -> None:
    sizes: list[int] = []
    pace = Pace()
    run_chunks(10**6, 1, lambda begin, end: sizes.append(end - begin), pace)
    assert sizes[0] == batches.FIRST_CHUNK
    assert max(sizes) == batches.LARGEST_CHUNK
    sizes.clear()
    run_chunks(10**5, 1, lambda begin, end: sizes.append(end - begin), pace)
    assert sizes == [10**5]
    run_chunks(1, 1, lambda begin, end: None, pace)
    sizes.clear()
    run_chunks(10**5, 1, lambda begin, end: sizes.append(end - begin), pace)
    assert sizes == [10**5]


def sleep_long(begin: int, end: int) -> None:
    time.sleep((end - begin) * 1e-3)


def test_chunks_of_slow_rays_are_short() -> None:
    took: list[float] = []

    def work(begin: int, end: int) -> None:
        took.append((end - begin) * 1e-3)
        time.sleep(took[-1] / 100)

    pace = Pace()
    pace.learn(1_000, 1.0)  # as many rays take a second
    run_chunks(500, 1, work, pace)
    assert took[0] <= batches.SECONDS


@pytest.fixture
def interrupt() -> Iterator[Callable[[float], None]]:
    """Return what raises KeyboardInterrupt in this thread after some seconds."""
    if not hasattr(signal, "setitimer"):
        pytest.skip("there are no such timers")

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    old = signal.signal(signal.SIGALRM, stop)
    yield lambda seconds: signal.setitimer(signal.ITIMER_REAL, seconds)
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, old)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_is_seen_soon(threads: int, interrupt: Callable[[float], None]) -> None:
    start = time.monotonic()
    interrupt(0.3)
    with pytest.raises(KeyboardInterrupt):
        run_chunks(100_000, threads, sleep_long, Pace())  # for 50 s and more
    assert time.monotonic() - start < 10  # a guard; it takes one and a half


def test_calls_of_a_thread_can_be_stopped() -> None:
    stop = threading.Event()
    stop.set()
    with stoppable(stop), pytest.raises(Stopped):
        run_chunks(10, 1, lambda begin, end: None, Pace())
    with stoppable(stop), pytest.raises(Stopped):
        run_chunks(10 * batches.CHUNK, 2, lambda begin, end: None, Pace())
    run_chunks(10, 1, lambda begin, end: None, Pace())


def test_a_picture_is_interrupted_soon_and_keeps_what_is_done(
    interrupt: Callable[[float], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    job = Job(pcsg.loads("sphere"), Options((256, 256), 1, threads=2))
    radiance = job.integrator.radiance
    slow = threading.Event()

    def drag(*arguments: object) -> object:
        if slow.is_set():
            pace = Pace()
            run_chunks(100_000, 1, sleep_long, pace)
        slow.set()
        return radiance(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(job.integrator, "radiance", drag)
    interrupt(1.0)
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        job.run()
    assert time.monotonic() - start < 15  # a guard; it takes two and a half
    finished = job.image().finished
    assert 0 < finished.mean() < 1


def test_calls_that_must_stop_soon_take_smaller_chunks():
    def sizes_of(pace):
        sizes = []
        run_chunks(10**5, 1, lambda begin, end: sizes.append(end - begin), pace)
        return sizes

    pace = Pace()
    pace._size = 10_000
    with stoppable(threading.Event(), 0.02):
        assert sizes_of(pace)[0] == 1_000
    pace._size = 20
    with stoppable(threading.Event(), 0.02):
        assert sizes_of(pace)[0] == batches.SMALLEST_CHUNK
    pace._size = 10_000
    assert sizes_of(pace)[0] == 10_000
