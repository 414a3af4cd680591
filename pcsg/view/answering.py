"""What stands at a point of a picture, in words."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.graph.derivation import find_derivation
from pcsg.graph.faults import format_path
from pcsg.graph.nodes import Leaf, Node
from pcsg.render.tracer import GROUND
from pcsg.vec import Vec3
from pcsg.view.opening import Prepared
from pcsg.view.wants import Question

THROUGH = 1e-6
"""Way through a surface, relative to the distance from the eye, by which its sides are found."""


def answers(prepared: Prepared, question: Question) -> Iterator[dict[str, Any]]:
    """Yield what a page shows of the point under a click: what is known at once, then all.

    Raises
    ------
    PcsgError
        The ray met a fault of the grammar.
    """
    stage = prepared.stage_for(question.want)
    width, height = question.want.size
    x, y = question.place
    at = np.array([x * width]), np.array([y * height])
    origins, directions = stage.camera.rays(*at, (width, height))
    # A pixel is what was seen: what ends below it in the picture ends here, too.
    seen = stage.seen_by(stage.camera, height, 0.5)
    hits = seen.tracer.intersect(origins, directions, 0.0, np.inf)
    if not np.isfinite(hits.t[0]):
        yield {"type": "answer", "hit": False}
        return
    found: dict[str, Any] = {
        "type": "answer",
        "hit": True,
        "position": hits.position[0].tolist(),
        "normal": hits.normal[0].tolist(),
        "distance": float(hits.t[0]),
        "label": int(hits.label[0]),
        "material": _material(prepared, int(hits.material[0])),
        "what": "the ground",
    }
    number = int(hits.leaf[0])
    if number == GROUND:
        yield found
        return
    node = prepared.scene.graph.nodes[number]
    assert isinstance(node, Leaf)
    found["what"] = node.solid.name
    found |= _place(node)
    yield {**found, "partial": True}
    point, normal = Vec3(*hits.position[0]), THROUGH * float(hits.t[0]) * hits.normal[0]
    derivation = find_derivation(
        prepared.scene.graph,
        prepared.scene.values,
        prepared.scene.boxes.boxes,
        number,
        point,
        Vec3(*normal),
    )
    if derivation is not None:
        found["derivation"] = format_path(derivation.path)
        found["values"] = dict(derivation.values)
    yield found


def _place(node: Node) -> dict[str, Any]:
    """Return where in the text a node is written."""
    span = node.span
    if span is None or not span.source.written:
        return {}
    while span.body is not None:
        span = span.body
    return {
        "file": Path(span.source.name).name,
        "line": span.line,
        "column": span.column,
        "source": span.source.line(span.line).strip()[:200],
    }


def _material(prepared: Prepared, number: int) -> str | None:
    materials = prepared.scene.setting_values("material")
    return materials[number]["name"] if 0 <= number < len(materials) else None
