"""What users of Python give as arguments, checked and in its proper form."""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pcsg.errors import UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def whole(value: Any, name: str, low: int, high: int | None = None) -> int:
    """Return a whole number between limits.

    Raises
    ------
    UsageError
        It is something else.
    """
    try:
        number = operator.index(value)
    except TypeError:
        raise UsageError(f"{name} is a whole number, not {shown(value)}") from None
    if number < low or (high is not None and number > high):
        legal = f"at least {low:,}" if high is None else f"from {low:,} to {high:,}"
        raise UsageError(f"{name} is a whole number {legal}, not {shown(value)}")
    return number


def real(value: Any, name: str, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a finite number between limits.

    Raises
    ------
    UsageError
        It is something else.
    """
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise UsageError(f"{name} is a number, not {shown(value)}") from None
    if not math.isfinite(number):
        raise UsageError(f"{name} is a finite number, not {shown(value)}")
    if not low <= number <= high:
        legal = f"from {low:g} to {high:g}" if high < math.inf else f"of at least {low:g}"
        raise UsageError(f"{name} is a number {legal}, not {shown(value)}")
    return number


def text(value: Any, name: str) -> str:
    """Return a text.

    Raises
    ------
    UsageError
        It is something else.
    """
    if not isinstance(value, str):
        raise UsageError(f"{name} is a text, not {shown(value)}")
    return value


def path(value: Any, name: str) -> Path:
    """Return the name of a file.

    Raises
    ------
    UsageError
        It is something else.
    """
    if not isinstance(value, (str, os.PathLike)):
        raise UsageError(f"{name} is the name of a file, not {shown(value)}")
    return Path(value)


def numbers(values: Any, name: str) -> dict[str, float]:
    """Return finite numbers by names; None is none of them.

    Raises
    ------
    UsageError
        It is something else.
    """
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise UsageError(f"{name} is a dictionary of names and numbers, not {shown(values)}")
    return {text(key, f"a name in {name}"): real(x, f"`{key}`") for key, x in values.items()}


def listed(values: Any, name: str, of: str) -> list[Any]:
    """Return a list of anything that can be walked, but texts.

    Raises
    ------
    UsageError
        It is something else.
    """
    try:
        if isinstance(values, (str, bytes, os.PathLike)):
            raise TypeError
        return list(values)
    except TypeError:
        raise UsageError(f"{name} is a list of {of}, not {shown(values)}") from None


def array(value: Any, name: str) -> NDArray[np.float64]:
    """Return an array of real numbers, contiguous.

    Raises
    ------
    UsageError
        It is something else: texts, complex numbers, rows of different lengths.
    """
    import numpy as np

    try:
        found = np.asarray(value)
        if found.dtype.kind not in "biuf" and not (found.dtype.kind == "O" and found.size):
            raise TypeError
        # An array of objects may hold numbers of classes that numpy does not know.
        if found.dtype.kind == "O" and any(
            isinstance(x, (str, bytes, type(None))) for x in found.flat
        ):
            raise TypeError
        return np.ascontiguousarray(found, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise UsageError(f"{name} are real numbers in rows of equal length") from None


def shown(value: object) -> str:
    """Return a value as messages show it, cut where it is long."""
    try:
        found = repr(value)
    except Exception:  # a class of the user's
        found = f"<{type(value).__name__}>"
    return found if len(found) <= 60 else found[:57] + "..."
