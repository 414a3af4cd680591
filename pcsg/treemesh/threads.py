"""Work divided over the processors.

Every piece writes to places of its own, so results do not depend on the number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

CHUNK = 2048
"""Items in a piece."""


@cache
def _pool() -> ThreadPoolExecutor:
    if hasattr(os, "sched_getaffinity"):
        n = len(os.sched_getaffinity(0))
    else:
        n = os.cpu_count() or 1
    return ThreadPoolExecutor(n, thread_name_prefix="treemesh")


def run_chunks(run: Callable[[int, int], None], n: int) -> None:
    """Call ``run(begin, end)`` for pieces of ``range(n)``; kernels release the GIL."""
    pieces = [(k, min(k + CHUNK, n)) for k in range(0, n, CHUNK)]
    if len(pieces) <= 1:
        for begin, end in pieces:
            run(begin, end)
        return
    for _ in _pool().map(lambda piece: run(*piece), pieces):
        pass
