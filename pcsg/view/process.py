"""A process that makes pictures, as the server holds it: messages to it and from it, its memory."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Thread
from typing import Any

from pcsg.memory import show_bytes
from pcsg.view.inbox import Message
from pcsg.view.opening import Limits

_CONTEXT = multiprocessing.get_context("spawn")
"""Started afresh: a process that is forked while threads run may hang."""


@dataclass(frozen=True)
class Ended:
    """What a process leaves: its exit status, negative for a signal."""

    status: int | None


class Process:
    """One process and the thread that listens to it.

    Parameters
    ----------
    path, limits
        What it opens.
    receive
        Called in the event loop with everything that the process says, and `Ended` at its end.
    """

    def __init__(self, path: Path, limits: Limits, receive: Callable[[Any], None]) -> None:
        from pcsg.view.worker import serve

        self._loop = asyncio.get_running_loop()
        self._receive = receive
        self._connection, theirs = _CONTEXT.Pipe()
        self._process: BaseProcess = _CONTEXT.Process(
            target=serve, args=(theirs, str(path), limits), name="pcsg-view", daemon=True
        )
        # In the main thread: a process may end with the thread that has started it.
        self._process.start()
        theirs.close()
        self._over = False
        Thread(target=self._listen, name="pcsg-listener", daemon=True).start()

    def redirect(self, receive: Callable[[Any], None]) -> None:
        """Let somebody else hear what the process says from now on."""
        self._receive = receive

    def send(self, message: Message) -> None:
        """Tell the process something; nothing happens where it has ended."""
        try:
            self._connection.send(message)
        except (OSError, ValueError):
            return

    def _listen(self) -> None:
        while True:
            try:
                said = self._connection.recv()
            except (EOFError, OSError, TypeError):
                break
            self._pass_on(said)
        self._process.join()
        self._pass_on(Ended(self._process.exitcode))

    def _pass_on(self, said: Any) -> None:
        if self._over:
            return
        try:
            self._loop.call_soon_threadsafe(self._hand_on, said)
        except RuntimeError:
            return  # the loop is closed: the server ends

    def _hand_on(self, said: Any) -> None:
        """In the event loop: who hears may have changed since it was said."""
        if not self._over:
            self._receive(said)

    def end(self) -> None:
        """End the process, whatever it does; nothing more comes from it."""
        self._over = True
        self._process.kill()

    @property
    def memory(self) -> int:
        """Bytes that it has in memory; 0 where the system does not tell."""
        try:
            pages = int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1])
        except (OSError, ValueError, IndexError):
            return 0
        return pages * os.sysconf("SC_PAGE_SIZE")


def tell_end(ended: Ended) -> str:
    """Return in words why a process has ended by itself."""
    status = ended.status
    if status is not None and status < 0:
        why = "perhaps for want of memory" if status == -9 else f"by signal {-status}"
        return (
            f"the process that made the picture was ended, {why};"
            " it starts again when the file is saved or a value changes"
        )
    return (
        f"the process that made the picture ended by itself (status {status});"
        " it starts again when the file is saved or a value changes"
    )


def tell_memory(limit: int) -> str:
    """Return in words that a process was ended for its memory."""
    return (
        f"the scene needed more than {show_bytes(limit)} of memory, and was given up;"
        " a lower order helps, or a larger --max-memory"
    )
