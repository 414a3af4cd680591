"""Fewer vertices for a closed mesh: its shortest edges collapse, many at a time.

What is wanted of the result is a line skeleton, so short edges go first, whatever the curvature:
that leaves triangles of even size, which contract best. An edge may collapse only if no face turns
over and its ends have no common neighbours but the two corners opposite of it (the link condition
of Dey, Edelsbrunner, Guha, Nekhayev 1999), so that the mesh keeps its handles and stays closed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pcsg.treemesh.skeleton import Floats, Ints

_SHARE = 0.3
"""Part of the edges, the shortest ones, that may collapse in one round."""

_LEAST_COSINE = 0.2
"""Of the angle by which a face may turn."""

_LEAST_PROGRESS = 1e-3
"""Part of the vertices that a round must remove to be followed by another."""


def decimate(verts: Floats, faces: Ints, most: int) -> tuple[Floats, Ints, Ints]:
    """Return a closed mesh with about as many vertices as wanted, or more if it can lose no more.

    Parameters
    ----------
    verts (v, 3), faces (f, 3)
        A closed, oriented mesh; all vertices are used.
    most
        Vertices to be left.

    Returns
    -------
    verts (w, 3), faces (g, 3)
        The mesh.
    into : int64 (v,)
        The vertex that every vertex went into.
    """
    verts, left = verts.copy(), len(verts)
    into = np.arange(len(verts))
    refused = np.zeros(0, dtype=np.int64)
    while left > most:
        i, j, tried = _collapses(verts, faces, left - most, refused)
        if len(i) < _LEAST_PROGRESS * left:
            if not len(refused):
                break
            refused = refused[:0]  # what was refused may be free by now
            continue
        refused = np.concatenate([refused, tried])
        parent = np.arange(len(verts))
        parent[j] = i
        verts[i] = 0.5 * (verts[i] + verts[j])
        corners = parent[faces]
        faces = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
        into = parent[into]
        left -= len(i)
    kept = np.unique(into)
    number = np.full(len(verts), -1)
    number[kept] = np.arange(len(kept))
    return verts[kept], number[faces], number[into]


def _collapses(verts: Floats, faces: Ints, surplus: int, refused: Ints) -> tuple[Ints, Ints, Ints]:
    """Return edges that may collapse at once, as ends that stay and that go; and keys of others.

    They are far from each other: the faces about one are none of those about another.
    """
    n = len(verts)
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    once = np.flatnonzero(a < b)  # each edge of a closed mesh is there in both directions
    i, j = a[once], b[once]
    length = np.linalg.norm(verts[i] - verts[j], axis=1)
    if len(refused):
        length[np.isin(i * n + j, refused)] = np.inf
    share = max(1, int(_SHARE * len(i)))
    chosen = np.argpartition(length, share - 1)[:share]
    chosen = np.sort(chosen[np.isfinite(length[chosen])])
    i, j = i[chosen], j[chosen]

    # An edge may go if no earlier one has an end beside one of its ends. By length few would be
    # free: where edges grow along a limb, each waits for the next.
    rank = np.random.default_rng(len(i)).permutation(len(i))
    first = np.full(n, len(i))
    np.minimum.at(first, i, rank)
    np.minimum.at(first, j, rank)
    ring = first.copy()
    np.minimum.at(ring, a, first[b])
    free = (ring[i] == rank) & (ring[j] == rank)
    i, j = i[free], j[free]
    good = _are_linked(faces, n, i, j)
    good &= ~_turn_over(verts, faces, i, j)
    return i[good][:surplus], j[good][:surplus], (i * n + j)[~good]


def _are_linked(faces: Ints, n: int, i: Ints, j: Ints) -> Any:
    """Return which edges' ends share two neighbours (e,) bool; no two edges touch the same face."""
    edge = np.full(n, -1)
    edge[i] = edge[j] = np.arange(len(i))
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    outward = (edge[a] >= 0) & (edge[a] != edge[b])
    # In a closed mesh each neighbour of a vertex is once at the end of a half-edge out of it.
    key = np.sort(edge[a[outward]] * n + b[outward])
    shared = key[1:][key[1:] == key[:-1]] // n
    return np.bincount(shared, minlength=len(i)) == 2


def _turn_over(verts: Floats, faces: Ints, i: Ints, j: Ints) -> Any:
    """Return for which edges a face would turn too far, or thin to nothing (e,) bool."""
    edge = np.full(len(verts), -1)
    edge[i] = edge[j] = np.arange(len(i))
    number = edge[faces].max(axis=1)
    stays = (number >= 0) & ((edge[faces] >= 0).sum(axis=1) == 1)
    number, corners = number[stays], faces[stays]
    moved = verts.copy()
    moved[i] = moved[j] = 0.5 * (verts[i] + verts[j])
    before, after = _normals(verts, corners), _normals(moved, corners)
    size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    bad = np.einsum("ij,ij->i", before, after) <= _LEAST_COSINE * size
    return np.bincount(number[bad], minlength=len(i)) > 0


def _normals(verts: Floats, faces: Ints) -> Floats:
    p, q, r = (verts[k] for k in faces.T)
    return np.asarray(np.cross(q - p, r - p))
