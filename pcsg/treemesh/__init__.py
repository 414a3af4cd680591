"""Quad meshes of trees from line skeletons with radii: see README.md and docs/treemesh.md."""

from pcsg.treemesh.files import load_skeleton, save_skeleton
from pcsg.treemesh.merging import merge
from pcsg.treemesh.meshes import extract_skeleton
from pcsg.treemesh.offsets import restore_offsets, transfer_offsets
from pcsg.treemesh.resampling import resample
from pcsg.treemesh.segments import Segments, skeleton_of_segments
from pcsg.treemesh.skeleton import Skeleton
from pcsg.treemesh.surface import QuadMesh, SurfaceOptions, tree_surface

__all__ = [
    "QuadMesh",
    "Segments",
    "Skeleton",
    "SurfaceOptions",
    "extract_skeleton",
    "load_skeleton",
    "merge",
    "resample",
    "restore_offsets",
    "save_skeleton",
    "skeleton_of_segments",
    "transfer_offsets",
    "tree_surface",
]
