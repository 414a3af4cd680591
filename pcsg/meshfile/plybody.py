"""The bodies of PLY files: columns of numbers and lists, as text and binary."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.meshfile.mesh import Floats, Integers, MeshFileError
from pcsg.meshfile.words import shown


@dataclass
class Property:
    """A property; `count` is the type of a list's length, None for a number."""

    name: str
    kind: str
    count: str | None = None


@dataclass
class Element:
    """Records of one kind, as the header declares them."""

    name: str
    size: int
    properties: list[Property] = field(default_factory=list)


@dataclass
class Column:
    """Values of a property with their type, and for lists how many belong to each record."""

    kind: str
    values: Floats
    counts: Integers | None


class Body(Protocol):
    """What stands behind a header."""

    def read(self, element: Element) -> Sequence[Column]:
        """Read the columns of the next element."""


class TextBody:
    """The body of a text file: a line for each record, or several that hold just one."""

    def __init__(self, name: str, data: bytes, at: int, line: int) -> None:
        self.name = name
        self.lines: Iterator[tuple[int, bytes]] = (
            (k, text) for k, text in enumerate(data[at:].splitlines(), line + 1) if text.strip()
        )
        self.last = line

    def read(self, element: Element) -> Sequence[Column]:
        """Read the columns of an element."""
        values: list[list[float]] = [[] for _ in element.properties]
        counts: list[list[int]] = [[] for _ in element.properties]
        for done in range(element.size):
            self._read_record(element, done, values, counts)
        return [
            Column(
                p.kind,
                np.array(numbers, np.float64),
                None if p.count is None else np.array(lengths, np.int64),
            )
            for p, numbers, lengths in zip(element.properties, values, counts, strict=True)
        ]

    def _read_record(
        self, element: Element, done: int, values: list[list[float]], counts: list[list[int]]
    ) -> None:
        number, text = next(self.lines, (-1, b""))
        if number < 0:
            reason = f"the file ends after {done} of {element.size} `{element.name}`"
            raise MeshFileError(self.name, f"line {self.last}", reason)
        self.last = number
        try:
            numbers = list(map(float, text.split()))
            at = 0
            whole = True
            for k, p in enumerate(element.properties):
                n = 1
                if p.count is not None:
                    whole &= self._have(numbers, at + 1)
                    n = int(numbers[at])
                    if n < 0:
                        raise ValueError
                    counts[k].append(n)
                    at += 1
                whole &= self._have(numbers, at + n)
                values[k] += numbers[at : at + n]
                at += n
            # Words behind a record are passed over, but not where lines were taken together: then
            # it is rather a number that is missing.
            if not whole and at != len(numbers):
                raise ValueError
        except (ValueError, OverflowError):
            reason = f"`{shown(text.strip())}` is not a `{element.name}` as the header says"
            raise MeshFileError(self.name, f"line {number}", reason) from None

    def _have(self, numbers: list[float], wanted: int) -> bool:
        """Read lines until there are so many numbers; return whether there were."""
        if wanted <= len(numbers):
            return True
        while len(numbers) < wanted:
            number, text = next(self.lines, (-1, b""))
            if number < 0:
                raise ValueError
            self.last = number
            numbers += map(float, text.split())
        return False


class BinaryBody:
    """The body of a binary file; `order` is ``<`` or ``>``."""

    def __init__(self, name: str, data: bytes, at: int, order: str) -> None:
        self.name, self.at, self.order = name, at, order
        self.data = np.frombuffer(data, np.uint8)

    def read(self, element: Element) -> Sequence[Column]:
        """Read the columns of an element."""
        left = len(self.data) - self.at
        plan: list[tuple[int, int, int]] = []
        for p in element.properties:
            length = 0 if p.count is None else np.dtype(p.count).itemsize
            signed = int(p.count is not None and p.count[0] == "i")
            plan.append((length, signed, np.dtype(p.kind).itemsize))
        least = sum(length or size for length, _, size in plan)
        # So many may fit at most; others need not be counted.
        fitting = min(element.size, left // least)
        width = len(plan)
        starts = np.empty(fitting * width + 1, np.int64)
        counts = np.empty(fitting * width, np.int64)
        done = walk_records(
            self.data, self.at, fitting, np.array(plan, np.int64).ravel(), self.order == ">",
            starts, counts,
        )  # fmt: skip
        if done < 0:
            record = (-1 - done) // width
            reason = f"a list of {counts[-1 - done]} numbers in `{element.name}` {record}"
            self._fail(int(starts[-1 - done]), reason)
        if done < element.size:
            reason = f"the file ends after {done} of {element.size} `{element.name}`"
            self._fail(len(self.data), reason)
        self.at = int(starts[-1])
        return [
            self._column(p, starts[k:-1:width].copy(), counts[k::width].copy())
            for k, p in enumerate(element.properties)
        ]

    def _fail(self, at: int, reason: str) -> NoReturn:
        raise MeshFileError(self.name, f"byte {at}", reason)

    def _column(self, p: Property, starts: Integers, counts: Integers) -> Column:
        kind = np.dtype(self.order + p.kind)
        out = np.empty(kind.itemsize * int(counts.sum()), np.uint8)
        gather_values(self.data, starts, counts, kind.itemsize, out)
        with np.errstate(invalid="ignore"):
            values = out.view(kind).astype(np.float64)
        return Column(p.kind, values, None if p.count is None else counts)


@njit(entry=True)
def walk_records(
    data: NDArray[np.uint8],
    at: int,
    size: int,
    plan: Integers,
    swapped: bool,
    starts: Integers,
    counts: Integers,
) -> int:
    """Find where the values of records begin.

    Parameters
    ----------
    data, at, size
        The bytes, where the first record begins, and how many there are.
    plan
        Three numbers for every property: bytes of a list's length, or 0; whether it is signed;
        and bytes of a value.
    swapped
        Whether the most significant byte comes first.
    starts, counts
        Receive the first byte of every value or list, the end behind them, and numbers of values.

    Returns
    -------
    int
        The number of whole records; ``-1 - k`` if list k has a negative length.
    """
    width = len(plan) // 3
    end = len(data)
    for record in range(size):
        for p in range(width):
            k = record * width + p
            length, item = plan[3 * p], plan[3 * p + 2]
            n = 1
            if length > 0:
                if at + length > end:
                    return record
                n = 0
                for b in range(length):
                    n = n * 256 + wide(data[at + (b if swapped else length - 1 - b)])
                if plan[3 * p + 1] == 1 and n >= 1 << (8 * length - 1):
                    counts[k], starts[k] = n - (1 << (8 * length)), at
                    return -1 - k
                at += length
            if n > (end - at) // item:
                return record
            starts[k], counts[k] = at, n
            at += n * item
    starts[size * width] = at
    return size


@njit(entry=True)
def gather_values(
    data: NDArray[np.uint8],
    starts: Integers,
    counts: Integers,
    item: int,
    out: NDArray[np.uint8],
) -> None:
    """Copy values of `item` bytes, runs of them that begin at `starts`, one behind the other."""
    to = 0
    for k in range(len(starts)):
        for b in range(starts[k], starts[k] + counts[k] * item):
            out[to] = data[b]
            to += 1
