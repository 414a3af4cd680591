"""Kills commands at random moments and lets them go on: ``python -m tests.fuzz.kills -n 50``.

Nothing of a killed command may run on, and what comes of it in the end is, to the last byte, what
comes of one that nobody killed.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

SECONDS = 2.0
"""Longest that anything may run on."""

GRAMMAR = """\
{n = 3} T
T if(n > 0, 2, 1)
1: T -> sphere
2: T -> sphere | {n = n-1} move(1.5*sin(90*TIME), 0, 1) uscale(0.7) T | {n = n-1} move(1, 1, 1) T
ground { z = -1 }
film { mode = path }
"""


@dataclass(frozen=True)
class Command:
    """What is killed.

    Attributes
    ----------
    start, again
        Its words; those with which it goes on.
    """

    name: str
    start: tuple[str, ...]
    again: tuple[str, ...]


_RENDER = ("render", "t.pcsg", "--size", "64x48", "--samples", "64", "-o", "out/a.png", "-q")
_RENDER += ("--show-every", "0.05", "--threads", "2")  # checkpoints come as often
_ANIMATE = ("animate", "t.pcsg", "--size", "48x36", "--samples", "16", "--frames", "0..5", "-q")
_ANIMATE += ("--jobs", "2", "-o", "out/a.webp")
_GALLERY = ("gallery", "--render", "sierpinski", "menger", "leaf", "--size", "48x36", "-o", "out")

COMMANDS = (
    Command("render", _RENDER, (*_RENDER, "--resume")),
    Command("animate", _ANIMATE, (*_ANIMATE, "--resume")),
    Command("gallery", _GALLERY, _GALLERY),
)


def start(words: tuple[str, ...], folder: Path) -> subprocess.Popen[bytes]:
    """Start a command in a folder, in a group of processes of its own."""
    (folder / "t.pcsg").write_text(GRAMMAR)
    (folder / "out").mkdir(exist_ok=True)
    with (folder / "told").open("wb") as told:
        return subprocess.Popen(
            [sys.executable, "-m", "pcsg", *words],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
            stdout=told,
            stderr=told,
            start_new_session=True,
        )


def run(words: tuple[str, ...], folder: Path) -> dict[str, bytes]:
    """Run a command to its end; return the files that it has made."""
    process = start(words, folder)
    if process.wait(timeout=600) != 0:
        raise AssertionError((folder / "told").read_text())
    files = (folder / "out").rglob("*")
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files if p.is_file()}


def alive(group: int) -> list[int]:
    """Return the processes of a group that run."""
    found = []
    for entry in Path("/proc").iterdir():
        # What has ended meanwhile is not there any more.
        with contextlib.suppress(OSError):
            if entry.name.isdigit():
                state, _, its = (entry / "stat").read_text().rpartition(")")[2].split()[:3]
                if int(its) == group and state not in "ZX":
                    found.append(int(entry.name))
    return found


def kill(words: tuple[str, ...], folder: Path, after: float) -> tuple[float, bool]:
    """Kill a command after some seconds.

    Returns
    -------
    took, killed
        How long anything of it ran on; whether it had not ended before.
    """
    process = start(words, folder)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(timeout=after)
    process.kill()
    stopped = process.wait() == -signal.SIGKILL
    killed = time.monotonic()
    while alive(process.pid) and time.monotonic() - killed < 10 * SECONDS:
        time.sleep(0.01)
    took = time.monotonic() - killed
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    return took, stopped


def withstand_kills(command: Command, kills: int, seed: int = 1) -> str:
    """Kill a command again and again; an assertion fails with what went wrong.

    Returns
    -------
    str
        What was seen.
    """
    rng = random.Random(f"{command.name} {seed}")
    longest, killed, undone = 0.0, 0, 0
    with tempfile.TemporaryDirectory() as place:
        # The first run may have to compile, which would be the moment of most kills.
        whole = run(command.start, _folder(place, "first"))
        began = time.monotonic()
        assert whole == run(command.start, _folder(place, "whole")) != {}
        needed = time.monotonic() - began
        for k in range(kills):
            folder = _folder(place, str(k))
            after = rng.uniform(0.0, needed)
            took, stopped = kill(command.start, folder, after)
            killed += stopped
            longest = max(longest, took)
            assert took <= SECONDS, f"{command.name}, killed after {after:.2f} s, ran on"
            undone += any((folder / "out").iterdir())
            made = run(command.again, folder)
            different = [n for n in {**whole, **made} if made.get(n) != whole.get(n)]
            assert not different, f"{command.name}, killed after {after:.2f} s: {different}"
    return (
        f"{command.name}: {killed} of {kills} killed within {needed:.1f} s, {undone} had left"
        f" something;"
        f" the same bytes, nothing ran on for more than {longest:.2f} s"
    )


def _folder(place: str, name: str) -> Path:
    folder = Path(place, name)
    folder.mkdir()
    return folder


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.kills")
    parser.add_argument("command", nargs="*", help="render, animate or gallery; default all")
    parser.add_argument("-n", type=int, default=50, help="kills of each")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    failed = False
    for command in COMMANDS:
        if command.name in (asked.command or [c.name for c in COMMANDS]):
            try:
                print(withstand_kills(command, asked.n, asked.seed), flush=True)
            except AssertionError as error:
                print(error, flush=True)
                failed = True
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
