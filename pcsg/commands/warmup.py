"""``pcsg warmup``: compile every kernel, so that no picture waits for it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from pcsg.commands.guard import show

if TYPE_CHECKING:
    from pcsg.scene import Scene

_GRAMMAR = "sphere \\ uscale(0.5) box"

_REPEATED = """
{n = 9} M
M 1 + (n > 0)
1: M -> sphere
2: M -> {n = n-1} uscale(0.5) (M | move(2,0,0) M | move(0,2,0) M | move(0,0,2) M)
"""
"""A grammar in which states stand in several places, so that recursion can end there."""

_MANY = """
{n = 12; s = SEED} M
M 1 + (n > 0)
1: M -> material(lamp) sphere
2: M -> {n = n-1} uscale(0.5) ({s = rand(s,1)} move(s,0,1) M | {s = rand(s,2)} move(0,s,-1) M)
material lamp { emission = (1, 1, 1) }
"""
"""A grammar of many states."""


def _kernels() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what every entry is for, and what makes it compile."""
    import numpy as np

    import pcsg
    from pcsg.render.textures import evaluate

    states = pcsg.loads(_GRAMMAR, engine="states", threads=1)
    repeated = pcsg.loads(_REPEATED, threads=1)
    many = pcsg.loads(_MANY, threads=1)
    lazy = pcsg.loads(_MANY, threads=1, block_memory=0)
    walked = pcsg.loads(_GRAMMAR, engine="cyclic", threads=1)
    rays = np.array([(0.0, 0.0, -5.0)]), np.array([(0.0, 0.0, 1.0)])
    yield "rays through states", lambda: states.intersect(*rays)
    yield "surface coordinates", lambda: states.intersect(*rays).uv
    yield "pictures", lambda: pcsg.render(states, size=(8, 8), samples=2)
    yield "recursion that ends", lambda: pcsg.render(repeated, size=(8, 8), samples=2)
    yield "many states", lambda: pcsg.render(many, size=(8, 8), samples=1)
    yield "what is asked about many states", lambda: _ask(many)
    yield "states on demand", lambda: pcsg.render(lazy, size=(8, 8), samples=1)
    yield "rays through the graph itself", lambda: walked.intersect(*rays)
    yield "textures", lambda: evaluate(np.zeros(1, np.int64), np.zeros((1, 3)), np.zeros(1))


def _ask(scene: Scene) -> None:
    """Ask for what is read from the states."""
    import numpy as np

    scene.stats()
    next(scene.leaves())
    scene.shining_covers(np.ones(1))


def run(as_json: bool) -> None:
    """Compile and tell how long it took."""
    took: dict[str, float] = {}
    for name, compile_now in _kernels():
        begin = time.perf_counter()
        compile_now()
        took[name] = round(time.perf_counter() - begin, 2)
        if not as_json:
            show(f"{name:30} {took[name]:6.2f} s")
    if as_json:
        show(json.dumps(took))
