"""From triangles as files hold them to closed, oriented, connected parts.

Tree generators write soups of tubes: open at their ends, overlapping, some inside out, vertices
written several times. Here vertices are merged, faces sorted into parts that hang together across
edges of exactly two faces, turned the same way, and open tubes are capped. What cannot be closed
is refused with its reason; flat sheets, such as leaves, are left out and counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pcsg.errors import UsageError
from pcsg.treemesh.contraction import face_areas, signed_volume
from pcsg.treemesh.skeleton import Floats, Ints, connected_groups

TOLERANCE = 1e-9
"""Vertices closer than this share of the box's diagonal are one."""

_SHEET = 8.0
"""Squared length of the only boundary over the area from which on a part is a sheet."""


class Part(NamedTuple):
    """A closed, connected mesh that looks outwards.

    Attributes
    ----------
    verts : float64 (v, 3)
    faces : int64 (f, 3)
    source : int64 (v,)
        The vertex of the input; -1 for the centres of caps.
    loops : tuple of int64 arrays
        The rims that were capped.
    n_open : int
        Faces before caps; the caps come last.
    """

    verts: Floats
    faces: Ints
    source: Ints
    loops: tuple[Ints, ...]
    n_open: int


@dataclass(frozen=True)
class Cleaned:
    """The parts of a mesh, largest first, and what was done to it."""

    parts: tuple[Part, ...]
    notes: tuple[str, ...]


def clean(verts: Floats, faces: Ints) -> Cleaned:
    """Return the closed parts of a triangle soup.

    Parameters
    ----------
    verts (v, 3), faces (f, 3)
        As read from a file.

    Raises
    ------
    UsageError
        Nothing is left, or a part cannot be oriented.
    """
    if not len(faces):
        raise UsageError("the mesh has no faces")
    if not np.isfinite(verts).all():
        raise UsageError("the mesh has vertices that are not finite")
    notes = []
    merged, source = _merge_vertices(verts)
    tri = merged[faces]
    whole = (tri[:, 0] != tri[:, 1]) & (tri[:, 1] != tri[:, 2]) & (tri[:, 2] != tri[:, 0])
    tri = tri[whole]
    if not whole.all():
        notes.append(f"{int((~whole).sum())} faces without area were left out")
    first = np.unique(np.sort(tri, axis=1), axis=0, return_index=True)[1]
    if len(first) < len(tri):
        notes.append(f"{len(tri) - len(first)} faces that were there twice were left out")
        tri = tri[np.sort(first)]
    if not len(tri):
        raise UsageError("the mesh has no faces with area")
    pairs = _pair_edges(tri)
    if pairs.crowded:
        notes.append(f"{pairs.crowded} edges with more than two faces were cut apart")
    flipped = _orient(tri, pairs)
    if flipped.any():
        tri[flipped] = tri[flipped, ::-1]
        pairs = _pair_edges(tri)
    corner_vertex, part_of = _split(tri, pairs)
    parts, sheets, turned = _collect(verts[source], source, tri, corner_vertex, part_of)
    if sheets:
        notes.append(f"{sheets} flat sheets (such as leaves) were left out")
    if turned or flipped.any():
        notes.append("faces that looked inwards were turned")
    caps = sum(len(part.loops) for part in parts)
    if caps:
        notes.append(f"{caps} open ends were capped")
    if not parts:
        raise UsageError("the mesh has no part with a volume: it consists of flat sheets only")
    parts.sort(key=lambda part: -signed_volume(part.verts, part.faces))
    return Cleaned(tuple(parts), tuple(notes))


def _merge_vertices(verts: Floats) -> tuple[Ints, Ints]:
    """Return the number of every vertex after merging, and one source for each number."""
    diagonal = float(np.linalg.norm(np.ptp(verts, axis=0)))
    grid = np.round((verts - verts.min(axis=0)) / max(TOLERANCE * diagonal, 1e-300))
    _, source, merged = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    return merged.ravel().astype(np.int64), source.astype(np.int64)


class _Pairs(NamedTuple):
    """Pairs of half-edges (corners) that share an edge of exactly two faces."""

    first: Ints
    second: Ints
    crowded: int


def _pair_edges(tri: Ints) -> _Pairs:
    a, b = tri.ravel(), np.roll(tri, -1, axis=1).ravel()
    key = np.minimum(a, b) * (int(tri.max()) + 1) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    counts = np.diff(np.append(starts, len(key)))
    two = starts[counts == 2]
    return _Pairs(order[two], order[two + 1], int((counts > 2).sum()))


def _orient(tri: Ints, pairs: _Pairs) -> np.ndarray:
    """Return which faces have to be turned, so that neighbours turn the same way."""
    n = len(tri)
    f, g = pairs.first // 3, pairs.second // 3
    same_way = tri.ravel()[pairs.first] == tri.ravel()[pairs.second]
    # Every face has two copies, as it is and turned; neighbours that agree are linked.
    i = np.concatenate([f, f + n])
    j = np.concatenate([np.where(same_way, g + n, g), np.where(same_way, g, g + n)])
    label = connected_groups(2 * n, i, j)
    if (label[:n] == label[n:]).any():
        raise UsageError("a part of the mesh has one side only, as a Moebius strip, and no inside")
    # Of the two consistent choices the one that keeps more faces is taken.
    part = np.minimum(label[:n], label[n:])
    kept = np.bincount(part, np.where(label[:n] == part, 1.0, -1.0), minlength=label.max() + 1)
    keep_first = kept[part] >= 0
    return np.asarray((label[:n] == part) != keep_first)


def _split(tri: Ints, pairs: _Pairs) -> tuple[Ints, Ints]:
    """Give every fan of faces a vertex of its own; return it for all corners, and faces' parts."""
    following = np.array([1, 2, 0])
    p, q = pairs.first, pairs.second
    p_next, q_next = (3 * (c // 3) + following[c % 3] for c in (p, q))
    # Two faces run along their edge in opposite ways: the start of one is the end of the other.
    label = connected_groups(tri.size, np.concatenate([p, p_next]), np.concatenate([q_next, q]))
    part = connected_groups(len(tri), p // 3, q // 3)
    return label, part


def _collect(
    places: Floats, source: Ints, tri: Ints, corner_vertex: Ints, part_of: Ints
) -> tuple[list[Part], int, bool]:
    """Return the parts with volume, the number of sheets, and whether a part was turned."""
    parts: list[Part] = []
    sheets, turned = 0, False
    order = np.argsort(part_of, kind="stable")
    bounds = np.searchsorted(part_of[order], np.arange(int(part_of.max()) + 2))
    corners = corner_vertex.reshape(-1, 3)
    for k in range(len(bounds) - 1):
        own = order[bounds[k] : bounds[k + 1]]
        _labels, first, faces = np.unique(
            corners[own].ravel(), return_index=True, return_inverse=True
        )
        vertex = tri[own].ravel()[first]
        part = _close(places[vertex], faces.reshape(-1, 3), source[vertex])
        if part is None:
            sheets += 1
            continue
        if signed_volume(part.verts, part.faces) < 0:
            turned = True
            part = part._replace(faces=part.faces[:, ::-1])
        parts.append(part)
    return parts, sheets, turned


def _close(verts: Floats, faces: Ints, source: Ints) -> Part | None:
    """Cap the rims of an oriented part with fans; None for a sheet."""
    loops = find_rims(faces, len(verts))
    if loops:
        rim = sum(_length(verts, loop) for loop in loops)
        if len(loops) == 1 and rim * rim > _SHEET * float(face_areas(verts, faces).sum()):
            return None
    n_open = len(faces)
    for loop in loops:
        centre = len(verts)
        verts = np.concatenate([verts, verts[loop].mean(axis=0)[None]])
        source = np.append(source, -1)
        cap = np.stack([np.roll(loop, -1), loop, np.full(len(loop), centre)], axis=1)
        faces = np.concatenate([faces, cap])
    area = float(face_areas(verts, faces).sum())
    if abs(signed_volume(verts - verts.mean(axis=0), faces)) < 1e-6 * area**1.5:
        return None
    return Part(verts, faces, source, tuple(loops), n_open)


def _length(verts: Floats, loop: Ints) -> float:
    return float(np.linalg.norm(verts[loop] - verts[np.roll(loop, -1)], axis=1).sum())


def find_rims(faces: Ints, n_verts: int) -> list[Ints]:
    """Return the loops of edges with one face, in the direction of their faces."""
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    ahead, back = a * n_verts + b, b * n_verts + a
    free = ~np.isin(ahead, back)
    following = dict(zip(a[free].tolist(), b[free].tolist(), strict=True))
    loops = []
    while following:
        start, node = following.popitem()
        loop = [start]
        while node != start:
            loop.append(node)
            node = following.pop(node)
        loops.append(np.array(loop))
    return sorted(loops, key=lambda loop: int(loop.min()))
