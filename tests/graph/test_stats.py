from __future__ import annotations

import json

from analysis_graphs import terrain
from paper_graphs import prefix, sierpinski, sphere

from pcsg.graph.graph import Graph
from pcsg.graph.stats import graph_stats


def test_sierpinski() -> None:
    found = graph_stats(sierpinski(40), nbytes={"tables": 123})
    assert found["nodes"] == {
        "total": 13,
        "calculation": 2,
        "leaf": 1,
        "operation": 1,
        "selection": 1,
        "transformation": 8,
    }
    assert found["edges"] == 16
    assert found["parameters"] == ["c"]
    assert found["states"] == 41
    assert found["primitives"] == 4**40
    assert found["boxes"] == "exact"
    assert found["bytes"] == {"boxes": 13 * 48, "tables": 123}
    assert json.loads(json.dumps(found)) == found


def test_too_many_states_are_none() -> None:
    found = graph_stats(terrain(12))
    assert (found["states"], found["primitives"]) == (None, 2 * 4**12)
    assert found["boxes"] == "interval"


def test_infinite_and_empty_bounds_can_be_written_as_json() -> None:
    ground = graph_stats(Graph(prefix("halfspace")() | sphere()))
    assert ground["bounds"][0] == [None, None, None]
    assert ground["scene_bounds"][0][0] < -0.99
    assert graph_stats(Graph(prefix("empty")()))["bounds"] is None
