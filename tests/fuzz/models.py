"""What subjects do with the file of a model: all that is done before rays are traced."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pcsg.grammar import check_file
from pcsg.graph.nodes import Leaf
from pcsg.scene import Scene, loads


def warm_up() -> None:
    """Load or compile the kernels that models need: that is no input's time."""
    loads('blob { point(1) + bend(20) cone(2, 0.3, 0.2) } | tree("populus", 2.6)').stats()


def look_at(path: Path) -> None:
    """Check a file, and make the scene that it stands for, with its models, boxes and tables."""
    graph, diagnostics = check_file(path)
    errors = [d for d in diagnostics if d.severity == "error"]
    assert (graph is None) == bool(errors)
    for d in diagnostics:
        assert d.render() and d.to_json()
    if graph is None:
        return
    scene = Scene(graph)
    assert not np.isnan(scene.bounds).any()
    assert any(isinstance(node, Leaf) for node in scene.graph.nodes)
    assert scene.stats()
