"""Processes that work for another one, and end when it does, however it ends.

Linux kills them itself. Elsewhere, and where a process was given to another parent before it could
ask for that, a thread waits for the end of a pipe that only the parent holds open.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from threading import Thread
from typing import Any

TIED = "PCSG_TIED"
"""Environment variable of a process that ends with its standard input."""

_PR_SET_PDEATHSIG = 1


def follow_pool() -> None:
    """Let this process of a pool end when the one that made it does, and at a Ctrl-C at once."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    assert parent is not None
    _follow(parent.join)


def start_tied(command: Sequence[str], **options: Any) -> subprocess.Popen[str]:
    """Start a command of pcsg that ends when this process does; options as for `Popen`."""
    environment = {**os.environ, TIED: "1"}
    return subprocess.Popen(command, stdin=subprocess.PIPE, text=True, env=environment, **options)


def follow_if_tied(environment: Mapping[str, str] = os.environ) -> None:
    """Let this process end when the one that started it does, if it was started so."""
    if environment.get(TIED):
        descriptor = sys.stdin.fileno()

        def wait() -> None:
            while os.read(descriptor, 1024):
                pass

        _follow(wait)


def _follow(wait: Callable[[], object]) -> None:
    """End when a function returns, which waits for the parent's end."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)

    def end() -> None:
        wait()
        # Nothing is left to be told, and nobody to tell it to.
        os._exit(1)

    Thread(target=end, name="pcsg-parent", daemon=True).start()
