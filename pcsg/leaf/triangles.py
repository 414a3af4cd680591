"""Rays and points against the triangles of one mesh: kernels of the mesh leaf.

Watertight: Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013. Vertices
are sheared so that the ray becomes the third axis through the origin. There the edge functions of
two triangles with a common edge are the same numbers with opposite signs; where rounding could
decide a sign, it is found exactly, and where it is zero, as if the ray passed infinitesimally
beside (Edelsbrunner, Mücke, "Simulation of Simplicity", 1990). So every ray crosses a closed mesh
as often inwards as outwards, also through edges and vertices.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.leaf.bvh import BLOCK_SIZE
from pcsg.leaf.registry import ALL, ANY, OVERFLOW, Array, Pool
from pcsg.simd import count_trailing_zeros, local_doubles, local_integers
from pcsg.slabs import WIDTH, make_slabs, meet_block_at
from pcsg.vec import Ray, Vec3

# The head of a mesh in the pool: integers, then numbers.
TRIANGLES, CLOSED, ORIENTATION, HAS_UV, HAS_NORMALS, HAS_COLORS, REFS = range(7)
REACH, BOX, BOXES = 0, 1, 7

COUNT = 3
"""Beside ALL, FIRST and ANY: only the directions of the crossings are wanted."""

_ROUNDING = 4e-15
"""Crossings that are nearer than this, relative to the mesh as the ray sees it, are one place."""

_ONE = np.uint64(1)
_NONE = np.uint64(0)
_SPLIT = 134217729.0


class Mesh(NamedTuple):
    """Where the parts of a mesh lie in the pool.

    Attributes
    ----------
    head, refs
        Integers: its head, and its references.
    numbers, boxes, corners, uvs, normals, colors
        Numbers: its head, boxes, and 9, 6, 9 and 9 numbers of every triangle.
    """

    head: int
    refs: int
    numbers: int
    boxes: int
    corners: int
    uvs: int
    normals: int
    colors: int


@njit
def find_mesh(args: Array, at: int, pool: Pool) -> Mesh:
    """Return the places of a mesh by its kernel arguments."""
    integers = pool[2]
    head = int(args[at + 2])
    numbers = int(args[at])
    count = integers[head + TRIANGLES]
    boxes = numbers + BOXES
    corners = boxes + integers[head + REFS]
    uvs = corners + 9 * count
    normals = uvs + 6 * count * integers[head + HAS_UV]
    colors = normals + 9 * count * integers[head + HAS_NORMALS]
    return Mesh(head, head + REFS + 1, numbers, boxes, corners, uvs, normals, colors)


class Shear(NamedTuple):
    """The map that makes a ray the third axis.

    Attributes
    ----------
    x, y, z
        Axes: z is the one along which the ray runs fastest.
    ox, oy, oz
        The ray's origin along them.
    sx, sy, sz
        Shear along x and y, and scale along z.
    """

    x: int
    y: int
    z: int
    ox: float
    oy: float
    oz: float
    sx: float
    sy: float
    sz: float


@njit
def _make_shear(ray: Ray) -> Shear:
    ax, ay, az = abs(ray.dx), abs(ray.dy), abs(ray.dz)
    z = 2
    if ax >= ay and ax >= az:
        z = 0
    elif ay >= az:
        z = 1
    x, y = (z + 1) % 3, (z + 2) % 3
    d = ray[3 + z]
    return Shear(x, y, z, ray[x], ray[y], ray[z], ray[3 + x] / d, ray[3 + y] / d, 1.0 / d)


@njit
def _product_error(a: float, b: float, product: float) -> float:
    """Return what rounding took from a product (Dekker, 1971)."""
    s, t = _SPLIT * a, _SPLIT * b
    a1, b1 = s - (s - a), t - (t - b)
    a2, b2 = a - a1, b - b1
    return a2 * b2 - (((product - a1 * b1) - a2 * b1) - a1 * b2)


@njit
def _edge_exactly(px: float, py: float, qx: float, qy: float) -> float:
    a, b = px * qy, py * qx
    exact = (a - b) + (_product_error(px, qy, a) - _product_error(py, qx, b))
    if exact != 0.0:
        return exact
    # The origin moved by (e, e e) for an infinitely small e.
    if py != qy:
        return math.copysign(5e-324, py - qy)
    if px != qx:
        return math.copysign(5e-324, qx - px)
    return 0.0


@njit(inline=True)
def _edge(px: float, py: float, qx: float, qy: float) -> float:
    """Return twice the area of the origin, p, q, with the right sign and zero for p = q only."""
    a, b = px * qy, py * qx
    area = a - b
    if abs(area) > 1e-15 * (abs(a) + abs(b)):
        return area
    return _edge_exactly(px, py, qx, qy)


@njit(inline=True)
def _weight(edge: float) -> float:
    """Return an edge function without the sign that stands for infinitely little."""
    return edge if abs(edge) > 5e-324 else 0.0


@njit
def _cross_triangle(numbers: NDArray[np.float64], at: int, shear: Shear) -> tuple[float, float]:
    """Return where a ray crosses a triangle, and 1 if inwards, -1 if outwards, 0 if it does not.

    Parameters
    ----------
    numbers, at
        The corners begin at ``numbers[at]``.
    """
    ox, oy, oz = shear.ox, shear.oy, shear.oz
    az, bz, cz = (
        numbers[at + shear.z] - oz,
        numbers[at + 3 + shear.z] - oz,
        numbers[at + 6 + shear.z] - oz,
    )
    ax, ay = numbers[at + shear.x] - ox - shear.sx * az, numbers[at + shear.y] - oy - shear.sy * az
    bx, by = (
        numbers[at + 3 + shear.x] - ox - shear.sx * bz,
        numbers[at + 3 + shear.y] - oy - shear.sy * bz,
    )
    u = _edge(ax, ay, bx, by)
    cx, cy = (
        numbers[at + 6 + shear.x] - ox - shear.sx * cz,
        numbers[at + 6 + shear.y] - oy - shear.sy * cz,
    )
    v = _edge(bx, by, cx, cy)
    if (u > 0.0) != (v > 0.0):
        return 0.0, 0.0
    w = _edge(cx, cy, ax, ay)
    if (u > 0.0) != (w > 0.0) or u == 0.0 or v == 0.0 or w == 0.0:
        return 0.0, 0.0
    # Weights of a mean, so that t lies between those of the corners. On an edge one is zero.
    a, b, c = _weight(v), _weight(w), _weight(u)
    total = a + b + c
    z = (a * az + b * bz + c * cz) / total if total != 0.0 else az
    t = z * shear.sz
    return t, -math.copysign(1.0, u * shear.sz)


@njit
def cross_triangles(
    pool: Pool,
    mesh: Mesh,
    ray: Ray,
    want: int,
    low: float,
    high: float,
    t: Array,
    n: int,
    apart: float,
) -> tuple[int, float, int, bool]:
    """Visit the triangles that a ray crosses in [low, high].

    Parameters
    ----------
    want
        ALL: write t and 1 (inwards) or -1 (outwards) of every crossing to ``t[n:]``. FIRST: find
        the nearest. ANY: find one. COUNT: find none.
    apart
        For FIRST and ANY: crossings no farther apart than this are in one place; 0 where nobody
        asks for others there.

    Returns
    -------
    count, nearest, winding, alone
        Number of crossings visited, `OVERFLOW` if they do not fit; the t of the one that was
        found; the sum of the directions, which is what winds about ``ray(low)``; and whether no
        other one is in the place of the one that was found.
    """
    numbers, integers = pool[0], pool[2]
    waiting = local_integers()
    entry = local_doubles()
    shear = _make_shear(ray)
    slabs = make_slabs(ray)
    count = 0
    winding = 0
    alone = True
    nearest = math.inf
    far = high
    waiting[0] = 0
    entry[0] = low
    entries = local_doubles()
    top = 1
    while top > 0:
        top -= 1
        if entry[top] > far:
            continue
        ref = waiting[top]
        if ref < 0:
            run = -1 - ref
            for k in range(run >> 3, (run >> 3) + (run & 7)):
                s, way = _cross_triangle(numbers, mesh.corners + 9 * k, shear)
                if way == 0.0 or not low <= s <= far:
                    continue
                winding += int(way)
                if want == ALL:
                    if n + 2 * count + 4 > len(t):
                        return OVERFLOW, nearest, winding, True
                    t[n + 2 * count] = s
                    t[n + 2 * count + 1] = way
                elif want != COUNT:
                    alone = s < nearest - apart
                    nearest = min(s, nearest)
                    far = nearest + apart
                    if want == ANY and (apart == 0.0 or not alone):
                        return 1, nearest, winding, alone
                    if want == ANY:
                        low = nearest - apart
                count += 1
            continue
        block = np.uint64(mesh.boxes + BLOCK_SIZE * ref)
        met = meet_block_at(numbers, block, slabs, low, far, entries)
        base = mesh.refs + WIDTH * ref
        begin = top
        while met != _NONE:
            k = wide(count_trailing_zeros(met))
            met &= met - _ONE
            # The nearest comes last, so that it is visited first.
            p = top
            if want != ALL:
                while p > begin and entry[p - 1] < entries[k]:
                    entry[p], waiting[p] = entry[p - 1], waiting[p - 1]
                    p -= 1
            entry[p] = entries[k]
            waiting[p] = integers[base + k]
            top += 1
    return count, nearest, winding, alone


@njit
def _sort_pairs(t: Array, n: int, count: int) -> None:
    """Sort pairs of numbers by the first of each."""
    for i in range(1, count):
        a, b = t[n + 2 * i], t[n + 2 * i + 1]
        k = i
        while k > 0 and t[n + 2 * k - 2] > a:
            t[n + 2 * k], t[n + 2 * k + 1] = t[n + 2 * k - 2], t[n + 2 * k - 1]
            k -= 1
        t[n + 2 * k], t[n + 2 * k + 1] = a, b


@njit
def mesh_crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
    """Write the intervals of a mesh; see `registry.Solid.crossings`."""
    mesh = find_mesh(args, at, pool)
    numbers, integers = pool[0], pool[2]
    closed = integers[mesh.head + CLOSED] == 1
    fastest = max(abs(ray.dx), abs(ray.dy), abs(ray.dz))
    size = numbers[mesh.numbers + REACH] + abs(ray.ox) + abs(ray.oy) + abs(ray.oz)
    apart = _ROUNDING * size / fastest
    if want != ALL and (not closed or _starts_outside(numbers, mesh.numbers, ray)):
        # Outside of its box a ray is outside of the solid, so that the first crossing leads in;
        # unless it leads out again in the same place, as at a silhouette.
        near = apart if closed else 0.0
        tmin, tmax = ray.tmin, ray.tmax
        count, nearest, _, alone = cross_triangles(pool, mesh, ray, want, tmin, tmax, t, n, near)
        if count == 0:
            return n
        if alone or not closed:
            t[n], t[n + 1] = nearest, math.inf if closed else nearest
            return n + 2
    count, _, _, _ = cross_triangles(pool, mesh, ray, ALL, -math.inf, math.inf, t, n, 0.0)
    if count < 0:
        return OVERFLOW
    _sort_pairs(t, n, count)
    return _pair_up(t, n, count, apart) if closed else _keep_apart(t, n, count, apart)


@njit
def _starts_outside(numbers: Array, at: int, ray: Ray) -> bool:
    """Return whether a ray begins outside of a mesh's box."""
    for axis in range(3):
        p = ray[axis] + ray.tmin * ray[3 + axis]
        if not numbers[at + BOX + axis] <= p <= numbers[at + BOX + 3 + axis]:
            return True
    return False


@njit
def _pair_up(t: Array, n: int, count: int, apart: float) -> int:
    """Turn sorted crossings into intervals where the winding number is not zero."""
    winding = 0
    out = n
    entered = 0.0
    for k in range(count):
        s, way = t[n + 2 * k], int(t[n + 2 * k + 1])
        if winding == 0:
            entered = s
        winding += way
        if winding == 0:
            if out > n and entered - t[out - 1] <= apart:
                t[out - 1] = s
            elif s - entered > apart:
                t[out], t[out + 1] = entered, s
                out += 2
    return out


@njit
def _keep_apart(t: Array, n: int, count: int, apart: float) -> int:
    """Turn sorted crossings into intervals of length zero, those in one place into one."""
    out = n
    for k in range(count):
        s = t[n + 2 * k]
        if out == n or s - t[out - 1] > apart:
            t[out], t[out + 1] = s, s
            out += 2
    return out


@njit
def mesh_contains(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
    """Return whether a mesh winds about a point."""
    mesh = find_mesh(args, at, pool)
    if pool[2][mesh.head + CLOSED] == 0:
        return False
    # Any direction does.
    ray = Ray(p.x, p.y, p.z, 0.36, 0.48, 0.8, 0.0, math.inf)
    numbers = pool[0]
    if _starts_outside(numbers, mesh.numbers, ray):
        return False
    nowhere = local_doubles()
    _, _, winding, _ = cross_triangles(pool, mesh, ray, COUNT, 0.0, math.inf, nowhere, 0, 0.0)
    return winding != 0
