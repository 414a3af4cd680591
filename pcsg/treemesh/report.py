"""Reports: what a surface is worth."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.treemesh.cage import limb_directions
from pcsg.treemesh.meshes import mesh_arrays
from pcsg.treemesh.nearest import MeshIndex, find_cuts, sample_surface
from pcsg.treemesh.projection import OFF
from pcsg.treemesh.quality import (
    aspect_ratios,
    away_from_ends,
    corner_folds,
    edge_flow,
    limb_places,
    smallest_angles,
    valence,
)
from pcsg.treemesh.skeleton import Bools, Floats, Ints
from pcsg.treemesh.subdivision import find_topology
from pcsg.treemesh.surface import triangulate

if TYPE_CHECKING:
    from pcsg.treemesh.surface import QuadMesh


def report_surface(
    surf: QuadMesh, original: Any = None, *, cuts: bool = True, per_face: int = 10
) -> dict[str, Any]:
    """Measure a surface.

    Parameters
    ----------
    original
        The mesh that it stands for, if any: what `meshes.extract_skeleton` takes.
    cuts
        Look for quads that cut each other.
    per_face
        Points on every face of the original and of the surface that distances are taken from.

    Returns
    -------
    dict
        Numbers only, ready for JSON; lengths in the units of the skeleton, angles in degrees.
    """
    verts, quads = surf.positions, surf.quads
    report: dict[str, Any] = {
        **check_quads(quads, len(verts)),
        "segments": surf.skeleton.n_edges,
        "joints": len(surf.skeleton.joints),
        "tips": len(surf.skeleton.tips),
        "quads_per_segment": len(quads) / surf.skeleton.n_edges,
        "dropped_segments": len(surf.dropped),
        "valence_4_share": float((valence(quads, len(verts)) == 4).mean()),
    }
    angles = smallest_angles(verts, quads)
    aspect = aspect_ratios(verts, quads)
    folds = corner_folds(verts, quads, surf.normals).any(axis=1)
    report["smallest_angle"] = _spread(angles, (0, 1, 50, 100))
    report["folded_quads"] = int(folds.sum())
    report["folded_share"] = float(folds.mean())
    report["aspect_ratio"] = _spread(aspect, (50, 99, 100))
    residual = np.abs(surf.residual - 1.0)
    report["residual"] = {"max": float(residual.max()), "off": int((residual > OFF).sum())}
    report |= _along_limbs(surf)
    if cuts:
        pairs, cutting = find_cuts(verts, quads, surf.triangles)
        outside = outside_acute_forks(surf, cutting)
        report["self_intersections"] = {
            "pairs": pairs,
            "quads": len(cutting),
            "share": len(cutting) / len(quads),
            "share_outside_forks_under_20_degrees": int(outside.sum()) / len(quads),
        }
    if original is not None:
        report["distance"] = _distances(surf, original, per_face)
    report["times"] = dict(surf.times or {})
    report["peak_memory_bytes"] = _peak_memory()
    report["notes"] = list(surf.notes)
    return report


def check_quads(quads: Ints, n_verts: int) -> dict[str, Any]:
    """Return counts, and whether the mesh is closed and oriented."""
    found: dict[str, Any] = {
        "vertices": n_verts,
        "quads": len(quads),
        "quad_share": 1.0 if quads.shape[1] == 4 else 0.0,
    }
    try:
        t = find_topology(quads.ravel(), np.arange(0, quads.size + 1, 4), n_verts)
    except UsageError as error:
        return {**found, "closed": False, "oriented": False, "problem": str(error)}
    return {**found, "closed": True, "oriented": True, "euler_characteristic": t.euler}


def _spread(values: Floats, percents: tuple[int, ...]) -> dict[str, float]:
    names = {0: "min", 50: "median", 100: "max"}
    if not len(values):
        return {}
    found = np.percentile(values, percents)
    return {names.get(p, f"{p}%"): float(v) for p, v in zip(percents, found, strict=True)}


def _along_limbs(surf: QuadMesh) -> dict[str, Any]:
    """Return radius errors and edge flow."""
    vertex, row, distance, radius, arc = limb_places(surf)
    error = distance / radius - 1.0
    far = away_from_ends(surf, surf.owner[vertex], arc)
    flow = edge_flow(surf, vertex, row)
    return {
        "radius_error": _signed(error),
        "radius_error_away_from_ends": _signed(error[far]),
        "edge_flow": _spread(flow[far], (50, 95)),
        "away_from_ends_share": float(far.mean()) if len(far) else 0.0,
    }


def _signed(error: Floats) -> dict[str, float]:
    if not len(error):
        return {}
    size = np.abs(error)
    return {
        "median": float(np.median(error)),
        "5%": float(np.percentile(error, 5)),
        "95%": float(np.percentile(error, 95)),
        "median_size": float(np.median(size)),
        "95%_size": float(np.percentile(size, 95)),
    }


def outside_acute_forks(surf: QuadMesh, quads: Ints, degrees: float = 20.0) -> Bools:
    """Return which quads are not near a joint where two limbs are closer than an angle."""
    limbs = surf.skeleton.limbs
    ptr, ends = limbs.joint_ends
    way = limb_directions(surf.skeleton, limbs)
    acute = np.zeros(len(limbs.joints), dtype=bool)
    for j in range(len(limbs.joints)):
        own = way[ends[ptr[j] : ptr[j + 1]]]
        cosine = own @ own.T
        np.fill_diagonal(cosine, -1.0)
        acute[j] = cosine.max() > np.cos(np.radians(degrees))
    # A quad of a limb is near both of its joints.
    near = np.append(acute, False)
    of_limb = near[limbs.ends].any(axis=1)
    flags = np.concatenate([of_limb, acute])
    return np.asarray(~flags[surf.owner[surf.quads[quads]]].any(axis=1))


def _distances(surf: QuadMesh, original: Any, per_face: int) -> dict[str, Any]:
    """Return distances to the original mesh in both directions, before and after offsets."""
    verts, faces = mesh_arrays(original)
    index = MeshIndex(verts, faces)
    points = sample_surface(verts, faces, per_face)
    radius = float(np.median(surf.skeleton.radius))
    found: dict[str, Any] = {}
    stages = [("before_offsets", surf.verts)]
    if surf.offsets is not None:
        stages.append(("after_offsets", surf.positions))
    for name, places in stages:
        tri = triangulate(places, surf.quads)
        ours = index.closest(sample_surface(places, tri, per_face))[1]
        theirs = MeshIndex(places, tri).closest(points)[1]
        found[name] = {
            "mean_new_to_original": float(ours.mean()),
            "mean_original_to_new": float(theirs.mean()),
            "hausdorff": float(max(ours.max(), theirs.max())),
            "mean_original_to_new_in_radii": float(theirs.mean()) / radius,
        }
    return found


def _peak_memory() -> int | None:
    """Return the largest memory of the process so far, in bytes, where the system tells."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak) if sys.platform == "darwin" else 1024 * int(peak)
