"""What a scene's preparation tells while it lasts, and asks before it takes memory."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from pcsg.errors import EnvironmentFault
from pcsg.memory import show_bytes

Report = Callable[[float | None], None]
"""Is told which share is done, from 0 to 1; None where nobody knows."""

_watching = threading.local()


@contextmanager
def watched(report: Report) -> Iterator[None]:
    """Have preparations of this thread tell how far they are."""
    before = getattr(_watching, "report", None)
    _watching.report = report
    try:
        yield
    finally:
        _watching.report = before


@dataclass(frozen=True)
class Preparation:
    """A part of a scene's preparation.

    Attributes
    ----------
    name
        Of the grammar.
    max_bytes
        Memory that may be taken.
    begin, end
        Which share of the preparation it is.
    """

    name: str = "the scene"
    max_bytes: int = 1 << 62
    begin: float = 0.0
    end: float = 1.0

    def tell(self, share: float | None) -> None:
        """Tell how much of this part is done."""
        report: Report | None = getattr(_watching, "report", None)
        if report is not None:
            width = self.end - self.begin
            report(None if share is None else self.begin + width * min(1.0, share))

    def require(self, needed: float) -> None:
        """Ask for memory, before it is taken.

        Raises
        ------
        EnvironmentFault
            There is not so much.
        """
        if needed > self.max_bytes:
            raise EnvironmentFault(
                f"{self.name}: its preparation needs {show_bytes(needed)} of memory, but only"
                f" {show_bytes(self.max_bytes)} are allowed; a larger --max-memory helps, or"
                " --block-memory 16M, which makes states on demand"
            )


UNLIMITED = Preparation()
"""For preparations that nobody waits for."""
