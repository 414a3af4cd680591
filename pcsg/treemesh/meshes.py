"""Skeletons of meshes as users have them: one closed surface, or a soup of tubes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from pcsg.errors import UsageError
from pcsg.meshfile import Mesh, read_mesh
from pcsg.treemesh.contraction import face_areas, signed_volume
from pcsg.treemesh.extraction import ExtractionOptions, skeleton_of_closed
from pcsg.treemesh.merging import merge_all
from pcsg.treemesh.parts import Cleaned, Part, clean
from pcsg.treemesh.skeleton import Floats, Ints, Skeleton
from pcsg.treemesh.tubes import tube_skeleton

COARSE = 1.5
"""Edges longer than this, in mean radii, are halved before contraction."""

FULL = 100_000
"""Vertices of a part whose edges are halved no more."""


class Triangles(Protocol):
    """Anything with vertices and triangles, such as `pcsg.meshfile.Mesh`."""

    @property
    def vertices(self) -> Floats:
        """Vertices, float64 (v, 3)."""

    @property
    def triangles(self) -> Ints:
        """Corners, int64 (f, 3)."""


@dataclass(frozen=True)
class Extracted:
    """A skeleton, and what was done to the mesh."""

    skeleton: Skeleton
    notes: tuple[str, ...]
    parts: int


def extract_skeleton(
    mesh: str | Path | Mesh | Triangles | tuple[Any, Any],
    *,
    largest_only: bool = False,
    reach: float | None = None,
    options: ExtractionOptions | None = None,
) -> Skeleton:
    """Return the line skeleton of a triangle mesh.

    Parameters
    ----------
    mesh
        A file (OBJ, PLY, STL, GLB), a mesh, or a pair of arrays (v, 3), (f, 3).
    largest_only
        Take the largest of several parts. By default they are joined.
    reach
        Widest gap between parts that is bridged; a twentieth of the box's diagonal by default.
    options
        Of contraction.

    Raises
    ------
    UsageError
        The mesh has no inside, or a part lies too far from the rest.
    """
    return extract(mesh, largest_only=largest_only, reach=reach, options=options).skeleton


def extract(
    mesh: str | Path | Mesh | Triangles | tuple[Any, Any],
    *,
    largest_only: bool = False,
    reach: float | None = None,
    options: ExtractionOptions | None = None,
) -> Extracted:
    """Return the skeleton of a mesh with notes; parameters as for `extract_skeleton`."""
    if isinstance(mesh, str | Path):
        mesh = read_mesh(mesh)
    verts, faces = mesh_arrays(mesh)
    cleaned = clean(verts, faces)
    notes = [*(mesh.notes if isinstance(mesh, Mesh) else ()), *cleaned.notes]
    parts = cleaned.parts[:1] if largest_only else cleaned.parts
    if len(parts) < len(cleaned.parts):
        notes.append(f"{len(cleaned.parts) - 1} smaller parts were left out")
    skeletons = [skeleton_of_part(part, options) for part in parts]
    diagonal = float(np.linalg.norm(np.ptp(verts, axis=0)))
    whole, bridged = merge_all(skeletons, 0.05 * diagonal if reach is None else reach)
    if len(parts) > 1:
        notes.append(f"{len(parts)} parts were joined")
    if bridged:
        notes.append(f"{bridged} gaps between parts were bridged")
    return Extracted(_with_root_below(whole), tuple(notes), len(parts))


def mesh_arrays(mesh: str | Path | Mesh | Triangles | tuple[Any, Any]) -> tuple[Floats, Ints]:
    """Return vertices (v, 3) and triangles (f, 3) of whatever stands for a mesh."""
    if isinstance(mesh, str | Path):
        mesh = read_mesh(mesh)
    if isinstance(mesh, tuple):
        verts, faces = np.asarray(mesh[0], dtype=np.float64), np.asarray(mesh[1], dtype=np.int64)
    else:
        verts, faces = mesh.vertices, mesh.triangles
    if verts.ndim != 2 or verts.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise UsageError("a mesh is an array of vertices (v, 3) and one of triangles (f, 3)")
    if len(faces) and not 0 <= int(faces.min()) <= int(faces.max()) < len(verts):
        raise UsageError("a face names a vertex that does not exist")
    return verts, faces


def skeleton_of_part(part: Part, options: ExtractionOptions | None = None) -> Skeleton:
    """Return the skeleton of a closed part: of a tube by its rings, else by contraction."""
    tube = tube_skeleton(part)
    if tube is None:
        verts, faces = refine(part.verts, part.faces)
        tube = skeleton_of_closed(verts, faces, options)
    # Vertices that were added on the way are none of the original's.
    source = np.concatenate([part.source, [-1]])
    mapping = []
    for vertices in tube.mapping or ():
        known = source[np.minimum(vertices, len(part.source))]
        mapping.append(known[known >= 0])
    return tube.replaced(mapping=tuple(mapping))


def refine(verts: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Halve long edges of a coarse closed mesh, so that it can be contracted.

    Contraction needs triangles that are not much longer than the limbs are thick; the mean radius
    is taken as twice the volume over the area.
    """
    area = float(face_areas(verts, faces).sum())
    limit = COARSE * 2.0 * abs(signed_volume(verts - verts.mean(axis=0), faces)) / area
    for _ in range(12):
        a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        length = np.linalg.norm(verts[a] - verts[b], axis=1).reshape(-1, 3)
        if float(length.max()) <= limit or len(verts) > FULL:
            break
        verts, faces = _halve(verts, faces, length > limit)
    return verts, faces


def _halve(verts: Floats, faces: Ints, long: Any) -> tuple[Floats, Ints]:
    """Cut the marked edges of triangles (f, 3) at their middles, the longest of each first."""
    a, b = faces, np.roll(faces, -1, axis=1)
    key = np.minimum(a, b) * len(verts) + np.maximum(a, b)
    cut, number = np.unique(key[long], return_inverse=True)
    middle = np.full(faces.shape, -1)
    middle[long] = len(verts) + number.ravel()
    i, j = cut // len(verts), cut % len(verts)
    verts = np.concatenate([verts, 0.5 * (verts[i] + verts[j])])
    done = [faces[~long.any(axis=1)]]
    tri, mid = faces[long.any(axis=1)], middle[long.any(axis=1)]
    # Cut one edge after the other: a triangle becomes two, which share the rest.
    while len(tri):
        side = np.linalg.norm(verts[tri] - verts[np.roll(tri, -1, axis=1)], axis=2)
        k = np.where(mid >= 0, side, -1.0).argmax(axis=1)
        rows = np.arange(len(tri))
        turn = (k[:, None] + np.arange(3)) % 3
        p, q, r = tri[rows[:, None], turn].T
        m, m_qr, m_rp = mid[rows[:, None], turn].T
        none = np.full(len(tri), -1)
        tri = np.concatenate([np.stack([p, m, r], 1), np.stack([m, q, r], 1)])
        mid = np.concatenate([np.stack([none, none, m_rp], 1), np.stack([none, m_qr, none], 1)])
        open_ = (mid >= 0).any(axis=1)
        done.append(tri[~open_])
        tri, mid = tri[open_], mid[open_]
    return verts, np.concatenate(done)


def _with_root_below(skel: Skeleton) -> Skeleton:
    """Return the skeleton with its thickest tip as the root."""
    tips = skel.tips
    if not len(tips):
        return skel
    ptr, others, _ = skel.incidence
    thick = np.maximum(skel.radius[tips], skel.radius[others[ptr[tips]]])
    return skel.replaced(root=int(tips[int(np.argmax(thick))]))


__all__ = ["Cleaned", "Extracted", "extract", "extract_skeleton", "mesh_arrays"]
