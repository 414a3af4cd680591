"""Places on triangle meshes: the triangle at a point, and what its corners have there."""

from __future__ import annotations

import math
from typing import NamedTuple

from pcsg.jit import njit
from pcsg.leaf.bvh import BLOCK_SIZE
from pcsg.leaf.registry import Array, Pool
from pcsg.leaf.triangles import REACH, Mesh
from pcsg.simd import local_doubles, local_integers
from pcsg.slabs import WIDTH
from pcsg.vec import Vec3


class Place(NamedTuple):
    """A point of a mesh: the triangle, and the weights of its corners."""

    triangle: int
    a: float
    b: float
    c: float


@njit
def _dot3(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    return ax * bx + ay * by + az * bz


@njit
def _closest(numbers: Array, at: int, p: Vec3) -> tuple[float, float, float, float]:
    """Return the weights of the point of a triangle nearest to p, and its squared distance.

    Ericson, "Real-Time Collision Detection", 2005, section 5.1.5.
    """
    ax, ay, az = numbers[at], numbers[at + 1], numbers[at + 2]
    ux, uy, uz = numbers[at + 3] - ax, numbers[at + 4] - ay, numbers[at + 5] - az
    vx, vy, vz = numbers[at + 6] - ax, numbers[at + 7] - ay, numbers[at + 8] - az
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
def locate(pool: Pool, mesh: Mesh, p: Vec3) -> Place:
    """Return the place of a mesh that is nearest to a point."""
    # Points of the surface are very near to it, which leaves few boxes to look into.
    size = pool[0][mesh.numbers + REACH] + abs(p.x) + abs(p.y) + abs(p.z)
    near = 1e-9 * size
    found, there = _locate_within(pool, mesh, p, near * near)
    if not there:
        found, _ = _locate_within(pool, mesh, p, math.inf)
    return found


@njit
def _locate_within(pool: Pool, mesh: Mesh, p: Vec3, best: float) -> tuple[Place, bool]:
    """Return the nearest place of a squared distance below `best`, and whether there is one."""
    numbers, integers = pool[0], pool[2]
    waiting = local_integers()
    distance = local_doubles()
    there = False
    found = Place(0, 1.0, 0.0, 0.0)
    waiting[0] = 0
    distance[0] = 0.0
    top = 1
    while top > 0:
        top -= 1
        if distance[top] >= best:
            continue
        ref = waiting[top]
        if ref < 0:
            run = -1 - ref
            for k in range(run >> 3, (run >> 3) + (run & 7)):
                a, b, c, d = _closest(numbers, mesh.corners + 9 * k, p)
                if d < best:
                    best = d
                    there = True
                    found = Place(k, a, b, c)
            continue
        begin = top
        for k in range(WIDTH):
            box = mesh.boxes + BLOCK_SIZE * ref + k
            d = 0.0
            for axis in range(3):
                below = numbers[box + WIDTH * axis] - p[axis]
                above = p[axis] - numbers[box + WIDTH * (3 + axis)]
                beside = max(below, above, 0.0)
                d += beside * beside
            if not d < best:
                continue
            place = top
            while place > begin and distance[place - 1] < d:
                distance[place], waiting[place] = distance[place - 1], waiting[place - 1]
                place -= 1
            distance[place] = d
            waiting[place] = integers[mesh.refs + WIDTH * ref + k]
            top += 1
    return found, there


@njit
def face_normal(numbers: Array, at: int) -> Vec3:
    """Return the normal of a triangle by the order of its corners, twice its area long."""
    ax, ay, az = numbers[at], numbers[at + 1], numbers[at + 2]
    ux, uy, uz = numbers[at + 3] - ax, numbers[at + 4] - ay, numbers[at + 5] - az
    vx, vy, vz = numbers[at + 6] - ax, numbers[at + 7] - ay, numbers[at + 8] - az
    return Vec3(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)


@njit
def interpolate(numbers: Array, at: int, width: int, k: int, place: Place) -> float:
    """Return the mean of number k of the three corners; each has `width` of them."""
    at += 3 * width * place.triangle + k
    a, b, c = numbers[at], numbers[at + width], numbers[at + 2 * width]
    mean: float = place.a * a + place.b * b + place.c * c
    return mean
