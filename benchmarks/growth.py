"""Growing trees: counts beside the paper's, time and size of a tree at an instant."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from benchmarks.report import Effort, Row, Subject, best_times
from pcsg.growth.model import GrowthModel
from pcsg.growth.state import State

# The paper's last picture: 181,692 primitives and 22,220 operation nodes.
PAPER = (181_692, 22_220)


def state_bytes(state: State) -> int:
    """Return the memory of all arrays of a tree at an instant."""
    tables: list[Any] = [getattr(state, f.name) for f in fields(state)]
    arrays = [a for t in tables if hasattr(t, "__dict__") for a in vars(t).values()]
    return sum(getattr(a, "nbytes", 0) for a in arrays)


def instants(effort: Effort) -> Iterator[Row]:
    model = GrowthModel.load("populus")
    for year in (1, 5) if effort.tiny else (1, 5, 10, 15, 20, 27):
        t = year - 0.4
        model.at(t)
        taken = best_times({"at": lambda: model.at(t)}, effort.repeats, time.process_time)["at"]  # noqa: B023
        c = model.counts(year)
        values = (c.operators, c.primitives, state_bytes(model.at(t)) / 1e6, taken)
        yield Row(f"populus, t = {t:g}", values, taken, 2.0, at_most=True)
    last = model.counts(model.species.ymax)
    for what, found, paper in (
        ("primitives", last.primitives, PAPER[0]),
        ("operators", last.operators, PAPER[1]),
    ):
        off = abs(found / paper - 1.0)
        yield Row(f"{what} beside the paper's {paper:,}", (None,) * 4, off, 0.03, at_most=True)


INSTANTS = Subject(
    "growth",
    "Growing trees",
    "A tree at an instant: what it counts at the end of that year, megabytes of its arrays, "
    "seconds of processor time without the table of years; then relative deviations.",
    ("operators", "primitives", "MB", "s"),
    instants,
)
