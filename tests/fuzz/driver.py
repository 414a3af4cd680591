"""Runs many made-up inputs of one subject and keeps those that fail.

An input fails if anything but an error of ours comes out of it, a warning counts; if it takes more
than ten seconds, or the process more than a gigabyte; and if the process dies. Input number k of a
seed is always the same, whatever was run before it.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import Any

from pcsg.commands.parent import follow_pool
from pcsg.errors import PcsgError

Data = bytes | str

SECONDS = 10.0
"""Longest that an input may take, of the processor's time."""

PREPARATION = 600.0
"""Longest that a preparation may take."""

PATIENCE = 300.0
"""Longest that an input may take by the clock: the machine may have others to serve."""

MEMORY = 2**30
"""Most bytes of a process."""

KEPT = 5
"""Inputs that are kept of failures that look alike."""


@dataclass(frozen=True)
class Subject:
    """What is tried.

    Attributes
    ----------
    name
        As the command line says it; its module is ``fuzz_NAME``.
    seeds
        Returns good inputs to begin with.
    mutate
        Returns a worse input; takes nothing by chance but from the generator.
    run
        Does what users do with an input. May write to the folder, which is empty each time.
    prepare
        Does at the beginning what may take its time, such as compiling.
    """

    name: str
    seeds: Callable[[], Sequence[Data]]
    mutate: Callable[[random.Random, Any], Data]
    run: Callable[[Any, Path], None]
    prepare: Callable[[], None] = lambda: None


@dataclass(frozen=True)
class Failure:
    """An input that failed.

    Attributes
    ----------
    number
        Of the input.
    kind
        What happened, and where: the same for failures that look alike.
    report
        With the traceback, as far as there is one.
    """

    number: int
    kind: str
    report: str


class Hang(BaseException):
    """An input takes too long."""


def subjects() -> list[str]:
    """Return the names of all subjects."""
    return sorted(p.stem.removeprefix("fuzz_") for p in Path(__file__).parent.glob("fuzz_*.py"))


def find_subject(name: str) -> Subject:
    """Return a subject by its name."""
    subject: Subject = import_module(f"fuzz_{name}").SUBJECT
    assert subject.name == name
    return subject


def make_input(subject: Subject, seeds: Sequence[Data], seed: int, number: int) -> Data:
    """Return an input; every thirtieth is a seed as it is."""
    rng = random.Random(f"{subject.name} {seed} {number}")
    data = rng.choice(seeds)
    return data if number % 30 == 0 else subject.mutate(rng, data)


def run_input(subject: Subject, data: Data, number: int, folder: Path) -> Failure | None:
    """Run an input; return how it failed."""
    before = peak_memory()
    try:
        with warnings.catch_warnings(), hang_guard():
            warnings.simplefilter("error")
            subject.run(data, folder)
    except PcsgError:
        pass
    except KeyboardInterrupt:
        raise
    except Hang:
        return Failure(number, f"hang {_place()}", traceback.format_exc())
    except BaseException as error:
        return Failure(number, f"{type(error).__name__} {_place()}", traceback.format_exc())
    finally:
        for path in folder.iterdir():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    grown = peak_memory() - before
    if grown > MEMORY:
        return Failure(number, "memory", f"{grown / 2**20:.0f} MB for one input")
    return None


def _place() -> str:
    """Return where the exception that is handled was raised: the innermost place of ours."""
    frames = traceback.extract_tb(sys.exc_info()[2])
    ours = [
        f for f in frames if f"{os.sep}pcsg{os.sep}" in f.filename and ".venv" not in f.filename
    ]
    frame = (ours or frames)[-1]
    return f"{Path(frame.filename).name}:{frame.lineno}"


@contextmanager
def hang_guard() -> Iterator[None]:
    """Raise `Hang` after too much time, as soon as Python has its turn again."""
    if not hasattr(signal, "setitimer"):  # Windows
        yield
        return

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise Hang

    old = [signal.signal(s, stop) for s in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in zip((signal.SIGPROF, signal.SIGALRM), old, strict=True):
            signal.signal(number, handler)


def peak_memory() -> int:
    """Return the most bytes that this process ever had."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def withstand(subject: Subject, inputs: int, folder: Path, seed: int = 1) -> None:
    """Run some inputs in this process, always the same; an assertion fails with what failed."""
    seeds = subject.seeds()
    subject.prepare()
    for number in range(inputs):
        data = make_input(subject, seeds, seed, number)
        failure = run_input(subject, data, number, folder)
        assert failure is None, f"input {number}: {data[:500]!r}\n{failure.report}"


# The long form: a process of its own makes the inputs, so that it may hang, grow and die.


def _work(name: str, seed: int, numbers: range, state: Any, told: Connection, trace: str) -> None:
    """Run inputs, and say which; called in a new process."""
    follow_pool()
    with Path(trace).open("w") as file, tempfile.TemporaryDirectory() as folder:
        faulthandler.enable(file)
        if hasattr(signal, "SIGUSR1"):
            faulthandler.register(signal.SIGUSR1, file)
        subject = find_subject(name)
        seeds = subject.seeds()
        state[1] = time.monotonic() + PREPARATION
        subject.prepare()
        state[2] = 1.0
        for number in numbers:
            state[0], state[1] = number, time.monotonic()
            data = make_input(subject, seeds, seed, number)
            failure = run_input(subject, data, number, Path(folder))
            if failure:
                told.send(failure)
            if peak_memory() > MEMORY:
                told.send(Failure(number, "memory", f"{peak_memory() / 2**20:.0f} MB"))
                return
        state[0] = numbers.stop


def memory_of(pid: int) -> int:
    """Return the bytes that a process has now, 0 where that cannot be found out."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize()
    except (OSError, IndexError, ValueError):
        return 0


def _run_until_trouble(
    name: str, seed: int, numbers: range, found: Callable[[Failure], None]
) -> int:
    """Run inputs in one process; return the number of the input after the last that was run."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    state = context.Array("d", 3, lock=False)
    state[0], state[1] = numbers.start, time.monotonic() + 60.0  # it has to import first
    with tempfile.TemporaryDirectory() as folder:
        trace = Path(folder, "trace")
        args = (name, seed, numbers, state, theirs, str(trace))
        worker = context.Process(target=_work, args=args, daemon=True)
        worker.start()
        assert worker.pid is not None
        theirs.close()
        trouble = ""
        while worker.is_alive() or ours.poll():
            try:
                while ours.poll(0.1):
                    found(ours.recv())
            except EOFError:
                break
            # Within the worker Python ends what hangs; where it has no turn, we do.
            if time.monotonic() - state[1] > PATIENCE + SECONDS:
                trouble = "hang of machine code"
            elif memory_of(worker.pid) > 1.5 * MEMORY:
                trouble = "memory"
            if trouble:
                if hasattr(signal, "SIGUSR1"):
                    os.kill(worker.pid, signal.SIGUSR1)
                    time.sleep(0.5)
                worker.kill()
                break
        worker.join()
        if not state[2]:
            raise RuntimeError(f"{name}: the preparation failed ({trouble or worker.exitcode})")
        at = int(state[0])
        if not trouble and worker.exitcode:
            trouble = f"died with {worker.exitcode}"
        if trouble:
            found(Failure(at, trouble, trace.read_text() if trace.exists() else ""))
        return min(at + 1, numbers.stop)


def explore(name: str, seed: int, numbers: range, folder: Path) -> dict[str, int]:
    """Run inputs in processes that may fail; return how often what happened.

    The inputs that failed are written to the folder, with their reports.
    """
    subject = find_subject(name)
    seeds = subject.seeds()
    counts: dict[str, int] = {}

    def keep(failure: Failure) -> None:
        counts[failure.kind] = counts.get(failure.kind, 0) + 1
        if counts[failure.kind] > KEPT:
            return
        if counts[failure.kind] == 1:
            print(f"{name} {failure.number}: {failure.kind}", flush=True)
        folder.mkdir(parents=True, exist_ok=True)
        data = make_input(subject, seeds, seed, failure.number)
        raw = data if isinstance(data, bytes) else data.encode("utf-8", "surrogatepass")
        path = folder / f"{name}-{seed}-{failure.number}"
        path.write_bytes(raw)
        path.with_name(path.name + ".txt").write_text(f"{failure.kind}\n{failure.report}")

    at = numbers.start
    while at < numbers.stop:
        at = _run_until_trouble(name, seed, range(at, numbers.stop), keep)
    return counts
