"""Interval algebra: two lists of events become one by an operator's truth table.

The definition is ``docs/solids.md``, section "Combining two lists".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.operators import OPERATORS
from pcsg.jit import njit
from pcsg.trace.precision import Precision, tolerance

CROSSING, SHEET = 0, 1
"""Kinds of events. Crossings alternate between enter and leave."""

TABLES = tuple(operator.table for operator in OPERATORS)
"""Truth tables by the operators' kinds."""


@njit
def truth(table: int, a: int, b: int) -> int:
    """Return whether a point with memberships a and b is in the result."""
    return (table >> (2 * a + b)) & 1


@njit
def merge(
    table: int,
    t: NDArray[np.float64],
    about: NDArray[np.int32],
    a: int,
    a_end: int,
    b: int,
    b_end: int,
    out_t: NDArray[np.float64],
    out_about: NDArray[np.int32],
    precision: Precision,
) -> int:
    """Combine the events ``[a, a_end)`` and ``[b, b_end)``.

    Parameters
    ----------
    table
        Truth table of the operator.
    t, about
        Parameters of the events, and two int32 for each: its record and its kind.
    out_t, out_about
        Where the result goes, from the beginning; at least as long as both lists together.
    precision
        Of the ray.

    Returns
    -------
    int
        Length of the result.
    """
    n = 0
    in_a = 0
    in_b = 0
    while a < a_end or b < b_end:
        a_next = a
        b_next = b
        if a >= a_end or (b < b_end and t[b] < t[a] - tolerance(t[a], precision)):
            at = t[b]
            reach = at
        else:
            at = t[a]
            reach = at + tolerance(at, precision)
            while a_next < a_end and t[a_next] == at:
                a_next += 1
        while b_next < b_end and t[b_next] <= reach:
            b_next += 1

        was_a = in_a
        was_b = in_b
        for k in range(a, a_next):
            if about[2 * k + 1] == CROSSING:
                in_a = 1 - in_a
        for k in range(b, b_next):
            if about[2 * k + 1] == CROSSING:
                in_b = 1 - in_b
        changes = truth(table, was_a, was_b) != truth(table, in_a, in_b)

        # A sheet stays where a point more or less of its operand changes the result.
        a_shows = truth(table, 0, was_b) != truth(table, 1, was_b)
        a_shows |= truth(table, 0, in_b) != truth(table, 1, in_b)
        b_shows = truth(table, was_a, 0) != truth(table, was_a, 1)
        b_shows |= truth(table, in_a, 0) != truth(table, in_a, 1)
        n, changes = _emit(about, a, a_next, at, a_shows, changes, out_t, out_about, n)
        n, changes = _emit(about, b, b_next, at, b_shows, changes, out_t, out_about, n)
        a = a_next
        b = b_next
    return n


@njit(inline=True)
def _emit(
    about: NDArray[np.int32],
    first: int,
    end: int,
    at: float,
    shows: bool,
    changes: bool,
    out_t: NDArray[np.float64],
    out_about: NDArray[np.int32],
    n: int,
) -> tuple[int, bool]:
    """Append what stays of an operand's part of a group; return the length and what is to come.

    Parameters
    ----------
    shows
        Whether its sheets stay.
    changes
        Whether the result's crossing is still to come: the first crossing of the group is it.
    """
    for k in range(first, end):
        sheet = about[2 * k + 1] == SHEET
        if shows if sheet else changes:
            out_t[n] = at
            out_about[2 * n], out_about[2 * n + 1] = about[2 * k], about[2 * k + 1]
            n += 1
            changes = changes and sheet
    return n, changes
