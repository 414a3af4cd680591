"""Files of tables: CSV with a header, and NumPy's arrays with named fields; read to plain columns.

Text is parsed in pieces, straight into arrays: a million rows take a second and little memory.
Where a piece is not all numbers, it is read cell by cell, so that the mistake has its place.
"""

from __future__ import annotations

import csv
import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.inputs import open_bytes, read_bytes

TABLE_ENDINGS = (".csv", ".tsv", ".txt", ".npy", ".npz")

LARGEST_FILE = 1 << 30
"""Bytes of a file at most: some ten million rows."""

_PIECE = 1 << 22
"""Bytes that are parsed in one go."""

_DELIMITERS = (b"\t", b";", b",")


class TableColumns(NamedTuple):
    """What a file says, column by column.

    Attributes
    ----------
    numbers : dict of str to float64 (N,)
        Columns of finite numbers.
    words : dict of str to list of str
        Columns of anything else, N words each.
    """

    numbers: dict[str, NDArray[np.float64]]
    words: dict[str, list[str]]


def read_table(path: Path, needed: Sequence[str] = ()) -> TableColumns:
    """Read a table.

    Parameters
    ----------
    path
        A file with an ending of `TABLE_ENDINGS`.
    needed
        Columns that must be numbers wherever they are there.

    Raises
    ------
    UsageError
        What is wrong with the file, with line and column.
    """
    ending = path.suffix.lower()
    if ending not in TABLE_ENDINGS:
        known = ", ".join(TABLE_ENDINGS)
        raise UsageError(f"cannot read the table `{path}`: its name must end in one of {known}")
    if ending in (".npy", ".npz"):
        return _read_arrays(path, needed)
    return _Text(path, needed).read()


def columns_of(table: Any, what: str, needed: Sequence[str] = ()) -> TableColumns:
    """Return the columns of a mapping to arrays, a structured array or a data frame.

    Parameters
    ----------
    table
        Whatever gives an array for each of its names.
    what
        How to call it in messages.
    needed
        As for `read_table`.

    Raises
    ------
    UsageError
        It is no table, columns have different lengths, or a number is not finite.
    """
    names = getattr(getattr(table, "dtype", None), "names", None)
    if names is None and isinstance(table, Mapping):
        names = list(table)
    if names is None:
        names = getattr(table, "columns", None)
    if names is None or not all(isinstance(name, str) for name in names):
        raise UsageError(
            f"{what} is a dict of arrays, a structured array or a data frame with named columns"
        )
    found = TableColumns({}, {})
    lengths = set()
    for name in names:
        values = np.asarray(table[name])
        if values.ndim != 1:
            raise UsageError(f"column `{name}` of {what} has shape {values.shape}, not (N,)")
        lengths.add(len(values))
        if values.dtype.kind in "buif":
            numbers = values.astype(np.float64)
            _require_finite(numbers, name, what)
            found.numbers[name] = numbers
        elif name in needed:
            raise UsageError(f"column `{name}` of {what} must be numbers")
        else:
            found.words[name] = [str(x) for x in values.tolist()]
    if len(lengths) > 1:
        raise UsageError(f"the columns of {what} have different lengths: {sorted(lengths)}")
    return found


def _require_finite(numbers: NDArray[np.float64], name: str, what: str) -> None:
    bad = np.flatnonzero(~np.isfinite(numbers))
    if len(bad):
        raise UsageError(f"row {bad[0] + 1}, column `{name}` of {what} is {numbers[bad[0]]}")


def _read_arrays(path: Path, needed: Sequence[str]) -> TableColumns:
    """Read a file of NumPy."""
    with open_bytes(path, "table", LARGEST_FILE) as file:
        try:
            with np.errstate(all="ignore"):
                loaded = np.load(file, allow_pickle=False)
                table: Any = dict(loaded) if hasattr(loaded, "files") else loaded
        except Exception as error:
            # NumPy raises whatever a damaged file leads it to.
            raise UsageError(f"cannot read the table `{path}`: {error}") from None
    return columns_of(table, f"the table `{path}`", needed)


class _Text:
    """The reading of one text file."""

    def __init__(self, path: Path, needed: Sequence[str]) -> None:
        self.path = path
        self.needed = frozenset(needed)
        self.delimiter = b","
        self.names: list[str] = []

    def read(self) -> TableColumns:
        """Return the columns."""
        parts: list[list[NDArray[np.float64]]] = []
        for piece in self._pieces():
            numbers = self._parse(piece)
            if numbers is None:
                return self._read_cells()
            parts.append([column.copy() for column in numbers.T])
        if not self.names:
            raise self._fault("it is empty; its first line names the columns")
        # Pieces of a column go as soon as it is whole.
        columns = {}
        for k, name in enumerate(self.names):
            columns[name] = np.concatenate([part[k] for part in parts] or [np.empty(0)])
            for part in parts:
                part[k] = columns[name][:0]
        return TableColumns(columns, {})

    def _pieces(self) -> Iterator[bytes]:
        """Yield the lines behind the header, many at a time, each with its line end."""
        with open_bytes(self.path, "table", LARGEST_FILE) as file:
            rest = b""
            while True:
                block = file.read(_PIECE)
                rest += block.replace(b"\r", b"") if b"\r\n" in block else block
                if block and not rest.count(b"\n"):
                    continue
                cut = rest.rfind(b"\n") + 1 if block else len(rest)
                lines, rest = rest[:cut], rest[cut:]
                if not self.names and lines:
                    header, _, lines = lines.partition(b"\n")
                    self._read_header(header)
                if lines.strip():
                    yield lines if lines.endswith(b"\n") else lines + b"\n"
                if not block:
                    return

    def _read_header(self, line: bytes) -> None:
        line = line.removeprefix(b"\xef\xbb\xbf")
        found = [d for d in _DELIMITERS if d in line]
        self.delimiter = found[0] if found else b","
        try:
            text = line.decode("utf-8")
        except UnicodeDecodeError:
            raise self._fault("its first line is not UTF-8; save it as UTF-8") from None
        self.names = [name.strip().strip('"').strip() for name in text.split(self._sign)]
        for k, name in enumerate(self.names):
            if not name:
                raise self._fault(f"line 1: column {k + 1} has no name")
            if name in self.names[:k]:
                raise self._fault(f"line 1: two columns are called `{name}`")
        if all(_number(name) is not None for name in self.names):
            raise self._fault("line 1 is all numbers; the first line names the columns")

    @property
    def _sign(self) -> str:
        return self.delimiter.decode()

    def _parse(self, lines: bytes) -> NDArray[np.float64] | None:
        """Return the numbers of some lines, (N, columns); None where they are not all numbers."""
        codes = np.frombuffer(lines, np.uint8)
        ends = (codes == self.delimiter[0]) | (codes == ord("\n"))
        # Every line has as many cells as the header.
        is_line_end = codes[ends] == ord("\n")
        width = len(self.names)
        if len(is_line_end) % width:
            return None
        rows = is_line_end.reshape(-1, width)
        if not rows[:, -1].all() or rows[:, :-1].any():
            return None
        if re.search(rb"[^-+.0-9eE \t;,\n]", lines):
            return None
        plain = lines.replace(self.delimiter, b" ") if self.delimiter != b"\t" else lines
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                numbers = np.fromstring(plain.decode("ascii"), sep=" ")
            except (ValueError, DeprecationWarning):
                return None
        if len(numbers) != rows.size or not np.isfinite(numbers).all():
            return None
        return numbers.reshape(rows.shape)

    def _read_cells(self) -> TableColumns:
        """Read the file cell by cell; what is no number has its place."""
        try:
            text = read_bytes(self.path, "table", LARGEST_FILE).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = error.object.count(b"\n", 0, error.start) + 1
            raise self._fault(f"line {line} is not UTF-8; save it as UTF-8") from None
        try:
            return self._sort(csv.reader(text.splitlines(), delimiter=self._sign))
        except csv.Error as error:
            raise self._fault(str(error)) from None

    def _sort(self, reader: Any) -> TableColumns:
        next(reader)
        width = len(self.names)
        cells: list[list[str]] = [[] for _ in self.names]
        lines: list[int] = []
        for row in reader:
            if not row or (len(row) == 1 and not row[0].strip()):
                continue
            if len(row) != width:
                here = f"line {reader.line_num} has {len(row)} cells"
                raise self._fault(f"{here}, the first line names {width} columns")
            lines.append(reader.line_num)
            for column, cell in zip(cells, row, strict=True):
                column.append(cell.strip())
        found = TableColumns({}, {})
        for name, column in zip(self.names, cells, strict=True):
            if name not in self.needed and column and _number(column[0]) is None:
                found.words[name] = column
            else:
                found.numbers[name] = self._numbers(name, column, lines)
        return found

    def _numbers(
        self, name: str, column: Sequence[str], lines: Sequence[int]
    ) -> NDArray[np.float64]:
        values = np.empty(len(column))
        for k, cell in enumerate(column):
            value = _number(cell)
            if value is None:
                what = f"`{cell}` is no number" if cell else "there is no number"
                raise self._fault(f"line {lines[k]}, column `{name}`: {what}")
            if not math.isfinite(value):
                raise self._fault(f"line {lines[k]}, column `{name}` is {value}")
            values[k] = value
        return values

    def _fault(self, what: str) -> UsageError:
        return UsageError(f"cannot read the table `{self.path}`: {what}")


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
