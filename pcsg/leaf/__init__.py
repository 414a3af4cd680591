"""Primitive solids and sheets, each with its crossings, normal, membership and coordinates."""

from pcsg.leaf import polyhedra, quadrics, sheets, solids, superellipsoid, torus

# isort: split
from pcsg.leaf import mesh

# isort: split
from pcsg.leaf import blob, heightfield
from pcsg.leaf.registry import LEAF_NAMES, LEAVES, Box, Solid, leaf

__all__ = [
    "LEAF_NAMES",
    "LEAVES",
    "Box",
    "Solid",
    "blob",
    "heightfield",
    "leaf",
    "mesh",
    "polyhedra",
    "quadrics",
    "sheets",
    "solids",
    "superellipsoid",
    "torus",
]
