"""Scenes that are dropped leave nothing behind."""

from __future__ import annotations

import gc
import weakref

import pcsg

TEXT = "{n = 3} A\nA if(n > 0, 2, 1)\n1: A -> box \\ sphere\n2: A -> {n=n-1} (move(2,0,0) A | cone)"


def use(number: int) -> list[weakref.ref[object]]:
    scene = pcsg.loads(TEXT, engine=("states", "cyclic")[number % 2], SEED=number)  # type: ignore[arg-type]
    rays = [[5, 6, 7]] * 20, [[-1, -1, -1.1]] * 20
    scene.intersect(*rays)
    scene.intersect_all(*rays)
    scene.stats()
    pcsg.render(scene, size=(4, 3), samples=1)
    return [weakref.ref(x) for x in (scene, scene.graph, scene.states, scene.tracer)]


def test_scenes_made_and_dropped() -> None:
    for number in range(4):
        use(number)
    gc.collect()
    before = len(gc.get_objects())
    dropped = [ref for number in range(20) for ref in use(number)]
    gc.collect()
    assert all(ref() is None for ref in dropped)
    assert len(gc.get_objects()) - before < 20 * 20 + len(dropped)
