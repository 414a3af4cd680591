"""Places on triangle meshes: the triangle at a point, and what its corners have there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pcsg.geometry.bvh import BLOCK
from pcsg.geometry.packets import LANES, PACKET, approach_packet
from pcsg.indices import place, wide
from pcsg.jit import njit
from pcsg.leaf.registry import Array, Pool
from pcsg.leaf.triangles import (
    CENTER,
    HAS_NORMALS,
    ORIENTATION,
    PACKETS,
    REACH,
    SCALE,
    Mesh,
)
from pcsg.simd import WIDTH, count_trailing_zeros, local_integers, overlap_boxes
from pcsg.vec import Vec3

_NONE, _ONE = np.uint64(0), np.uint64(1)
_WIDTH, _BLOCK, _PACKET = np.uint64(WIDTH), np.uint64(6 * WIDTH), np.uint64(PACKET)


class Place(NamedTuple):
    """A point of a mesh.

    Attributes
    ----------
    triangle
        Its number.
    at
        Where its first number is in its packet.
    a, b, c
        Weights of its corners.
    """

    triangle: int
    at: int
    a: float
    b: float
    c: float


@njit
def _dot3(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    return ax * bx + ay * by + az * bz


@njit
def _sides(
    numbers: Array, at: int
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return a triangle's first corner, and its sides from there to the others."""
    ax, ay, az = numbers[at], numbers[at + LANES], numbers[at + 2 * LANES]
    b, c = at + 3 * LANES, at + 6 * LANES
    return (
        ax,
        ay,
        az,
        numbers[b] - ax,
        numbers[b + LANES] - ay,
        numbers[b + 2 * LANES] - az,
        numbers[c] - ax,
        numbers[c + LANES] - ay,
        numbers[c + 2 * LANES] - az,
    )


@njit
def _closest(numbers: Array, at: int, p: Vec3) -> tuple[float, float, float, float]:
    """Return the weights of the point of a triangle nearest to p, and its squared distance.

    Ericson, "Real-Time Collision Detection", 2005, section 5.1.5.
    """
    ax, ay, az, ux, uy, uz, vx, vy, vz = _sides(numbers, at)
    px, py, pz = p.x - ax, p.y - ay, p.z - az
    d1, d2 = _dot3(ux, uy, uz, px, py, pz), _dot3(vx, vy, vz, px, py, pz)
    uu, uv, vv = (
        _dot3(ux, uy, uz, ux, uy, uz),
        _dot3(ux, uy, uz, vx, vy, vz),
        _dot3(vx, vy, vz, vx, vy, vz),
    )
    # What d1 and d2 are from the second and the third corner.
    d3, d4 = d1 - uu, d2 - uv
    d5, d6 = d1 - uv, d2 - vv
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        b, c = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        b, c = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        b, c = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        b, c = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        b, c = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        c = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        b = 1.0 - c
    else:
        b, c = vb / (va + vb + vc), vc / (va + vb + vc)
    qx, qy, qz = px - b * ux - c * vx, py - b * uy - c * vy, pz - b * uz - c * vz
    return 1.0 - b - c, b, c, _dot3(qx, qy, qz, qx, qy, qz)


@njit
def is_part(pool: Pool, mesh: Mesh, part: float) -> bool:
    """Return whether a number is that of a triangle: ``LANES packet + lane``."""
    return 0.0 <= part < LANES * wide(pool[2][mesh.head + PACKETS])


@njit
def corners_of_part(mesh: Mesh, part: float) -> int:
    """Return where the numbers of a triangle begin."""
    return mesh.corners + PACKET * (int(part) // LANES) + int(part) % LANES


@njit
def locate(pool: Pool, mesh: Mesh, p: Vec3, part: float) -> Place:
    """Return the place of a triangle, or else of the mesh, that is nearest to a point."""
    numbers, integers = pool[0], pool[2]
    if is_part(pool, mesh, part):
        at = corners_of_part(mesh, part)
        a, b, c, _ = _closest(numbers, at, p)
        return Place(integers[mesh.begins + int(part) // LANES] + int(part) % LANES, at, a, b, c)
    # Points of the surface are very near to it, which leaves few boxes to look into.
    near = 1e-9 * (numbers[mesh.numbers + REACH] + abs(p.x) + abs(p.y) + abs(p.z))
    found, there = _locate_within(pool, mesh, p, near)
    while not there and near < math.inf:
        near *= 64.0
        found, there = _locate_within(pool, mesh, p, near)
    return found


@njit
def _locate_within(pool: Pool, mesh: Mesh, p: Vec3, near: float) -> tuple[Place, bool]:
    """Return the nearest place that is no farther than this, and whether there is one."""
    numbers, singles, integers = pool
    waiting = local_integers()
    at, scale = mesh.numbers, numbers[mesh.numbers + SCALE]
    x, y, z = (
        (p.x - numbers[at + CENTER]) * scale,
        (p.y - numbers[at + CENTER + 1]) * scale,
        (p.z - numbers[at + CENTER + 2]) * scale,
    )
    room = near * scale
    lx, ly, lz = np.float32(x - room), np.float32(y - room), np.float32(z - room)
    ux, uy, uz = np.float32(x + room), np.float32(y + room), np.float32(z + room)
    boxes, refs = place(mesh.boxes), place(mesh.refs)
    there = False
    best = near * near
    found = Place(0, mesh.corners, 1.0, 0.0, 0.0)
    waiting[0] = BLOCK
    top = _ONE
    while top > _NONE:
        top -= _ONE
        ref = waiting[top]
        if ref & 7 == BLOCK:
            block = place(ref >> 3)
            base = refs + _WIDTH * block
            met = overlap_boxes(singles, boxes + _BLOCK * block, lx, ly, lz, ux, uy, uz)
            while met != _NONE:
                waiting[top] = wide(integers[base + count_trailing_zeros(met)])
                met &= met - _ONE
                top += _ONE
            continue
        packet = ref >> 3
        corners = mesh.corners + PACKET * packet
        may = approach_packet(numbers, place(corners), p.x, p.y, p.z, near)
        while may != _NONE:
            k = wide(count_trailing_zeros(may))
            may &= may - _ONE
            a, b, c, d = _closest(numbers, corners + k, p)
            if d <= best:
                best = d
                there = True
                found = Place(integers[mesh.begins + packet] + k, corners + k, a, b, c)
    return found, there


@njit
def normal_at(pool: Pool, mesh: Mesh, place: Place) -> Vec3:
    """Return the outward normal at a place: the file's, or that of the triangle."""
    numbers, integers = pool[0], pool[2]
    if integers[mesh.head + HAS_NORMALS] == 1:
        x = interpolate(numbers, mesh.normals, 3, 0, place)
        y = interpolate(numbers, mesh.normals, 3, 1, place)
        z = interpolate(numbers, mesh.normals, 3, 2, place)
        if max(abs(x), abs(y), abs(z)) > 0.0:
            return Vec3(x, y, z)
    return face_normal(pool, mesh, place.at)


@njit
def face_normal(pool: Pool, mesh: Mesh, at: int) -> Vec3:
    """Return the outward normal of the triangle whose numbers begin at a place."""
    _, _, _, ux, uy, uz, vx, vy, vz = _sides(pool[0], at)
    turn = float(pool[2][mesh.head + ORIENTATION])
    return Vec3(turn * (uy * vz - uz * vy), turn * (uz * vx - ux * vz), turn * (ux * vy - uy * vx))


@njit
def interpolate(numbers: Array, at: int, width: int, k: int, place: Place) -> float:
    """Return the mean of number k of the three corners; each has `width` of them."""
    at += 3 * width * place.triangle + k
    a, b, c = numbers[at], numbers[at + width], numbers[at + 2 * width]
    mean: float = place.a * a + place.b * b + place.c * c
    return mean
