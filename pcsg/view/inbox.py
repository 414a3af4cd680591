"""Messages to a process that makes pictures: the newest wish counts, and questions are kept."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from multiprocessing.connection import Connection
from threading import Condition, Thread
from typing import Any, NamedTuple

from pcsg.view.wants import Want

PATIENCE = 0.15
"""Seconds that a coarse picture may take before it is given up for a newer one."""


class Message(NamedTuple):
    """A word and what belongs to it."""

    word: str
    content: Any = None


class Inbox:
    """Reads messages in a thread of its own, and interrupts what they make useless.

    Parameters
    ----------
    connection
        Where they come from.
    interrupt
        Ends the picture in the making; called from that thread.
    """

    def __init__(self, connection: Connection, interrupt: Callable[[], None]) -> None:
        self._connection, self._interrupt = connection, interrupt
        self._news = Condition()
        self._want: Want | None = None
        self._messages: deque[Message] = deque()
        self._is_new = self._closed = False
        self._glancing_since: float | None = None
        Thread(target=self._read, name="pcsg-inbox", daemon=True).start()

    def _read(self) -> None:
        while True:
            try:
                message = self._connection.recv()
            except (EOFError, OSError):
                message = None
            with self._news:
                if message is None:
                    self._closed = True
                elif message.word == "want":
                    self._want = message.content
                else:
                    self._messages.append(message)
                self._is_new = True
                self._news.notify()
            if self.superseded:
                self._interrupt()
            if message is None:
                return

    @property
    def superseded(self) -> bool:
        """Whether something has come since `take` for which the picture should end.

        A coarse picture is shown before the next one is made, or a hand that moves without a
        pause would see none.
        """
        begun = self._glancing_since
        return self._is_new and (begun is None or time.perf_counter() - begun > PATIENCE)

    def begin_glance(self) -> None:
        """Say that a coarse picture is being made, which is seldom worth being interrupted."""
        self._glancing_since = time.perf_counter()

    def end_glance(self) -> None:
        """Say that it is made."""
        self._glancing_since = None

    def take(self) -> tuple[Want | None, list[Message]] | None:
        """Wait for something new; return the newest wish and the other messages, None at the end.

        The wish is the one before where only other messages have come.
        """
        with self._news:
            while not self._is_new:
                self._news.wait()
            if self._closed:
                return None
            self._is_new = False
            messages = list(self._messages)
            self._messages.clear()
            return self._want, messages
