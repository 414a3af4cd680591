"""``pcsg warmup``: compile every kernel, so that no picture waits for it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator

import typer

_GRAMMAR = "sphere \\ uscale(0.5) box"


def _kernels() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what every entry is for, and what makes it compile."""
    import numpy as np

    import pcsg
    from pcsg.render.textures import evaluate

    states = pcsg.loads(_GRAMMAR, engine="states", threads=1)
    walked = pcsg.loads(_GRAMMAR, engine="cyclic", threads=1)
    rays = np.array([(0.0, 0.0, -5.0)]), np.array([(0.0, 0.0, 1.0)])
    yield "rays through states", lambda: states.intersect(*rays)
    yield "surface coordinates", lambda: states.intersect(*rays).uv
    yield "rays through the graph itself", lambda: walked.intersect(*rays)
    yield "textures", lambda: evaluate(np.zeros(1, np.int64), np.zeros((1, 3)), np.zeros(1))


def run(as_json: bool) -> None:
    """Compile and tell how long it took."""
    took: dict[str, float] = {}
    for name, compile_now in _kernels():
        begin = time.perf_counter()
        compile_now()
        took[name] = round(time.perf_counter() - begin, 2)
        if not as_json:
            typer.echo(f"{name:30} {took[name]:6.2f} s")
    if as_json:
        typer.echo(json.dumps(took))
