"""The control cage: squares swept along the limbs, joined at the joints; closed, 3- and 4-sided.

After Ji, Liu, Wang 2010 (B-Mesh, section 4.2), with the connectivity of joints from `joints.py`.
A cage is planned once; `Cage.place` moves its vertices when nodes of the skeleton are dragged, so
that the frames of an animation share their faces.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from pcsg.errors import UsageError
from pcsg.jit import njit
from pcsg.treemesh.joints import (
    Faces,
    hull_triangles,
    measure_ends,
    pair_triangles,
)
from pcsg.treemesh.limits import check_aspect
from pcsg.treemesh.skeleton import Floats, Ints, Limbs, Skeleton
from pcsg.treemesh.subdivision import PolyMesh

RHO = 1.5
"""Corner distance of a square over the radius: the limit of a square tube has 2/3 of it."""


@dataclass(frozen=True, eq=False)
class Stations:
    """The squares of a cage, in order along the limbs.

    Attributes
    ----------
    limb : int64 (s,)
        The limb of every station.
    ptr : int64 (n_limbs + 1,)
        The stations of limb k are ``ptr[k] : ptr[k + 1]``.
    step : int64 (s,)
        The entry of `Limbs.nodes` that comes before every station.
    part : float64 (s,)
        How far it lies towards the next node, from 0 to 1.
    """

    limb: Ints
    ptr: Ints
    step: Ints
    part: Floats


@dataclass(frozen=True, eq=False)
class Cage:
    """A control cage with what its faces stand for.

    Attributes
    ----------
    mesh : PolyMesh
        Corner q of station i is vertex ``4 i + q``.
    stations : Stations
    owner : int64 (f,)
        The limb of every face; for faces of joints the number of limbs plus the joint.
    edge : int64 (f,)
        The edge of the skeleton that every face belongs to.
    reach : float64 (2 n_limbs,)
        How far the joint at every end of a limb reaches along it; 0 at tips.
    """

    mesh: PolyMesh
    stations: Stations
    owner: Ints
    edge: Ints
    reach: Floats

    def place(self, skel: Skeleton, factor: Floats | None = None) -> Cage:
        """Return the cage with the same faces about a skeleton whose nodes have moved."""
        limbs = skel.limbs
        if len(limbs) != len(self.stations.ptr) - 1:
            raise UsageError("the cage belongs to a skeleton with other limbs")
        ends = measure_joints(skel, limbs, factor)
        stations = _keep_order(_clear_joints(self.stations, limbs, ends.reach), limbs)
        rings = place_rings(skel, limbs, stations, ends)
        mesh = PolyMesh(ring_corners(rings), self.mesh.flat, self.mesh.ptr)
        return replace(self, mesh=mesh, stations=stations, reach=ends.reach)


@dataclass(frozen=True, eq=False)
class JointEnds:
    """What joints ask of the limbs' ends, in the order of ``2 limb + side``."""

    direction: Floats
    reach: Floats
    crotch: Floats


@dataclass(frozen=True, eq=False)
class Rings:
    """Frames of the squares: centres, tangents, towards corner 0, radii."""

    centre: Floats
    tangent: Floats
    u: Floats
    radius: Floats


def measure_joints(skel: Skeleton, limbs: Limbs, factor: Floats | None = None) -> JointEnds:
    """Return how far joints reach; see `joints.measure_ends` and section 5.1."""
    n = len(limbs)
    first, last = limbs.ptr[:-1], limbs.ptr[1:] - 1
    after = np.stack([first + 1, last - 1], axis=1).ravel()
    direction = limb_directions(skel, limbs)
    reach, crotch = np.zeros(2 * n), np.zeros((2 * n, 3))
    ptr, ends = limbs.joint_ends
    measure_ends(
        ptr,
        ends,
        direction,
        limbs.radius[after],
        skel.radius[limbs.joints],
        np.ones(2 * n) if factor is None else factor,
        reach,
        crotch,
    )
    is_joint = limbs.ends >= 0
    share = np.where(is_joint.all(axis=1), 0.45, 0.7)[:, None]
    length = limbs.lengths[:, None]
    both = np.where(is_joint, np.minimum(reach.reshape(-1, 2), share * length), 0.0)
    total = both.sum(axis=1, keepdims=True)
    most = 0.9 * length
    both *= np.divide(most, total, out=np.ones_like(total), where=total > most)
    return JointEnds(direction, both.ravel(), crotch)


def limb_directions(skel: Skeleton, limbs: Limbs) -> Floats:
    """Return where limbs go from their ends, unit vectors (2 n_limbs, 3), by ``2 limb + side``.

    To the next node, or to where the limb is a radius of its joint away: what lies inside the
    joint says nothing about the limb.
    """
    n = len(limbs)
    first, last = limbs.ptr[:-1], limbs.ptr[1:] - 1
    at = np.stack([first, last], axis=1)
    after = np.stack([first + 1, last - 1], axis=1)
    own = skel.radius[limbs.nodes[at]]
    step = np.abs(limbs.arc[after] - limbs.arc[at])
    away = np.maximum(step, np.minimum(own, 0.5 * limbs.lengths[:, None]))
    away[limbs.ends < 0] = step[limbs.ends < 0]
    arc = np.stack([away[:, 0], limbs.lengths - away[:, 1]], axis=1).ravel()
    k, part = find_arcs(limbs, np.repeat(np.arange(n), 2), arc)
    p, q = skel.pos[limbs.nodes[k]], skel.pos[limbs.nodes[k + 1]]
    way = p + part[:, None] * (q - p) - skel.pos[limbs.nodes[at.ravel()]]
    size = np.linalg.norm(way, axis=1)
    # A limb that bends back to its joint is seen by its first segment.
    bent = size < 1e-6 * np.maximum(away.ravel(), 1e-300)
    nodes = limbs.nodes
    way[bent] = skel.pos[nodes[after.ravel()[bent]]] - skel.pos[nodes[at.ravel()[bent]]]
    return _unit(way)


def place_stations(limbs: Limbs, reach: Floats, max_aspect: float | None) -> Stations:
    """Choose where squares stand: section 5.2.

    Parameters
    ----------
    reach
        Of the joints, in the order of ``2 limb + side``.
    max_aspect
        Longest distance between two squares in radii; None for as few as there are.
    """
    ptr, arc_of, radius_of = limbs.ptr.tolist(), limbs.arc.tolist(), limbs.radius.tolist()
    limb: list[int] = []
    step: list[int] = []
    part: list[float] = []
    starts = [0]
    for k in range(len(limbs)):
        a, b = ptr[k], ptr[k + 1]
        length = arc_of[b - 1]
        low, high = reach[2 * k], length - reach[2 * k + 1]
        places = [low]
        places += [
            arc_of[i]
            for i in range(a + 1, b - 1)
            if min(arc_of[i] - low, high - arc_of[i]) >= 0.25 * radius_of[i]
        ]
        places.append(high)
        if max_aspect is not None:
            places = _refine(places, arc_of[a:b], radius_of[a:b], max_aspect)
        i = a
        for s in places:
            while i < b - 2 and arc_of[i + 1] <= s:
                i += 1
            limb.append(k)
            step.append(i)
            part.append((s - arc_of[i]) / (arc_of[i + 1] - arc_of[i]))
        starts.append(len(limb))
    return Stations(np.array(limb), np.array(starts), np.array(step), np.array(part))


def _refine(
    places: list[float], arc: list[float], radius: list[float], max_aspect: float
) -> list[float]:
    """Insert stations until none is farther from the next than `max_aspect` radii."""
    middles = [0.5 * (a + b) for a, b in itertools.pairwise(places)]
    found = [places[0]]
    i = 0
    for a, middle, b in zip(places[:-1], middles, places[1:], strict=True):
        while i < len(arc) - 2 and arc[i + 1] < middle:
            i += 1
        f = (middle - arc[i]) / (arc[i + 1] - arc[i])
        r = radius[i] + f * (radius[i + 1] - radius[i])
        n = max(1, math.ceil((b - a) / (max_aspect * r) - 1e-9))
        found += [a + (b - a) * q / n for q in range(1, n)]
        found.append(b)
    return found


def _clear_joints(stations: Stations, limbs: Limbs, reach: Floats) -> Stations:
    """Move the stations of a planned cage out of joints that reach farther now."""
    arc = _arcs(stations, limbs)
    low = reach[0::2][stations.limb]
    high = (limbs.lengths - reach[1::2])[stations.limb]
    arc = np.clip(arc, low, high)
    arc[stations.ptr[:-1]] = low[stations.ptr[:-1]]
    arc[stations.ptr[1:] - 1] = high[stations.ptr[1:] - 1]
    # Stations that were pushed to one place are drawn apart a little.
    count = np.diff(stations.ptr)[stations.limb]
    rank = np.arange(len(arc)) - stations.ptr[stations.limb]
    even = low + (high - low) * rank / np.maximum(count - 1, 1)
    return _at_arcs(stations, limbs, 0.95 * arc + 0.05 * even)


def _keep_order(stations: Stations, limbs: Limbs) -> Stations:
    """Return stations in the order of their places, where nodes moved past each other."""
    arc = _arcs(stations, limbs)
    order = np.lexsort((arc, stations.limb))
    return _at_arcs(stations, limbs, arc[order])


def _arcs(stations: Stations, limbs: Limbs) -> Floats:
    step = stations.step
    return np.asarray(limbs.arc[step] + stations.part * (limbs.arc[step + 1] - limbs.arc[step]))


def _at_arcs(stations: Stations, limbs: Limbs, arc: Floats) -> Stations:
    """Return stations at other places of their limbs."""
    step, part = find_arcs(limbs, stations.limb, arc)
    return replace(stations, step=step, part=part)


def find_arcs(limbs: Limbs, limb: Ints, arc: Floats) -> tuple[Ints, Floats]:
    """Return the entry of `Limbs.nodes` before places along limbs, and the part of its segment."""
    # Limbs laid one behind the other are one sorted sequence.
    base = np.concatenate([[0.0], np.cumsum(limbs.lengths + 1.0)])
    line = limbs.arc + base[limbs.limb_of]
    step = np.searchsorted(line, arc + base[limb], side="right") - 1
    step = np.clip(step, limbs.ptr[limb], limbs.ptr[limb + 1] - 2)
    part = (arc - limbs.arc[step]) / (limbs.arc[step + 1] - limbs.arc[step])
    return step, np.clip(part, 0.0, 1.0)


def place_rings(skel: Skeleton, limbs: Limbs, stations: Stations, ends: JointEnds) -> Rings:
    """Return the frames of all stations: bisecting tangents, frames carried along without twist.

    A ring at a joint turns an edge of its square, not a corner, to the nearest limb; between two
    joints what is missing, modulo 90 degrees, is spread over the stations.
    """
    step, part = stations.step, stations.part[:, None]
    p, q = skel.pos[limbs.nodes[step]], skel.pos[limbs.nodes[step + 1]]
    centre = p + part * (q - p)
    radius = limbs.radius[step] + stations.part * (limbs.radius[step + 1] - limbs.radius[step])
    tangent = _unit(q - p)
    # A station that stands on an inner node takes the bisector of both segments.
    for node, before in ((step, step - 1), (step + 1, step + 1)):
        inner = (node > limbs.ptr[stations.limb]) & (node < limbs.ptr[stations.limb + 1] - 1)
        on_it = inner & (np.abs(stations.part - (node - step)) < 1e-9)
        k = before[on_it]
        other = _unit(skel.pos[limbs.nodes[k + 1]] - skel.pos[limbs.nodes[k]])
        both = tangent[on_it] + other
        blunt = np.linalg.norm(both, axis=1) > 1e-6
        tangent[np.flatnonzero(on_it)[blunt]] = _unit(both[blunt])
    u = np.zeros_like(centre)
    carry_frames(stations.ptr, tangent, ends.crotch, u)
    return Rings(centre, tangent, u, radius)


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


@njit
def _across(t: Floats, i: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the unit vector along (x, y, z) made orthogonal to tangent i; zero if parallel."""
    c = t[i, 0] * x + t[i, 1] * y + t[i, 2] * z
    x, y, z = x - c * t[i, 0], y - c * t[i, 1], z - c * t[i, 2]
    size = math.sqrt(x * x + y * y + z * z)
    if size < 1e-9:
        return 0.0, 0.0, 0.0
    return x / size, y / size, z / size


@njit
def _any_across(t: Floats, i: int) -> tuple[float, float, float]:
    """Return a unit vector orthogonal to tangent i."""
    if abs(t[i, 2]) < 0.9:
        return _across(t, i, 0.0, 0.0, 1.0)
    return _across(t, i, 1.0, 0.0, 0.0)


@njit
def _turn(t: Floats, u: Floats, i: int, angle: float) -> None:
    """Turn frame i about its tangent."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = u[i, 0], u[i, 1], u[i, 2]
    u[i, 0] = c * x + s * (t[i, 1] * z - t[i, 2] * y)
    u[i, 1] = c * y + s * (t[i, 2] * x - t[i, 0] * z)
    u[i, 2] = c * z + s * (t[i, 0] * y - t[i, 1] * x)


@njit(entry=True)
def carry_frames(ptr: Ints, tangent: Floats, crotch: Floats, u: Floats) -> None:
    """Fill in the direction of corner 0 of every station, limb by limb.

    Parameters
    ----------
    ptr
        Stations by limbs.
    tangent (s, 3)
        Unit tangents.
    crotch (2 n_limbs, 3)
        The wish of every end, 0 where there is none.
    u (s, 3)
        Result.
    """
    quarter = 0.5 * math.pi
    for k in range(len(ptr) - 1):
        a, b = ptr[k], ptr[k + 1]
        x, y, z = _across(tangent, a, crotch[2 * k, 0], crotch[2 * k, 1], crotch[2 * k, 2])
        fixed = x != 0.0 or y != 0.0 or z != 0.0
        if not fixed:
            x, y, z = _any_across(tangent, a)
        for i in range(a, b):
            if i > a:
                x, y, z = _across(tangent, i, x, y, z)
                if x == 0.0 and y == 0.0 and z == 0.0:
                    x, y, z = _any_across(tangent, i)
            u[i, 0], u[i, 1], u[i, 2] = x, y, z
        e = b - 1
        p, q, r = _across(
            tangent, e, crotch[2 * k + 1, 0], crotch[2 * k + 1, 1], crotch[2 * k + 1, 2]
        )
        if p == 0.0 and q == 0.0 and r == 0.0:
            continue
        # The angle from the carried corner to the wanted one, in [-45, 45] degrees.
        wx = tangent[e, 1] * u[e, 2] - tangent[e, 2] * u[e, 1]
        wy = tangent[e, 2] * u[e, 0] - tangent[e, 0] * u[e, 2]
        wz = tangent[e, 0] * u[e, 1] - tangent[e, 1] * u[e, 0]
        angle = math.atan2(p * wx + q * wy + r * wz, p * u[e, 0] + q * u[e, 1] + r * u[e, 2])
        angle -= quarter * math.floor(angle / quarter + 0.5)
        for i in range(a, b):
            share = (i - a) / max(1, e - a) if fixed else 1.0
            _turn(tangent, u, i, angle * share)


def ring_corners(rings: Rings) -> Floats:
    """Return the corners of the squares, (4 s, 3)."""
    r = RHO * rings.radius[:, None]
    u, w = r * rings.u, r * np.cross(rings.tangent, rings.u)
    corners = rings.centre[:, None] + np.stack([u, w, -u, -w], axis=1)
    return np.asarray(corners.reshape(-1, 3))


def build_cage(
    skel: Skeleton, max_aspect: float | None = 4.0, factor: Floats | None = None
) -> Cage:
    """Build the control cage of a skeleton.

    Parameters
    ----------
    max_aspect
        Longest distance between two squares, in radii; None for one square at each node.
    factor : (2 n_limbs,)
        Enlarges the reach of joints, in the order of ``2 limb + side``.
    """
    check_aspect(max_aspect)
    limbs = skel.limbs
    ends = measure_joints(skel, limbs, factor)
    stations = place_stations(limbs, ends.reach, max_aspect)
    rings = place_rings(skel, limbs, stations, ends)
    verts = ring_corners(rings)
    sides, side_station = _side_quads(stations)
    caps, cap_station = _cap_quads(limbs, stations)
    quads = np.concatenate([sides, caps])
    joints = _joint_faces(limbs, stations, rings, ends, verts)
    station = np.concatenate([side_station, cap_station])
    middle = stations.step[station]
    ahead = np.minimum(station + 1, len(stations.limb) - 1)
    next_step = np.where(stations.limb[ahead] == stations.limb[station], stations.step[ahead], 0)
    # A quad belongs to the edge where its middle lies, which is among those of its two stations.
    middle = np.where(next_step > middle, (middle + next_step + 1) // 2, middle)
    middle[len(side_station) :] = stations.step[cap_station]
    mesh = PolyMesh(
        verts,
        np.concatenate([quads.ravel(), joints.flat]),
        np.concatenate([np.arange(0, quads.size, 4), quads.size + joints.ptr]),
    )
    owner = np.concatenate([stations.limb[station], len(limbs) + joints.owner])
    edge = np.concatenate([limbs.edges[middle], _joint_edges(limbs)[joints.owner]])
    return Cage(mesh, stations, owner, edge, ends.reach)


def _side_quads(stations: Stations) -> tuple[Ints, Ints]:
    """Return the quads between neighbouring squares, and the station each begins at."""
    begin = np.flatnonzero(np.diff(stations.limb) == 0)
    q = np.arange(4)
    a, b = 4 * begin[:, None], 4 * begin[:, None] + 4
    ahead = (q + 1) % 4
    quads = np.stack([a + q, a + ahead, b + ahead, b + q], axis=2)
    return quads.reshape(-1, 4), np.repeat(begin, 4)


def _cap_quads(limbs: Limbs, stations: Stations) -> tuple[Ints, Ints]:
    """Return the quads that close tips, and their stations."""
    starts = stations.ptr[:-1][limbs.ends[:, 0] < 0]
    ends = (stations.ptr[1:] - 1)[limbs.ends[:, 1] < 0]
    q = np.arange(4)
    quads = np.concatenate([4 * starts[:, None] + q[::-1], 4 * ends[:, None] + q])
    return quads, np.concatenate([starts, ends])


def _joint_faces(
    limbs: Limbs, stations: Stations, rings: Rings, ends: JointEnds, verts: Floats
) -> Faces:
    """Return the faces between the rings of every joint."""
    ptr, end_list = limbs.joint_ends
    limb, side = end_list // 2, end_list % 2
    ring = np.where(side == 0, stations.ptr[limb], stations.ptr[limb + 1] - 1)
    triangles, owners = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    ends_here = side == 1
    outward = rings.tangent[ring] * np.where(ends_here, -1.0, 1.0)[:, None]
    for j in range(len(limbs.joints)):
        at = slice(ptr[j], ptr[j + 1])
        own = ring[at]
        local = hull_triangles(
            ends.direction[end_list[at]], outward[at], rings.u[own], ends_here[at]
        )
        triangles.append(4 * own[local // 4] + local % 4)
        owners.append(np.full(len(local), j))
    return pair_triangles(verts, np.concatenate(triangles), np.concatenate(owners))


def _joint_edges(limbs: Limbs) -> Ints:
    """Return the edge of the thickest limb at every joint."""
    ptr, ends = limbs.joint_ends
    limb, side = ends // 2, ends % 2
    last = limbs.ptr[limb + 1] - 1
    thick = limbs.radius[np.where(side == 0, limbs.ptr[limb] + 1, last - 1)]
    edge = limbs.edges[np.where(side == 0, limbs.ptr[limb], last - 1)]
    joint = np.repeat(np.arange(len(limbs.joints)), np.diff(ptr))
    order = np.lexsort((-thick, joint))
    return np.asarray(edge[order][ptr[:-1]], dtype=np.int64)
