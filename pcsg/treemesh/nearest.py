"""Questions to a triangle mesh: the closest point, the surface along a normal, what cuts what."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.bvh import BLOCK, EMPTY, STACK, build_hierarchy
from pcsg.jit import njit
from pcsg.simd import WIDTH
from pcsg.treemesh.skeleton import Floats, Ints
from pcsg.treemesh.threads import run_chunks

Indices = NDArray[np.int32]
Planes = NDArray[np.float32]

_BLOCK_SIZE = 6 * WIDTH


@njit
def _closest_on_triangle(
    tri: Floats, f: int, px: float, py: float, pz: float
) -> tuple[float, float, float]:
    """Return the point of triangle f closest to a point (Ericson 2005, section 5.1.5)."""
    ax, ay, az = tri[f, 0], tri[f, 1], tri[f, 2]
    bx, by, bz = tri[f, 3] - ax, tri[f, 4] - ay, tri[f, 5] - az
    cx, cy, cz = tri[f, 6] - ax, tri[f, 7] - ay, tri[f, 8] - az
    x, y, z = px - ax, py - ay, pz - az
    d1, d2 = bx * x + by * y + bz * z, cx * x + cy * y + cz * z
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az
    bb, bc, cc = (
        bx * bx + by * by + bz * bz,
        bx * cx + by * cy + bz * cz,
        cx * cx + cy * cy + cz * cz,
    )
    d3, d4 = d1 - bb, d2 - bc
    if d3 >= 0.0 and d4 <= d3:
        return ax + bx, ay + by, az + bz
    d5, d6 = d1 - bc, d2 - cc
    if d6 >= 0.0 and d5 <= d6:
        return ax + cx, ay + cy, az + cz
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3) if d1 != d3 else 0.0
        return ax + v * bx, ay + v * by, az + v * bz
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6) if d2 != d6 else 0.0
        return ax + w * cx, ay + w * cy, az + w * cz
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        s = (d4 - d3) + (d5 - d6)
        w = (d4 - d3) / s if s != 0.0 else 0.0
        return (
            ax + bx + w * (cx - bx),
            ay + by + w * (cy - by),
            az + bz + w * (cz - bz),
        )
    total = va + vb + vc
    v, w = vb / total, vc / total
    return ax + v * bx + w * cx, ay + v * by + w * cy, az + v * bz + w * cz


@njit
def _box_distance(planes: Planes, at: int, px: float, py: float, pz: float) -> float:
    """Return the squared distance of a point from a box of a block."""
    dx = max(planes[at] - px, px - planes[at + 3 * WIDTH], 0.0)
    dy = max(planes[at + WIDTH] - py, py - planes[at + 4 * WIDTH], 0.0)
    dz = max(planes[at + 2 * WIDTH] - pz, pz - planes[at + 5 * WIDTH], 0.0)
    squared: float = dx * dx + dy * dy + dz * dz
    return squared


@njit(entry=True)
def closest_range(
    points: Floats,
    planes: Planes,
    refs: Indices,
    tri: Floats,
    begin: int,
    end: int,
    stack: Ints,
    found: Floats,
) -> None:
    """Write to ``found[begin:end]`` the closest points of a mesh, and their distances."""
    for k in range(begin, end):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        best = math.inf
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            block = stack[top]
            nearest, at = math.inf, -1
            for c in range(WIDTH):
                ref = refs[WIDTH * block + c]
                if ref == EMPTY:
                    continue
                beside = _box_distance(planes, _BLOCK_SIZE * block + c, px, py, pz)
                if beside >= best:
                    continue
                if ref & 7 == BLOCK:
                    stack[top] = ref >> 3
                    if beside < nearest:
                        nearest, at = beside, top
                    top += 1
                    continue
                qx, qy, qz = _closest_on_triangle(tri, ref >> 3, px, py, pz)
                d = (px - qx) ** 2 + (py - qy) ** 2 + (pz - qz) ** 2
                if d < best:
                    best = d
                    found[k, 0], found[k, 1], found[k, 2] = qx, qy, qz
            if at >= 0:
                # The nearest of the boxes just pushed comes first.
                stack[at], stack[top - 1] = stack[top - 1], stack[at]
        found[k, 3] = math.sqrt(best)


@njit
def _cross_line(
    tri: Floats, f: int, px: float, py: float, pz: float, dx: float, dy: float, dz: float
) -> tuple[float, float]:
    """Return t where the line p + t d meets triangle f (inf for a miss), and normal . d."""
    ax, ay, az = tri[f, 0], tri[f, 1], tri[f, 2]
    bx, by, bz = tri[f, 3] - ax, tri[f, 4] - ay, tri[f, 5] - az
    cx, cy, cz = tri[f, 6] - ax, tri[f, 7] - ay, tri[f, 8] - az
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    along = nx * dx + ny * dy + nz * dz
    if along == 0.0:
        return math.inf, 0.0
    ox, oy, oz = ax - px, ay - py, az - pz
    t = (nx * ox + ny * oy + nz * oz) / along
    ex, ey, ez = oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx
    u = (cx * ex + cy * ey + cz * ez) / along
    v = -(bx * ex + by * ey + bz * ez) / along
    if u < -1e-12 or v < -1e-12 or u + v > 1.0 + 1e-12:
        return math.inf, along
    return t, along


@njit(entry=True)
def shoot_range(
    points: Floats,
    normals: Floats,
    limit: Floats,
    planes: Planes,
    refs: Indices,
    tri: Floats,
    begin: int,
    end: int,
    stack: Ints,
    found: Floats,
) -> None:
    """Write to ``found[begin:end]`` the signed t of the nearest face along the normal, or NaN.

    Only faces whose normal agrees with the given one count, and |t| up to the limit.
    """
    for k in range(begin, end):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        dx, dy, dz = normals[k, 0], normals[k, 1], normals[k, 2]
        best, t_best = limit[k], math.nan
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            block = stack[top]
            for c in range(WIDTH):
                ref = refs[WIDTH * block + c]
                if ref == EMPTY:
                    continue
                at = _BLOCK_SIZE * block + c
                if (
                    planes[at] > px + best * abs(dx)
                    or planes[at + 3 * WIDTH] < px - best * abs(dx)
                    or planes[at + WIDTH] > py + best * abs(dy)
                    or planes[at + 4 * WIDTH] < py - best * abs(dy)
                    or planes[at + 2 * WIDTH] > pz + best * abs(dz)
                    or planes[at + 5 * WIDTH] < pz - best * abs(dz)
                ):
                    continue
                if ref & 7 == BLOCK:
                    stack[top] = ref >> 3
                    top += 1
                    continue
                t, along = _cross_line(tri, ref >> 3, px, py, pz, dx, dy, dz)
                if along > 0.0 and abs(t) <= best:
                    best, t_best = abs(t), t
        found[k] = t_best


@njit
def _edge_cuts(tri: Floats, f: int, side: int, g: int) -> bool:
    """Return whether an edge of triangle f passes through triangle g."""
    i, j = 3 * side, 3 * ((side + 1) % 3)
    px, py, pz = tri[f, i], tri[f, i + 1], tri[f, i + 2]
    t, _ = _cross_line(tri, g, px, py, pz, tri[f, j] - px, tri[f, j + 1] - py, tri[f, j + 2] - pz)
    return 0.0 <= t <= 1.0


@njit(entry=True)
def cuts_range(
    boxes: Floats,
    planes: Planes,
    refs: Indices,
    tri: Floats,
    corners: Ints,
    face: Ints,
    begin: int,
    end: int,
    stack: Ints,
    found: Ints,
) -> None:
    """Count for triangles [begin, end) the later ones that they cut and share no vertex with.

    Parameters
    ----------
    boxes (t, 6), tri (t, 9), corners (t, 3), face (t,)
        Triangles in the order of the hierarchy: boxes, places, the corners of the faces that they
        are parts of (t, 4), and these faces' numbers.
    found (t, 2)
        Result: how many, and whether there is any earlier or later one.
    """
    for k in range(begin, end):
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            block = stack[top]
            for c in range(WIDTH):
                ref = refs[WIDTH * block + c]
                if ref == EMPTY:
                    continue
                at = _BLOCK_SIZE * block + c
                apart = False
                for axis in range(3):
                    apart |= (
                        planes[at + WIDTH * axis] > boxes[k, 3 + axis]
                        or planes[at + WIDTH * (3 + axis)] < boxes[k, axis]
                    )
                if apart:
                    continue
                if ref & 7 == BLOCK:
                    stack[top] = ref >> 3
                    top += 1
                    continue
                g = ref >> 3
                if face[g] == face[k] or _share_corner(corners, k, g) or _are_apart(boxes, k, g):
                    continue
                for side in range(3):
                    if _edge_cuts(tri, k, side, g) or _edge_cuts(tri, g, side, k):
                        found[k, 1] = 1
                        if face[g] > face[k]:
                            found[k, 0] += 1
                        break


@njit
def _share_corner(corners: Ints, k: int, g: int) -> bool:
    for p in range(corners.shape[1]):
        for q in range(corners.shape[1]):
            if corners[k, p] == corners[g, q]:
                return True
    return False


@njit
def _are_apart(boxes: Floats, k: int, g: int) -> bool:
    for axis in range(3):
        if boxes[g, axis] > boxes[k, 3 + axis] or boxes[g, 3 + axis] < boxes[k, axis]:
            return True
    return False


class MeshIndex:
    """A triangle mesh ready for questions.

    Parameters
    ----------
    verts (v, 3), faces (f, 3)
        The mesh.
    """

    def __init__(self, verts: Floats, faces: Ints) -> None:
        places = verts[faces]
        boxes = np.concatenate([places.min(axis=1), places.max(axis=1)], axis=1)
        found = build_hierarchy(boxes)
        self.order = found.order.astype(np.int64)
        self.planes, self.refs = found.boxes, found.refs
        self.tri = np.ascontiguousarray(places[self.order].reshape(-1, 9))
        self.boxes = np.ascontiguousarray(boxes[self.order])

    def closest(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the closest points (n, 3) of the mesh, and their distances (n,)."""
        found = np.empty((len(points), 4))

        def run(begin: int, end: int, stack: Ints) -> None:
            closest_range(points, self.planes, self.refs, self.tri, begin, end, stack, found)

        _run(run, len(points))
        return found[:, :3], found[:, 3]

    def shoot(self, points: Floats, normals: Floats, limit: Floats) -> Floats:
        """Return the signed distance along normals to the nearest face that looks their way.

        NaN where there is none within the limit (n,).
        """
        found = np.empty(len(points))

        def run(begin: int, end: int, stack: Ints) -> None:
            shoot_range(
                points,
                normals,
                limit,
                self.planes,
                self.refs,
                self.tri,
                begin,
                end,
                stack,
                found,
            )

        _run(run, len(points))
        return found


def _run(run: Callable[[int, int, Ints], None], n: int) -> None:
    def with_stack(begin: int, end: int) -> None:
        run(begin, end, np.empty(STACK, dtype=np.int64))

    run_chunks(with_stack, n)


def find_cuts(verts: Floats, quads: Ints, triangles: Ints) -> tuple[int, Ints]:
    """Return the number of pairs of quads that cut each other, and the quads that do.

    Parameters
    ----------
    triangles (2 f, 3)
        Of the quads, two for each in order. Quads that share a vertex do not count.
    """
    index = MeshIndex(verts, triangles)
    face = index.order // 2
    corners = np.ascontiguousarray(quads[face])
    found = np.zeros((len(triangles), 2), dtype=np.int64)

    def run(begin: int, end: int, stack: Ints) -> None:
        cuts_range(
            index.boxes,
            index.planes,
            index.refs,
            index.tri,
            corners,
            face,
            begin,
            end,
            stack,
            found,
        )

    _run(run, len(triangles))
    return int(found[:, 0].sum()), np.unique(face[found[:, 1] > 0])


def sample_surface(verts: Floats, faces: Ints, per_face: int = 10, seed: int = 0) -> Floats:
    """Return points on triangles, `per_face` on each on average, evenly by area."""
    rng = np.random.default_rng(seed)
    a, b, c = (verts[k] for k in faces.T)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    total = np.cumsum(area)
    n = per_face * len(faces)
    place = (np.arange(n) + rng.random(n)) / n * total[-1]
    f = np.minimum(np.searchsorted(total, place), len(faces) - 1)
    u, v = rng.random(n), rng.random(n)
    flip = u + v > 1.0
    u[flip], v[flip] = 1.0 - u[flip], 1.0 - v[flip]
    return np.asarray(a[f] + u[:, None] * (b[f] - a[f]) + v[:, None] * (c[f] - a[f]))
