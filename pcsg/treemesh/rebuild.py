"""Taking over what an edit does not touch.

Weights are local, so a vertex whose start, segments and neighbourhood are as before ends where it
ended before. Such vertices are recognised by their content, whatever the numbers of nodes and
limbs: no operation has to say what it changed.
"""

from __future__ import annotations

import itertools
from hashlib import blake2b
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pcsg.treemesh.field import SegmentField
from pcsg.treemesh.projection import FairZone, find_fair_zone
from pcsg.treemesh.skeleton import Bools, Floats, Ints, connected_groups

if TYPE_CHECKING:
    from pcsg.treemesh.surface import QuadMesh


def field_marks(field: SegmentField) -> list[bytes]:
    """Return a digest of the segments that every owner sees."""
    rest = f"{field.kind} {field.T} {field.reach}".encode()
    rows, table, ptr = field.rows, field.table, field.ptr.tolist()
    return [
        blake2b(table[rows[a:b]].tobytes() + rest, digest_size=16).digest()
        for a, b in itertools.pairwise(ptr)
    ]


def carry_over(
    previous: QuadMesh, start: Floats, owner: Ints, field: SegmentField, zone: FairZone
) -> Ints:
    """Find the vertices that end where they ended in a previous surface.

    Parameters
    ----------
    start (v, 3), owner (v,)
        Vertices of the subdivided cage.

    Returns
    -------
    int64 (v,)
        The vertex of the previous surface that every vertex ends as, -1 where anything is new.
    """
    twin = _match(previous.start, start)
    marks = {mark: k for k, mark in reversed(list(enumerate(field_marks(previous.field))))}
    new = np.array([marks.get(mark, -1) for mark in field_marks(field)], dtype=np.int64)
    old = np.array([marks[mark] for mark in field_marks(previous.field)], dtype=np.int64)
    same = (twin >= 0) & (new[owner] >= 0) & (new[owner] == old[previous.owner[twin]])
    old_zone = find_fair_zone(previous.quads, len(previous.start))
    in_zone, was_in_zone = _flags(zone, len(start)), _flags(old_zone, len(previous.start))
    same &= in_zone == was_in_zone[twin]
    clean = same & ~_touched_zone(zone, same, in_zone)
    return np.where(clean, twin, -1)


def _flags(zone: FairZone, n: int) -> Bools:
    flags = np.zeros(n, dtype=bool)
    flags[zone.chosen] = True
    return flags


def _match(old: Floats, new: Floats) -> Ints:
    """Return for every new point an equal old one, -1 if there is none."""
    old_key, new_key = _keys(old), _keys(new)
    order = np.argsort(old_key, kind="stable")
    at = np.minimum(np.searchsorted(old_key[order], new_key), len(order) - 1)
    twin = order[at]
    return np.where((old[twin] == new).all(axis=1), twin, -1)


def _keys(points: Floats) -> NDArray[np.uint64]:
    """Return a hash of every point."""
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)
    odd = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    return np.asarray(np.bitwise_xor.reduce(bits * odd ^ (bits >> np.uint64(29)), axis=1))


def _touched_zone(zone: FairZone, same: Bools, in_zone: Bools) -> Bools:
    """Return the vertices of connected pieces of the zone where anything is new."""
    n = len(same)
    place = np.full(n, -1)
    place[zone.chosen] = np.arange(len(zone.chosen))
    source = np.repeat(np.arange(len(zone.chosen)), np.diff(zone.ptr))
    inner = in_zone[zone.neighbours]
    piece = connected_groups(len(zone.chosen), source[inner], place[zone.neighbours[inner]])
    changed = np.zeros(int(piece.max(initial=-1)) + 1, dtype=bool)
    changed[piece[~same[zone.chosen]]] = True
    changed[piece[source[~same[zone.neighbours]]]] = True
    touched = np.zeros(n, dtype=bool)
    touched[zone.chosen] = changed[piece]
    return touched
