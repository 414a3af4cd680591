"""Batches of rays through the walker: the compiled entry that Python calls."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.leaf.registry import ANY, FIRST, Pool
from pcsg.trace.merge import SHEET
from pcsg.trace.surface import Surface, describe_hit
from pcsg.trace.tables import Tables
from pcsg.trace.walk import LIST, MEMBERSHIP, SHRINK, walk
from pcsg.trace.walk_space import ARGUMENTS_AT, ATTRIBUTES_AT, OK, Scratch, chain_map, copy_record
from pcsg.vec import Ray, load_affine, store_affine


@njit
def _take_first_event(tables: Tables, scratch: Scratch, n: int, ray: Ray) -> int:
    """Make the first of n finite events in [tmin, tmax] the first hit; return how many hit."""
    for k in range(n):
        t = scratch.event_t[k]
        if ray.tmin <= t <= ray.tmax and not math.isinf(t):
            scratch.best[0] = t
            copy_record(scratch.records, scratch.record_about, scratch.event_about[2 * k])
            m = chain_map(
                tables.kind,
                tables.detail,
                tables.matrices,
                scratch.chain,
                scratch.chain_matrices,
                scratch.record_about[1],
            )
            store_affine(scratch.best, 1, m)
            return 1
    return 0


# What a batch asks for.
SURFACES, OCCLUSION, CONTAINS, INTERVALS = range(4)

OUTPUT_FULL = 100
"""The intervals' arrays are too short."""


class Intervals(NamedTuple):
    """Inside intervals of rays, one ray's after the other's.

    Attributes
    ----------
    counts : int64 (N,)
        Number of intervals of every ray.
    t_in, t_out : float64 (K,)
        Their ends; equal for a sheet.
    """

    counts: NDArray[np.int64]
    t_in: NDArray[np.float64]
    t_out: NDArray[np.float64]


@njit
def _write_intervals(scratch: Scratch, n: int, used: int, out: Intervals) -> int:
    """Write a list of n events as intervals from `used` on and return their number."""
    count = 0
    entered = -1
    for k in range(n):
        t = scratch.event_t[k]
        if scratch.event_about[2 * k + 1] == SHEET:
            out.t_in[used + count] = t
            out.t_out[used + count] = t
            count += 1
        elif entered < 0:
            entered = used + count
            out.t_in[entered], out.t_out[entered] = t, math.inf
            count += 1
        else:
            out.t_out[entered] = t
            entered = -1
    return count


@njit(entry=True)
def trace_batch(
    tables: Tables,
    pool: Pool,
    scratch: Scratch,
    asked: int,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    t_min: NDArray[np.float64],
    t_max: NDArray[np.float64],
    begin: int,
    end: int,
    surface: Surface,
    flags: NDArray[np.bool_],
    intervals: Intervals,
    used: int,
) -> tuple[int, int, int]:
    """Trace rays [begin, end).

    One entry for all questions, because every entry compiles the whole walker anew.

    Parameters
    ----------
    asked
        SURFACES: first crossings, into `surface`. OCCLUSION: whether there is one, into `flags`.
        CONTAINS: whether the origins are inside, into `flags`. INTERVALS: all of them on
        [t_min, t_max], into `intervals` from `used` on.

    Returns
    -------
    status, i, used
        OK and `end`, or what went wrong at ray i, those before it being done; and the number of
        intervals written.
    """
    want = ANY if asked == OCCLUSION else FIRST
    first_way = SHRINK if asked <= OCCLUSION else (MEMBERSHIP if asked == CONTAINS else LIST)
    for i in range(begin, end):
        ray = Ray(
            origins[i, 0],
            origins[i, 1],
            origins[i, 2],
            directions[i, 0],
            directions[i, 1],
            directions[i, 2],
            t_min[i],
            t_max[i],
        )
        way = first_way
        status, n = OK, -1
        while status == OK and n < 0:
            status, n = walk(tables, pool, scratch, way, want, ray)
            if n < 0:
                way += LIST - SHRINK
            elif way == LIST and asked <= OCCLUSION:
                n = _take_first_event(tables, scratch, n, ray)
        if status != OK:
            return status, i, used
        if asked == SURFACES:
            if n > 0:
                r = scratch.records
                node = scratch.record_about[0]
                describe_hit(
                    surface,
                    i,
                    ray,
                    scratch.best[0],
                    node,
                    tables.detail[node],
                    Ray(r[0], r[1], r[2], r[3], r[4], r[5], ray.tmin, ray.tmax),
                    r,
                    ARGUMENTS_AT,
                    pool,
                    load_affine(scratch.best, 1),
                    scratch.record_about[2],
                    r,
                    ATTRIBUTES_AT,
                )
        elif asked != INTERVALS:
            flags[i] = n > 0
        elif used + n > len(intervals.t_in):
            return OUTPUT_FULL, i, used
        else:
            intervals.counts[i] = _write_intervals(scratch, n, used, intervals)
            used += intervals.counts[i]
    return OK, end, used
