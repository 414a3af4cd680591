"""Periodic rays: the union of a scene's copies at all multiples of a cell, without copies.

A ray is cut at the borders of the cells that it passes. In each it meets the copies whose boxes
reach into the cell, so that crowns may overhang: the copies stay where the scene is, and the ray is
moved against them. Of unbounded solids each cell is taken to have the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array
from pcsg.errors import UsageError
from pcsg.trace.hits import Hits
from pcsg.trace.rays import Rays

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_CELLS = 10_000
"""Cells that a ray passes at most in either direction; it misses what is beyond them."""

FARTHEST = 1e12
"""Of a cell's corners: farther away places are too coarse to tell cells apart."""

MOST_COPIES = 100
"""Copies that reach into a cell, in either direction."""

BATCH = 1 << 17
"""Rays that are followed together."""


class Cell(NamedTuple):
    """A rectangle whose copies fill the plane.

    Attributes
    ----------
    xmin, ymin, xmax, ymax : float
        World coordinates.
    """

    xmin: float
    ymin: float
    xmax: float
    ymax: float

    @property
    def sides(self) -> Floats:
        """Its sides, float64 (2,)."""
        return np.array([self.xmax - self.xmin, self.ymax - self.ymin])

    @property
    def corner(self) -> Floats:
        """Its smallest corner, float64 (2,)."""
        return np.array([self.xmin, self.ymin])

    @property
    def area(self) -> float:
        """Its area."""
        return float(self.sides.prod())


def as_cell(value: ArrayLike) -> Cell:
    """Return a checked cell.

    Raises
    ------
    UsageError
        It is not (xmin, ymin, xmax, ymax).
    """
    numbers = array(value, "periodic")
    if numbers.shape != (4,) or not np.isfinite(numbers).all():
        raise UsageError("`periodic` is (xmin, ymin, xmax, ymax), four finite numbers")
    cell = Cell(*numbers.tolist())
    if np.abs(numbers).max() > FARTHEST:
        raise UsageError(f"`periodic` has numbers up to {FARTHEST:g}")
    if not (cell.xmin < cell.xmax and cell.ymin < cell.ymax):
        raise UsageError(f"the cell {tuple(numbers.tolist())} of `periodic` is empty")
    return cell


class _Segments(NamedTuple):
    """Parts of rays in one copy: which rays, where they begin and end, and how it is shifted."""

    ray: Integers
    t_min: Floats
    t_max: Floats
    shift: Floats


@dataclass
class _Axis:
    """Where rays are along x or y.

    Attributes
    ----------
    origin, direction, index, step : float64 (N,)
        Components of the rays, the cell that each is in, and how that changes: whole numbers.
    ahead : float64 (N,)
        Which border of its cell a ray comes to: 1 for the upper one.
    corner, side : float
        Of the cell.
    """

    origin: Floats
    direction: Floats
    index: Floats
    step: Floats
    ahead: Floats
    corner: float
    side: float

    def border(self) -> Floats:
        """Return where rays leave their cells."""
        t = (self.corner + (self.index + self.ahead) * self.side - self.origin) / self.direction
        t[self.step == 0.0] = math.inf
        return t

    def is_beside(
        self, shift: Floats, begin: Floats, end: Floats, low: float, high: float
    ) -> NDArray[np.bool_]:
        """Return which parts of rays pass beside a copy between low and high.

        Where a ray has no end that is no number, and it does not.
        """
        a = self.origin + begin * self.direction - shift
        b = self.origin + end * self.direction - shift
        slack = 1e-9 * (self.side + abs(low) + abs(high))
        lower, upper = low - slack, high + slack
        return ((a < lower) & (b < lower)) | ((a > upper) & (b > upper))

    def take(self, which: Integers) -> _Axis:
        """Return some of the rays."""
        return _Axis(
            self.origin[which],
            self.direction[which],
            self.index[which],
            self.step[which],
            self.ahead[which],
            self.corner,
            self.side,
        )


def _begin_axis(
    rays: Rays, which: Integers, t: Floats, k: int, corner: float, side: float
) -> _Axis:
    """Return where rays begin along an axis."""
    o, d = rays.origins[which, k], rays.directions[which, k]
    index = np.floor((o + t * d - corner) / side)
    step = np.sign(d)
    return _Axis(o, d, index, step, np.where(step > 0.0, 1.0, 0.0), corner, side)


class PeriodicScene:
    """Answers periodic rays.

    Parameters
    ----------
    cell
        Whose copies there are.
    bounds : float64 (2, 3)
        Corners of the box about the bounded parts of the scene.
    heights
        Between which z there is anything, -inf and inf where something is unbounded.
    """

    def __init__(self, cell: Cell, bounds: Floats, heights: tuple[float, float]) -> None:
        self._cell = cell
        self._low, self._high = bounds[0, :2], bounds[1, :2]
        self._heights = heights
        sides = cell.sides
        first = last = np.zeros(2)
        if np.isfinite(bounds).all():
            # Copies that reach into the cell, by how many cells they are shifted.
            with np.errstate(over="ignore"):
                first = np.floor((cell.corner - self._high) / sides) + 1.0
                last = np.ceil((cell.corner + sides - self._low) / sides) - 1.0
        if not (last - first < MOST_COPIES).all():
            raise UsageError("the scene is more than a hundred cells of `periodic` wide")
        self._offsets = tuple(
            first[k] + np.arange(max(1.0, last[k] - first[k] + 1.0)) for k in (0, 1)
        )

    def _walk(self, rays: Rays, best: Floats, done: NDArray[np.bool_]) -> Iterator[_Segments]:
        """Yield parts of rays in their order; who traces them keeps `best` and `done`."""
        cell, sides = self._cell, self._cell.sides
        n = len(rays.origins)
        with np.errstate(divide="ignore", invalid="ignore"):
            t_min, t_max = self._clip(rays, n)
            if (t_min == -math.inf).any():
                raise UsageError("a periodic ray begins somewhere: its t_min is finite")
            going = np.flatnonzero(t_min <= t_max)
            now, last = t_min[going], t_max[going]
            axes = [
                _begin_axis(rays, going, now, k, float(cell.corner[k]), float(sides[k]))
                for k in (0, 1)
            ]
            for _ in range(2 * MOST_CELLS):
                if not len(going):
                    return
                x, y = (axis.border() for axis in axes)
                border = np.minimum(x, y)
                end = np.minimum(border, last)
                part = self._meet(axes, going, now, np.minimum(end, best[going]))
                if len(part.ray):
                    yield part
                # What is found in a cell cannot be beaten farther on.
                left = np.flatnonzero((border < last) & ~done[going] & (best[going] > end))
                axes[0].index += np.where(x <= y, axes[0].step, 0.0)
                axes[1].index += np.where(x <= y, 0.0, axes[1].step)
                now = np.maximum(now, end)[left]
                going, last = going[left], last[left]
                axes = [axis.take(left) for axis in axes]

    def _clip(self, rays: Rays, n: int) -> tuple[Floats, Floats]:
        """Return where rays pass the heights between which there is anything."""
        z, dz = rays.origins[:, 2], rays.directions[:, 2]
        low, high = self._heights
        slack = 1e-9 * max(1.0, *(abs(h) for h in self._heights if math.isfinite(h)), 1.0)
        a, b = (low - slack - z) / dz, (high + slack - z) / dz
        inside = (z >= low - slack) & (z <= high + slack)
        level = dz == 0.0
        first = np.where(level, np.where(inside, -math.inf, math.inf), np.minimum(a, b))
        last = np.where(level, np.where(inside, math.inf, -math.inf), np.maximum(a, b))
        t_min = np.maximum(np.broadcast_to(rays.t_min, (n,)), first)
        t_max = np.minimum(np.broadcast_to(rays.t_max, (n,)), last)
        return t_min, t_max

    def _meet(self, axes: list[_Axis], ray: Integers, begin: Floats, end: Floats) -> _Segments:
        """Return the parts of rays in the copies that reach into their cells."""
        x, y = (
            [(axis.index + offset) * axis.side for offset in offsets]
            for axis, offsets in zip(axes, self._offsets, strict=True)
        )
        if len(x) == len(y) == 1:
            return _Segments(ray, begin, end, np.stack([x[0], y[0]], axis=-1))
        # The rectangle about a part of a ray, and whether it meets that of a copy.
        beside = [
            [axis.is_beside(shift, begin, end, low, high) for shift in shifts]
            for axis, shifts, low, high in zip(
                axes, (x, y), self._low.tolist(), self._high.tolist(), strict=True
            )
        ]
        rows, shifts = [], []
        for i, of_x in enumerate(beside[0]):
            for j, of_y in enumerate(beside[1]):
                which = np.flatnonzero(~(of_x | of_y))
                rows.append(which)
                shifts.append(np.stack([x[i][which], y[j][which]], axis=-1))
        which = np.concatenate(rows)
        return _Segments(ray[which], begin[which], end[which], np.concatenate(shifts))

    def intersect(self, rays: Rays, trace: Callable[..., Hits]) -> Hits:
        """Find the first crossing of every ray; `trace` answers rays without period."""
        n = len(rays.origins)
        best = np.full(n, math.inf)
        found = _Pieces(n)
        for begin in range(0, n, BATCH):
            rows = np.arange(begin, min(n, begin + BATCH))
            some = rays.take(rows)
            nearest = np.full(len(rows), math.inf)
            done = np.zeros(len(rows), np.bool_)
            for part in self._walk(some, nearest, done):
                hits = trace(_moved(some, part), some.directions[part.ray], part.t_min, part.t_max)
                np.minimum.at(nearest, part.ray, hits.t)
                closer = np.isfinite(hits.t) & (hits.t == nearest[part.ray])
                found.add(rows[part.ray], part.shift, hits, closer)
            best[rows] = nearest
        return found.join(best)

    def occluded(self, rays: Rays, trace: Callable[..., NDArray[np.bool_]]) -> NDArray[np.bool_]:
        """Find whether every ray crosses anything."""
        n = len(rays.origins)
        blocked = np.zeros(n, np.bool_)
        for begin in range(0, n, BATCH):
            rows = np.arange(begin, min(n, begin + BATCH))
            some = rays.take(rows)
            done = np.zeros(len(rows), np.bool_)
            for part in self._walk(some, np.full(len(rows), math.inf), done):
                hit = trace(_moved(some, part), some.directions[part.ray], part.t_min, part.t_max)
                done[part.ray[hit]] = True
            blocked[rows] = done
        return blocked


def _moved(rays: Rays, part: _Segments) -> Floats:
    """Return the origins of parts of rays as their copies see them."""
    origins = rays.origins[part.ray]
    origins[:, :2] -= part.shift
    return origins


class _Pieces:
    """Hits of parts of rays, put together when all are known."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._source = np.full(n, -1, np.int64)
        self._row = np.zeros(n, np.int64)
        self._shift = np.zeros((n, 2))
        self._parts: list[Hits] = []

    def add(self, rays: Integers, shift: Floats, hits: Hits, closer: NDArray[np.bool_]) -> None:
        """Take the hits that are closer than those before."""
        rows = np.flatnonzero(closer)
        if not len(rows):
            return
        self._source[rays[rows]] = len(self._parts)
        self._row[rays[rows]] = np.arange(len(rows))
        self._shift[rays[rows]] = shift[rows]
        self._parts.append(hits.take(rows))

    def join(self, t: Floats) -> Hits:
        """Return the hits of all rays; columns are gathered when they are asked for."""
        return PeriodicHits(self._parts, self._source, self._row, self._shift, t)


class PeriodicHits(Hits):
    """First crossings of periodic rays; positions are those of the copy that was met.

    Parameters
    ----------
    parts
        Hits of parts of rays.
    source, row : int64 (N,)
        Which of them has a ray's hit (-1: missed), and in which row.
    shift : float64 (N, 2)
        How far that copy stands from the scene.
    t : float64 (N,)
    """

    def __init__(
        self, parts: list[Hits], source: Integers, row: Integers, shift: Floats, t: Floats
    ) -> None:
        # The fields of hits are frozen.
        vars(self).update(t=t, shift=shift, _parts=parts, _source=source, _row=row)

    def _gather(self, name: str, missed: Any) -> Any:
        values = vars(self)
        out = np.array(missed)[None].repeat(len(values["t"]), axis=0)
        order = np.argsort(values["_source"], kind="stable")
        ends = np.searchsorted(values["_source"][order], np.arange(len(values["_parts"]) + 1))
        for k, part in enumerate(values["_parts"]):
            here = order[ends[k] : ends[k + 1]]
            if len(here):
                out[here] = getattr(part, name)[values["_row"][here]]
        values[name] = out
        return out

    def __getattr__(self, name: str) -> Any:
        if name == "position":
            position = self._gather("position", np.zeros(3))
            position[:, :2] += np.where(self._source[:, None] >= 0, self.shift, 0.0)
            return position
        if name in _MISSED:
            return self._gather(name, _MISSED[name])
        raise AttributeError(name)


_MISSED: dict[str, Any] = {
    "normal": np.zeros(3),
    "uv": np.zeros(2),
    "other_uv": np.zeros((2, 3)),
    "leaf": np.int64(-1),
    "label": np.int64(-1),
    "color": np.full(3, -1.0),
    "material": np.int64(-1),
    "texture": np.int64(-1),
    "texture_scale": np.float64(1.0),
}
