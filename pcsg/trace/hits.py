"""What a batch of rays is answered with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Hits:
    """First crossings of N rays.

    Attributes
    ----------
    t : float64 (N,)
        Infinite where missed.
    position, normal : float64 (N, 3)
        World coordinates; normals are unit and outward (of sheets: by the order of the vertices).
        Zero where missed.
    uv : float64 (N, 2)
        Surface coordinates of the leaf.
    other_uv : float64 (N, 2, 3)
        Those of two parts that blend with the first, and their shares: 0 for all leaves but blobs.
    leaf : int64 (N,)
        Number of the leaf node in the graph, -1 where missed.
    label, material, texture : int64 (N,)
        -1 where none is set. Materials and textures count in the order of the settings.
    color : float64 (N, 3)
        -1 where none is set.
    texture_scale : float64 (N,)
        Second argument of `texture`.
    """

    t: NDArray[np.float64]
    position: NDArray[np.float64]
    normal: NDArray[np.float64]
    uv: NDArray[np.float64]
    other_uv: NDArray[np.float64]
    leaf: NDArray[np.int64]
    label: NDArray[np.int64]
    color: NDArray[np.float64]
    material: NDArray[np.int64]
    texture: NDArray[np.int64]
    texture_scale: NDArray[np.float64]

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Which rays hit, bool (N,)."""
        return self.leaf >= 0

    def columns(self) -> dict[str, Any]:
        """Return all fields by their names."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def take(self, rows: NDArray[np.int64]) -> Hits:
        """Return some of the hits."""
        return Hits(**{f.name: getattr(self, f.name)[rows] for f in fields(Hits)})

    def replaced(self, **values: Any) -> Hits:
        """Return the same hits with other values of some fields."""
        return Hits(**(self.columns() | values))

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True)
class Spans:
    """Inside intervals of N rays; those of ray i are ``[offsets[i], offsets[i + 1])``.

    Attributes
    ----------
    offsets : int64 (N + 1,)
    t_in, t_out : float64 (offsets[-1],)
        Where a ray enters and leaves; equal for a sheet, infinite for unbounded solids.
    leaf_in, leaf_out : int64 (offsets[-1],)
        Numbers of the leaf nodes whose surfaces it passes there.
    label_in, label_out : int64 (offsets[-1],)
        Their labels as the grammar sets them, -1 where none is set.
    """

    offsets: NDArray[np.int64]
    t_in: NDArray[np.float64]
    t_out: NDArray[np.float64]
    leaf_in: NDArray[np.int64]
    leaf_out: NDArray[np.int64]
    label_in: NDArray[np.int64]
    label_out: NDArray[np.int64]


class RaySpans(NamedTuple):
    """Inside intervals of some rays: which ray, and the columns of `Spans`."""

    ray: NDArray[np.int64]
    t_in: NDArray[np.float64]
    t_out: NDArray[np.float64]
    leaf_in: NDArray[np.int64]
    leaf_out: NDArray[np.int64]
    label_in: NDArray[np.int64]
    label_out: NDArray[np.int64]


def join_spans(n: int, parts: Iterable[Sequence[RaySpans]]) -> Spans:
    """Return the intervals of n rays in their order; those of one ray are in order already."""
    columns = [np.concatenate(c) for c in zip(*(p for part in parts for p in part), strict=True)]
    if not columns:
        columns = [np.zeros(0, np.int64), *np.zeros((2, 0)), *np.zeros((4, 0), np.int64)]
    order = np.argsort(columns[0], kind="stable")
    counts = np.bincount(columns[0], minlength=n)
    return Spans(np.concatenate([[0], np.cumsum(counts)]), *(c[order] for c in columns[1:]))


@dataclass(frozen=True)
class Crossings(Hits):
    """All crossings of N rays, in order; those of ray i are ``[offsets[i], offsets[i + 1])``.

    Attributes
    ----------
    offsets : int64 (N + 1,)
    ray : int64 (K,)
        Which ray crosses.
    entering : bool (K,)
        Whether it enters a solid there. False where it leaves one, and for sheets.
    sheet : bool (K,)
        Whether it passes a sheet, which has no inside.

    The other columns are those of `Hits`, one row for each crossing.
    """

    offsets: NDArray[np.int64]
    ray: NDArray[np.int64]
    entering: NDArray[np.bool_]
    sheet: NDArray[np.bool_]

    def replaced(self, **values: Any) -> Crossings:
        """Return the same crossings with other values of some columns."""
        return Crossings(**(self.columns() | values))
