"""BlobTree: implicit models of skeletons, blends, contacts and warps, and exact rays through them.

Names are loaded on first use: reading a grammar needs no kernels.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOMES = {
    "Areas": "areas",
    "Field": "nodes",
    "Junctions": "tree",
    "Model": "model",
    "bend": "nodes",
    "box": "nodes",
    "color": "nodes",
    "cone": "nodes",
    "contour": "meshing",
    "controlled": "nodes",
    "convolution_segment": "nodes",
    "disc": "nodes",
    "gbb": "nodes",
    "grow": "tree",
    "intersect": "nodes",
    "joint": "nodes",
    "junction_areas": "areas",
    "label": "nodes",
    "pcm": "nodes",
    "place": "nodes",
    "point": "nodes",
    "polygon": "nodes",
    "r_intersect": "nodes",
    "r_union": "nodes",
    "read_skeleton": "lines",
    "ricci": "nodes",
    "segment": "nodes",
    "subtract": "nodes",
    "taper": "nodes",
    "total": "nodes",
    "twist": "nodes",
    "union": "nodes",
    "weight": "nodes",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"pcsg.blobtree.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'pcsg.blobtree' has no attribute '{name}'")


def __dir__() -> list[str]:
    return [*__all__]
