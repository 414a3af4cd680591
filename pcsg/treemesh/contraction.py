"""Contraction of a closed triangle mesh to almost a line (Au, Tai, Chu, Cohen-Or, Lee 2008).

The mesh is smoothed implicitly by its cotangent Laplacian, again and again, while weights hold
what has already collapsed: in the least-squares sense,

    W_L L V' = 0,    W_H V' = W_H V.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pcsg.errors import UsageError, missing_extra
from pcsg.treemesh.skeleton import Floats, Ints

_LARGEST_COTANGENT = 1e4
_LARGEST_HOLD = 1e4
_LARGEST_PULL = 2048.0


@dataclass(frozen=True)
class ContractionOptions:
    """How a mesh is contracted.

    Attributes
    ----------
    pull
        First weight of the Laplacian; None for the root of the mean one-ring area, after the mesh
        was scaled to a mean face area of 1, so that size and density do not matter. Au et al. take
        1e-3 of the root of the mean face area.
    growth
        Factor of that weight from step to step.
    hold
        Weight of the present places.
    stop
        Volume over the first volume where contraction is finished. Au et al. take 1e-6.
    most
        Most steps.
    """

    pull: float | None = None
    growth: float = 2.0
    hold: float = 1.0
    stop: float = 1e-4
    most: int = 20


def signed_volume(verts: Floats, faces: Ints) -> float:
    """Return the volume of a closed mesh, positive if its faces look outwards."""
    a, b, c = (verts[k] for k in faces.T)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def face_areas(verts: Floats, faces: Ints) -> Floats:
    """Return the areas of triangles (f,)."""
    a, b, c = (verts[k] for k in faces.T)
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def ring_areas(verts: Floats, faces: Ints) -> Floats:
    """Return the area of the faces about every vertex (v,)."""
    area = face_areas(verts, faces)
    return np.bincount(faces.ravel(), np.repeat(area, 3), minlength=len(verts)).astype(np.float64)


def cotangent_laplacian(verts: Floats, faces: Ints) -> Any:
    """Return the Laplacian: (cot a + cot b) / 2 for an edge, rows that sum to 0; sparse (v, v)."""
    from scipy.sparse import coo_array, diags_array

    i, j, weight = [], [], []
    for k in range(3):
        a, b, c = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        p, q = verts[b] - verts[a], verts[c] - verts[a]
        sine = np.linalg.norm(np.cross(p, q), axis=1)
        cot = np.einsum("ij,ij->i", p, q) / np.maximum(sine, 1e-300)
        i += [b, c]
        j += [c, b]
        weight += [0.5 * cot, 0.5 * cot]
    n = len(verts)
    entries = (np.concatenate(weight), (np.concatenate(i), np.concatenate(j)))
    matrix = coo_array(entries, shape=(n, n)).tocsr()
    matrix.data = np.clip(np.nan_to_num(matrix.data), 0.0, _LARGEST_COTANGENT)
    return matrix - diags_array(matrix.sum(axis=1))


def contract(verts: Floats, faces: Ints, options: ContractionOptions | None = None) -> Floats:
    """Return the vertices of a mesh contracted to almost a line.

    Parameters
    ----------
    verts (v, 3), faces (f, 3)
        A closed, connected mesh.
    """
    try:
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu
    except ImportError:
        raise UsageError(missing_extra("tree meshes need", "scipy", "mesh")) from None

    o = options or ContractionOptions()
    scale = 1.0 / np.sqrt(face_areas(verts, faces).mean())
    centre = verts.mean(axis=0)
    now = (verts - centre) * scale
    first_area = ring_areas(now, faces)
    first_volume = last_volume = abs(signed_volume(now, faces))
    pull = np.sqrt(first_area.mean()) if o.pull is None else o.pull
    hold = np.full(len(verts), o.hold)
    for _ in range(o.most):
        laplacian = cotangent_laplacian(now, faces)
        system = pull**2 * (laplacian.T @ laplacian) + diags_array(hold**2)
        try:
            solve = splu(
                system.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            ).solve
            moved = solve(hold[:, None] ** 2 * now)
        except RuntimeError:  # singular to working precision
            break
        if not np.isfinite(moved).all():
            break
        volume = abs(signed_volume(moved, faces))
        if volume > 0.8 * last_volume:
            break  # what is left is rounding and folds; going on would shorten the limbs
        now, last_volume = moved, volume
        if volume < o.stop * first_volume:
            break
        pull = min(o.growth * pull, _LARGEST_PULL)
        shrunk = first_area / np.maximum(ring_areas(now, faces), 1e-300)
        hold = np.minimum(o.hold * np.sqrt(shrunk), _LARGEST_HOLD)
    return np.asarray(now / scale + centre)
