"""Where limbs meet: how far a joint reaches along its limbs, and the faces between their rings.

The connectivity of a joint is taken from a convex hull on a sphere, where it cannot fail: every
limb is a small square about its direction, every square is a facet of the hull, and what is left
when the squares are taken away is a sphere with one hole for each limb.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pcsg.errors import UsageError, missing_extra
from pcsg.jit import njit
from pcsg.treemesh.skeleton import Bools, Floats, Ints
from pcsg.treemesh.subdivision import corner_steps

PARTING = 1.5
"""Reach of a joint over the distance where cylinders part; 1.15 folds three times more quads."""

BEYOND = 4.0
"""But at most this many of the limb's own radii beyond: twigs begin at their bearer."""

_LEAST_SINE = 0.15
_NEARLY_OPPOSITE = math.radians(171.0)
_LEAST_ANGLE = math.radians(4.0)
_LARGEST_CAP = math.radians(50.0)


@njit(entry=True)
def measure_ends(
    ptr: Ints,
    ends: Ints,
    direction: Floats,
    radius: Floats,
    joint_radius: Floats,
    factor: Floats,
    reach: Floats,
    crotch: Floats,
) -> None:
    """Find how far every joint reaches along its limbs, and which way its rings want to turn.

    Parameters
    ----------
    ptr, ends
        Ends of limbs by joints.
    direction (e, 3), radius (e,)
        Unit vector from the joint into the limb; radius at the limb's next node.
    joint_radius (j,)
        Radius of the joints' nodes.
    factor (e,)
        Enlarges the reach, 1 to begin with.
    reach (e,), crotch (e, 3)
        Results: distance of the first ring; direction of its first corner, 0 where any will do.
    """
    for j in range(len(ptr) - 1):
        for i in range(ptr[j], ptr[j + 1]):
            e = ends[i]
            parting, nearest, partner = 0.0, -2.0, -1
            for k in range(ptr[j], ptr[j + 1]):
                f = ends[k]
                if k == i:
                    continue
                c = 0.0
                for q in range(3):
                    c += direction[e, q] * direction[f, q]
                c = max(-1.0, min(1.0, c))
                if c > nearest:
                    nearest, partner = c, f
                if math.acos(c) <= _NEARLY_OPPOSITE:
                    sine = max(_LEAST_SINE, math.sqrt(max(0.0, 1.0 - c * c)))
                    parting = max(parting, (radius[f] + radius[e] * c) / sine)
            least = max(0.6 * radius[e], 0.3 * joint_radius[j])
            beyond = min((PARTING - 1.0) * parting, BEYOND * radius[e])
            reach[e] = factor[e] * max(parting + beyond, least)
            d0, d1, d2 = direction[e, 0], direction[e, 1], direction[e, 2]
            p0, p1, p2 = direction[partner, 0], direction[partner, 1], direction[partner, 2]
            m0, m1, m2 = d1 * p2 - d2 * p1, d2 * p0 - d0 * p2, d0 * p1 - d1 * p0
            size = math.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
            if size > 1e-6:
                m0, m1, m2 = m0 / size, m1 / size, m2 / size
                s = math.sqrt(0.5)
                crotch[e, 0] = s * (m0 + m1 * d2 - m2 * d1)
                crotch[e, 1] = s * (m1 + m2 * d0 - m0 * d2)
                crotch[e, 2] = s * (m2 + m0 * d1 - m1 * d0)
            else:
                crotch[e, 0] = crotch[e, 1] = crotch[e, 2] = 0.0


def spread(directions: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors no closer than 4 degrees to each other, and half angles of their caps.

    Only the connectivity of a joint is made from these, so turning limbs apart does not show.
    """
    d = directions.copy()
    k = len(d)
    for _ in range(100):
        cosine = np.clip(d @ d.T, -1.0, 1.0)
        np.fill_diagonal(cosine, -1.0)
        if cosine.max() <= math.cos(0.999 * _LEAST_ANGLE):
            break
        push = np.zeros_like(d)
        for i, j in zip(*np.nonzero(np.triu(cosine > math.cos(_LEAST_ANGLE))), strict=True):
            apart = d[j] - d[i]
            size = float(np.linalg.norm(apart))
            if size < 1e-6:  # turn about an axis that depends on the pair only
                apart = np.cross(d[i], _spiral(i + k * j))
                size = float(np.linalg.norm(apart))
            missing = 0.55 * (_LEAST_ANGLE - math.acos(cosine[i, j]))
            push[i] -= missing * apart / size
            push[j] += missing * apart / size
        d += push
        d /= np.linalg.norm(d, axis=1)[:, None]
    angle = np.arccos(np.clip(d @ d.T, -1.0, 1.0))
    np.fill_diagonal(angle, math.pi)
    return d, np.minimum(0.49 * angle.min(axis=1), _LARGEST_CAP)


def _spiral(k: int) -> Floats:
    """Return the k-th of a sequence of unit vectors that keep apart."""
    z = 1.0 - 2.0 * ((0.5 + k * 0.6180339887498949) % 1.0)
    phi = 2.399963229728653 * k
    r = math.sqrt(1.0 - z * z)
    return np.array([r * math.cos(phi), r * math.sin(phi), z])


def hull_triangles(directions: Floats, outward: Floats, u: Floats, ends_here: Bools) -> Ints:
    """Return the triangles between the squares of a joint, (t, 3), oriented outwards.

    Parameters
    ----------
    directions (k, 3)
        Of the limbs at the joint.
    outward, u (k, 3)
        Of every limb's first ring as seen from the joint: unit tangent away from the joint, and
        towards corner 0.
    ends_here (k,)
        Whether the limb ends at the joint, so that its corners run the other way round.

    Returns
    -------
    int64 (t, 3)
        Corner q of limb i is ``4 i + q``.
    """
    try:
        from scipy.spatial import ConvexHull
    except ImportError:
        raise UsageError(missing_extra("tree meshes need", "scipy", "mesh")) from None

    d, alpha = spread(directions)
    # The frame is turned with its tangent, by the smallest rotation that takes it to d.
    both = outward + d
    cosine = 1.0 + np.einsum("ij,ij->i", outward, d)
    u = u - both * (np.einsum("ij,ij->i", u, d) / np.maximum(cosine, 1e-3))[:, None]
    u -= d * np.einsum("ij,ij->i", u, d)[:, None]
    u /= np.linalg.norm(u, axis=1)[:, None]
    side = np.cross(d, u) * np.where(ends_here, -1.0, 1.0)[:, None]
    square = np.stack([u, side, -u, -side], axis=1)
    points = np.cos(alpha)[:, None, None] * d[:, None] + np.sin(alpha)[:, None, None] * square
    points = points.reshape(-1, 3)
    for attempt in range(4):
        hull = ConvexHull(points)
        tri = hull.simplices.astype(np.int64)
        ring = tri // 4
        inside_ring = (ring[:, 0] == ring[:, 1]) & (ring[:, 1] == ring[:, 2])
        if inside_ring.sum() == 2 * len(d) and len(tri) == 8 * len(d) - 4:
            break
        # Points in a common plane may confuse the hull; a change below anything visible helps.
        points = points + 1e-7 * 10.0**attempt * np.array([_spiral(k) for k in range(len(points))])
    else:
        raise AssertionError(f"the hull of a joint with {len(d)} limbs failed")
    corner = points[tri]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    flipped = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    tri[flipped] = tri[flipped, ::-1]
    return np.asarray(tri[~inside_ring])


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces with three or four corners, and the joint of each."""

    flat: Ints
    ptr: Ints
    owner: Ints


def pair_triangles(verts: Floats, tri: Ints, owner: Ints) -> Faces:
    """Join triangles to quads where these are good ones.

    Quads that touch exactly two rings come first, then those whose angles are nearest to 90
    degrees. A triangle that is left becomes three quads in the first subdivision.

    Parameters
    ----------
    verts (v, 3)
        Corners of rings; corner q of ring i is ``4 i + q``.
    tri (t, 3), owner (t,)
        Triangles of all joints, and the joint of each.
    """
    first, other = _neighbours(tri)
    t1, t2 = first // 3, other // 3
    following = np.array([1, 2, 0])
    p, q = tri.ravel()[first], tri.ravel()[other]
    r = tri[t1, following[following[first % 3]]]
    s = tri[t2, following[following[other % 3]]]
    quad = np.stack([p, s, q, r], axis=1)
    normal = np.cross(verts[tri[:, 1]] - verts[tri[:, 0]], verts[tri[:, 2]] - verts[tri[:, 0]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    flat_enough = np.einsum("ij,ij->i", normal[t1], normal[t2]) >= 0.3
    worst = np.abs(quad_angles(verts, quad) - 90.0).max(axis=1)
    rings = np.sort(quad // 4, axis=1)
    spans_two = (np.diff(rings, axis=1) != 0).sum(axis=1) == 1
    good = np.flatnonzero(flat_enough & (worst <= 75.0))
    order = good[np.lexsort((worst[good].round(6), ~spans_two[good]))]
    taken = [False] * len(tri)
    chosen = []
    for k, a, b in zip(order.tolist(), t1[order].tolist(), t2[order].tolist(), strict=True):
        if not taken[a] and not taken[b]:
            taken[a] = taken[b] = True
            chosen.append(k)
    left = np.flatnonzero(~np.array(taken, dtype=bool))
    sizes = np.concatenate([np.full(len(chosen), 4), np.full(len(left), 3)]).astype(np.int64)
    return Faces(
        np.concatenate([quad[chosen].ravel(), tri[left].ravel()]),
        np.concatenate([[0], np.cumsum(sizes)]),
        np.concatenate([owner[t1[chosen]], owner[left]]),
    )


def _neighbours(tri: Ints) -> tuple[Ints, Ints]:
    """Return the pairs of corners from which an edge runs in both directions."""
    a = tri.ravel()
    b = a[corner_steps(np.arange(0, a.size + 1, 3))[1]]
    big = int(a.max(initial=0)) + 1
    ahead, back = a * big + b, b * big + a
    order = np.argsort(ahead)
    at = np.minimum(np.searchsorted(ahead[order], back), max(len(order) - 1, 0))
    twin = order[at]
    found = np.flatnonzero((ahead[twin] == back) & (a < b))
    return found, twin[found]


def quad_angles(verts: Floats, quads: Ints) -> Floats:
    """Return the angles at the corners of quads (f, 4), in degrees."""
    corner = verts[quads]
    ahead = np.roll(corner, -1, axis=1) - corner
    size = np.maximum(np.linalg.norm(ahead, axis=2), 1e-300)
    ahead /= size[:, :, None]
    cosine = -np.einsum("ijk,ijk->ij", ahead, np.roll(ahead, 1, axis=1))
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
