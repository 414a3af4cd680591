"""A process that keeps one scene and makes pictures of it, as one page wants them.

It may be killed at any moment, and ends when the server does: an endless grammar, one that eats
memory, and a crash take this process only.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from decimal import Decimal
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.commands.parent import follow_pool
from pcsg.errors import PcsgError
from pcsg.render.job import Job
from pcsg.render.options import Options
from pcsg.render.progressive import UNKNOWN_PACE, Frame, Progressive
from pcsg.trace.preparing import watched
from pcsg.trace.rays import Stopped
from pcsg.view.answering import answers
from pcsg.view.encoding import color_layer, encode, lay_over, sample_depth
from pcsg.view.inbox import Inbox, Message
from pcsg.view.opening import (
    Limits,
    Opened,
    Prepared,
    describe_error,
    files_in,
    open_grammar,
    overrides_of,
)
from pcsg.view.sheet import make_tiles
from pcsg.view.wants import Question, SheetWant, Want

FAILURES = (PcsgError, MemoryError, RecursionError, OSError, ArithmeticError, ValueError)
"""What may go wrong with a scene; the page tells it."""

TOLD_EVERY = 0.3
"""Seconds between two words about how far a preparation is."""


QUICK = 3.0
"""Seconds of a scene's preparation up to which its parts are counted, too."""


def show_count(number: int) -> str:
    """Return a number as a line of figures has room for it."""
    return f"{number:,}" if number < 10**12 else f"{Decimal(number):.3g}"


@dataclass(frozen=True)
class Picture:
    """A picture for a page.

    Attributes
    ----------
    head
        What is said about it.
    depth
        Distances (rows, columns).
    data
        The bytes of a file.
    place
        Of the page: a newer picture for it makes this one useless.
    """

    head: dict[str, Any]
    depth: NDArray[np.float32]
    data: bytes
    place: str = "picture"


Send = Callable[[Any], None]


def serve(connection: Connection, path: str, limits: Limits) -> None:
    """Make pictures until the connection ends: the whole life of the process."""
    follow_pool()
    os.nice(1)  # the page itself comes first
    worker = Worker(connection.send, Path(path), limits)
    inbox = Inbox(connection, worker.interrupt)
    worker.inbox = inbox
    connection.send({"type": "ready"})
    while (news := inbox.take()) is not None:
        want, messages = news
        try:
            connection.send({"type": "taken"})
            worker.answer(messages)
            if want is not None and not worker.rests:
                worker.show(want)
        except (BrokenPipeError, ConnectionResetError):
            return


class Worker:
    """What the process knows.

    Parameters
    ----------
    send
        Takes dictionaries and pictures for the page.
    path
        The grammar.
    limits
        What a scene may take.

    Attributes
    ----------
    rests
        Whether nobody looks.
    """

    inbox: Inbox

    def __init__(self, send: Send, path: Path, limits: Limits) -> None:
        self._send, self._path, self._limits = send, path, limits
        self._is_stale = True
        self._opened_path = path
        self._draft: Path | None = None
        self._opened: Opened | None = None
        self._prepared: Prepared | None = None
        self._progressive: Progressive | None = None
        # What cannot be prepared, so that it is not tried for every step of the camera.
        self._refused: tuple[Opened, Mapping[str, float]] | None = None
        self._shown: Want | None = None
        self._below: NDArray[np.uint8] | None = None
        self._job: Job | None = None
        self._counted: Prepared | None = None
        self._took = 0.0
        self._file_is_due = False
        self.rests = False

    def interrupt(self) -> None:
        """End the picture in the making; called from another thread."""
        if self._progressive is not None:
            self._progressive.interrupt()

    def answer(self, messages: list[Message]) -> None:
        """Do what was asked besides the picture."""
        for message in messages:
            if message.word == "reload":
                self._is_stale, self._opened_path = True, self._path
            elif message.word == "draft":
                self._opened_path = self._draft = Path(message.content)
                self._is_stale = True
            elif message.word == "again":
                self.rests, self._shown, self._refused = False, None, None
                self._tell_scene(0.0)
            elif message.word == "rest":
                self.rests = True
            elif message.word == "ask":
                self._answer(message.content)
            elif message.word == "sheet":
                self._make_sheet(message.content)
            elif message.word == "file":
                self._file_is_due = True
                self._send_file()

    def _answer(self, question: Question) -> None:
        if self._prepared is None:
            return
        try:
            for found in answers(self._prepared, question):
                self._send(found)
        except PcsgError as error:
            self._tell_errors(error)

    def _make_sheet(self, sheet: SheetWant) -> None:
        if self._opened is None:
            return
        tiles = make_tiles(self._opened, sheet, self._limits, lambda: self.inbox.superseded)
        for k, tile in enumerate(tiles):
            head = {"type": "tile", "index": k, "value": sheet.steps[k]}
            if isinstance(tile, str):
                self._send({**head, "error": tile})
                continue
            data, kind = encode(tile.to_bytes(), False)
            nothing = np.zeros((0, 0), np.float32)
            self._send(Picture({**head, "kind": kind}, nothing, data, f"tile {k}"))

    def _send_file(self) -> None:
        """Send the picture as the file that ``pcsg render`` writes, once it is done."""
        if not self._file_is_due or self._shown is None or self._job is None:
            return
        self._file_is_due = False
        picture = self._job.image()
        name = f"{self._path.stem}.png"
        head = {"type": "file", "kind": "image/png", "name": name}
        self._send(Picture(head, np.zeros((0, 0), np.float32), picture._repr_png_(), "file"))

    def show(self, want: Want) -> None:
        """Show what a page wants, unless it has it.

        Where the grammar is wrong, or has no picture for the values, the last good one stays and
        can be looked at from all sides.
        """
        wanted, before = replace(want, number=0, moving=False), self._prepared
        if self._shown == wanted and not self._is_stale:
            return
        with self._telling_errors():
            self._prepare(want)
        if self._prepared is None or (self._prepared is before and self._shown == wanted):
            return
        self._shown = None
        with self._telling_errors():
            if self._draw(want):
                self._shown = wanted
                self._send_file()
                self._count()

    @contextmanager
    def _telling_errors(self) -> Iterator[None]:
        """Tell the page what goes wrong within, but not that something newer was wanted."""
        try:
            yield
        except Stopped:
            return
        except (BrokenPipeError, ConnectionResetError):
            raise
        except FAILURES as error:
            self._tell_errors(error)

    def _tell_errors(self, error: BaseException) -> None:
        files = set(self._opened.files if self._opened else ())
        files |= files_in(getattr(error, "diagnostics", ()))
        told = describe_error(error)
        self._send({"type": "errors", "errors": told, "files": self._saved(files)})

    def _count(self) -> None:
        """Tell what the scene consists of, once; where its preparation took long, so would this."""
        if self._prepared is None or self._prepared is self._counted or self._took > QUICK:
            return
        self._counted = self._prepared
        primitives = self._prepared.scene.stats()["primitives"]
        self._send({"type": "counts", "primitives": show_count(primitives)})

    def _saved(self, files: Iterable[str]) -> list[str]:
        """Return the files that somebody may save: a draft is none."""
        return sorted({str(self._path), *files} - {str(self._draft)})

    def _prepare(self, want: Want) -> None:
        """Have the scene with the values that are wanted.

        Raises
        ------
        PcsgError
            There is none; the one before stays.
        """
        if self._is_stale:
            self._is_stale = False
            self._opened = None
            self._send({"type": "preparing", "share": None})
            self._opened = open_grammar(self._opened_path, self._limits.include)
        opened, before = self._opened, self._prepared
        if opened is None or self._refused == (opened, want.values):
            return
        if before is not None and before.opened is opened and before.values == want.values:
            return
        self._refused = opened, want.values
        begin = told = time.perf_counter()

        def report(share: float | None) -> None:
            nonlocal told
            if time.perf_counter() - told > TOLD_EVERY:
                told = time.perf_counter()
                self._send({"type": "preparing", "share": share})

        self._send({"type": "preparing", "share": None})
        with watched(report):
            prepared = Prepared.make(
                opened, want.values, self._limits, want.size, self._tell_compiling
            )
        self._refused = None
        self.adopt(prepared)
        self._took = time.perf_counter() - begin
        self._tell_scene(self._took)

    def adopt(self, prepared: Prepared) -> None:
        """Show a scene from now on."""
        self._opened, self._prepared, self._is_stale = prepared.opened, prepared, False
        self._below = None
        self._progressive = Progressive(
            prepared.scene,
            prepared.stage_for(Want()),
            {},
            lambda: self.inbox.superseded,
            self._limits.threads,
            UNKNOWN_PACE if self._progressive is None else self._progressive.pace,
        )

    def _tell_compiling(self) -> None:
        self._send({"type": "preparing", "share": None, "compiling": True})

    def _tell_scene(self, seconds: float) -> None:
        if self._prepared is None:
            return
        files = self._saved(self._prepared.opened.files)
        self._send({"type": "scene", **self._prepared.describe(), "files": files, "took": seconds})

    def _draw(self, want: Want) -> bool:
        """Draw what is wanted; return whether nothing finer is to come."""
        assert self._prepared is not None
        assert self._progressive is not None
        overrides = overrides_of(want.camera, want.mode)
        self._progressive.turn(self._prepared.stage_for(want), overrides)
        options = Options(
            want.size,
            want.samples,
            threads=self._limits.threads,
            max_memory=self._limits.max_memory,
        )
        if want.moving:
            self.inbox.begin_glance()
            try:
                frame = self._progressive.glance(options)
            finally:
                self.inbox.end_glance()
            self._send_frame(frame, want)
            return False
        self._job = self._progressive.refine(options, lambda frame: self._send_frame(frame, want))
        return True

    def _send_frame(self, frame: Frame, want: Want) -> None:
        pixels = lay_over(color_layer(frame.image, want.layer), self._below)
        if frame.divisor > 1 or frame.done:
            self._below = pixels
        data, kind = encode(pixels, frame.done)
        depth = sample_depth(frame.image)
        camera = frame.stage.camera
        head = {
            "type": "frame",
            "number": want.number,
            "kind": kind,
            "grid": [depth.shape[1], depth.shape[0]],
            "camera": {
                "eye": camera.eye,
                "target": camera.target,
                "up": camera.up,
                "fov": math.degrees(camera.angle),
                "projection": camera.projection,
                "height": camera.height,
            },
            "own_camera": not want.camera,
            "size": want.size,
            "divisor": frame.divisor,
            "done": frame.done,
            "samples": frame.samples,
            "rays": frame.rays,
            "seconds": frame.seconds,
        }
        self._send(Picture(head, depth, data))
