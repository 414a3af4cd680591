"""A bar for what takes long and is no picture."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

PATIENCE = 1.0
"""Seconds until a bar appears for what mostly is done at once."""


@contextmanager
def show_share(text: str, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """Show a bar on a terminal; yields the function that moves it, None where there is none."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=None), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True, expand=True) as bar:
        task = bar.add_task(text, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def show_preparation(name: str, quiet: bool) -> Iterator[None]:
    """Show on a terminal how far the preparation of a scene is, where it takes long."""
    if quiet or not sys.stderr.isatty():
        yield
        return
    from pcsg.trace.preparing import watched

    begin = time.perf_counter()
    move: Callable[[int, int], None] | None = None
    with ExitStack() as bars:

        def report(share: float | None) -> None:
            nonlocal move
            if move is None:
                if time.perf_counter() - begin < PATIENCE:
                    return
                move = bars.enter_context(show_share(f"preparing {name}", quiet))
            if move is not None and share is not None:
                move(round(1000.0 * share), 1000)

        with watched(report):
            yield
