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

from pcsg.geometry.bvh import BLOCK
from pcsg.geometry.packets import LANES, PACKET, cross_packet
from pcsg.geometry.slabs import make_slabs, meet_block_at
from pcsg.indices import place, wide
from pcsg.jit import njit
from pcsg.leaf.registry import ALL, ANY, NO_PART, OVERFLOW, Array, Pool
from pcsg.simd import (
    WIDTH,
    count_trailing_zeros,
    local_doubles,
    local_integers,
    local_singles,
    stay_apart,
)
from pcsg.vec import Ray, Vec3

# The head of a mesh in the pool: integers, then numbers.
TRIANGLES, PACKETS, BLOCKS, CLOSED, ORIENTATION, HAS_UV, HAS_NORMALS, HAS_COLORS, REFS = range(9)
REACH, BOX, CENTER, SCALE, CORNERS = 0, 1, 7, 10, 16

COUNT = 3
"""Beside ALL, FIRST and ANY: only the directions of the crossings are wanted."""

_ROUNDING = 4e-15
"""Crossings that are nearer than this, relative to the mesh as the ray sees it, are one place."""

_NONE, _ONE, _TWO, _THREE = (np.uint64(k) for k in (0, 1, 2, 3))
_LANES, _TWO_LANES, _BITS = np.uint64(LANES), np.uint64(2 * LANES), np.uint64((1 << LANES) - 1)
_WIDTH, _BLOCK, _PACKET = np.uint64(WIDTH), np.uint64(6 * WIDTH), np.uint64(PACKET)
_SPLIT = 134217729.0


class Mesh(NamedTuple):
    """Where the parts of a mesh lie in the pool.

    Attributes
    ----------
    head, refs, begins
        Integers: its head, references, and the first triangle of every packet.
    boxes
        Numbers in single precision: its boxes, in a frame of their own, see `_enter_frame`.
    numbers, corners, uvs, normals, colors
        Numbers: its head, packets, and 6, 9 and 9 numbers of every triangle.
    """

    head: int
    refs: int
    begins: int
    boxes: int
    numbers: int
    corners: int
    uvs: int
    normals: int
    colors: int


@njit
def find_mesh(args: Array, at: int, pool: Pool) -> Mesh:
    """Return the places of a mesh by its kernel arguments."""
    integers = pool[2]
    head, numbers = int(args[place(at + 2)]), int(args[place(at)])
    count = wide(integers[place(head + TRIANGLES)])
    refs = head + REFS
    corners = numbers + CORNERS
    uvs = corners + PACKET * wide(integers[place(head + PACKETS)])
    normals = uvs + 6 * count * wide(integers[place(head + HAS_UV)])
    return Mesh(
        head,
        refs,
        refs + WIDTH * wide(integers[place(head + BLOCKS)]),
        int(args[place(at + 1)]),
        numbers,
        corners,
        uvs,
        normals,
        normals + 9 * count * wide(integers[place(head + HAS_NORMALS)]),
    )


class Shear(NamedTuple):
    """The map that makes a ray the third axis.

    Attributes
    ----------
    x, y, z
        Axes, times `LANES`: z is the one along which the ray runs fastest.
    ox, oy, oz
        The ray's origin along them.
    sx, sy, sz
        Shear along x and y, and scale along z.
    """

    x: np.uint64
    y: np.uint64
    z: np.uint64
    ox: float
    oy: float
    oz: float
    sx: float
    sy: float
    sz: float


@njit
def make_shear(ray: Ray) -> Shear:
    """Return the map of a ray."""
    ax, ay, az = abs(ray.dx), abs(ray.dy), abs(ray.dz)
    ox, oy, oz, dx, dy, dz = ray.ox, ray.oy, ray.oz, ray.dx, ray.dy, ray.dz
    x, y, z = _NONE, _LANES, _TWO_LANES
    if ax >= ay and ax >= az:
        x, y, z = _LANES, _TWO_LANES, _NONE
        ox, oy, oz, dx, dy, dz = oy, oz, ox, dy, dz, dx
    elif ay >= az:
        x, y, z = _TWO_LANES, _NONE, _LANES
        ox, oy, oz, dx, dy, dz = oz, ox, oy, dz, dx, dy
    return Shear(x, y, z, ox, oy, oz, dx / dz, dy / dz, 1.0 / dz)


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
def cross_triangle(numbers: Array, at: np.uint64, shear: Shear) -> tuple[float, float]:
    """Return where a ray crosses a triangle, and 1 if inwards, -1 if outwards, 0 if it does not.

    Parameters
    ----------
    numbers, at
        Its first number in its packet is ``numbers[at]``.
    """
    ox, oy, oz = shear.ox, shear.oy, shear.oz
    b_at, c_at = at + _THREE * _LANES, at + _THREE * _TWO_LANES
    az, bz, cz = (
        numbers[at + shear.z] - oz,
        numbers[b_at + shear.z] - oz,
        numbers[c_at + shear.z] - oz,
    )
    ax, ay = numbers[at + shear.x] - ox - shear.sx * az, numbers[at + shear.y] - oy - shear.sy * az
    bx, by = (
        numbers[b_at + shear.x] - ox - shear.sx * bz,
        numbers[b_at + shear.y] - oy - shear.sy * bz,
    )
    u = _edge(ax, ay, bx, by)
    cx, cy = (
        numbers[c_at + shear.x] - ox - shear.sx * cz,
        numbers[c_at + shear.y] - oy - shear.sy * cz,
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


@njit(inline=True)
def _cross_packet(numbers: Array, at: np.uint64, shear: Shear, out: Array) -> np.uint64:
    """Test a ray against a packet, also exactly where rounding could decide.

    Returns
    -------
    uint64
        Bit k is set where triangle k is crossed, bit 2 LANES + k where inwards; `out` receives
        where.
    """
    found: np.uint64 = cross_packet(
        numbers,
        at,
        shear.x,
        shear.y,
        shear.z,
        shear.ox,
        shear.oy,
        shear.oz,
        shear.sx,
        shear.sy,
        shear.sz,
        out,
    )
    if shear.sz < 0.0:
        found ^= _BITS << _TWO_LANES
    if (found >> _LANES) & _BITS != _NONE:
        found = _decide_exactly(numbers, at, shear, found, out)
    return found


@njit
def _decide_exactly(
    numbers: Array, at: np.uint64, shear: Shear, found: np.uint64, out: Array
) -> np.uint64:
    """Find out which of the doubtful triangles of a packet a ray crosses."""
    stay_apart()
    doubtful = (found >> _LANES) & _BITS
    while doubtful != _NONE:
        k = count_trailing_zeros(doubtful)
        doubtful &= doubtful - _ONE
        t, way = cross_triangle(numbers, at + k, shear)
        found &= ~(_ONE << k | _ONE << (_TWO_LANES + k))
        if way != 0.0:
            out[k] = t
            found |= _ONE << k
            if way > 0.0:
                found |= _ONE << (_TWO_LANES + k)
    return found


@njit(inline=True)
def _enter_frame(numbers: Array, at: int, ray: Ray) -> tuple[Ray, float]:
    """Return a ray in the frame of the boxes, and where to count its parameter from.

    There the mesh is about the origin and about 1 long, so that single precision is enough.
    """
    center, scale = place(at + CENTER), numbers[place(at + SCALE)]
    x, y, z = numbers[center], numbers[center + _ONE], numbers[center + _TWO]
    ox, oy, oz = (ray.ox - x) * scale, (ray.oy - y) * scale, (ray.oz - z) * scale
    dx, dy, dz = ray.dx * scale, ray.dy * scale, ray.dz * scale
    about = 0.0
    if max(abs(ox), abs(oy), abs(oz)) > 4.0:
        about = -(ox * dx + oy * dy + oz * dz) / (dx * dx + dy * dy + dz * dz)
        if not abs(about) < math.inf:
            about = 0.0
    return Ray(ox, oy, oz, dx, dy, dz, ray.tmin, ray.tmax), about


@njit(inline=True)
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
) -> tuple[int, float, int, bool, int]:
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
    count, nearest, winding, alone, part
        Number of crossings visited, `OVERFLOW` if they do not fit; the t of the one that was
        found; the sum of the directions, which is what winds about ``ray(low)``; whether no
        other one is in the place of the one that was found; and its triangle, as
        ``LANES packet + lane``.
    """
    numbers, singles, integers = pool
    waiting, entry = local_integers(), local_singles()
    entries, prepared = local_singles(), local_singles()
    crossed = local_doubles()
    shear = make_shear(ray)
    inner, about = _enter_frame(numbers, mesh.numbers, ray)
    slabs = make_slabs(inner, about, prepared)
    boxes, refs, corners = place(mesh.boxes), place(mesh.refs), place(mesh.corners)
    count = 0
    winding = 0
    part = -1
    alone = True
    nearest = math.inf
    far = high
    limit = np.float32((far - about) * slabs.speed)
    top = _NONE
    ref = BLOCK
    while True:
        if ref & 7 == BLOCK:
            block = place(ref >> 3)
            met = meet_block_at(singles, boxes + _BLOCK * block, slabs, low, far, prepared, entries)
            if met != _NONE:
                base = refs + _WIDTH * block
                k = count_trailing_zeros(met)
                met &= met - _ONE
                near = entries[k]
                ref = wide(integers[base + k])
                begin = top
                while met != _NONE:
                    k = count_trailing_zeros(met)
                    met &= met - _ONE
                    e = entries[k]
                    r = wide(integers[base + k])
                    if e < near:
                        e, near = near, e
                        r, ref = ref, r
                    # The nearest comes last, so that it is visited first.
                    p = top
                    while p > begin and entry[p - _ONE] < e:
                        entry[p], waiting[p] = entry[p - _ONE], waiting[p - _ONE]
                        p -= _ONE
                    entry[p] = e
                    waiting[p] = r
                    top += _ONE
                continue
        else:
            packet = place(ref >> 3)
            found = _cross_packet(numbers, corners + _PACKET * packet, shear, crossed)
            hits = found & _BITS
            while hits != _NONE:
                k = count_trailing_zeros(hits)
                hits &= hits - _ONE
                s = crossed[k]
                if not low <= s <= far:
                    continue
                way = 1 if (found >> (_TWO_LANES + k)) & _ONE == _ONE else -1
                winding += way
                if want == ALL:
                    if n + 2 * count + 4 > len(t):
                        return OVERFLOW, nearest, winding, True, part
                    t[n + 2 * count] = s
                    t[n + 2 * count + 1] = float(way)
                elif want != COUNT:
                    alone = s < nearest - apart
                    if s < nearest:
                        nearest = s
                        part = LANES * wide(packet) + wide(k)
                    far = nearest + apart
                    if want == ANY and (apart == 0.0 or not alone):
                        return 1, nearest, winding, alone, part
                    if want == ANY:
                        low = nearest - apart
                    limit = np.float32((far - about) * slabs.speed)
                count += 1
        while top > _NONE:
            top -= _ONE
            if entry[top] <= limit:
                break
        else:
            return count, nearest, winding, alone, part
        ref = waiting[top]


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
    """Write the intervals of a mesh; see `registry.Solid.crossings`.

    For COUNT nothing is written, and what winds about the ray's beginning is returned.
    """
    mesh = find_mesh(args, at, pool)
    numbers, integers = pool[0], pool[2]
    closed = integers[place(mesh.head + CLOSED)] == 1
    fastest = max(abs(ray.dx), abs(ray.dy), abs(ray.dz))
    size = numbers[place(mesh.numbers + REACH)] + abs(ray.ox) + abs(ray.oy) + abs(ray.oz)
    apart = _ROUNDING * size / fastest
    outside = _starts_outside(numbers, mesh.numbers, ray)
    if want == COUNT and (outside or not closed):
        return 0
    # Outside of its box a ray is outside of the solid, so that the first crossing leads in;
    # unless it leads out again in the same place, as at a silhouette.
    near = apart if closed else 0.0
    low, high = ray.tmin, ray.tmax
    if want == ALL or (want != COUNT and closed and not outside):
        want, low, high = ALL, -math.inf, math.inf
    while True:
        count, nearest, winding, alone, part = cross_triangles(
            pool, mesh, ray, want, low, high, t, n, near
        )
        if want == COUNT:
            return winding
        if want == ALL:
            break
        if count == 0:
            return n
        if alone or not closed:
            t[n], t[n + 1] = nearest, math.inf if closed else nearest
            if n + 2 < len(t):
                t[n + 2] = part
            return n + 2
        want, low, high = ALL, -math.inf, math.inf
    if count < 0:
        return OVERFLOW
    _sort_pairs(t, n, count)
    n = _pair_up(t, n, count, apart) if closed else _keep_apart(t, n, count, apart)
    if n < len(t):
        t[n] = NO_PART
    return n


@njit
def _starts_outside(numbers: Array, at: int, ray: Ray) -> bool:
    """Return whether a ray begins outside of a mesh's box."""
    box = place(at + BOX)
    x, y, z = ray.ox + ray.tmin * ray.dx, ray.oy + ray.tmin * ray.dy, ray.oz + ray.tmin * ray.dz
    inside_x = numbers[box] <= x <= numbers[box + _THREE]
    inside_y = numbers[box + _ONE] <= y <= numbers[box + _ONE + _THREE]
    inside_z = numbers[box + _TWO] <= z <= numbers[box + _TWO + _THREE]
    return not (inside_x & inside_y & inside_z)


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
    # Any direction does.
    ray = Ray(p.x, p.y, p.z, 0.36, 0.48, 0.8, 0.0, math.inf)
    return mesh_crossings(ray, COUNT, args, at, pool, local_doubles(), 0) != 0
