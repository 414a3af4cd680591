"""A language and ray tracer for natural scenes of any complexity.

    scene = pcsg.load("tree.pcsg")                     # a grammar; `loads` takes its text
    hits = scene.intersect(origins, directions)        # .t .position .normal .label ...
    pcsg.render(scene, size=(640, 480)).save("tree.png")

Scenes: `load`, `loads`, `Scene`. What rays meet: `Hits`, `Crossings`, `Spans`. Pictures: `render`,
`Image`, and in notebooks `show`. Canopies: `light`, `lidar`. Graphs built in Python: `S` modules,
`C` calculations, `P` parameters, `define`, `if_`, `and_`, `or_`, `not_`, `call`; every primitive,
transformation and attribute of the language is a function here: ``sphere()``, ``move(0, 0, 1)``,
``color(1, 0, 0)``; `scatter` places copies by a table; `tree` and its parts grow.
Errors: all are `PcsgError`.

``help(pcsg.Scene)`` and ``help(pcsg.render)`` tell more; docs/python.md has examples.

Names are loaded on first use, so that ``import pcsg`` is instant.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from pcsg.errors import (
        EnvironmentFault,
        EvaluationFault,
        GrammarError,
        PcsgError,
        UsageError,
    )
    from pcsg.graph.build import C, S, define
    from pcsg.graph.expr import P, and_, call, if_, not_, or_
    from pcsg.graph.graph import Graph
    from pcsg.graph.leaves import Leaves
    from pcsg.growth.leaf import tree, tree_leaves, tree_wood
    from pcsg.render import Image, render
    from pcsg.scene import Scene, load, loads
    from pcsg.trace.hits import Crossings, Hits, Spans
    from pcsg.view.notebook import show

_HOMES = {
    "C": "pcsg.graph.build",
    "Crossings": "pcsg.trace.hits",
    "EnvironmentFault": "pcsg.errors",
    "EvaluationFault": "pcsg.errors",
    "GrammarError": "pcsg.errors",
    "Graph": "pcsg.graph.graph",
    "Hits": "pcsg.trace.hits",
    "Image": "pcsg.render",
    "Leaves": "pcsg.graph.leaves",
    "P": "pcsg.graph.expr",
    "PcsgError": "pcsg.errors",
    "S": "pcsg.graph.build",
    "Scene": "pcsg.scene",
    "Spans": "pcsg.trace.hits",
    "UsageError": "pcsg.errors",
    "and_": "pcsg.graph.expr",
    "call": "pcsg.graph.expr",
    "define": "pcsg.graph.build",
    "if_": "pcsg.graph.expr",
    "load": "pcsg.scene",
    "loads": "pcsg.scene",
    "not_": "pcsg.graph.expr",
    "or_": "pcsg.graph.expr",
    "render": "pcsg.render",
    "show": "pcsg.view.notebook",
    "tree": "pcsg.growth.leaf",
    "tree_leaves": "pcsg.growth.leaf",
    "tree_wood": "pcsg.growth.leaf",
}

__all__ = [
    "C",
    "Crossings",
    "EnvironmentFault",
    "EvaluationFault",
    "GrammarError",
    "Graph",
    "Hits",
    "Image",
    "Leaves",
    "P",
    "PcsgError",
    "S",
    "Scene",
    "Spans",
    "UsageError",
    "and_",
    "call",
    "define",
    "if_",
    "load",
    "loads",
    "not_",
    "or_",
    "render",
    "show",
    "tree",
    "tree_leaves",
    "tree_wood",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    if name in ("light", "lidar"):
        return import_module(f"pcsg.{name}")
    # `from pcsg import errors` asks for a module first as if it were a name.
    if not name.startswith("_") and find_spec(f"pcsg.{name}") is None:
        constructors = import_module("pcsg.graph.build").CONSTRUCTORS
        if name in constructors:
            return constructors[name]
    raise AttributeError(f"module 'pcsg' has no attribute '{name}'")


def __dir__() -> list[str]:
    constructors = import_module("pcsg.graph.build").CONSTRUCTORS
    return sorted({*globals(), *__all__, *constructors})
