"""Python's collector of cycles, which large graphs keep busy for nothing."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Keep the collector away; it would walk what grows again and again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextmanager
def kept_for_good() -> Iterator[None]:
    """Keep the collector away, and for ever from what is there at the end.

    For a process that reads one file: what stands in memory then stays there until it ends, and
    the collector would walk all of it again and again, the last time at the very end.
    """
    with collector_at_rest():
        try:
            yield
        finally:
            gc.freeze()
