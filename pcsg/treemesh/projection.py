"""Moving vertices onto the convolution surface, and evening them out on it.

Newton's step is taken on a power of F that is nearly linear in the distance, since the plain step
runs away from far outside under the Cauchy kernel:

    Cauchy:   step = 3 F (1 - (F/T)^(1/3)) grad F / |grad F|^2
    quartic:  step = 2.5 F ((T/F)^0.4 - 1) grad F / |grad F|^2

Both reduce to the plain step of Zhu, Jin, You 2015, equation 5 (with the sign for a field that is
larger inside) where F = T.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pcsg.jit import njit
from pcsg.treemesh.field import CAUCHY, LENGTH, RADIUS_A, RADIUS_B, SegmentField, field_at
from pcsg.treemesh.skeleton import Bools, Floats, Ints
from pcsg.treemesh.threads import run_chunks

SIGMA = 0.95
STEPS = 7
NEAR = 1e-3
"""|F/T - 1| where a vertex is left in peace."""
OFF = 1e-2
"""|F/T - 1| that counts as off the surface."""

FAIR_RINGS = 3
"""Rings of neighbours about an extraordinary vertex that are evened out with it."""

# Columns of the state of a vertex: normal (3), F/T, row of the nearest segment.
STATE = 5


@njit
def closest_on(
    table: Floats, i: int, px: float, py: float, pz: float
) -> tuple[float, float, float, float]:
    """Return the point of segment i that is closest to a point, and the radius there."""
    x = (
        (px - table[i, 0]) * table[i, 3]
        + (py - table[i, 1]) * table[i, 4]
        + (pz - table[i, 2]) * table[i, 5]
    )
    x = max(0.0, min(table[i, LENGTH], x))
    r = table[i, RADIUS_A] + x / table[i, LENGTH] * (table[i, RADIUS_B] - table[i, RADIUS_A])
    return (
        table[i, 0] + x * table[i, 3],
        table[i, 1] + x * table[i, 4],
        table[i, 2] + x * table[i, 5],
        r,
    )


@njit
def _newton(F: float, g2: float, T: float, kind: int) -> float:
    """Return the factor of grad F in the step towards F = T."""
    if kind == CAUCHY:
        return 3.0 * F * (1.0 - math.pow(F / T, 1.0 / 3.0)) / g2
    return 2.5 * F * (math.pow(T / F, 0.4) - 1.0) / g2


@njit(entry=True)
def project_range(
    verts: Floats,
    chosen: Ints,
    owner: Ints,
    ptr: Ints,
    rows: Ints,
    table: Floats,
    kind: int,
    reach: float,
    T: float,
    steps: int,
    is_last: bool,
    begin: int,
    end: int,
    state: Floats,
) -> None:
    """Project the vertices ``chosen[begin:end]`` in place and write their state.

    Parameters
    ----------
    steps
        Most Newton steps.
    is_last
        Place what is still off the surface at its radius from the nearest segment.
    state (v, 5)
        Result: outward normal, F/T, row of the nearest segment.
    """
    for k in range(begin, end):
        v = chosen[k]
        o = owner[v]
        low, high = ptr[o], ptr[o + 1]
        px, py, pz = verts[v, 0], verts[v, 1], verts[v, 2]
        F, gx, gy, gz, i = field_at(px, py, pz, rows, low, high, table, kind, reach)
        for _ in range(steps):
            if abs(F / T - 1.0) < NEAR:
                break
            cx, cy, cz, r = closest_on(table, i, px, py, pz)
            g2 = gx * gx + gy * gy + gz * gz
            if F <= 0.0 or not g2 > 0.0:
                # Outside all supports: to 1.2 radii from the nearest segment.
                away = math.sqrt((px - cx) ** 2 + (py - cy) ** 2 + (pz - cz) ** 2)
                if away == 0.0:
                    break
                f = 1.2 * r / away
                px, py, pz = cx + f * (px - cx), cy + f * (py - cy), cz + f * (pz - cz)
            else:
                f = SIGMA * _newton(F, g2, T, kind)
                size = abs(f) * math.sqrt(g2)
                if size > 0.75 * r:
                    f *= 0.75 * r / size
                px, py, pz = px + f * gx, py + f * gy, pz + f * gz
            F, gx, gy, gz, i = field_at(px, py, pz, rows, low, high, table, kind, reach)
        if is_last and not abs(F / T - 1.0) <= OFF:
            cx, cy, cz, r = closest_on(table, i, px, py, pz)
            away = math.sqrt((px - cx) ** 2 + (py - cy) ** 2 + (pz - cz) ** 2)
            if away > 0.0:
                f = r / away
                px, py, pz = cx + f * (px - cx), cy + f * (py - cy), cz + f * (pz - cz)
                gx, gy, gz = cx - px, cy - py, cz - pz
        verts[v, 0], verts[v, 1], verts[v, 2] = px, py, pz
        size = max(math.sqrt(gx * gx + gy * gy + gz * gz), 1e-300)
        state[v, 0], state[v, 1], state[v, 2] = -gx / size, -gy / size, -gz / size
        state[v, 3], state[v, 4] = F / T, i


@njit(entry=True)
def fair_range(
    verts: Floats,
    state: Floats,
    chosen: Ints,
    ptr: Ints,
    neighbours: Ints,
    begin: int,
    end: int,
    moved: Floats,
) -> None:
    """Write to ``moved[k]`` where vertex ``chosen[k]`` lies after half a tangential step.

    v + 0.5 (I - n n^T) (mean of the neighbours - v).
    """
    for k in range(begin, end):
        v = chosen[k]
        mx = my = mz = 0.0
        for j in range(ptr[k], ptr[k + 1]):
            w = neighbours[j]
            mx, my, mz = mx + verts[w, 0], my + verts[w, 1], mz + verts[w, 2]
        n = ptr[k + 1] - ptr[k]
        x, y, z = verts[v, 0], verts[v, 1], verts[v, 2]
        mx, my, mz = mx / n - x, my / n - y, mz / n - z
        nx, ny, nz = state[v, 0], state[v, 1], state[v, 2]
        c = mx * nx + my * ny + mz * nz
        moved[k, 0] = x + 0.5 * (mx - c * nx)
        moved[k, 1] = y + 0.5 * (my - c * ny)
        moved[k, 2] = z + 0.5 * (mz - c * nz)


@dataclass(frozen=True, eq=False)
class FairZone:
    """Vertices near extraordinary ones, with their neighbours.

    Attributes
    ----------
    chosen : int64 (z,)
    ptr, neighbours : int64
        The neighbours of vertex ``chosen[k]`` are ``neighbours[ptr[k] : ptr[k + 1]]``.
    """

    chosen: Ints
    ptr: Ints
    neighbours: Ints

    def restricted(self, keep: Bools) -> FairZone:
        """Return the part of the zone whose vertices are marked, keep (v,)."""
        at = keep[self.chosen]
        counts = np.diff(self.ptr)
        return FairZone(
            self.chosen[at],
            np.concatenate([[0], np.cumsum(counts[at])]),
            self.neighbours[np.repeat(at, counts)],
        )


def find_fair_zone(quads: Ints, n_verts: int) -> FairZone:
    """Return the vertices within `FAIR_RINGS` rings of one whose valence is not 4."""
    a, b = quads.ravel(), np.roll(quads, -1, axis=1).ravel()
    valence = np.bincount(a, minlength=n_verts)
    marked = valence != 4
    for _ in range(FAIR_RINGS):
        grown = marked.copy()
        # Every edge runs once in each direction, so one end suffices.
        grown[b[marked[a]]] = True
        marked = grown
    chosen = np.flatnonzero(marked)
    use = marked[a]
    order = np.argsort(a[use], kind="stable")
    return FairZone(
        chosen,
        np.concatenate([[0], np.cumsum(valence[chosen])]),
        b[use][order],
    )


def project(
    verts: Floats,
    owner: Ints,
    field: SegmentField,
    *,
    state: Floats,
    chosen: Ints,
    steps: int = STEPS,
    is_last: bool = False,
) -> None:
    """Project chosen vertices in place; see `project_range`."""

    def run(begin: int, end: int) -> None:
        project_range(
            verts,
            chosen,
            owner,
            field.ptr,
            field.rows,
            field.table,
            field.kind,
            field.reach,
            field.T,
            steps,
            is_last,
            begin,
            end,
            state,
        )

    run_chunks(run, len(chosen))


def evolve(
    verts: Floats,
    owner: Ints,
    field: SegmentField,
    zone: FairZone,
    chosen: Ints,
    *,
    fair: int = 10,
) -> tuple[Floats, Floats]:
    """Return the vertices on the surface, and their state (v, 5).

    Parameters
    ----------
    verts (v, 3), owner (v,)
        Of the subdivided cage.
    zone
        What is evened out; part of `chosen`.
    chosen
        The vertices to move.
    fair
        Rounds of tangential smoothing, two projection steps after every second one.
    """
    verts = verts.copy()
    state = np.zeros((len(verts), STATE))
    project(verts, owner, field, state=state, chosen=chosen)
    moved = np.empty((len(zone.chosen), 3))

    def run(begin: int, end: int) -> None:
        fair_range(verts, state, zone.chosen, zone.ptr, zone.neighbours, begin, end, moved)

    for k in range(fair):
        run_chunks(run, len(zone.chosen))
        verts[zone.chosen] = moved
        if k % 2 or k == fair - 1:
            project(verts, owner, field, state=state, chosen=zone.chosen, steps=2)
    project(verts, owner, field, state=state, chosen=chosen, is_last=True)
    return verts, state
