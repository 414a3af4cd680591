"""Primitive solids and sheets, each with its crossings, normal, membership and coordinates."""

from pcsg.leaf import polyhedra, sheets, solids, torus

# isort: split
from pcsg.leaf import mesh
from pcsg.leaf.registry import LEAF_NAMES, LEAVES, Box, Solid, leaf

__all__ = [
    "LEAF_NAMES",
    "LEAVES",
    "Box",
    "Solid",
    "leaf",
    "mesh",
    "polyhedra",
    "sheets",
    "solids",
    "torus",
]
