"""Marching tetrahedra on a field of segments: the baseline for meshes of trees."""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcsg.treemesh.field import SegmentField, build_field
from pcsg.treemesh.skeleton import Skeleton

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
# Kuhn's cut of a cube: one tetrahedron for each way from (0, 0, 0) to (1, 1, 1).
TETRAHEDRA = np.array(
    [
        [0, a, b, 7]
        for a, b in (
            (4, 6),
            (4, 5),
            (2, 6),
            (2, 3),
            (1, 5),
            (1, 3),
        )
    ]
)


@dataclass(frozen=True)
class Contour:
    """A triangulated iso-surface."""

    triangles: Floats
    tetrahedra: int
    points: int
    seconds: dict[str, float]

    def smallest_angles(self) -> Floats:
        a = self.triangles
        side = np.roll(a, -1, axis=1) - a
        size = np.linalg.norm(side, axis=2)
        whole = (size > 1e-12).all(axis=1)
        side, size = side[whole], size[whole]
        cosine = -np.einsum("ijk,ijk->ij", side, np.roll(side, 1, axis=1))
        cosine /= size * np.roll(size, 1, axis=1)
        return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).min(axis=1)

    def lost_tips(self, skel: Skeleton) -> float:
        """Share of tips that are farther than two of their radii from the surface."""
        from scipy.spatial import cKDTree

        away, _ = cKDTree(self.triangles.reshape(-1, 3)).query(skel.pos[skel.tips])
        return float((away > 2.0 * skel.radius[skel.tips]).mean())


def near_cells(field: SegmentField, cell: float) -> tuple[Integers, Integers]:
    """Cells within 1.6 radii of a segment, and the first segment of each."""
    found, rows = [], []
    for k, row in enumerate(field.table):
        steps = max(2, int(np.ceil(2.0 * row[6] / cell)))
        t = np.linspace(-0.6, row[6] + 0.6 * row[10], steps)[:, None]
        reach = 1.6 * max(row[10], row[11])
        n = int(np.ceil(reach / cell)) + 1
        box = np.array(list(itertools.product(range(-n, n + 1), repeat=3)))
        box = box[np.linalg.norm(box * cell, axis=1) <= reach + 2.0 * cell]
        line = row[0:3] + np.clip(t, -0.6 * row[10], row[6] + 0.6 * row[11]) * row[3:6]
        cells = (np.floor(line / cell).astype(np.int64)[:, None] + box).reshape(-1, 3)
        cells = np.unique(cells, axis=0)
        found.append(cells)
        rows.append(np.full(len(cells), k))
    cells, first = np.unique(np.concatenate(found), axis=0, return_index=True)
    return cells, np.concatenate(rows)[first]


def march(skel: Skeleton, cell: float) -> Contour:
    """Return the iso-surface on a grid of cells of one size, only near the skeleton."""
    times = {}
    start = time.perf_counter()
    field = build_field(skel, locality="all")
    limbs = skel.limbs
    limb_of_row = limbs.limb_of[np.flatnonzero(limbs.edges >= 0)]
    cells, row = near_cells(field, cell)
    times["cells"] = time.perf_counter() - start

    start = time.perf_counter()
    corner = (cells[:, None] + CORNERS).reshape(-1, 3)
    low = corner.min(axis=0)
    size = corner.max(axis=0) - low + 1
    key = np.ravel_multi_index(tuple((corner - low).T), tuple(size))
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    points = corner[first] * cell
    owner = np.repeat(limb_of_row[row], 8)[first]
    tets = number.reshape(-1, 8)[:, TETRAHEDRA].reshape(-1, 4)
    times["tetrahedra"] = time.perf_counter() - start

    start = time.perf_counter()
    F = field.evaluate(points, owner)[0]
    times["field"] = time.perf_counter() - start

    start = time.perf_counter()
    triangles = cut_tetrahedra(points, F - field.T, tets)
    times["extraction"] = time.perf_counter() - start
    return Contour(triangles, len(tets), len(points), times)


def cut_tetrahedra(points: Floats, G: Floats, tets: Integers) -> Floats:
    """Return the triangles (t, 3, 3) where G changes its sign."""
    inside = G[tets] > 0.0
    count = inside.sum(axis=1)
    pieces = []
    for one, alone in ((1, True), (3, False)):
        chosen = tets[count == one]
        odd = np.argmax(inside[count == one] == alone, axis=1)
        rows = np.arange(len(chosen))[:, None]
        others = (odd[:, None] + np.arange(1, 4)) % 4
        a = np.repeat(chosen[rows, odd[:, None]], 3, axis=1)
        pieces.append(_between(points, G, a, chosen[rows, others]))
    chosen, flags = tets[count == 2], inside[count == 2]
    order = np.argsort(~flags, axis=1, kind="stable")
    p, q, r, s = np.take_along_axis(chosen, order, axis=1).T
    quad = _between(points, G, np.stack([p, p, q, q], 1), np.stack([r, s, s, r], 1))
    pieces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return np.concatenate(pieces)


def _between(points: Floats, G: Floats, a: Integers, b: Integers) -> Floats:
    t = G[a] / (G[a] - G[b])
    return points[a] + t[..., None] * (points[b] - points[a])
