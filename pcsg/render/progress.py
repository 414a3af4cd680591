"""A progress bar on a terminal: rays per second and the time that is left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from pcsg.render.job import Progress


@contextmanager
def show_progress() -> Iterator[Callable[[Progress], None]]:
    """Show a bar on standard error; yields the function that moves it."""
    bar = Bar(
        TextColumn("pass {task.fields[number]} of {task.fields[passes]}"),
        BarColumn(bar_width=None),
        TextColumn("{task.percentage:3.0f}%"),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        expand=True,
    )
    task = bar.add_task("", total=None, number=1, passes=1, rate="")

    def report(progress: Progress) -> None:
        rate = progress.rays / max(progress.seconds, 1e-9)
        bar.update(
            task,
            total=progress.expected,
            completed=progress.samples,
            number=progress.pass_number,
            passes=progress.passes,
            rate=f"{rate / 1e6:.2f} Mray/s",
        )

    with bar:
        yield report
