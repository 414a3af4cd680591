"""Batches of rays through the walker: the compiled entry that Python calls."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.leaf.registry import ANY, FIRST, Pool
from pcsg.trace.merge import SHEET
from pcsg.trace.precision import Extent, precision_of, store_precision
from pcsg.trace.surface import LABEL, Surface, describe_hit, whole_label
from pcsg.trace.tables import Tables
from pcsg.trace.walk import LIST, MEMBERSHIP, SHRINK, walk
from pcsg.trace.walk_space import (
    ARGUMENTS_AT,
    ATTRIBUTES_AT,
    OK,
    PRECISION,
    RECORD,
    Scratch,
    chain_map,
    copy_record,
)
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
SURFACES, OCCLUSION, CONTAINS, INTERVALS, CROSSINGS = range(5)

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
    leaf_in, leaf_out, label_in, label_out : int64 (K,)
        The leaf nodes whose surfaces these are, and their labels.
    """

    counts: NDArray[np.int64]
    t_in: NDArray[np.float64]
    t_out: NDArray[np.float64]
    leaf_in: NDArray[np.int64]
    leaf_out: NDArray[np.int64]
    label_in: NDArray[np.int64]
    label_out: NDArray[np.int64]


def make_intervals(counts: NDArray[np.int64], room: int) -> Intervals:
    """Return room for intervals of rays with these counts."""
    times = np.empty(room), np.empty(room)
    return Intervals(counts, *times, *(np.empty(room, np.int64) for _ in range(4)))


@njit
def _write_intervals(scratch: Scratch, n: int, used: int, out: Intervals) -> int:
    """Write a list of n events as intervals from `used` on and return their number."""
    count = 0
    entered = -1
    for k in range(n):
        t = scratch.event_t[k]
        record = scratch.event_about[2 * k]
        leaf = scratch.record_about[3 * record]
        label = whole_label(scratch.records[record * RECORD + ATTRIBUTES_AT + LABEL])
        sheet = scratch.event_about[2 * k + 1] == SHEET
        leaves = not sheet and entered >= 0
        at = entered if leaves else used + count
        if not leaves:
            out.t_in[at], out.leaf_in[at], out.label_in[at] = t, leaf, label
            out.t_out[at], out.leaf_out[at], out.label_out[at] = math.inf, -1, -1
            count += 1
        if sheet or leaves:
            out.t_out[at], out.leaf_out[at], out.label_out[at] = t, leaf, label
        if not sheet:
            entered = -1 if leaves else at
    return count


@njit
def _write_crossings(
    tables: Tables,
    pool: Pool,
    scratch: Scratch,
    n: int,
    ray: Ray,
    used: int,
    out: Surface,
    entering: NDArray[np.bool_],
) -> int:
    """Write what of a list of n events lies in [tmin, tmax] from `used` on; return how much."""
    count = 0
    inside = False
    r = scratch.records
    for k in range(n):
        sheet = scratch.event_about[2 * k + 1] == SHEET
        if not sheet:
            inside = not inside
        t = scratch.event_t[k]
        if math.isinf(t) or not ray.tmin <= t <= ray.tmax:
            continue
        record = scratch.event_about[2 * k]
        node = scratch.record_about[3 * record]
        m = chain_map(
            tables.kind,
            tables.detail,
            tables.matrices,
            scratch.chain,
            scratch.chain_matrices,
            scratch.record_about[3 * record + 1],
        )
        at = record * RECORD
        describe_hit(
            out,
            used + count,
            ray,
            t,
            node,
            tables.detail[node],
            Ray(r[at], r[at + 1], r[at + 2], r[at + 3], r[at + 4], r[at + 5], ray.tmin, ray.tmax),
            r,
            at + ARGUMENTS_AT,
            pool,
            m,
            scratch.record_about[3 * record + 2],
            r,
            at + ATTRIBUTES_AT,
        )
        entering[used + count] = inside and not sheet
        count += 1
    return count


@njit(entry=True)
def trace_batch(
    tables: Tables,
    pool: Pool,
    scratch: Scratch,
    extent: Extent,
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
    extent
        Where the scene is.
    asked
        SURFACES: first crossings, into `surface`. OCCLUSION: whether there is one, into `flags`.
        CONTAINS: whether the origins are inside, into `flags`. INTERVALS: all of them on
        [t_min, t_max], into `intervals` from `used` on. CROSSINGS: all ends of these, into
        `surface` from `used` on, and whether they enter, into `flags`; their numbers into the
        counts of `intervals`.

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
        store_precision(scratch.best, PRECISION, precision_of(ray, extent))
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
        elif asked <= CONTAINS:
            flags[i] = n > 0
        elif asked == CROSSINGS:
            if used + n > len(flags):
                return OUTPUT_FULL, i, used
            counts = intervals.counts
            counts[i] = _write_crossings(tables, pool, scratch, n, ray, used, surface, flags)
            used += counts[i]
        elif used + n > len(intervals.t_in):
            return OUTPUT_FULL, i, used
        else:
            intervals.counts[i] = _write_intervals(scratch, n, used, intervals)
            used += intervals.counts[i]
    return OK, end, used
