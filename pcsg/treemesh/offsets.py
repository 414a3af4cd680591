"""Offsets that bring the surface back to the original mesh (Zhu, Jin, You 2015, section 4.4)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pcsg.treemesh.meshes import mesh_arrays
from pcsg.treemesh.nearest import MeshIndex
from pcsg.treemesh.skeleton import Floats
from pcsg.treemesh.surface import QuadMesh

FARTHEST = 1.5
"""Longest offset, in local radii."""

_ROUNDS = 10


def local_radii(surf: QuadMesh) -> Floats:
    """Return the skeleton's radius at every vertex, from its nearest segment, (v,)."""
    table = surf.field.table[surf.nearest]
    away = surf.verts - table[:, 0:3]
    part = np.clip(np.einsum("ij,ij->i", away, table[:, 3:6]) / table[:, 6], 0.0, 1.0)
    return np.asarray(table[:, 10] + part * (table[:, 11] - table[:, 10]))


def restore_offsets(surf: QuadMesh, mesh: Any) -> QuadMesh:
    """Return the surface with offsets along its normals to an original mesh.

    Parameters
    ----------
    mesh
        What `meshes.extract_skeleton` takes. Its faces must look outwards.

    Returns
    -------
    QuadMesh
        With `offsets` positive where the original lies outside. Where no face lies within 1.5
        radii, the offset is interpolated from the neighbours.
    """
    index = MeshIndex(*mesh_arrays(mesh))
    found = index.shoot(surf.verts, surf.normals, FARTHEST * local_radii(surf))
    share = float(np.isfinite(found).mean())
    note = f"offsets were found for {100 * share:.1f} % of the vertices"
    return replace(surf, offsets=_fill(surf, found), notes=(*surf.notes, note))


def _fill(surf: QuadMesh, offsets: Floats) -> Floats:
    """Interpolate missing offsets: harmonic, by Jacobi's method."""
    missing = np.isnan(offsets)
    found = np.where(missing, 0.0, offsets)
    a, b = surf.quads.ravel(), np.roll(surf.quads, -1, axis=1).ravel()
    count = np.bincount(a, minlength=len(found))
    known = ~missing
    for _ in range(_ROUNDS):
        # Neighbours that are not known yet do not count.
        total = np.bincount(a, found[b] * known[b], minlength=len(found))
        n = np.bincount(a, known[b].astype(np.float64), minlength=len(found))
        found = np.where(missing & (n > 0), total / np.maximum(n, 1.0), found)
        known = known | (n > 0)
    assert count.min() > 0
    return found


def transfer_offsets(edited: QuadMesh, surf: QuadMesh, relative: bool = True) -> QuadMesh:
    """Carry offsets over to an edited surface with the same faces.

    Parameters
    ----------
    relative
        Scale them with the local radii, so that bark keeps its proportions.
    """
    if surf.offsets is None:
        return edited
    scale = local_radii(edited) / local_radii(surf) if relative else 1.0
    return replace(edited, offsets=surf.offsets * scale)
