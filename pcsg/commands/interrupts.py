"""Ctrl-C ends every command, also while one ray keeps a kernel busy.

Python tells the main thread of an interrupt when machine code has returned. A ray that meets a
billion solids in one place does not return, so a second thread listens, too.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread
from types import FrameType

from pcsg.commands.guard import INTERRUPTED, say

PATIENCE = 1.5
"""Seconds that machine code has to return after an interrupt, and threads after the last word."""


@contextmanager
def heard_interrupts() -> Iterator[None]:
    """Let an interrupt end the process, whatever its threads are in; the work is done within.

    What runs in the background of a shell ignores interrupts, and goes on doing so.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    told, over = Event(), Event()
    listener, speaker = socket.socketpair()
    speaker.setblocking(False)

    def tell(number: int, frame: FrameType | None) -> None:
        told.set()
        signal.default_int_handler(number, frame)

    def listen() -> None:
        listener.recv(1)
        if told.wait(PATIENCE):
            # The main thread saves what there is, however long that takes.
            over.wait()
            Event().wait(PATIENCE)
        else:
            say("interrupted, within a ray that does not end; what was kept before is kept")
        sys.stdout.flush()
        os._exit(INTERRUPTED)

    signal.signal(signal.SIGINT, tell)
    signal.set_wakeup_fd(speaker.fileno(), warn_on_full_buffer=False)
    Thread(target=listen, daemon=True).start()
    try:
        yield
    finally:
        over.set()
