"""A flattened field: the arrays that kernels read, and what users ask."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.blobtree.bvh import build_hierarchy
from pcsg.blobtree.fields import T
from pcsg.blobtree.flatten import Flattener
from pcsg.blobtree.layout import (
    ABOUT,
    ATTRIBUTES_AT,
    CHAIN,
    CONSTANT,
    COUNT,
    FLOATS,
    FULL_ROW,
    HEADER,
    NODES,
    NODES_AT,
    OPERATORS,
    OPERATORS_AT,
    PARENT,
    PRIMITIVE,
    ROW,
    SLIM,
    SLIM_ROW,
    UV_AT,
    Pool,
)
from pcsg.blobtree.native import (
    CROSSINGS,
    DESCRIPTION,
    FIELD,
    GRADIENT,
    MOST,
    address,
    ask_batch,
)
from pcsg.blobtree.nodes import Field
from pcsg.blobtree.points import (
    ATTRIBUTE_COLUMNS,
    BOUND,
    MODEL_SLOTS,
    OTHERS,
    U,
    V,
)
from pcsg.blobtree.skeletons import SKELETONS
from pcsg.blobtree.trace import ALL, ANY, FIRST
from pcsg.errors import EnvironmentFault

Array = NDArray[np.float64]


class Model:
    """A field, flattened; immutable.

    Parameters
    ----------
    root
        The expression.

    Attributes
    ----------
    primitives, operators
        Their numbers; operators that merely group do not count.
    pool
        The three arrays, float64, float32, int32.
    bounds : float64 (2, 3)
        A box that contains the solid.
    """

    def __init__(self, root: Field) -> None:
        flat = Flattener(root)
        n = flat.count
        self.primitives = n
        kinds = [operator.blend.name for operator in flat.operators]
        self.operators = 1 + len(kinds) - kinds.count("sum")
        lower = np.concatenate([s.lower for s in flat.segments] or [np.zeros((0, 3))])
        upper = np.concatenate([s.upper for s in flat.segments] or [np.zeros((0, 3))])
        box = (lower.min(axis=0), upper.max(axis=0)) if n else (np.zeros(3), np.zeros(3))
        boxes, codes = build_hierarchy(np.concatenate([lower, upper], axis=1))
        # float64: header, operators' numbers and chains, attributes, rows.
        extra = np.array([*(0.5 * (box[0] + box[1])), 0.5 * float(np.linalg.norm(box[1] - box[0]))])
        operators_numbers = np.array(flat.floats, np.float64)
        attributes = np.array(flat.attribute_rows, np.float64).ravel()
        shift = FLOATS
        attributes_at = shift + len(operators_numbers)
        rows_at = attributes_at + len(attributes)
        widths = [(SLIM_ROW if s.about & SLIM else FULL_ROW) for s in flat.segments]
        rows, at = [], rows_at
        table = np.empty((n, PRIMITIVE), np.int32)
        k = 0
        chains_at = PRIMITIVE * n
        for segment, width in zip(flat.segments, widths, strict=True):
            m = len(segment.rows)
            block = np.asarray(segment.rows, np.float64).reshape(m, width)
            if width == FULL_ROW:
                block = block.copy()
                block[:, CHAIN] += np.where(block[:, CHAIN] >= 0.0, chains_at, 0.0)
                if (segment.about & (SLIM - 1)) == SKELETONS["polygon"].kind:
                    block[:, CONSTANT + 1] += shift
            table[k : k + m, ROW] = at + width * np.arange(m)
            table[k : k + m, PARENT] = segment.parent
            table[k : k + m, ABOUT] = segment.about
            rows.append(block.ravel())
            at, k = at + m * width, k + m
        ops = np.array([operator.row(shift) for operator in flat.operators], np.int32)
        chains = np.array(flat.chains, np.int32)
        _shift_chains(chains, shift)
        uv = np.concatenate([s.uv for s in flat.segments] or [np.zeros((0, 2), np.float32)])
        uv_at = boxes.size if np.any(uv) else -1
        header = np.zeros(HEADER, np.int32)
        header[COUNT], header[OPERATORS], header[NODES] = n, len(ops), len(codes)
        header[OPERATORS_AT] = HEADER + table.size + chains.size
        header[NODES_AT] = header[OPERATORS_AT] + ops.size
        header[UV_AT], header[ATTRIBUTES_AT] = uv_at, attributes_at
        self.pool: Pool = (
            np.concatenate([extra, operators_numbers, attributes, *rows]),
            np.concatenate([boxes.ravel(), uv.ravel() if uv_at >= 0 else uv.ravel()[:0]]),
            np.concatenate([header, table.ravel(), chains, ops.ravel(), codes]),
        )
        self.support = np.stack(box)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays in bytes."""
        return sum(a.nbytes for a in self.pool)

    @property
    def bounds(self) -> Array:
        """A box (2, 3) that contains the solid."""
        return self.support.copy()

    def field(self, points: ArrayLike) -> Array:
        """Return the field at points (N, 3); the solid is where it is 0.5 or more."""
        return self._ask(FIELD, points, 1)[:, 0]

    def gradient(self, points: ArrayLike) -> Array:
        """Return the gradient (N, 3) of the field at points (N, 3); it points inwards."""
        return self._ask(GRADIENT, points, 3)

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether points (N, 3) are in the solid."""
        inside: NDArray[np.bool_] = self.field(points) >= T
        return inside

    def attributes(self, points: ArrayLike) -> dict[str, Array]:
        """Return attributes of points (N, 3).

        Returns
        -------
        dict
            ``color`` (N, 3), mixed by what primitives contribute, and ``label`` (N,), the
            strongest primitive's, NaN where there is none; ``bound`` (N,), the share of bounded
            blends; ``uv`` (N, 2); ``other_uv`` (N, 2, 3), those of two more primitives and
            their shares, which fall; every other attribute by the name of its slot.
        """
        out = self._ask(DESCRIPTION, points, ATTRIBUTE_COLUMNS)
        named = {name: out[:, k] for k, name in enumerate(MODEL_SLOTS) if k >= 3}
        named["label"] = named.pop("@label")
        placed = {"uv": out[:, [U, V]], "other_uv": out[:, OTHERS:].reshape(-1, 2, 3)}
        return named | placed | {"color": out[:, :3], "bound": out[:, BOUND]}

    def _ask(self, asked: int, points: ArrayLike, columns: int) -> Array:
        where = np.asarray(points, np.float64).reshape(-1, 3)
        rays = np.zeros((len(where), 8))
        rays[:, :3] = where
        out = np.zeros(len(where) * columns)
        counts = np.zeros(len(where), np.int64)
        done, _used = ask_batch(
            address(), asked, 0, self.pool, rays, 0, len(where), columns, out, counts, 0
        )
        if done < len(where):
            raise EnvironmentFault(_CROWDED)
        return out.reshape(-1, columns)

    def shoot(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        want: int = ALL,
        t_min: float = 0.0,
        t_max: float = math.inf,
    ) -> tuple[NDArray[np.int64], Array]:
        """Return the crossings of rays.

        Parameters
        ----------
        origins, directions : array_like (N, 3)
            Directions of any length but zero; t counts in them.
        want
            `ALL` crossings of the whole line, alternately entering and leaving, or the `FIRST` in
            [t_min, t_max].

        Returns
        -------
        counts : int64 (N,)
        t : float64
            One ray's after the other's.
        """
        o = np.asarray(origins, np.float64).reshape(-1, 3)
        d = np.asarray(directions, np.float64).reshape(-1, 3)
        n = len(o)
        limits = np.broadcast_to(np.array([t_min, t_max]), (n, 2))
        rays = np.ascontiguousarray(np.concatenate([o, d, limits], axis=1))
        counts, t = np.zeros(n, np.int64), np.empty(4 * n + 64)
        done, used, seen = 0, 0, -1
        while done < n:
            done, used = ask_batch(
                address(), CROSSINGS, want, self.pool, rays, done, n, 0, t, counts, used
            )
            if done < n:
                if done == seen and len(t) - used > MOST:
                    raise EnvironmentFault(_CROWDED)
                seen = done
                t = np.concatenate([t, np.empty(len(t) + MOST)])
        return counts, t[:used]

    def intersect(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: float = 0.0,
        t_max: float = math.inf,
    ) -> Array:
        """Return the first crossing of every ray in [t_min, t_max], infinite if there is none."""
        counts, t = self.shoot(origins, directions, FIRST, t_min, t_max)
        out = np.full(len(counts), math.inf)
        out[counts > 0] = t
        return out

    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: float = 0.0,
        t_max: float = math.inf,
    ) -> NDArray[np.bool_]:
        """Return whether every ray crosses the surface in [t_min, t_max]."""
        counts, _t = self.shoot(origins, directions, ANY, t_min, t_max)
        hit: NDArray[np.bool_] = counts > 0
        return hit


_CROWDED = f"a ray crosses more than {MOST} fields"


def _shift_chains(chains: NDArray[np.int32], shift: int) -> None:
    """Count the numbers of warps from the beginning of the floats, in place."""
    at = 0
    while at < len(chains):
        count = int(chains[at])
        chains[at + 2 : at + 2 * count + 1 : 2] += shift
        at += 2 * count + 1
