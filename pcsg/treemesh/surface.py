"""From a skeleton to a closed surface of quads: cage, subdivision, weights, projection."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.treemesh.cage import Cage, build_cage, limb_directions
from pcsg.treemesh.coordinates import cage_coordinates
from pcsg.treemesh.field import Kernel, Locality, SegmentField, build_field, nearest_rows
from pcsg.treemesh.projection import OFF, FairZone, evolve, find_fair_zone
from pcsg.treemesh.pruning import drop_hidden_twigs
from pcsg.treemesh.quality import corner_folds
from pcsg.treemesh.rebuild import carry_over
from pcsg.treemesh.skeleton import Bools, Floats, Ints, Skeleton
from pcsg.treemesh.subdivision import Level, plan_levels, subdivide

ENLARGE = 1.5
"""How much farther a joint reaches when it is built again because of folded quads."""

FEW = 1e-5
"""Share of folded quads that is let be: in a crown of thousands of forks some always are."""


@dataclass(frozen=True)
class SurfaceOptions:
    """How a surface is made from a skeleton.

    Attributes
    ----------
    levels
        Steps of Catmull-Clark; each has four times the quads.
    kernel, kappa, taper, locality
        Of the field; see `field.build_field`.
    max_aspect
        Longest distance between two squares of the cage, in radii; None for one at each node.
    fair
        Rounds of tangential smoothing near forks.
    tries
        How often joints with folded quads are built again, reaching farther.
    """

    levels: int = 2
    kernel: Kernel = "cauchy"
    kappa: float = 2.0
    taper: bool = True
    max_aspect: float | None = 4.0
    locality: Locality = "graph"
    fair: int = 10
    tries: int = 3


@dataclass(frozen=True, eq=False)
class QuadMesh:
    """A closed, oriented surface of quads about a skeleton.

    Attributes
    ----------
    verts : float64 (v, 3)
        On the convolution surface, before offsets.
    quads : int64 (f, 4)
        Corners, counter-clockwise from outside.
    owner : int64 (v,)
        The limb of every vertex; at joints the number of limbs plus the joint.
    start : float64 (v, 3)
        Vertices of the subdivided cage, before projection.
    offsets : float64 (v,) or None
        Distances along the normals to the original mesh; see `offsets.restore_offsets`.
    normals : float64 (v, 3)
        Outward, from the field.
    residual : float64 (v,)
        F/T, which is 1 on the surface.
    nearest : int64 (v,)
        The row in `field` of the segment that is nearest to every vertex, in radii.
    edge : int64 (f,)
        The edge of the skeleton that every quad belongs to.
    cage, levels, factor
        The control cage, the steps of its subdivision, and how much farther joints reach.
    uv : float64 (f, 4, 2)
        At the corners of quads: u once around the limb, v along it in circumferences, so that
        pictures are not stretched.
    skeleton : Skeleton
        What the surface is about, without the twigs that were dropped.
    dropped : int64
        Edges of the given skeleton that end inside a thicker limb.
    notes : tuple of str
        What a user should know.
    times : mapping of str to float or None
        Seconds of every stage.
    """

    verts: Floats
    quads: Ints
    owner: Ints
    start: Floats
    offsets: Floats | None
    normals: Floats
    residual: Floats
    nearest: Ints
    edge: Ints
    uv: Floats
    skeleton: Skeleton
    cage: Cage
    levels: tuple[Level, ...]
    factor: Floats
    field: SegmentField
    dropped: Ints
    notes: tuple[str, ...] = ()
    times: Mapping[str, float] | None = None

    @cached_property
    def positions(self) -> Floats:
        """Vertices with their offsets, float64 (v, 3): the final surface."""
        if self.offsets is None:
            return self.verts
        return self.verts + self.offsets[:, None] * self.normals

    @property
    def labels(self) -> Ints:
        """The number that every quad carries from the skeleton's tag `label`; -1 for none."""
        tag = self.skeleton.tags.get("label")
        return np.full(len(self.quads), -1) if tag is None else tag[self.edge]

    @property
    def triangles(self) -> Ints:
        """Every quad cut along its shorter diagonal, int64 (2 f, 3)."""
        return triangulate(self.positions, self.quads)

    def report(self, original: Any = None, **options: Any) -> dict[str, Any]:
        """Return measures of the surface; see `report.report_surface`."""
        from pcsg.treemesh.report import report_surface

        return report_surface(self, original, **options)

    def save(self, path: str | Path) -> Path:
        """Write the surface; the ending says how: .obj, .ply, .glb, .stl, .usda or .usd."""
        from pcsg.treemesh.files import save_surface

        return save_surface(self, path)

    def __repr__(self) -> str:
        return f"<pcsg.treemesh.QuadMesh of {len(self.quads)} quads, {len(self.verts)} vertices>"


def triangulate(verts: Floats, quads: Ints) -> Ints:
    """Return two triangles for each quad, cut along its shorter diagonal, (2 f, 3)."""
    a, b, c, d = quads.T
    first = np.linalg.norm(verts[a] - verts[c], axis=1) <= np.linalg.norm(
        verts[b] - verts[d], axis=1
    )
    tri = np.empty((len(quads), 2, 3), dtype=np.int64)
    tri[:, 0] = np.where(first[:, None], np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    tri[:, 1] = np.where(first[:, None], np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return tri.reshape(-1, 3)


class Timer:
    """Seconds by stage."""

    def __init__(self) -> None:
        self.times: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of a block to a stage."""
        start = time.perf_counter()
        yield
        self.times[name] = self.times.get(name, 0.0) + time.perf_counter() - start


def tree_surface(
    skel: Skeleton,
    options: SurfaceOptions | None = None,
    *,
    previous: QuadMesh | None = None,
    **more: Any,
) -> QuadMesh:
    """Build the surface of a skeleton.

    Parameters
    ----------
    options, **more
        See `SurfaceOptions`; names given directly win.
    previous
        A surface of a similar skeleton with the same options: what did not change is taken over.

    Returns
    -------
    QuadMesh
        Closed, oriented and of quads only, whatever the skeleton.

    Raises
    ------
    UsageError
        The skeleton or an option cannot be used.
    """
    wanted = make_options(options, more)
    timer = Timer()
    with timer.stage("cage"):
        kept, dropped = drop_hidden_twigs(skel)
    if not len(kept.limbs):
        raise UsageError("every segment of the skeleton ends inside a thicker one: too thick")
    factor = np.ones(2 * len(kept.limbs))
    surf = _build(kept, wanted, factor, timer, previous)
    for _ in range(wanted.tries):
        grown = _enlarge(surf, factor)
        if grown is None:
            break
        other = _build(kept, wanted, grown, timer, surf)
        if folded_quads(other).sum() >= folded_quads(surf).sum():
            break
        factor, surf = grown, other
    notes = []
    if len(dropped):
        notes.append(f"{len(dropped)} segments end inside a thicker limb and were dropped")
    off = int((np.abs(surf.residual - 1.0) > OFF).sum())
    if off:
        notes.append(f"{off} vertices could not be brought onto the surface")
    return replace(
        surf, factor=factor, dropped=dropped, notes=tuple(notes), times=dict(timer.times)
    )


def make_options(options: SurfaceOptions | None, more: Mapping[str, Any]) -> SurfaceOptions:
    """Return options with some of them replaced."""
    unknown = set(more) - set(SurfaceOptions.__dataclass_fields__)
    if unknown:
        known = ", ".join(SurfaceOptions.__dataclass_fields__)
        raise UsageError(f"a surface has no option `{sorted(unknown)[0]}`; it has {known}")
    return replace(options or SurfaceOptions(), **more)


def _build(
    skel: Skeleton,
    options: SurfaceOptions,
    factor: Floats,
    timer: Timer,
    previous: QuadMesh | None,
) -> QuadMesh:
    with timer.stage("cage"):
        cage = build_cage(skel, options.max_aspect, factor)
    with timer.stage("subdivision"):
        mesh = cage.mesh
        levels = tuple(plan_levels(mesh.flat, mesh.ptr, len(mesh.verts), options.levels))
    return build_on(skel, cage, levels, options, timer, previous)


def build_on(
    skel: Skeleton,
    cage: Cage,
    levels: Sequence[Level],
    options: SurfaceOptions,
    timer: Timer,
    previous: QuadMesh | None = None,
) -> QuadMesh:
    """Return the surface of a cage; vertices that are as in a previous surface are taken over."""
    with timer.stage("subdivision"):
        verts = subdivide(cage.mesh.verts, levels)
        quads = levels[-1].quads
        owner, edge = spread_labels(cage, levels)
    with timer.stage("coordinates"):
        uv = cage_coordinates(cage, skel.limbs)
        corners = uv
        for level in levels:
            corners = level.apply_corners(corners).reshape(-1, 2)
        uv = corners.reshape(-1, 4, 2)
    with timer.stage("weights"):
        found = build_field(
            skel,
            kernel=options.kernel,
            kappa=options.kappa,
            taper=options.taper,
            locality=options.locality,
        )
    with timer.stage("projection"):
        zone = find_fair_zone(quads, len(verts))
        placed, state = _evolve(verts, owner, found, zone, options.fair, previous)
    return QuadMesh(
        verts=placed,
        quads=quads,
        owner=owner,
        start=verts,
        offsets=None,
        normals=state[:, :3],
        residual=state[:, 3],
        nearest=state[:, 4].astype(np.int64),
        edge=edge,
        uv=uv,
        skeleton=skel,
        cage=cage,
        levels=tuple(levels),
        factor=np.ones(2 * len(skel.limbs)),
        field=found,
        dropped=np.zeros(0, dtype=np.int64),
    )


def repose(surf: QuadMesh, skel: Skeleton, options: SurfaceOptions | None = None) -> QuadMesh:
    """Return the surface with the same faces about the skeleton with its nodes moved.

    For animation: no square of the cage is added or taken away, so that all frames share their
    quads and only vertices move.

    Parameters
    ----------
    skel
        `QuadMesh.skeleton` with other places or radii.
    options
        Those that the surface was made with.

    Raises
    ------
    UsageError
        The skeleton has other edges.
    """
    if not np.array_equal(skel.edges, surf.skeleton.edges) or skel.root != surf.skeleton.root:
        raise UsageError("an animation moves nodes only: the skeleton has other edges")
    skel.check()
    timer = Timer()
    with timer.stage("cage"):
        cage = surf.cage.place(skel, surf.factor)
    found = build_on(skel, cage, surf.levels, options or SurfaceOptions(), timer, surf)
    return replace(found, factor=surf.factor, times=dict(timer.times))


def spread_labels(cage: Cage, levels: Sequence[Level]) -> tuple[Ints, Ints]:
    """Return the owner of every vertex, and the skeleton's edge of every quad, after subdivision.

    A quad inherits from its cage face; a vertex belongs to a limb if it touches one.
    """
    owner, edge = cage.owner, cage.edge
    for level in levels:
        owner, edge = owner[level.topology.face], edge[level.topology.face]
    n_limbs = len(cage.stations.ptr) - 1
    t = levels[-1].topology
    of_vertex = np.full(t.n_verts + t.n_edges + t.n_faces, -1)
    quads = levels[-1].quads
    for part in (owner >= n_limbs, owner < n_limbs):
        of_vertex[quads[part].ravel()] = np.repeat(owner[part], 4)
    return of_vertex, edge


def _evolve(
    verts: Floats,
    owner: Ints,
    found: SegmentField,
    zone: FairZone,
    fair: int,
    previous: QuadMesh | None,
) -> tuple[Floats, Floats]:
    """Return vertices on the surface and their state, what is as before taken over."""
    if previous is None:
        return evolve(verts, owner, found, zone, np.arange(len(verts)), fair=fair)
    source = carry_over(previous, verts, owner, found, zone)
    dirty = source < 0
    begin = np.where(dirty[:, None], verts, previous.verts[source])
    chosen = np.flatnonzero(dirty)
    placed, state = evolve(begin, owner, found, zone.restricted(dirty), chosen, fair=fair)
    kept = ~dirty
    state[kept, :3] = previous.normals[source[kept]]
    state[kept, 3] = previous.residual[source[kept]]
    # Rows are counted anew after an edit, so they are looked up again.
    state[kept, 4] = nearest_rows(placed[kept], owner[kept], found)
    return placed, state


def folded_quads(surf: QuadMesh) -> Bools:
    """Return which quads have a corner that is turned inside out."""
    return np.asarray(corner_folds(surf.verts, surf.quads, surf.normals).any(axis=1))


def _enlarge(surf: QuadMesh, factor: Floats) -> Floats | None:
    """Return larger reaches for the two limbs beside every folded quad, None if there is none."""
    folded = folded_quads(surf)
    limbs = surf.skeleton.limbs
    if folded.sum() <= FEW * len(folded) or not len(limbs.joints):
        return None
    grown = factor.copy()
    place = surf.verts[surf.quads[folded]].mean(axis=1)
    owner = surf.owner[surf.quads[folded]].max(axis=1)
    ptr, ends = limbs.joint_ends
    nodes = surf.skeleton.pos[limbs.joints]
    direction = limb_directions(surf.skeleton, limbs)
    for point, k in zip(place, owner.tolist(), strict=True):
        if k >= len(limbs):
            joint = k - len(limbs)
        else:
            near = [j for j in limbs.ends[k].tolist() if j >= 0]
            if not near:
                continue
            joint = min(near, key=lambda j: float(np.linalg.norm(point - nodes[j])))
        own = ends[ptr[joint] : ptr[joint + 1]]
        beside = own[np.argsort(-(direction[own] @ (point - nodes[joint])), kind="stable")[:2]]
        grown[beside] = ENLARGE * factor[beside]
    return grown
