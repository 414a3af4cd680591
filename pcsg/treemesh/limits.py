"""What the options of a surface may be."""

from __future__ import annotations

from pcsg.errors import UsageError


def check_levels(levels: int) -> None:
    """Refuse a number of steps that is none.

    Raises
    ------
    UsageError
        It does not lie between 1 and 6.
    """
    if not 1 <= levels <= 6:
        raise UsageError(f"levels must lie between 1 and 6, not {levels}")


def check_aspect(max_aspect: float | None) -> None:
    """Refuse a longest distance between two squares that is none.

    Raises
    ------
    UsageError
        It is 0.1 or less.
    """
    if max_aspect is not None and not max_aspect > 0.1:
        raise UsageError(f"max_aspect must be larger than 0.1, or None, not {max_aspect}")
