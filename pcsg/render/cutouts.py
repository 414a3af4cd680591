"""Cut-outs: surfaces that are not there where their material says so.

A leaf is a card with a picture of a leaf; rays go through the card beside it. That is known to the
tracer, so that it holds for rays of all kinds, in every mode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.render.pictures import Pixels, read_opacity
from pcsg.render.textures import IMAGE, Textures
from pcsg.render.tracer import Bools, Floats, Ints, Tracer, WideTracer
from pcsg.trace.coverage import Footprint
from pcsg.trace.hits import Hits

MOST_LAYERS = 256
"""Surfaces that a ray goes through; the next one stops it."""

STEP = 1e-9
"""By which a ray goes on behind a surface, relative to its place and distance."""


class Cutouts:
    """How much of their surface materials have.

    Parameters
    ----------
    several
        Settings ``material NAME {}`` in the order of the text.
    numbers
        Number of every texture.
    textures
        The textures.
    written
        Settings ``texture NAME {}``.
    """

    def __init__(
        self,
        several: Sequence[Mapping[str, Any]],
        numbers: Mapping[str, int],
        textures: Textures,
        written: Sequence[Mapping[str, Any]],
    ) -> None:
        # The last one is the default, which number -1 finds.
        self._opacity = np.array([*(row["opacity"] for row in several), 1.0])
        names = [row["cutout"] for row in several]
        self._texture = np.array([-1 if n is None else numbers[n] for n in names] + [-1])
        pictures: dict[int, Pixels] = {
            k: np.repeat(read_opacity(Path(written[k]["file"]))[..., None], 3, axis=2)
            for k in set(self._texture.tolist())
            if k >= 0 and textures.kind[k] == IMAGE
        }
        self._textures = replace(textures, pictures=pictures)
        self._cut = (self._opacity < 1.0) | (self._texture >= 0)

    @property
    def exist(self) -> bool:
        """Whether there are any."""
        return bool(self._cut.any())

    def are_gone(self, hits: Hits, origins: Floats, directions: Floats) -> Bools:
        """Return (N,) which hits are not there.

        Where a surface is there in part, a number at random that belongs to the ray decides.
        """
        gone = np.zeros(len(hits.t), dtype=bool)
        rows = np.flatnonzero(np.isfinite(hits.t) & self._cut[hits.material])
        if len(rows) == 0:
            return gone
        material = hits.material[rows]
        there = self._opacity[material]
        texture = self._texture[material]
        drawn = np.flatnonzero(texture >= 0)
        if len(drawn):
            there[drawn] *= self._shares(hits, rows[drawn], texture[drawn])
        gone[rows] = _chance(hits.position[rows], directions[rows]) >= there
        return gone

    def _shares(self, hits: Hits, rows: Ints, texture: Ints) -> Floats:
        """Return how much is there of a surface, by its texture."""
        position, uv, size = hits.position[rows], hits.uv[rows], hits.texture_scale[rows]
        found = 1.0 - self._textures.amounts(texture, position, uv, size)
        for number in self._textures.pictures:
            some = np.flatnonzero(texture == number)
            if len(some):
                found[some] = self._textures.look_up(number, uv[some], size[some])[:, 0]
        return found


def _chance(position: Floats, directions: Floats) -> Floats:
    """Return (N,) numbers in [0, 1) that look random and belong to the places of rays."""
    mixed = np.zeros(len(position), dtype=np.uint64)
    for column in (*position.T, *directions.T):
        mixed ^= np.ascontiguousarray(column).view(np.uint64)
        mixed ^= mixed >> np.uint64(32)
        mixed *= np.uint64(0xD6E8FEB86659FD93)
        mixed ^= mixed >> np.uint64(32)
    return np.asarray((mixed >> np.uint64(11)) * 2.0**-53)


class CutTracer:
    """A tracer whose rays go through what is cut out.

    Parameters
    ----------
    inner
        Finds surfaces.
    cutouts
        Says where they are not there.
    """

    takes_footprints = True

    def __init__(self, inner: Tracer | WideTracer, cutouts: Cutouts) -> None:
        self.inner: Any = inner
        self.cutouts = cutouts
        self._wide = isinstance(inner, WideTracer)

    def _meet(
        self,
        origins: Floats,
        directions: Floats,
        t_min: float | Floats,
        t_max: float | Floats,
        footprint: Footprint | None,
    ) -> Hits:
        if footprint is None or not self._wide:
            found: Hits = self.inner.intersect(origins, directions, t_min, t_max)
        else:
            found = self.inner.intersect(origins, directions, t_min, t_max, footprint)
        return found

    def intersect(
        self,
        origins: Floats,
        directions: Floats,
        t_min: float | Floats,
        t_max: float | Floats,
        footprint: Footprint | None = None,
    ) -> Hits:
        """Return the first crossings in the closed ranges."""
        hits = self._meet(origins, directions, t_min, t_max, footprint)
        rows = np.flatnonzero(self.cutouts.are_gone(hits, origins, directions))
        if len(rows) == 0:
            return hits
        low = np.array(np.broadcast_to(t_min, len(hits.t)), dtype=float)
        high = np.broadcast_to(t_max, len(hits.t))
        t = hits.t[rows]
        for _ in range(MOST_LAYERS):
            scale = np.maximum(np.abs(origins[rows]).max(axis=1), t)
            low[rows] = t + STEP * scale
            beyond = low[rows] > high[rows]
            low[rows] = np.minimum(low[rows], high[rows])
            wide = None if footprint is None else Footprint(*(width[rows] for width in footprint))
            some = self._meet(origins[rows], directions[rows], low[rows], high[rows], wide)
            gone = self.cutouts.are_gone(some, origins[rows], directions[rows]) & ~beyond
            rows, t = rows[gone], some.t[gone]
            if len(rows) == 0:
                break
        return self._meet(origins, directions, low, t_max, footprint)

    def occluded(
        self,
        origins: Floats,
        directions: Floats,
        t_min: float | Floats,
        t_max: float | Floats,
        footprint: Footprint | None = None,
    ) -> Bools:
        """Return whether anything lies in the closed ranges."""
        if len(origins) == 0:
            return np.zeros(0, dtype=bool)
        hits = self.intersect(origins, directions, t_min, t_max, footprint)
        return np.isfinite(hits.t)
