"""A process that waits ready, so that a window need not wait for one to start.

The first has the scene already when the browser opens. Those after it have only loaded what all
need: a grammar that does not end must not keep a processor busy behind everybody's back.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pcsg.memory import half_of_memory
from pcsg.view.document import Watch
from pcsg.view.inbox import Message
from pcsg.view.opening import Limits
from pcsg.view.process import Ended, Process
from pcsg.view.wants import Want
from pcsg.view.worker import Picture

LONGEST = 120.0
"""Seconds that a process may take to be ready; kernels may have to be compiled."""

PAUSE = 2.0
"""Seconds after which another is started for one that was taken: the page has its picture then."""

FIRST_LOOK = Want(size=(64, 48), samples=1)


class Standby:
    """Starts processes for windows, one ahead.

    Parameters
    ----------
    path, limits
        What they open.
    values
        Of parameters, that the first window has.
    launch
        Starts a process: `Process`, or a test's.
    """

    def __init__(
        self,
        path: Path,
        limits: Limits,
        values: Mapping[str, float],
        launch: Callable[..., Any] = Process,
    ) -> None:
        self._path, self._limits, self._start = path, limits, launch
        self._taken_at = time.monotonic()
        self._watch = Watch([path])
        self._most = limits.max_memory or half_of_memory()
        self._is_useless = False
        self._process: Process | None = self._launch()
        self._process.send(Message("want", replace(FIRST_LOOK, values=values)))
        self._has_wish = True

    def _launch(self) -> Process:
        self._is_idle = self._has_wish = False
        launched: Process = self._start(self._path, self._limits, self._hear)
        return launched

    def _hear(self, said: Any) -> None:
        if isinstance(said, Ended):
            self._process = None
        elif isinstance(said, Picture):
            self._is_idle = said.head.get("done", False)
        elif said["type"] == "errors" or (said["type"] == "ready" and not self._has_wish):
            self._is_idle = True

    def start(self, path: Path, limits: Limits, receive: Callable[[Any], None]) -> Process:
        """Return a process for a window: the one that waits, if it is ready."""
        ready, self._process = self._process, None
        self._is_useless = False
        self._taken_at = time.monotonic()
        if ready is not None and self._is_idle:
            ready.redirect(receive)
            # The window knows nothing of the scene, and the file may have changed since.
            if self._watch.changed():
                ready.send(Message("reload"))
            ready.send(Message("again"))
            return ready
        if ready is not None:
            ready.end()
        fresh: Process = self._start(path, limits, receive)
        return fresh

    def tick(self) -> None:
        """Start the next one when there is time for it; end one that is of no use."""
        waited = time.monotonic() - self._taken_at
        if self._process is not None and (
            (waited > LONGEST and not self._is_idle) or self._process.memory > self._most
        ):
            self.end()
            self._is_useless = True
        if self._process is None and waited > PAUSE and not self._is_useless:
            self._process = self._launch()

    def end(self) -> None:
        """End the process that waits."""
        if self._process is not None:
            self._process.end()
            self._process = None
