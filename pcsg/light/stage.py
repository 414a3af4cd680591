"""A scene as light sees it: its cell, its soil, and where rays begin."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.errors import UsageError
from pcsg.trace.hits import Hits
from pcsg.trace.periodic import Cell, as_cell

if TYPE_CHECKING:
    from pcsg.scene import Scene

Floats = NDArray[np.float64]

BATCH = 1 << 16
"""Rays that are followed together, at most."""

BATCHES = 32
"""Batches at least: standard errors come from how they differ."""


class Stage:
    """What light passes through.

    Parameters
    ----------
    scene
        The scene.
    periodic
        A cell, or None for the scene alone.
    soil
        Height of the soil; None for the grammar's ``ground``, or else the lowest point.

    Raises
    ------
    UsageError
        The scene is empty.
    """

    def __init__(self, scene: Scene, periodic: ArrayLike | None, soil: float | None = None) -> None:
        self.scene = scene
        self.cell: Cell | None = None if periodic is None else as_cell(periodic)
        self.low, self.high = scene.bounds
        if not np.isfinite(scene.bounds).all():
            raise UsageError("the scene is empty, or has no bounded part")
        grounds = scene.setting_values("ground")
        written = grounds[0]["z"] if grounds else None
        heights = [z for z in (soil, written, float(self.low[2])) if z is not None]
        self.soil = float(heights[0])
        self.top = float(self.high[2])
        size = float(np.abs(scene.bounds).max()) + float((self.high - self.low).max())
        self.step = 1e-10 * size
        """How far a ray that leaves a surface is from it."""

    def launch(self, towards: Floats, u: Floats) -> tuple[Floats, Floats]:
        """Return origins above the scene of rays from given directions, and areas.

        Parameters
        ----------
        towards : float64 (N, 3)
            Where the light comes from.
        u : float64 (N, 2)
            Uniform in [0, 1).

        Returns
        -------
        origins : float64 (N, 3)
        areas : float64 (N,)
            Of the horizontal rectangles that the origins were drawn on.
        """
        z = self.top + 4.0 * self.step
        n = len(towards)
        if self.cell is not None:
            places = self.cell.corner + u * self.cell.sides
            return np.column_stack([places, np.full(n, z)]), np.full(n, self.cell.area)
        # The rectangle from which the box is met along the direction.
        slope = towards[:, :2] / np.maximum(towards[:, 2:], 1e-9)
        reach = slope * (z - min(self.soil, float(self.low[2])))
        low = self.low[:2] + np.minimum(reach, 0.0)
        high = self.high[:2] + np.maximum(reach, 0.0)
        places = low + u * (high - low)
        return np.column_stack([places, np.full(n, z)]), (high - low).prod(axis=1)

    def cast(self, origins: Floats, directions: Floats) -> tuple[Hits, NDArray[np.bool_], Floats]:
        """Find what rays meet first: a surface, the soil, or nothing.

        Returns
        -------
        hits
            Surfaces.
        on_soil : bool (N,)
        t : float64 (N,)
            Where the soil is met.
        """
        dz = directions[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.soil - origins[:, 2]) / dz
        down = (dz < 0.0) & (t > 0.0)
        limit = np.where(down, t, math.inf)
        cell = None if self.cell is None else np.array(self.cell)
        hits = self.scene.intersect(origins, directions, self.step, limit, periodic=cell)
        return hits, down & ~np.isfinite(hits.t), limit

    def is_free(self, origins: Floats, directions: Floats) -> NDArray[np.bool_]:
        """Find whether nothing stands between places and the sky."""
        cell = None if self.cell is None else np.array(self.cell)
        return ~self.scene.occluded(origins, directions, self.step, periodic=cell)

    def fold(self, points: Floats) -> Floats:
        """Return points moved into the cell."""
        if self.cell is not None:
            sides = self.cell.sides
            points[:, :2] -= np.floor((points[:, :2] - self.cell.corner) / sides) * sides
        return points

    def is_sheet(self, hits: Hits) -> NDArray[np.bool_]:
        """Return which hits are of sheets, bool (N,)."""
        return np.asarray(self.scene.sheets[np.maximum(hits.leaf, 0)])


def chance(*keys: int) -> np.random.Generator:
    """Return random numbers that belong to some whole numbers, of a generator that counts."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(keys)))


def batches(rays: int, seed: int) -> Iterator[tuple[int, np.random.Generator]]:
    """Yield sizes of batches, and chance that belongs to each: results do not depend on threads."""
    size = max(1, min(BATCH, -(-rays // BATCHES)))
    for k, begin in enumerate(range(0, rays, size)):
        count = min(size, rays - begin)
        yield count, chance(seed, k)
