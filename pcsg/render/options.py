"""How a picture is made: what can be asked for, and what is refused."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from pcsg.arguments import real, shown, whole
from pcsg.errors import EnvironmentFault, UsageError
from pcsg.memory import half_of_memory, show_bytes
from pcsg.render.film import BYTES_PER_PIXEL
from pcsg.render.sampler import MAX_SAMPLES
from pcsg.render.stage import Overrides


@dataclass(frozen=True)
class Options:
    """How a picture is made.

    Attributes
    ----------
    size
        Width and height in pixels.
    samples
        Largest number of samples per pixel.
    seed
        Of the sampling; any integer.
    threads
        How many; None for one per processor.
    max_memory
        Bytes that the picture may take; None for half of the machine's.
    overrides
        Values in place of the grammar's settings, by kind and key.
    tile
        (i, n): only part i of n, counted from 1, of the picture's rows. None for all of it.
    detail
        Size in pixels below which refining stops; 0 never.
    """

    size: tuple[int, int] = (800, 600)
    samples: int = 16
    seed: int = 1
    threads: int | None = None
    max_memory: int | None = None
    overrides: Overrides = field(default_factory=dict)
    tile: tuple[int, int] | None = None
    detail: float = 0.5

    def validate(self) -> Options:
        """Return the options in their proper form, or raise an error if no picture is possible.

        Raises
        ------
        UsageError
            A number is out of range.
        EnvironmentFault
            The picture does not fit into memory.
        """
        if not isinstance(self.size, Sequence) or len(self.size) != 2:
            raise UsageError(f"the size is a pair of whole numbers, not {shown(self.size)}")
        width, height = (whole(side, "a side of the size", 1) for side in self.size)
        whole(self.samples, "samples", 1, MAX_SAMPLES)
        whole(self.seed, "seed", -(2**63), 2**64 - 1)
        if self.threads is not None:
            whole(self.threads, "threads", 1)
        if self.max_memory is not None:
            whole(self.max_memory, "max_memory", 0)
        real(self.detail, "detail", 0.0, 1000.0)
        if self.tile is not None:
            part, parts = self.tile
            if not 1 <= part <= parts <= height:
                raise UsageError(
                    f"a tile is i/n with i from 1 to n and n at most {height}, the rows of the"
                    f" picture, not {part}/{parts}"
                )
        first, last = self.film_rows
        needed = width * (last - first) * BYTES_PER_PIXEL
        limit = half_of_memory() if self.max_memory is None else self.max_memory
        if needed > limit:
            raise EnvironmentFault(
                f"a picture of {width}x{height} pixels needs {show_bytes(needed)} of memory, but"
                f" only {show_bytes(limit)} are allowed; a smaller --size or a larger --max-memory"
                " helps"
            )
        if max(self.size) > 1 << 20:
            raise UsageError(f"the size must be at most {1 << 20} pixels a side")
        return replace(self, size=(width, height), samples=int(self.samples), seed=int(self.seed))

    @property
    def rows(self) -> tuple[int, int]:
        """First row, and the one after the last, of what is asked for."""
        part, parts = self.tile or (1, 1)
        height = self.size[1]
        return height * (part - 1) // parts, height * part // parts

    @property
    def film_rows(self) -> tuple[int, int]:
        """The same with the rows beside it, on which it depends whether its pixels are finished.

        One row more is for bright samples, which count as far as their neighbours have some.
        """
        first, last = self.rows
        beside = len(self.levels) + 3
        return max(first - beside, 0), min(last + beside, self.size[1])

    @property
    def levels(self) -> list[int]:
        """Numbers of samples that the passes bring pixels to."""
        levels = [1]
        while levels[-1] < self.samples:
            levels.append(min(4 * levels[-1], self.samples))
        return levels


def processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
