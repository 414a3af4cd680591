"""Graphs and expressions as flat values, which `pickle` and `copy` take however deep they are.

Records refer to one another by their numbers, so that nothing recurses, cycles are possible, and
what is shared stays shared. What is compared by identity, such as operators, is told by its name.
"""

from __future__ import annotations

from dataclasses import MISSING, fields, is_dataclass
from typing import Any, NamedTuple


class Flat(NamedTuple):
    """A value, and the records that it refers to.

    Attributes
    ----------
    value
        A `_Number` stands for a record, in it and in the records' fields.
    records
        Their classes, and their fields by name.
    """

    value: Any
    records: list[tuple[type[Any], dict[str, Any]]]


class _Number(NamedTuple):
    number: int


def flatten(value: Any) -> Flat:
    """Return a value whose records (dataclasses such as nodes) stand in a list, each once.

    Parameters
    ----------
    value
        Records, in tuples, lists and dicts too, and anything else that can be pickled.
    """
    items: list[Any] = []
    numbers: dict[int, int] = {}

    def encode(x: Any) -> Any:
        if isinstance(x, (tuple, list)) and not hasattr(x, "_fields"):
            return type(x)([encode(y) for y in x])
        if isinstance(x, dict):
            return {key: encode(y) for key, y in x.items()}
        if not _is_record(x):
            return x
        number = numbers.setdefault(id(x), len(items))
        if number == len(items):
            items.append(x)
        return _Number(number)

    found = encode(value)
    records = [  # the list of items grows while it is walked
        (type(item), {f.name: encode(getattr(item, f.name)) for f in fields(item) if f.init})
        for item in items
    ]
    return Flat(found, records)


def restore(flat: Flat) -> Any:
    """Return the value that was flattened, made of new records."""
    made = [object.__new__(kind) for kind, _ in flat.records]

    def decode(x: Any) -> Any:
        if isinstance(x, _Number):
            return made[x.number]
        if isinstance(x, (tuple, list)) and not hasattr(x, "_fields"):
            return type(x)([decode(y) for y in x])
        if isinstance(x, dict):
            return {key: decode(y) for key, y in x.items()}
        return x

    for item, (kind, values) in zip(made, flat.records, strict=True):
        for field in fields(kind):
            if field.init:
                value = decode(values[field.name])
            else:
                assert field.default_factory is not MISSING
                value = field.default_factory()
            # Records may lead back to themselves, and may be frozen.
            object.__setattr__(item, field.name, value)
    return decode(flat.value)


class Flattened:
    """A record that is pickled and copied flat, with all that it leads to."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return restore, (flatten(self),)


def _is_record(x: object) -> bool:
    """Return whether a value is a record that does not tell for itself how it is pickled."""
    if not is_dataclass(x) or isinstance(x, type):
        return False
    return isinstance(x, Flattened) or type(x).__reduce__ is object.__reduce__
