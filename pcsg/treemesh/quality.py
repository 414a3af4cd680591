"""Measures of a quad mesh: angles, folds, aspect, edge flow, radius."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from pcsg.treemesh.joints import quad_angles
from pcsg.treemesh.skeleton import Bools, Floats, Ints

if TYPE_CHECKING:
    from pcsg.treemesh.surface import QuadMesh


def corner_folds(verts: Floats, quads: Ints, normals: Floats) -> Bools:
    """Return whether the corners of quads (f, 4) are turned inside out.

    A corner is folded if its normal, from its two sides, points against the field's.
    """
    corner = verts[quads]
    ahead = np.roll(corner, -1, axis=1) - corner
    back = np.roll(corner, 1, axis=1) - corner
    normal = np.cross(ahead, back)
    return np.asarray(np.einsum("ijk,ijk->ij", normal, normals[quads]) < 0.0)


def smallest_angles(verts: Floats, quads: Ints) -> Floats:
    """Return the smallest angle of every quad, in degrees."""
    return np.asarray(quad_angles(verts, quads).min(axis=1))


def aspect_ratios(verts: Floats, quads: Ints) -> Floats:
    """Return the longest side over the shortest of every quad."""
    corner = verts[quads]
    sides = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2)
    return np.asarray(sides.max(axis=1) / np.maximum(sides.min(axis=1), 1e-300))


def valence(quads: Ints, n_verts: int) -> Ints:
    """Return the number of quads at every vertex."""
    return np.bincount(quads.ravel(), minlength=n_verts)


def limb_places(surf: QuadMesh) -> tuple[Ints, Ints, Floats, Floats, Floats]:
    """Return, for the vertices of limbs, where they stand along their limb.

    Returns
    -------
    vertex (k,), row (k,), distance (k,), radius (k,), arc (k,)
        The vertices, the nearest segment of their own limb, their distance from its axis, the
        interpolated radius there, and the arc length along the limb.
    """
    limbs = surf.skeleton.limbs
    table, row_of = surf.field.table, surf.field.row
    at = np.flatnonzero(surf.owner < len(limbs))
    points, owner = surf.positions[at], surf.owner[at]
    best = np.full(len(at), math.inf)
    row, radius, arc = np.zeros(len(at), np.int64), np.zeros(len(at)), np.zeros(len(at))
    order = np.argsort(owner, kind="stable")
    bounds = np.searchsorted(owner[order], np.arange(len(limbs) + 1))
    for k in range(len(limbs)):
        mine = order[bounds[k] : bounds[k + 1]]
        for i in range(limbs.ptr[k], limbs.ptr[k + 1] - 1):
            line = table[row_of[i]]
            away = points[mine] - line[0:3]
            x = np.clip(away @ line[3:6], 0.0, line[6])
            distance = np.linalg.norm(away - x[:, None] * line[3:6], axis=1)
            nearer = distance < best[mine]
            chosen = mine[nearer]
            best[chosen], row[chosen] = distance[nearer], row_of[i]
            part = x[nearer] / line[6]
            radius[chosen] = limbs.radius[i] + part * (limbs.radius[i + 1] - limbs.radius[i])
            arc[chosen] = limbs.arc[i] + x[nearer]
    return at, row, best, radius, arc


def away_from_ends(surf: QuadMesh, owner: Ints, arc: Floats, factor: float = 3.0) -> Bools:
    """Return which places of limbs are farther from joints and tips than `factor` radii.

    At a joint the radius is that of the thickest limb there.
    """
    limbs = surf.skeleton.limbs
    ptr, ends = limbs.joint_ends
    limb, side = ends // 2, ends % 2
    last = limbs.ptr[limb + 1] - 1
    thick = limbs.radius[np.where(side == 0, limbs.ptr[limb] + 1, last - 1)]
    thickest = np.maximum.reduceat(thick, ptr[:-1]) if len(thick) else np.zeros(0)
    thickest = np.maximum(thickest, surf.skeleton.radius[limbs.joints])
    margin = np.stack([limbs.radius[limbs.ptr[:-1]], limbs.radius[limbs.ptr[1:] - 1]], axis=1)
    at_joint = limbs.ends >= 0
    margin[at_joint] = thickest[limbs.ends[at_joint]]
    margin *= factor
    return np.asarray((arc > margin[owner, 0]) & (arc < limbs.lengths[owner] - margin[owner, 1]))


def edge_flow(surf: QuadMesh, vertex: Ints, row: Ints) -> Floats:
    """Return the angle between the limb and the nearest side of a quad, at vertices, in degrees."""
    verts = surf.positions
    place = np.full(len(verts), -1)
    place[vertex] = np.arange(len(vertex))
    a, b = surf.quads.ravel(), np.roll(surf.quads, -1, axis=1).ravel()
    side = verts[b] - verts[a]
    side /= np.maximum(np.linalg.norm(side, axis=1), 1e-300)[:, None]
    use = place[a] >= 0
    tangent = surf.field.table[row, 3:6][place[a[use]]]
    along = np.abs(np.einsum("ij,ij->i", side[use], tangent))
    best = np.zeros(len(vertex))
    np.maximum.at(best, place[a[use]], along)
    return np.asarray(np.degrees(np.arccos(np.clip(best, -1.0, 1.0))))
