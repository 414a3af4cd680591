"""Columns of tables in expressions: `Lookup` is the number of a row in a column."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import SourceSpan
from pcsg.graph.expr import Apply, Expr
from pcsg.graph.functions import COLUMN


class Column:
    """A column of numbers.

    Parameters
    ----------
    name
        Its name in the table.
    values : float64 (N,)
        Finite numbers, which nobody changes.
    """

    def __init__(self, name: str, values: NDArray[np.float64]) -> None:
        self.name = name
        self.values = np.ascontiguousarray(values, np.float64)
        self.values.flags.writeable = False

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def range(self) -> tuple[float, float]:
        """The smallest and the largest of its numbers; (0, 0) without any."""
        if len(self.values) == 0:
            return 0.0, 0.0
        return float(self.values.min()), float(self.values.max())

    @cached_property
    def digest(self) -> str:
        """What tells its numbers from others."""
        return hashlib.sha256(self.values.tobytes()).hexdigest()[:16]

    @property
    def key(self) -> tuple[str, str]:
        """A value that is equal for, and only for, columns that are alike."""
        return self.name, self.digest

    def at(self, row: float) -> float:
        """Return the number of a row, counted from 1; NaN where there is none."""
        if not 1.0 <= row <= len(self.values):
            return float("nan")
        return float(self.values[int(row) - 1])

    def __copy__(self) -> Column:
        return self

    def __deepcopy__(self, memo: object) -> Column:
        return self


@dataclass(frozen=True, eq=False, slots=True)
class Lookup(Apply):
    """The number of a row in a column; rows count from 1.

    Attributes
    ----------
    column
        None in no lookup that is made by `look_up`.
    """

    column: Column | None = None

    def with_args(self, args: tuple[Expr, ...]) -> Lookup:
        """Return the same lookup of another row."""
        return Lookup(self.function, args, self.seeds, self.span, self.column)

    @property
    def head(self) -> tuple[object, ...]:
        """The function, and which column it reads."""
        assert self.column is not None
        return self.function, self.seeds, self.column.key


def look_up(column: Column, row: Expr, span: SourceSpan | None = None) -> Lookup:
    """Return the number of a row in a column."""
    return Lookup(COLUMN, (row,), 0, span, column)


class Table:
    """A table whose rows a `scatter` places.

    Parameters
    ----------
    columns
        Columns of numbers by their names, all of one length.
    words
        Numbers from 1 for the words of a column, by its name: what the grammar says, as text.
    text
        The name of its file as written in a grammar; None where there is none.
    """

    def __init__(
        self, columns: Mapping[str, Column], words: Mapping[str, str], text: str | None
    ) -> None:
        self.columns = dict(columns)
        self.words = dict(words)
        self.text = text

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def __copy__(self) -> Table:
        return self

    def __deepcopy__(self, memo: object) -> Table:
        return self
