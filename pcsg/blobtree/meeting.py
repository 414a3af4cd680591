"""What a ray meets: primitives whose support it crosses, prepared for it.

What is prepared stands in the workspace, `MET` numbers each: see `layout`.
"""

from __future__ import annotations

import math

from pcsg.blobtree.blend import Array
from pcsg.blobtree.layout import (
    ABOUT,
    ACCELERATION,
    BOX,
    CHAIN,
    CONSTANT,
    DIRECTION,
    ENTER,
    FALL,
    H_ACCELERATION,
    H_CONSTANT,
    H_INVERSE,
    H_ROW,
    H_SPEED,
    H_WEIGHT,
    INVERSE,
    KINDS,
    LEAVE,
    MATRIX,
    MET,
    NEAREST,
    ORIGIN,
    PRIMITIVE,
    RISE,
    ROW,
    SLIM,
    SPEED,
    WEIGHT,
    Tables,
    Work,
)
from pcsg.blobtree.skeletons import CONSTANTS, DIRECT, SKELETONS
from pcsg.jit import njit
from pcsg.vec import Vec3, load_affine, transform_point, transform_vector

POLYGON = SKELETONS["polygon"].kind


@njit(contract=True)
def frame_of(axis: Vec3) -> tuple[Vec3, Vec3]:
    """Return two directions across a unit one; right-handed (Duff et al. 2017)."""
    sign = math.copysign(1.0, axis.z)
    a = -1.0 / (sign + axis.z)
    b = axis.x * axis.y * a
    return (
        Vec3(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x),
        Vec3(b, sign + axis.y * axis.y * a, -axis.y),
    )


@njit(contract=True)
def passes_by(f: Array, row: int, o: Vec3, d: Vec3) -> bool:
    """Return whether a ray is surely too far from the axis of a slim primitive; most rays are.

    What distance the two lines have is told with certainty where they are not nearly parallel.
    """
    vx, vy, vz = f[row + 3], f[row + 4], f[row + 5]
    nx, ny, nz = d.y * vz - d.z * vy, d.z * vx - d.x * vz, d.x * vy - d.y * vx
    apart = (o.x - f[row]) * nx + (o.y - f[row + 1]) * ny + (o.z - f[row + 2]) * nz
    across2 = nx * nx + ny * ny + nz * nz
    most = f[row + 6] + abs(f[row + 7])
    certain = across2 > 1e-8 * (vx * vx + vy * vy + vz * vz)
    return bool(certain and apart * apart > 1.0001 * most * most * across2)


@njit(contract=True)
def meet_slim(m: Tables, row: int, o: Vec3, d: Vec3, h: Array, at: int) -> bool:
    """Prepare a slim primitive for a ray of unit speed; return whether it meets the support."""
    f = m.floats
    vx, vy, vz = f[row + 3], f[row + 4], f[row + 5]
    a, reach = f[row + 6], abs(f[row + 7])
    qx, qy, qz = o.x - f[row], o.y - f[row + 1], o.z - f[row + 2]
    most = a + reach
    length = math.sqrt(vx * vx + vy * vy + vz * vz)
    axis = Vec3(0.0, 0.0, 1.0)
    if length > 0.0:
        axis = Vec3(vx / length, vy / length, vz / length)
    if f[row + 7] < 0.0:
        # A disc has a direction but no length.
        length = 0.0
    u, w = frame_of(axis)
    px = qx * u.x + qy * u.y + qz * u.z
    py = qx * w.x + qy * w.y + qz * w.z
    pz = qx * axis.x + qy * axis.y + qz * axis.z
    dx = d.x * u.x + d.y * u.y + d.z * u.z
    dy = d.x * w.x + d.y * w.y + d.z * w.z
    dz = d.x * axis.x + d.y * axis.y + d.z * axis.z
    # From where it is nearest to the middle.
    t = -(px * dx + py * dy + (pz - 0.5 * length) * dz)
    px, py, pz = px + t * dx, py + t * dy, pz + t * dz
    across, along, c = dx * dx + dy * dy, px * dx + py * dy, px * px + py * py
    c -= most * most
    t0, t1 = -math.inf, math.inf
    if across > 1e-18:
        disc = along * along - across * c
        if disc <= 0.0:
            return False
        root = math.sqrt(disc)
        t0, t1 = (-along - root) / across, (-along + root) / across
    elif c >= 0.0:
        return False
    if abs(dz) > 1e-12:
        i = 1.0 / dz
        z0, z1 = (-reach - pz) * i, (length + reach - pz) * i
        t0, t1 = max(t0, min(z0, z1)), min(t1, max(z0, z1))
    elif pz < -reach or pz > length + reach:
        return False
    if not t0 < t1:
        return False
    h[at], h[at + 1], h[at + 2] = px, py, pz
    h[at + DIRECTION], h[at + DIRECTION + 1], h[at + DIRECTION + 2] = dx, dy, dz
    h[at + NEAREST], h[at + H_INVERSE], h[at + H_WEIGHT] = t, 1.0 / (reach * reach), 1.0
    h[at + H_SPEED] = 2.0
    slant = math.sqrt(length * length + a * a)
    h[at + H_CONSTANT], h[at + H_CONSTANT + 1] = length, a
    h[at + H_CONSTANT + 2], h[at + H_CONSTANT + 3] = 0.0, 1.0
    if slant > 0.0:
        h[at + H_CONSTANT + 2], h[at + H_CONSTANT + 3] = a / slant, length / slant
    h[at + H_CONSTANT + 4] = slant
    h[at + ENTER], h[at + LEAVE] = t + t0, t + t1
    h[at + H_ROW] = -1.0
    return True


@njit(contract=True)
def meet_full(m: Tables, row: int, direct: bool, o: Vec3, d: Vec3, h: Array, at: int) -> bool:
    """Prepare any other primitive for a ray; return whether it meets the support."""
    f = m.floats
    bent = f[row + CHAIN] >= 0.0
    p, v = o, d
    if not bent:
        local = load_affine(f, row + MATRIX)
        p, v = transform_point(local, o), transform_vector(local, d)
    b = row + BOX
    mx = 0.5 * (f[b] + f[b + 3])
    my = 0.5 * (f[b + 1] + f[b + 4])
    mz = 0.5 * (f[b + 2] + f[b + 5])
    speed2 = v.x * v.x + v.y * v.y + v.z * v.z
    t = -((p.x - mx) * v.x + (p.y - my) * v.y + (p.z - mz) * v.z) / speed2
    p = Vec3(p.x + t * v.x, p.y + t * v.y, p.z + t * v.z)
    t0, t1 = -math.inf, math.inf
    for k in range(3):
        low, high = f[b + k] - p[k], f[b + 3 + k] - p[k]
        if abs(v[k]) > 1e-150:
            i = 1.0 / v[k]
            t0, t1 = max(t0, min(low * i, high * i)), min(t1, max(low * i, high * i))
        elif low > 0.0 or high < 0.0:
            return False
    if not t0 < t1:
        return False
    for k in range(3):
        h[at + ORIGIN + k], h[at + DIRECTION + k] = p[k], v[k]
    h[at + NEAREST] = t
    h[at + H_INVERSE], h[at + H_WEIGHT] = f[row + INVERSE], f[row + WEIGHT]
    h[at + H_SPEED] = f[row + SPEED] if bent else 2.0 * speed2
    h[at + H_ACCELERATION] = f[row + ACCELERATION]
    for k in range(CONSTANTS):
        h[at + H_CONSTANT + k] = f[row + CONSTANT + k]
    h[at + ENTER], h[at + LEAVE] = t + t0, t + t1
    h[at + H_ROW] = row if bent else -1.0
    if direct and not bent:
        h[at + H_SPEED], h[at + H_ACCELERATION] = f[row + RISE] * speed2, f[row + FALL] * speed2
    return True


@njit(contract=True)
def meet(m: Tables, work: Work, i: int, k: int, o: Vec3, d: Vec3) -> bool:
    """Prepare primitive i as the k-th that a ray of unit speed meets, if it meets the support."""
    at = m.primitives + PRIMITIVE * i
    about = int(m.ints[at + ABOUT])
    row = m.f + int(m.ints[at + ROW])
    work.ints[k] = i
    work.ints[KINDS * work.room + k] = about & (SLIM - 1)
    if about & SLIM:
        return meet_slim(m, row, o, d, work.floats, MET * k)
    kind = about & (SLIM - 1)
    met = meet_full(m, row, kind >= DIRECT, o, d, work.floats, MET * k)
    if kind == POLYGON:
        # Its corners are counted from where the model begins.
        work.floats[MET * k + H_CONSTANT + 1] += m.f
    return met
