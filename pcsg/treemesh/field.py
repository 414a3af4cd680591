"""The convolution field of a skeleton: local weights, and which segments a vertex sees.

Weights follow from the radii alone: every segment is given the weight that an infinitely long one
of its radius would need (Zhu, Jin, You 2015, equations 3 and 4). So changing one limb changes no
other, and no system of equations is solved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from pcsg.blobtree.convolution import (
    cauchy_segment,
    cauchy_weight,
    quartic_segment,
    quartic_weight,
)
from pcsg.errors import UsageError
from pcsg.jit import njit
from pcsg.treemesh.skeleton import Floats, Ints, Limbs, Skeleton
from pcsg.treemesh.threads import run_chunks

Kernel = Literal["cauchy", "quartic"]
Locality = Literal["graph", "all"]

CAUCHY, QUARTIC = 0, 1

# Columns of the table of segments: start (3), direction (3), then these.
LENGTH, WEIGHT_A, WEIGHT_B, SHAPE, RADIUS_A, RADIUS_B = 6, 7, 8, 9, 10, 11
COLUMNS = 12

_REACH = {"graph": 12.0, "all": 6.0}
"""Distance, in radii, from which on a Cauchy segment is left out."""


@dataclass(frozen=True, eq=False)
class SegmentField:
    """The field F of all segments, and for every owner of vertices those that count.

    Attributes
    ----------
    table : float64 (m, 12)
        One row for each segment, in the order of `Limbs.nodes`.
    row : int64
        The row of the segment after every entry of `Limbs.nodes`; -1 at a limb's last.
    ptr, rows : int64
        The rows that owner k sees are ``rows[ptr[k] : ptr[k + 1]]``; owners are the limbs, then
        the joints.
    kind : int
        CAUCHY or QUARTIC.
    T : float
        The iso value; inside is F > T.
    reach : float
        Distance in radii beyond which a Cauchy segment is left out.
    """

    table: Floats
    row: Ints
    ptr: Ints
    rows: Ints
    kind: int
    T: float
    reach: float

    def evaluate(self, points: Floats, owner: Ints) -> tuple[Floats, Floats]:
        """Return F (n,) and its gradient (n, 3) at points, as vertices of their owners see it."""
        found = np.empty((len(points), 4))

        def run(begin: int, end: int) -> None:
            evaluate_range(
                points,
                owner,
                self.ptr,
                self.rows,
                self.table,
                self.kind,
                self.reach,
                begin,
                end,
                found,
            )

        run_chunks(run, len(points))
        return found[:, 0], found[:, 1:]


def build_field(
    skel: Skeleton,
    *,
    kernel: Kernel = "cauchy",
    kappa: float = 2.0,
    taper: bool = True,
    locality: Locality = "graph",
    T: float = 1.0,
) -> SegmentField:
    """Return the field of a skeleton.

    Parameters
    ----------
    kernel
        ``cauchy``, smoother, or ``quartic``, which is exactly local and faster.
    kappa
        Width of the Cauchy kernel: s = kappa / d for a segment of radius d.
    taper
        Let weights vary along segments, from the radius at one end to that at the other.
    locality
        ``graph``: a vertex of a limb sees the segments of its limb and of those that share a joint
        with it, so that branches that merely pass near each other keep apart. ``all``: every
        segment that is near enough.
    T
        The iso value.
    """
    if kernel not in get_args(Kernel):
        raise UsageError(f"unknown kernel `{kernel}`; one of {', '.join(get_args(Kernel))}")
    if locality not in get_args(Locality):
        raise UsageError(f"unknown locality `{locality}`; one of {', '.join(get_args(Locality))}")
    if not 0.1 <= kappa <= 20.0:
        raise UsageError(f"kappa must lie between 0.1 and 20, not {kappa}")
    limbs = skel.limbs
    kind = CAUCHY if kernel == "cauchy" else QUARTIC
    table, row = segment_table(skel, limbs, kind, kappa, taper, T)
    if locality == "graph":
        ptr, rows = _rows_by_graph(limbs, row)
    else:
        ptr, rows = _rows_by_boxes(limbs, row, table, kind)
    return SegmentField(table, row, ptr, rows, kind, T, _REACH[locality])


def segment_table(
    skel: Skeleton, limbs: Limbs, kind: int, kappa: float, taper: bool, T: float
) -> tuple[Floats, Ints]:
    """Return the table of segments, and the row after every entry of `Limbs.nodes`."""
    at = np.flatnonzero(limbs.edges >= 0)
    row = np.full(len(limbs.nodes), -1)
    row[at] = np.arange(len(at))
    a, b = skel.pos[limbs.nodes[at]], skel.pos[limbs.nodes[at + 1]]
    ra, rb = limbs.radius[at], limbs.radius[at + 1]
    d = 0.5 * (ra + rb)
    length = np.linalg.norm(b - a, axis=1)
    table = np.empty((len(at), COLUMNS))
    table[:, 0:3] = a
    table[:, 3:6] = (b - a) / length[:, None]
    table[:, LENGTH] = length
    table[:, RADIUS_A], table[:, RADIUS_B] = ra, rb
    if kind == CAUCHY:
        table[:, SHAPE] = kappa / d
        wa, wb, middle = (cauchy_weight(r, kappa / d, T) for r in (ra, rb, d))
    else:
        table[:, SHAPE] = R = 2.0 * d
        wa, wb, middle = (quartic_weight(np.minimum(r, 0.9 * R), R, T) for r in (ra, rb, d))
    if not taper:
        wa = wb = middle
    # A line between the weights of the ends lies above the convex curve of the weights between
    # them, by a parabola: two thirds of its height are taken off, so that it is right on average.
    chord = 0.5 * (wa + wb)
    even = 1.0 - 2.0 / 3.0 * (chord - middle) / chord
    table[:, WEIGHT_A], table[:, WEIGHT_B] = even * wa, even * wb
    return table, row


def _rows_of_limbs(limbs: Limbs, row: Ints) -> list[Ints]:
    return [row[a : b - 1] for a, b in zip(limbs.ptr[:-1], limbs.ptr[1:], strict=True)]


def _rows_by_graph(limbs: Limbs, row: Ints) -> tuple[Ints, Ints]:
    """Return the rows of a limb and its neighbours, and of the limbs at a joint."""
    own = _rows_of_limbs(limbs, row)
    ptr, ends = limbs.joint_ends
    at_joint = [
        list(dict.fromkeys((ends[ptr[j] : ptr[j + 1]] // 2).tolist()))
        for j in range(len(limbs.joints))
    ]
    seen = []
    for k in range(len(limbs)):
        near = [k]
        for j in limbs.ends[k].tolist():
            if j >= 0:
                near += at_joint[j]
        seen.append([own[i] for i in dict.fromkeys(near)])
    seen += [[own[i] for i in near] for near in at_joint]
    return _flatten(seen)


def _flatten(groups: list[list[Ints]]) -> tuple[Ints, Ints]:
    counts = [sum(len(part) for part in group) for group in groups]
    ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return ptr, np.concatenate([part for group in groups for part in group])


def _rows_by_boxes(limbs: Limbs, row: Ints, table: Floats, kind: int) -> tuple[Ints, Ints]:
    """Return the rows whose support meets the box of a limb or a joint."""
    start = table[:, 0:3]
    end = start + table[:, LENGTH, None] * table[:, 3:6]
    thick = np.maximum(table[:, RADIUS_A], table[:, RADIUS_B])
    reach = table[:, SHAPE] if kind == QUARTIC else _REACH["all"] * thick
    low, high = np.minimum(start, end), np.maximum(start, end)
    grown_low, grown_high = low - reach[:, None], high + reach[:, None]
    own = _rows_of_limbs(limbs, row)
    ptr, ends = limbs.joint_ends
    groups = own + [
        np.concatenate([own[e // 2] for e in ends[ptr[j] : ptr[j + 1]]])
        for j in range(len(limbs.joints))
    ]
    seen = []
    for group in groups:
        margin = 3.0 * thick[group].max()
        a, b = low[group].min(axis=0) - margin, high[group].max(axis=0) + margin
        near = ((grown_high >= a) & (grown_low <= b)).all(axis=1)
        seen.append([np.flatnonzero(near)])
    return _flatten(seen)


@njit(contract=True)
def field_at(
    px: float,
    py: float,
    pz: float,
    rows: Ints,
    begin: int,
    end: int,
    table: Floats,
    kind: int,
    reach: float,
) -> tuple[float, float, float, float, int]:
    """Return F, its gradient, and the row of the segment that is nearest in radii."""
    F = gx = gy = gz = 0.0
    nearest, best = -1, math.inf
    for k in range(begin, end):
        i = rows[k]
        ux, uy, uz = table[i, 3], table[i, 4], table[i, 5]
        qx, qy, qz = px - table[i, 0], py - table[i, 1], pz - table[i, 2]
        length = table[i, LENGTH]
        x = qx * ux + qy * uy + qz * uz
        hx, hy, hz = qx - x * ux, qy - x * uy, qz - x * uz
        h2 = hx * hx + hy * hy + hz * hz
        gap = max(-x, x - length, 0.0)
        d2 = h2 + gap * gap
        part = max(0.0, min(1.0, x / length))
        r = table[i, RADIUS_A] + part * (table[i, RADIUS_B] - table[i, RADIUS_A])
        if d2 < best * r * r:
            nearest, best = i, d2 / (r * r)
        shape = table[i, SHAPE]
        if kind == CAUCHY:
            d = max(table[i, RADIUS_A], table[i, RADIUS_B])
            if d2 > reach * reach * d * d:
                continue
            f, dx, dh = cauchy_segment(x, h2, length, table[i, WEIGHT_A], table[i, WEIGHT_B], shape)
        else:
            if d2 >= shape * shape:
                continue
            f, dx, dh = quartic_segment(
                x, h2, length, table[i, WEIGHT_A], table[i, WEIGHT_B], shape
            )
        F += f
        gx += dx * ux + 2.0 * dh * hx
        gy += dx * uy + 2.0 * dh * hy
        gz += dx * uz + 2.0 * dh * hz
    return F, gx, gy, gz, nearest


def nearest_rows(points: Floats, owner: Ints, field: SegmentField) -> Ints:
    """Return the row of the segment that is nearest in radii to points, as owners see it."""
    found = np.empty(len(points), dtype=np.int64)

    def run(begin: int, end: int) -> None:
        nearest_range(points, owner, field.ptr, field.rows, field.table, begin, end, found)

    run_chunks(run, len(points))
    return found


@njit(entry=True)
def nearest_range(
    points: Floats,
    owner: Ints,
    ptr: Ints,
    rows: Ints,
    table: Floats,
    begin: int,
    end: int,
    found: Ints,
) -> None:
    """Write the row of the nearest segment for points [begin, end)."""
    for v in range(begin, end):
        o = owner[v]
        found[v] = field_at(
            points[v, 0],
            points[v, 1],
            points[v, 2],
            rows,
            ptr[o],
            ptr[o + 1],
            table,
            QUARTIC,
            0.0,
        )[4]


@njit(entry=True)
def evaluate_range(
    points: Floats,
    owner: Ints,
    ptr: Ints,
    rows: Ints,
    table: Floats,
    kind: int,
    reach: float,
    begin: int,
    end: int,
    found: Floats,
) -> None:
    """Write F and its gradient at points [begin, end) to the rows of `found`."""
    for v in range(begin, end):
        o = owner[v]
        F, gx, gy, gz, _ = field_at(
            points[v, 0],
            points[v, 1],
            points[v, 2],
            rows,
            ptr[o],
            ptr[o + 1],
            table,
            kind,
            reach,
        )
        found[v, 0], found[v, 1], found[v, 2], found[v, 3] = F, gx, gy, gz
