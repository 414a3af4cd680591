"""What the engine of states finds, and hits whose surface is worked out when it is asked for."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_attributes, leaf_other_uv, leaf_uv
from pcsg.leaf.registry import LEAVES, Pool, Solid
from pcsg.trace.blocks import Blocks, find_nodes
from pcsg.trace.hits import Hits
from pcsg.trace.surface import MOST
from pcsg.vec import Vec3


class Found(NamedTuple):
    """What a kernel writes of N rays.

    Attributes
    ----------
    t : float64 (N,)
        Infinite where missed.
    record : int32 (N,)
        Number of the leaf record in the blocks, -1 where missed.
    position, normal : float64 (N, 3)
        World coordinates; unit and outward. Zero where missed.
    local : float64 (N, 3)
        The place in the leaf's frame; zero where missed.
    leaves, args, attributes
        Where states are suspended, the leaf records of the hits, as in `Blocks`: each has its own.
        Else empty.
    """

    t: NDArray[np.float64]
    record: NDArray[np.int32]
    position: NDArray[np.float64]
    normal: NDArray[np.float64]
    local: NDArray[np.float64]
    leaves: NDArray[np.int32]
    args: NDArray[np.float64]
    attributes: NDArray[np.float64]


_NO_LEAVES, _NO_NUMBERS = np.zeros(0, np.int32), np.zeros(0)


class LeafRecords(NamedTuple):
    """The leaf records that hits refer to, as in `Blocks`."""

    leaves: NDArray[np.int32]
    args: NDArray[np.float64]
    attributes: NDArray[np.float64]


def records_of(found: Found, blocks: Blocks) -> LeafRecords:
    """Return the leaf records of what was found in blocks."""
    if len(found.leaves) == 0:
        return LeafRecords(blocks.leaves, blocks.args, blocks.attributes)
    return LeafRecords(found.leaves, found.args, found.attributes)


def make_found(n: int, args: int = 0) -> Found:
    """Return room for what is found of n rays; the kernel writes all of it.

    Parameters
    ----------
    args
        Most arguments of a leaf, where hits have leaf records of their own.
    """
    # One piece: the system hands it out in large pages, ten times as fast as many small ones.
    room = np.empty(11 * n)
    t, record = room[:n], room[n : 2 * n].view(np.int32)[:n]
    position, normal, local = (room[k * n : (k + 3) * n].reshape(n, 3) for k in (2, 5, 8))
    if args == 0:
        none = _NO_LEAVES, _NO_NUMBERS, _NO_NUMBERS
        return Found(t, record, position, normal, local, *none)
    attributes = np.zeros(len(ATTRIBUTE_DEFAULTS) * (n + 1))
    attributes[-len(ATTRIBUTE_DEFAULTS) :] = ATTRIBUTE_DEFAULTS
    leaves = np.zeros(4 * n, np.int32)
    return Found(t, record, position, normal, local, leaves, np.zeros(args * n), attributes)


UV, OTHER_UV, OWN = range(3)
"""What leaves can be asked about a place: (u, v), `Solid.other_uv`, `Solid.attributes`."""


@njit(entry=True)
def ask_leaves(
    asked: int,
    leaves: NDArray[np.int32],
    args: NDArray[np.float64],
    pool: Pool,
    record: NDArray[np.int32],
    local: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Write what leaves answer about the places of hits; rows of misses stay.

    Parameters
    ----------
    leaves, args
        As in `Trees`.
    record, local
        As in `Found`.
    out : float64 (N, 2), (N, 6) or (N, 4)
    """
    for i in range(len(record)):
        if record[i] < 0:
            continue
        leaf = 4 * record[i]
        kind, at = leaves[leaf], leaves[leaf + 1]
        p = Vec3(local[i, 0], local[i, 1], local[i, 2])
        if asked == UV:
            out[i, 0], out[i, 1] = leaf_uv(kind, p, args, at, pool)
        elif asked == OTHER_UV:
            others = leaf_other_uv(kind, p, args, at, pool)
            for k in range(6):
                out[i, k] = others[k]
        else:
            own = leaf_attributes(kind, p, args, at, pool)
            for k in range(4):
                out[i, k] = own[k]


class FoundHits(Hits):
    """First crossings that are looked up in the leaf records when somebody asks.

    Parameters
    ----------
    found
        What the kernel wrote.
    blocks, pool
        What was traced.
    """

    def __init__(self, found: Found, blocks: Blocks, pool: Pool) -> None:
        self._found: Found
        self._records: LeafRecords
        self._pool: Pool
        self._walked: tuple[NDArray[np.int64], Hits] | None
        # The fields of hits are frozen.
        vars(self).update(t=found.t, position=found.position, normal=found.normal)
        records = records_of(found, blocks)
        vars(self).update(_found=found, _records=records, _pool=pool, _walked=None)

    def replace(self, at: NDArray[np.int64], hits: Hits) -> None:
        """Take some of the hits from elsewhere; once, before anybody asks."""
        found = self._found
        found.t[at], found.position[at], found.normal[at] = hits.t, hits.position, hits.normal
        vars(self).update(_walked=(at, hits))

    def take(self, rows: NDArray[np.int64]) -> Hits:
        """Return some of the hits, still to be looked up."""
        if self._walked is not None:
            return super().take(rows)
        found = self._found
        some = found._replace(
            t=found.t[rows],
            record=found.record[rows],
            position=found.position[rows],
            normal=found.normal[rows],
            local=found.local[rows],
        )
        taken = object.__new__(FoundHits)
        vars(taken).update(t=some.t, position=some.position, normal=some.normal)
        vars(taken).update(_found=some, _records=self._records, _pool=self._pool, _walked=None)
        return taken

    def _complete(self, name: str, values: Any) -> Any:
        """Put in what comes from elsewhere."""
        if self._walked is not None:
            at, hits = self._walked
            values[at] = getattr(hits, name)
        return values

    def _attribute(self, slots: int | slice, kind: type) -> Any:
        # The last row is for misses, whose record is -1.
        table = self._records.attributes.reshape(-1, len(ATTRIBUTE_DEFAULTS))[:, slots]
        table = np.clip(table, -MOST, MOST) if kind is np.int64 else table
        return table.astype(kind)[self._found.record]

    def _any_leaf_has(self, kernel: str) -> bool:
        solids = tuple(LEAVES.values())
        kinds = np.flatnonzero(np.bincount(self._records.leaves[::4]))
        default = getattr(Solid, kernel)
        return any(getattr(solids[kind], kernel) is not default for kind in kinds)

    def _ask_leaves(self, asked: int, out: NDArray[np.float64]) -> NDArray[np.float64]:
        found, records = self._found, self._records
        arrays = records.leaves, records.args, self._pool, found.record, found.local
        ask_leaves(asked, *arrays, out)
        return out

    @cached_property
    def _own(self) -> Any:
        """Colours and labels of the leaves' own, None where no leaf has any."""
        if not self._any_leaf_has("attributes"):
            return None
        return self._ask_leaves(OWN, np.full((len(self.t), 4), -1.0))

    @cached_property
    def leaf(self) -> Any:
        """Numbers of the leaf nodes."""
        return self._complete("leaf", find_nodes(self._records.leaves, self._found.record))

    @cached_property
    def uv(self) -> Any:
        """Surface coordinates."""
        return self._complete("uv", self._ask_leaves(UV, np.zeros((len(self.t), 2))))

    @cached_property
    def other_uv(self) -> Any:
        """Surface coordinates of two more parts, and their shares."""
        others = np.zeros((len(self.t), 6))
        if self._any_leaf_has("other_uv"):
            self._ask_leaves(OTHER_UV, others)
        return self._complete("other_uv", others.reshape(-1, 2, 3))

    @cached_property
    def color(self) -> Any:
        """Colors."""
        color = self._attribute(slice(0, 3), np.float64)
        if self._own is not None:
            color = np.where(self._own[:, :3] >= 0.0, self._own[:, :3], color)
        return self._complete("color", color)

    @cached_property
    def material(self) -> Any:
        """Numbers of the materials."""
        return self._complete("material", self._attribute(3, np.int64))

    @cached_property
    def texture(self) -> Any:
        """Numbers of the textures."""
        return self._complete("texture", self._attribute(4, np.int64))

    @cached_property
    def texture_scale(self) -> Any:
        """Second arguments of `texture`."""
        return self._complete("texture_scale", self._attribute(5, np.float64))

    @cached_property
    def label(self) -> Any:
        """Labels."""
        label = self._attribute(6, np.int64)
        if self._own is not None:
            label = np.where(self._own[:, 3] >= 0.0, self._own[:, 3].astype(np.int64), label)
        return self._complete("label", label)
