"""Which pixels of a picture get more samples, in batches of fixed composition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pcsg.render.tracer import Bools, Ints

BATCH = 1 << 14
"""Camera rays per batch."""


@dataclass(frozen=True)
class Pass:
    """Which pixels get more samples, and how far that is.

    Attributes
    ----------
    taken, level
        Numbers of samples before and after.
    pixels
        (P,) positions in the film; `batch` parts them always in the same way.
    done
        (B,) which batches are done.
    """

    taken: int
    level: int
    pixels: Ints
    done: Bools

    @classmethod
    def of(cls, taken: int, level: int, pixels: Ints) -> Pass:
        """Return a pass that has not begun."""
        step = cls._step(taken, level)
        return cls(taken, level, pixels, np.zeros(-(-len(pixels) // step), dtype=bool))

    @staticmethod
    def _step(taken: int, level: int) -> int:
        return max(1, BATCH // (level - taken))

    @property
    def pixels_left(self) -> int:
        """How many pixels are not done."""
        step = self._step(self.taken, self.level)
        return min(int((~self.done).sum()) * step, len(self.pixels))

    def batch(self, number: int) -> Ints:
        """Return the pixels of a batch."""
        step = self._step(self.taken, self.level)
        return self.pixels[number * step : (number + 1) * step]
