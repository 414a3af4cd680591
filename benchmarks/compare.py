"""One version of pcsg against another: ``python -m benchmarks compare OLD NEW``.

Both do the tasks of `tasks` in turns, each round in a process of its own, with machine code of
their own that was compiled before. The measuring code and the grammars are those of NEW.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.report import show
from benchmarks.tasks import TASKS

ROOT = Path(__file__).parents[1]

MEAN_LIMIT, ROW_LIMIT = 3.0, 10.0
"""Per cent by which the geometric mean, and a row, may be slower."""

Told = dict[str, float | str]
"""By task: seconds, or what went wrong."""


@dataclass(frozen=True)
class Compared:
    """A task that both did, or one of them, or neither.

    Attributes
    ----------
    old, new
        Shortest seconds; or what went wrong.
    """

    task: str
    old: float | str
    new: float | str

    @property
    def ratio(self) -> float | None:
        """New over old; None where one has no time."""
        if isinstance(self.old, str) or isinstance(self.new, str):
            return None
        return self.new / self.old


def shortest(rounds: Sequence[Told]) -> Told:
    """Return the shortest time of each task; what went wrong once is wrong."""
    best: Told = {}
    for told in rounds:
        for task, value in told.items():
            kept = best.get(task, math.inf)
            if isinstance(kept, str):
                continue
            best[task] = value if isinstance(value, str) else min(value, kept)
    return best


def pair(old: Told, new: Told) -> list[Compared]:
    """Return the tasks of the new version beside those of the old one."""
    missing = "was not measured"
    return [Compared(task, old.get(task, missing), new.get(task, missing)) for task in new | old]


def geometric_mean(rows: Sequence[Compared]) -> float | None:
    """Return the mean ratio of new to old; None if no task was done by both."""
    ratios = [row.ratio for row in rows if row.ratio is not None]
    return math.exp(math.fsum(map(math.log, ratios)) / len(ratios)) if ratios else None


def find_faults(
    rows: Sequence[Compared], mean_limit: float = MEAN_LIMIT, row_limit: float = ROW_LIMIT
) -> list[str]:
    """Return why the new version does not pass, nothing if it does.

    What only the old version lacks is no fault; what the new one cannot do is.
    """
    faults = [f"{row.task}: {row.new}" for row in rows if isinstance(row.new, str)]
    faults += [
        f"{row.task}: {_percent(row.ratio)}, at most +{row_limit:g} % is allowed"
        for row in rows
        if row.ratio is not None and row.ratio > 1.0 + row_limit / 100.0
    ]
    mean = geometric_mean(rows)
    if mean is None:
        faults.append("no task was done by both versions")
    elif mean > 1.0 + mean_limit / 100.0:
        faults.append(f"the mean: {_percent(mean)}, at most +{mean_limit:g} % is allowed")
    return faults


def _percent(ratio: float) -> str:
    return f"{100.0 * (ratio - 1.0):+.1f} % time"


def table(rows: Sequence[Compared]) -> Iterator[str]:
    """Yield the lines of the table: milliseconds, and new over old."""
    yield "| task | old, ms | new, ms | new / old |"
    yield "| --- | --- | --- | --- |"
    for row in rows:
        old, new = (None if isinstance(t, str) else 1e3 * t for t in (row.old, row.new))
        ratio = "-" if row.ratio is None else f"{row.ratio:.3f}"
        yield f"| {row.task} | {show(old)} | {show(new)} | {ratio} |"
    mean = geometric_mean(rows)
    yield f"| geometric mean | | | {'-' if mean is None else f'{mean:.3f}'} |"


def unpack(source: str, folder: Path) -> None:
    """Copy a version to a folder: that of a folder, or of a revision of this repository.

    Raises
    ------
    ValueError
        It is neither.
    """
    if Path(source, "pcsg").is_dir():
        for part in ("pcsg", "benchmarks", "grammars"):
            if Path(source, part).is_dir():
                ignored = shutil.ignore_patterns("__pycache__")
                shutil.copytree(Path(source, part), folder / part, ignore=ignored)
        return
    git = ["git", "-C", os.fspath(ROOT), "archive", "--format=tar", source]
    packed = subprocess.run(git, capture_output=True, check=False)
    if packed.returncode:
        why = packed.stderr.decode(errors="replace").strip()
        raise ValueError(f"`{source}` is neither a folder with pcsg in it nor a revision: {why}")
    with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as archive:
        archive.extractall(folder, filter="data")


class Side:
    """One of the two versions, in a folder of its own.

    Parameters
    ----------
    name
        ``old`` or ``new``.
    source
        A revision or a folder.
    folder
        Where it is put: its package, and its compiled kernels.
    """

    def __init__(self, name: str, source: str, folder: Path) -> None:
        self.name, self.source = name, source
        self.tree = folder / f"{name}-tree"
        self.tree.mkdir()
        unpack(source, self.tree)
        self.package = folder / name
        self.package.mkdir()
        shutil.copytree(self.tree / "pcsg", self.package / "pcsg")
        self._cache = folder / f"{name}-cache"
        self._cache.mkdir()

    def measure(self, code: Path, tasks: Sequence[str]) -> Told:
        """Do tasks in a process of its own.

        Parameters
        ----------
        code
            Folder of the measuring code.
        """
        paths = os.pathsep.join(map(os.fspath, (self.package, code)))
        environment = {
            **os.environ,
            "PYTHONPATH": paths,
            "PYTHONSAFEPATH": "1",  # only the two of them, wherever this runs
            "XDG_CACHE_HOME": os.fspath(self._cache),
        }
        command = [sys.executable, "-m", "benchmarks.tasks", *tasks]
        run = subprocess.run(
            command, env=environment, cwd=self.package, stdout=subprocess.PIPE, check=False
        )
        lines = [json.loads(line) for line in run.stdout.splitlines()]
        if not lines or Path(lines[0]["pcsg"]) != (self.package / "pcsg").resolve():
            raise RuntimeError(f"{self.name} was not measured: status {run.returncode}")
        told: Told = {x["task"]: x.get("seconds", x.get("error")) for x in lines[1:]}
        ended = f"its process ended with status {run.returncode}"
        return {task: told.get(task, ended) for task in tasks}


def measure_both(
    sides: tuple[Side, Side],
    code: Path,
    tasks: Sequence[str],
    rounds: int,
    say: Callable[..., None],
) -> list[Compared]:
    """Compile, and measure in turns; each version begins every second round."""
    for side in sides:
        say(f"{side.name} ({side.source}): compiling")
        side.measure(code, tasks)
    told: dict[str, list[Told]] = {side.name: [] for side in sides}
    for k in range(rounds):
        for side in sides[:: -1 if k % 2 else 1]:
            say(f"round {k + 1} of {rounds}: {side.name}")
            told[side.name].append(side.measure(code, tasks))
    old, new = (shortest(told[side.name]) for side in sides)
    return pair(old, new)


def choose(words: Sequence[str], tasks: Mapping[str, object] = TASKS) -> list[str]:
    """Return the tasks whose names have any of the words in them; all without words."""
    return [task for task in tasks if not words or any(word in task for word in words)]


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main(arguments: Sequence[str]) -> int:
    """Compare two versions; return 0 if the new one passes, 1 if not."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks compare", description="One version of pcsg against another, in turns."
    )
    parser.add_argument("old", metavar="OLD", help="a git revision, or a folder with pcsg in it")
    parser.add_argument("new", metavar="NEW", help="likewise; its tasks are those that are done")
    parser.add_argument(
        *("--tasks", "-t"),
        metavar="WORD",
        nargs="+",
        default=[],
        help="only the tasks with one of these words in their names",
    )
    parser.add_argument("--rounds", type=int, default=5, help="the best of so many (5)")
    for name, limit, what in (
        ("--mean", MEAN_LIMIT, "the geometric mean"),
        ("--row", ROW_LIMIT, "a task"),
    ):
        told = f"per cent that {what} may be slower ({limit:g})"
        parser.add_argument(name, type=float, default=limit, metavar="PERCENT", help=told)
    options = parser.parse_args(arguments)
    if options.rounds < 1:
        parser.error("--rounds takes a number from 1 on")
    tasks = choose(options.tasks)
    if not tasks:
        parser.error(f"no task has such a name; there are: {'; '.join(TASKS)}")
    with tempfile.TemporaryDirectory(prefix="pcsg-compare-") as folder:
        try:
            sides = tuple(
                Side(name, source, Path(folder))
                for name, source in (("old", options.old), ("new", options.new))
            )
        except ValueError as error:
            parser.error(str(error))
        old, new = sides
        code = new.tree if (new.tree / "benchmarks" / "tasks.py").exists() else ROOT
        measuring = Path(folder) / "measuring"
        measuring.mkdir()
        for part in ("benchmarks", "grammars"):
            shutil.copytree(code / part, measuring / part)
        rows = measure_both((old, new), measuring, tasks, options.rounds, _tell)
    print("\n".join(table(rows)))
    for row in rows:
        if isinstance(row.old, str):
            print(f"not counted, as the old version cannot do it: {row.task}: {row.old}")
    faults = find_faults(rows, options.mean, options.row)
    for fault in faults:
        print(f"slower or broken: {fault}")
    return 1 if faults else 0
