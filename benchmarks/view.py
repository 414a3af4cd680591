"""Seeing it live: how soon pictures come, counted by a client without a window."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread, Timer
from typing import Any

from benchmarks.report import Effort, Row, Subject
from benchmarks.scenes import GRAMMARS, HERE

SECONDS = 5.0
"""For counting pictures while something turns."""

BROWSER = 3.0
"""Seconds that a browser takes to open; the server has begun to read the grammar then."""

RELOADS = 1000

FEW = GRAMMARS / "sierpinski.pcsg"
MANY = HERE / "grammars" / "village.pcsg"
TREE = GRAMMARS / "tree.pcsg"


class Window:
    """A client of ``pcsg view``: what a page does, without a page."""

    def __init__(self, socket: Any, size: tuple[int, int]) -> None:
        self._socket, self._size, self._number = socket, size, 0

    def want(self, **more: Any) -> int:
        self._number += 1
        message = {"type": "want", "size": self._size, "number": self._number, **more}
        self._socket.send(json.dumps(message))
        return self._number

    def frame(self, number: int) -> dict[str, Any]:
        """Return the first picture that answers a wish."""
        while True:
            message = self._socket.recv(timeout=300)
            if isinstance(message, bytes):
                (size,) = struct.unpack("<I", message[:4])
                head: dict[str, Any] = json.loads(message[8 : 8 + size])
                if head["type"] == "frame" and head["number"] >= number:
                    return head


@contextmanager
def served(path: Path) -> Iterator[Any]:
    """Serve a file; yields what opens a window: a function of a name and a size."""
    from websockets.sync.client import connect

    with subprocess.Popen(
        [sys.executable, "-m", "pcsg", "view", str(path), "--no-browser"],
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        found = re.search(r"(http://\S+)/#token=(\S+)", process.stderr.readline())
        assert found is not None
        address, token = found.groups()

        @contextmanager
        def window(name: str, size: tuple[int, int] = (400, 300)) -> Iterator[Window]:
            place = address.replace("http", "ws") + "/ws"
            with connect(place, origin=address, max_size=None) as socket:  # type: ignore[arg-type]
                socket.send(json.dumps({"token": token, "window": name}))
                yield Window(socket, size)

        try:
            yield window
        finally:
            process.terminate()


def rows(effort: Effort) -> Iterator[Row]:
    yield from _first(effort)
    few = {"c": 3.0} if effort.tiny else {"c": 40.0}
    tree = {"cnt": 3.0} if effort.tiny else {}
    yield _turning("tree", TREE, tree, 15.0, effort)
    yield _turning("Sierpinski 40", FEW, few, 30.0, effort)
    small = 100.0 if effort.tiny else 10_000.0
    yield _changed("a slider's new scene, few states", FEW, "c", (5.0, 6.0, 7.0), 0.3)
    yield _changed("a change of 10,000 states", MANY, "n", (small, small + 1.0, small + 2.0), 1.0)
    yield _stopped(effort)
    yield _reloaded(20 if effort.tiny else RELOADS)


def _first(effort: Effort) -> Iterator[Row]:
    """A window that opens: it takes the process that waits."""
    times = []
    for k in range(1 + min(3, effort.repeats)):  # the first may have to compile
        with served(FEW) as window:
            time.sleep(BROWSER)
            start = time.perf_counter()
            with window(f"first {k}") as page:
                page.frame(page.want())
                times.append(time.perf_counter() - start)
    seconds = min(times[1:])
    yield Row("first picture after the page", (seconds, None, None), seconds, 0.5, at_most=True)
    with served(FEW) as window:
        with window("one") as page:
            page.frame(page.want())
        time.sleep(BROWSER + 2.0)
        start = time.perf_counter()
        with window("two") as page:
            page.frame(page.want())
        seconds = time.perf_counter() - start
    yield Row("first picture of a second window", (seconds, None, None))


def _turning(name: str, path: Path, values: dict[str, float], target: float, effort: Effort) -> Row:
    with served(path) as window, window("turning") as page:
        camera = page.frame(page.want(values=values))["camera"]
        x, y, z = camera["eye"]

        def turn(seconds: float) -> tuple[int, float, float]:
            """Return the pictures, as they are and as whole ones, and the seconds they took."""
            count, pixels, begin = 0, 0.0, time.perf_counter()
            while time.perf_counter() - begin < seconds:
                eye = [x + 0.01 * (count % 50), y, z]
                wanted = page.want(values=values, camera={**camera, "eye": eye}, moving=True)
                pixels += 1.0 / page.frame(wanted)["divisor"] ** 2
                count += 1
            return count, pixels, time.perf_counter() - begin

        turn(0.2 if effort.tiny else 2.0)  # finds out how large pictures may be
        count, pixels, taken = turn(0.5 if effort.tiny else SECONDS)
    rate, whole = count / taken, pixels / taken
    return Row(f"{name}, turning, 400x300", (None, rate, whole), whole, target)


def _changed(
    what: str, path: Path, name: str, values: tuple[float, float, float], target: float
) -> Row:
    with served(path) as window, window("changed") as page:
        times = []
        for value in values:
            start = time.perf_counter()
            page.frame(page.want(values={name: value}))
            times.append(time.perf_counter() - start)
    seconds = min(times[1:])
    return Row(what, (seconds, None, None), seconds, target, at_most=True)


def _stopped(effort: Effort) -> Row:
    """From the interrupt to the end of the picture in the making."""
    import pcsg
    from pcsg.render.options import Options
    from pcsg.render.progressive import Progressive
    from pcsg.render.stage import build_stage
    from pcsg.trace.rays import Stopped

    scene = pcsg.load(TREE, parameters={"cnt": 3.0} if effort.tiny else {})
    worst, told = 0.0, [False]
    for k in range(3 if effort.tiny else 10):
        told[0] = False
        makes = Progressive(scene, build_stage(scene, (800, 600), {}), {}, lambda: told[0])
        begun = [0.0]

        def stop(makes: Progressive = makes, begun: list[float] = begun) -> None:
            begun[0], told[0] = time.perf_counter(), True
            makes.interrupt()

        timer = Timer(0.5 + 0.15 * k, stop)
        timer.start()
        try:
            makes.refine(Options((800, 600), 64), lambda frame: None)
        except Stopped:
            worst = max(worst, time.perf_counter() - begun[0])
        timer.join()
    return Row("stop, the longest of ten", (worst, None, None), worst, 0.05, at_most=True)


def _reloaded(count: int) -> Row:
    """Megabytes that a process gains by so many saves of its file."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.view", folder, str(count)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    gained = float(done.stdout.split()[-1])
    return Row(f"MB gained by {count:,} reloads", (None, None, None), gained, 20.0, at_most=True)


def _reload(folder: Path, count: int) -> None:
    from multiprocessing import Pipe

    from pcsg.view.inbox import Inbox, Message
    from pcsg.view.opening import Limits
    from pcsg.view.wants import Want
    from pcsg.view.worker import Worker

    file = folder / "reloaded.pcsg"
    file.write_text("sphere\n")
    _ours, theirs = Pipe()
    worker = Worker(lambda said: None, file, Limits())
    worker.inbox = Inbox(theirs, worker.interrupt)
    before = 0.0
    for k in range(count):
        file.write_text(
            f"{{n = {k % 7}}} S\nS if(n > 0, 1, 2)\n1: S -> box | {{n = n-1}} S\n2: S -> cone\n"
        )
        worker.answer([Message("reload")])
        worker.show(Want(size=(32, 24), samples=1))
        if k == count // 10:
            before = _resident()
    print(_resident() - before)


def _resident() -> float:
    words = Path("/proc/self/statm").read_text(encoding="ascii").split()
    return int(words[1]) * 4096 / 1e6


VIEW = Subject(
    "view",
    "Seeing it live",
    "`pcsg view` as a client without a window sees it. Seconds until the first picture; pictures a"
    " second while the camera moves, as they are, and as whole ones that have as many pixels.",
    ("seconds", "pictures/s", "of whole size"),
    rows,
)

if __name__ == "__main__":
    # The inbox's thread keeps a process alive that nobody tells to end.
    work = Thread(target=_reload, args=(Path(sys.argv[1]), int(sys.argv[2])))
    work.start()
    work.join()
