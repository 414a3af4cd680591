"""What the axiom's block may ask for."""

from __future__ import annotations

import pytest

import pcsg


def test_the_axioms_block_may_ask_for_the_world() -> None:
    text = "{a = localz(1, 2, 3); b = worldx(4, 5, 6)} move(a, b, 0) A\n1: A -> sphere"
    for engine in ("states", "cyclic"):
        scene = pcsg.loads(text, engine=engine)  # type: ignore[arg-type]
        assert scene.parameters["a"] == 3.0
        assert scene.intersect([[3, 4, 5]], [[0, 0, -1]]).t[0] == pytest.approx(4.0)
