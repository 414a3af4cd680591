"""Line skeletons of triangle meshes: contraction, surgery, and what makes the result precise."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np

from pcsg.errors import UsageError
from pcsg.treemesh.contraction import ContractionOptions, contract, ring_areas
from pcsg.treemesh.decimation import decimate
from pcsg.treemesh.resampling import smooth_radii
from pcsg.treemesh.skeleton import Floats, Ints, Skeleton
from pcsg.treemesh.surgery import collapse

SPUR = 1.0
"""A limb that ends in a tip and is shorter than this, in radii of its joint, is a spur."""

JOINED = 1.25
"""Joints closer than this, in radii, are one: whorls come apart by about a radius."""

DENSE = 50_000
"""Vertices of a mesh that is contracted as it is; of a denser one, short edges collapse first."""

MOST = 400_000
"""Vertices that can be contracted at all."""


@dataclass(frozen=True)
class ExtractionOptions:
    """How a skeleton is made from a mesh.

    Attributes
    ----------
    contraction
        Of the mesh.
    smooth
        Average radii over three neighbours along limbs.
    """

    contraction: ContractionOptions = field(default_factory=ContractionOptions)
    smooth: bool = True


def skeleton_of_closed(
    verts: Floats, faces: Ints, options: ExtractionOptions | None = None
) -> Skeleton:
    """Return the skeleton of a closed, connected, oriented mesh.

    Parameters
    ----------
    verts (v, 3), faces (f, 3)
        The mesh.

    Returns
    -------
    Skeleton
        With the induced mapping from nodes to vertices; its root is the thickest tip.

    Raises
    ------
    UsageError
        The mesh cannot be made small enough to be contracted.
    """
    o = options or ExtractionOptions()
    fewer, corners, into = decimate(verts, faces, DENSE)
    if len(fewer) > MOST:
        raise UsageError(
            f"a part of the mesh has {len(verts):,} vertices, and limbs so fine that more than "
            f"{MOST:,} must stay; cut it into pieces, or thin it out"
        )
    nodes, edges, node_of = collapse(contract(fewer, corners, o.contraction), corners)
    if len(nodes) < 2:
        return _two_nodes(verts, faces)
    node_of = node_of[into]
    draft = _Draft(verts, ring_areas(verts, faces), len(nodes), edges, node_of)
    draft.break_false_loops(faces)
    draft.measure()
    draft.remove_spurs()
    draft.place_joints()
    draft.join_joints()
    draft.place_joints()
    draft.clear_joints()
    skel = draft.finish()
    return skel.replaced(radius=smooth_radii(skel)) if o.smooth else skel


def _two_nodes(verts: Floats, faces: Ints) -> Skeleton:
    """Return the skeleton of a mesh that contracts to a point: its longest axis."""
    centre = verts.mean(axis=0)
    axis = np.linalg.svd(verts - centre, full_matrices=False)[2][0]
    along = (verts - centre) @ axis
    radius = float(np.linalg.norm(verts - centre - along[:, None] * axis, axis=1).mean())
    half = max(float(np.abs(along).max()) - 0.5 * radius, 0.25 * radius)
    side = along > 0
    return Skeleton.make(
        [centre - half * axis, centre + half * axis],
        [radius, radius],
        [[0, 1]],
        mapping=(np.flatnonzero(~side), np.flatnonzero(side)),
    )


class _Draft:
    """A skeleton that is being made precise."""

    def __init__(
        self, verts: Floats, area: Floats, n_nodes: int, edges: Ints, node_of: Ints
    ) -> None:
        self.verts, self.area = verts, area
        self.n, self.edges, self.node_of = n_nodes, edges, node_of
        self.pos = np.zeros((n_nodes, 3))
        self.radius = np.ones(n_nodes)

    @property
    def degree(self) -> Ints:
        return np.bincount(self.edges.ravel(), minlength=self.n)

    def break_false_loops(self, faces: Ints) -> None:
        """Keep as many loops as the mesh has handles: the shortest edges of the others stay."""
        v, f = len(self.verts), len(faces)
        handles = (2 - (v - f // 2)) // 2
        surplus = len(self.edges) - self.n + 1 - handles
        if surplus <= 0:
            return
        self._centre()
        length = np.linalg.norm(np.diff(self.pos[self.edges], axis=1)[:, 0], axis=1)
        group = np.arange(self.n)
        in_loop = []
        for k in np.argsort(length, kind="stable").tolist():
            a, b = group[self.edges[k]]
            if a == b:
                in_loop.append(k)
            else:
                group[group == b] = a
        drop = np.array(in_loop[-surplus:])
        self.edges = np.delete(self.edges, drop, axis=0)

    def _centre(self) -> None:
        """Move every node to the centroid of its vertices, weighted by area."""
        total = np.bincount(self.node_of, self.area, minlength=self.n)
        for k in range(3):
            moment = np.bincount(self.node_of, self.area * self.verts[:, k], minlength=self.n)
            self.pos[:, k] = moment / np.maximum(total, 1e-300)

    def measure(self) -> None:
        """Set places and radii: the mean distance of a node's vertices from the local axis."""
        self._centre()
        tangent = self._tangents()
        away = self.verts - self.pos[self.node_of]
        along = np.einsum("ij,ij->i", away, tangent[self.node_of])
        distance = np.linalg.norm(away - along[:, None] * tangent[self.node_of], axis=1)
        count = np.maximum(np.bincount(self.node_of, minlength=self.n), 1)
        radius = np.bincount(self.node_of, distance, minlength=self.n) / count
        self.radius = np.maximum(radius, 1e-9 * float(np.ptp(self.verts, axis=0).max()))
        self._measure_joints()

    def _tangents(self) -> Floats:
        """Return the direction of the axis at nodes with one or two edges, 0 at joints."""
        tangent = np.zeros((self.n, 3))
        a, b = self.edges.T
        d = self.pos[b] - self.pos[a]
        d /= np.maximum(np.linalg.norm(d, axis=1), 1e-300)[:, None]
        # The two edges of a node point to it and away from it, in either order.
        first = np.full(self.n, -1)
        for e, (i, j) in enumerate(self.edges.tolist()):
            for v, way in ((i, d[e]), (j, d[e])):
                if first[v] < 0:
                    first[v] = e
                    tangent[v] = way
                else:
                    f = first[v]
                    other = tangent[v]
                    sign = 1.0 if (self.edges[f, 1] == v) != (self.edges[e, 1] == v) else -1.0
                    tangent[v] = other + sign * way
        size = np.linalg.norm(tangent, axis=1)
        tangent /= np.maximum(size, 1e-300)[:, None]
        tangent[(self.degree > 2) | (size < 1e-6)] = 0.0
        return tangent

    def _skeleton(self) -> Skeleton:
        return Skeleton(self.pos, self.radius, self.edges)

    def _measure_joints(self) -> None:
        """Give joints the median radius of the nearest three nodes of their thickest limb."""
        limbs = self._skeleton().limbs
        ptr, ends = limbs.joint_ends
        radius = self.radius.copy()
        for j, node in enumerate(limbs.joints.tolist()):
            found = []
            for e in ends[ptr[j] : ptr[j + 1]].tolist():
                k = e // 2
                chain = limbs.nodes[limbs.ptr[k] : limbs.ptr[k + 1]]
                chain = chain if e % 2 == 0 else chain[::-1]
                near = [a for a in chain[1:4].tolist() if self.degree[a] == 2]
                if near:
                    found.append(float(np.median(self.radius[near])))
            if found:
                radius[node] = max(found)
        self.radius = radius

    def remove_spurs(self) -> None:
        """Remove limbs that end in a tip and are shorter than the radius of their joint."""
        while True:
            skel = self._skeleton()
            limbs = skel.limbs
            one_tip = (limbs.ends >= 0).sum(axis=1) == 1
            joint = limbs.joints[limbs.ends.max(axis=1)] if len(limbs.joints) else limbs.nodes[:0]
            if not one_tip.any():
                return
            short = np.flatnonzero(one_tip)[
                limbs.lengths[one_tip] < SPUR * self.radius[joint[one_tip]]
            ]
            if not len(short):
                return
            # One at a time for each joint: the joint may be none afterwards.
            order = short[np.argsort(limbs.lengths[short], kind="stable")]
            _, first = np.unique(limbs.ends.max(axis=1)[order], return_index=True)
            target = np.arange(self.n)
            for k in order[first].tolist():
                chain = limbs.nodes[limbs.ptr[k] : limbs.ptr[k + 1]]
                target[chain] = limbs.joints[limbs.ends[k].max()]
            self._merge(target)
            self.measure()

    def join_joints(self) -> None:
        """Make joints one that are too close to each other to be two."""
        while True:
            degree = self.degree
            both = (degree[self.edges] >= 3).all(axis=1)
            a, b = self.edges[both].T
            distance = np.linalg.norm(self.pos[a] - self.pos[b], axis=1)
            limit = JOINED * np.maximum(self.radius[a], self.radius[b])
            near = distance < limit
            chained = self._short_limbs()
            if not near.any() and not chained:
                return
            target = np.arange(self.n)
            for i, j in zip(a[near].tolist(), b[near].tolist(), strict=True):
                while target[i] != i:
                    i = target[i]
                while target[j] != j:
                    j = target[j]
                target[j] = i
            for chain in chained:
                i = chain[0]
                while target[i] != i:
                    i = target[i]
                for j in chain[1:]:
                    while target[j] != j:
                        j = target[j]
                    if j != i:
                        target[j] = i
            while (target[target] != target).any():
                target = target[target]
            self._merge(target)
            self.measure()

    def place_joints(self) -> None:
        """Move joints to where the axes of their limbs meet.

        The axis of a limb is fitted to its nodes between 1 and 4 radii from the joint: nearer ones
        stray, since the vertices of a joint lie on no cylinder.
        """
        limbs = self._skeleton().limbs
        ptr, ends = limbs.joint_ends
        moved = self.pos.copy()
        for j, node in enumerate(limbs.joints.tolist()):
            r = self.radius[node]
            matrix = 0.05 * np.eye(3)
            right = 0.05 * self.pos[node]
            lines = 0
            for e in ends[ptr[j] : ptr[j + 1]].tolist():
                k, side = e // 2, e % 2
                at = slice(limbs.ptr[k], limbs.ptr[k + 1])
                arc = limbs.arc[at] if side == 0 else limbs.lengths[k] - limbs.arc[at]
                far = limbs.lengths[k] - arc
                margin = self.radius[limbs.joints[limbs.ends[k, 1 - side]]] * (
                    limbs.ends[k, 1 - side] >= 0
                )
                chosen = limbs.nodes[at][(arc > r) & (arc < 4.0 * r) & (far > margin)]
                if len(chosen) < 2:
                    continue
                points = self.pos[chosen]
                centre = points.mean(axis=0)
                axis = np.linalg.svd(points - centre, full_matrices=False)[2][0]
                across = np.eye(3) - np.outer(axis, axis)
                matrix += across
                right += across @ centre
                lines += 1
            if lines >= 2:
                place = np.linalg.solve(matrix, right)
                step = place - self.pos[node]
                size = float(np.linalg.norm(step))
                moved[node] = self.pos[node] + step * min(1.0, 1.5 * r / max(size, 1e-300))
        self.pos = moved

    def clear_joints(self) -> None:
        """Let the nodes of limbs that lie inside a joint vanish into it."""
        limbs = self._skeleton().limbs
        target = np.arange(self.n)
        for k in range(len(limbs)):
            at = slice(limbs.ptr[k], limbs.ptr[k + 1])
            nodes, arc = limbs.nodes[at], limbs.arc[at]
            near = np.zeros(len(nodes), dtype=bool)
            for side in (0, 1):
                if limbs.ends[k, side] < 0:
                    continue
                joint = limbs.joints[limbs.ends[k, side]]
                along = arc if side == 0 else arc[-1] - arc
                inside = (along < self.radius[joint]) & ~near
                inside[[0, -1]] = False
                near |= inside
                target[nodes[inside]] = joint
        joints, places = limbs.joints, self.pos[limbs.joints].copy()
        radii = self.radius[joints].copy()
        number = np.cumsum(target == np.arange(self.n)) - 1
        self._merge(target)
        self.pos[number[joints]], self.radius[number[joints]] = places, radii

    def _short_limbs(self) -> list[list[int]]:
        """Return limbs of several edges between two joints that are too close to be two."""
        limbs = self._skeleton().limbs
        found = []
        for k in range(len(limbs)):
            i, j = limbs.ends[k].tolist()
            if i < 0 or j < 0 or i == j:
                continue
            a, b = limbs.joints[i], limbs.joints[j]
            if limbs.lengths[k] < JOINED * max(self.radius[a], self.radius[b]):
                found.append(limbs.nodes[limbs.ptr[k] : limbs.ptr[k + 1]].tolist())
        return found

    def _merge(self, target: Ints) -> None:
        """Let nodes vanish into others: target (n,)."""
        kept = np.flatnonzero(target == np.arange(self.n))
        number = np.full(self.n, -1)
        number[kept] = np.arange(len(kept))
        edges = np.sort(number[target[self.edges]], axis=1)
        self.edges = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0)
        self.node_of = number[target[self.node_of]]
        self.pos, self.radius = self.pos[kept], self.radius[kept]
        self.n = len(kept)

    def finish(self) -> Skeleton:
        """Lengthen the tips, which contraction shortened, and choose the root."""
        order = np.argsort(self.node_of, kind="stable")
        bounds = np.searchsorted(self.node_of[order], np.arange(self.n + 1))
        mapping = tuple(order[a:b] for a, b in itertools.pairwise(bounds))
        draft = self._skeleton()
        ptr, others, _ = draft.incidence
        pos, radius = self.pos.copy(), self.radius.copy()
        for tip in draft.tips.tolist():
            inner = others[ptr[tip]]
            way = self.pos[tip] - self.pos[inner]
            size = float(np.linalg.norm(way))
            if size == 0.0:
                continue
            way /= size
            if draft.degree[inner] == 2:
                # A tip's vertices are a cap: their distance from the axis is not the radius.
                radius[tip] = min(self.radius[inner], max(radius[tip], 0.5 * self.radius[inner]))
            reach = float(((self.verts[mapping[tip]] - self.pos[tip]) @ way).max(initial=0.0))
            pos[tip] += max(0.0, reach - 0.5 * radius[tip]) * way
        tips = draft.tips
        candidates = tips if len(tips) else np.arange(self.n)
        thick = [radius[others[ptr[a] : ptr[a + 1]]].max() for a in candidates]
        root = int(candidates[int(np.argmax(thick))])
        return Skeleton.make(pos, radius, self.edges, root, mapping)
