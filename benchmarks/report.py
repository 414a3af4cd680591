"""Rows against targets, tables of rows, and the page that keeps them.

A subject is a module with one `Subject`; a subject's rows come one by one, so that what is done
is seen while the rest is measured.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pcsg

Value = float | str | None


@dataclass(frozen=True)
class Effort:
    """How much is spent on a measurement: rays of a batch, side of a picture, repetitions.

    `tiny` leaves out what takes long, for the tests.
    """

    rays: int = 262_144
    size: int = 512
    repeats: int = 5
    tiny: bool = False


@dataclass(frozen=True)
class Row:
    """One measurement.

    Attributes
    ----------
    what
        Scene, rays.
    values
        One for each of the subject's columns; None is a dash: not there, or not possible.
    ratio, target
        What is to be reached, and what should be; a row without a target only tells.
    at_most
        Whether the target is an upper bound.
    """

    what: str
    values: tuple[Value, ...]
    ratio: float | None = None
    target: float | None = None
    at_most: bool = False

    @property
    def reached(self) -> bool | None:
        """Whether the target is reached; None without a target or a measurement."""
        if self.ratio is None or self.target is None:
            return None
        return self.ratio <= self.target if self.at_most else self.ratio >= self.target


@dataclass(frozen=True)
class Subject:
    """What one module measures.

    Attributes
    ----------
    name
        On the command line.
    title, note
        Of its table: what is compared with what, in which unit.
    columns
        Names of the values.
    rows
        Measures.
    """

    name: str
    title: str
    note: str
    columns: tuple[str, ...]
    rows: Callable[[Effort], Iterator[Row]]


def show(value: Value) -> str:
    """Return a value with three digits."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def lines_of(subject: Subject, effort: Effort) -> Iterator[str]:
    """Yield the lines of a subject's table as they are measured."""
    yield f"## {subject.title}"
    yield ""
    yield subject.note
    yield ""
    names = ("what", *subject.columns, "ratio", "target", "reached")
    yield f"| {' | '.join(names)} |"
    yield f"| {' | '.join('---' for _ in names)} |"
    for row in subject.rows(effort):
        target = None if row.target is None else f"{'<=' if row.at_most else '>='} {row.target:g}"
        reached = {True: "yes", False: "**no**", None: "-" if row.target else ""}[row.reached]
        cells = (row.what, *map(show, row.values), show(row.ratio), target or "", reached)
        yield f"| {' | '.join(cells)} |"
    yield ""


def best_times(
    contestants: Mapping[str, Callable[[], object]],
    repeats: int,
    clock: Callable[[], float] = time.thread_time,
) -> dict[str, float]:
    """Return the shortest time of each contestant; they take turns, so that noise is shared."""
    best = dict.fromkeys(contestants, float("inf"))
    for _ in range(repeats):
        for name, run in contestants.items():
            start = clock()
            run()
            best[name] = min(best[name], clock() - start)
    return best


def measure_command(command: Sequence[str], **variables: str) -> tuple[float, float, float]:
    """Return seconds on the clock, processor seconds and peak megabytes of a command.

    Python keeps what it makes of source files, as it does for who has installed pcsg, even where
    the environment of the measurement says otherwise.
    """
    script = (
        "import resource, subprocess, sys, time; t = time.perf_counter();"
        "subprocess.run(sys.argv[1:], check=True, capture_output=True);"
        "r = resource.getrusage(resource.RUSAGE_CHILDREN);"
        "print(time.perf_counter() - t, r.ru_utime + r.ru_stime, r.ru_maxrss / 1e3)"
    )
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "", **variables}
    line = [sys.executable, "-c", script, *command]
    told = subprocess.run(line, check=True, capture_output=True, text=True, env=environment)
    clock, processor, peak = map(float, told.stdout.split())
    return clock, processor, peak


def ratio(a: float | None, b: float | None) -> float | None:
    """Return a / b, None where either was not measured."""
    return None if a is None or b is None else a / b


def describe_machine() -> list[str]:
    """Return the lines that say what was measured on."""
    processors = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    )
    versions = [f"Python {platform.python_version()}", f"pcsg {pcsg.__version__}"]
    for name in ("numpy", "numba", "embreex", "mitsuba"):
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"no {name}")
    return [
        f"- {processor_name()}, {processors} processors, {memory()}, {platform.system()}",
        f"- {', '.join(versions)}, {povray_version()}",
    ]


def processor_name() -> str:
    """Return the processor's model."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or platform.machine()
    facts = dict(
        (part.strip() for part in line.split(":", 1))
        for line in text.split("\n\n")[0].splitlines()
        if ":" in line
    )
    model = facts.get("model name", platform.machine())
    family = "/".join(facts[k] for k in ("cpu family", "model") if k in facts)
    return f"{model} (family/model {family})" if family else model


def memory() -> str:
    """Return the machine's memory."""
    try:
        return f"{os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 2**30:.0f} GiB"
    except (AttributeError, ValueError, OSError):
        return "memory unknown"


def povray_version() -> str:
    """Return the version of POV-Ray on the path."""
    try:
        told = subprocess.run(["povray", "--version"], capture_output=True, text=True, check=False)
    except OSError:
        return "no POV-Ray"
    lines = [line for line in (told.stderr + told.stdout).splitlines() if "POV-Ray" in line]
    return lines[0].strip() if lines else "POV-Ray"
