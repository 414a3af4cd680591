"""Integrals over all primitives of a scene from its states: counts, volumes, areas, points on them.

What a state holds is known once, however often it stands in the scene, so that sums over 10^12
leaves are sums over some thousands of states. Under similarities areas are exact; a map that
stretches changes an area by how the surface lies to it, so below such maps points are drawn in
proportion to a bound, and weighted by how much of it is there.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.nodes import Leaf
from pcsg.graph.operators import UNION
from pcsg.jit import njit
from pcsg.leaf.faces import Draw, Faces, draw_points, faces_of
from pcsg.trace.expand.expansion import Expansion
from pcsg.trace.expand.programs import L_ARGS, LEAF_FIELDS
from pcsg.trace.expand.table import LEAF, OPERATION, STATE, Table
from pcsg.trace.measures import Key, Measured, Quantity, Samples

Floats = NDArray[np.float64]

SAMPLES = 200_000
"""Points that an area is estimated with, where it is not exact."""

_SIMILAR = 1e-9
"""By how much the lengths of a similarity's axes may differ, relatively."""

_EXACT = 2.0**53
_LABEL = ATTRIBUTE_SLOTS.index("@label")


@njit(entry=True)
def pass_down(
    table: Table, order: NDArray[np.int32], factors: Floats, totals: Floats, n: int
) -> None:
    """Add up the products of factors along all ways from the axiom to every state.

    Parameters
    ----------
    order : int32 (N,)
        The states, each after those that it contains.
    factors : float64 (M,)
        Of every item.
    totals : float64 (N,)
        0, and 1 for the axiom.
    """
    for k in range(n - 1, -1, -1):
        s = order[k]
        for i in range(table.first[s], table.last[s]):
            if table.kind[i] == STATE:
                totals[table.target[i]] += totals[s] * factors[i]


@njit(entry=True)
def pass_up(
    table: Table,
    order: NDArray[np.int32],
    factors: Floats,
    own: Floats,
    masses: Floats,
    totals: Floats,
    n: int,
) -> None:
    """Add up what is below every state, items weighted by their factors.

    Parameters
    ----------
    own : float64 (M,)
        What every item has itself.
    masses : float64 (M,)
        Receives what every item has with all below it.
    """
    for k in range(n):
        s = order[k]
        total = 0.0
        for i in range(table.first[s], table.last[s]):
            masses[i] = own[i]
            if table.kind[i] == STATE:
                masses[i] = factors[i] * totals[table.target[i]]
            total += masses[i]
        totals[s] = total


class Measuring:
    """The integrals of one table of states.

    Parameters
    ----------
    expansion
        A complete table.

    Raises
    ------
    UsageError
        A state contains itself.
    """

    def __init__(self, expansion: Expansion) -> None:
        if expansion.order is None:
            raise UsageError("a module of the grammar leads back to itself with the same values")
        self.expansion = expansion
        self.table, self.order = expansion.table, expansion.order
        n = expansion.n_items
        self.kind, self.target = self.table.kind[:n], self.table.target[:n]
        self.is_leaf = self.kind == LEAF
        nodes = [expansion.graph.nodes[k] for k in expansion.leaf_nodes]
        self.leaves = [node for node in nodes if isinstance(node, Leaf)]
        self.names = np.array([node.solid.name for node in self.leaves] or [""])
        if len(self.leaves):
            self.is_leaf &= (self.names != "empty")[np.where(self.is_leaf, self.target, 0)]

    @cached_property
    def linear(self) -> Floats:
        """The linear part of every item's map, float64 (M, 3, 3)."""
        count = int(self.table.matrix[: len(self.kind)].max(initial=-1)) + 1
        maps = self.table.matrices[: 12 * count].reshape(-1, 3, 4)[:, :, :3]
        maps = np.concatenate([maps, np.eye(3)[None]])
        found: Floats = maps[self.table.matrix[: len(self.kind)]]
        return found

    @cached_property
    def stretch(self) -> tuple[Floats, NDArray[np.bool_]]:
        """The largest factor by which every item's map multiplies areas, and which vary."""
        m = self.linear
        squares = np.einsum("nki,nkj->nij", m, m)
        mean = np.trace(squares, axis1=1, axis2=2) / 3.0
        off = np.abs(squares - mean[:, None, None] * np.eye(3)).max(axis=(1, 2))
        varies = ~(off <= _SIMILAR * mean)
        largest = mean.copy()
        if varies.any():
            sizes = np.linalg.svd(m[varies], compute_uv=False)
            largest[varies] = sizes[:, 0] * sizes[:, 1]
        return largest, varies

    @cached_property
    def cofactors(self) -> Floats:
        """What every item's map makes of area vectors, float64 (M, 3, 3)."""
        a, b, c = np.moveaxis(self.linear, 1, 0)
        return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)

    @cached_property
    def labels(self) -> NDArray[np.int64]:
        """Labels of the leaf items, int64 (M,)."""
        label = np.full(len(self.kind), -1, np.int64)
        assigned = self.expansion.programs.attributes >= 0
        if not assigned[_LABEL]:
            return label
        counts = self.expansion.programs.leaves[L_ARGS::LEAF_FIELDS]
        here = np.flatnonzero(self.is_leaf)
        at = self.table.numbers_at[here] + counts[self.target[here]]
        values = self.table.numbers[at + int(np.count_nonzero(assigned[:_LABEL]))]
        label[here] = np.where(np.isnan(values), -1.0, values).astype(np.int64)
        return label

    @cached_property
    def kinds(self) -> tuple[list[Faces], NDArray[np.int64], list[tuple[Leaf, tuple[float, ...]]]]:
        """Surfaces, which of them every leaf item has, and whose they are."""
        found: dict[tuple[int, tuple[float, ...]], int] = {}
        faces: list[Faces] = []
        owners: list[tuple[Leaf, tuple[float, ...]]] = []
        which = np.full(len(self.kind), -1, np.int64)
        counts = self.expansion.programs.leaves[L_ARGS::LEAF_FIELDS]
        for k, node in enumerate(self.leaves):
            here = np.flatnonzero(self.is_leaf & (self.target == k))
            if not len(here):
                continue
            at = self.table.numbers_at[here][:, None] + np.arange(int(counts[k]))
            rows, inverse = np.zeros((1, 0)), np.zeros(len(here), np.int64)
            if counts[k]:
                rows, inverse = np.unique(self.table.numbers[at], axis=0, return_inverse=True)
            numbers = []
            for row in rows.tolist():
                key = k, tuple(row)
                if key not in found:
                    found[key] = len(faces)
                    faces.append(faces_of(node.solid, node.constants, tuple(row)))
                    owners.append((node, tuple(row)))
                numbers.append(found[key])
            which[here] = np.array(numbers)[inverse.reshape(-1)]
        return faces, which, owners

    def require_union(self, what: str) -> None:
        """Raise an error where a primitive is carved: its surface is not known from its state.

        Raises
        ------
        UsageError
            There is a difference or an intersection.
        """
        operations = np.flatnonzero(self.kind == OPERATION)
        if (self.target[operations] != UNION.kind).any():
            raise UsageError(
                f"{what} of differences and intersections is not known from their states; leave"
                " them out, or measure by rays"
            )

    @cached_property
    def own_areas(self) -> Floats:
        """The exact area of every leaf item in its state's frame, float64 (M,)."""
        faces, which, _ = self.kinds
        largest, varies = self.stretch
        areas = np.zeros(len(self.kind))
        for k, face in enumerate(faces):
            here = np.flatnonzero(which == k)
            areas[here] = face.area * largest[here]
            bent = here[varies[here]]
            step = max(1, 4_000_000 // max(1, len(face.vectors)))
            for at in range(0, len(bent), step):
                rows = bent[at : at + step]
                moved = np.einsum("nij,kj->nki", self.cofactors[rows], face.vectors)
                areas[rows] = np.linalg.norm(moved, axis=2).sum(axis=1)
        return areas

    def weigh(self, factors: Floats) -> Floats:
        """Return what every state counts for, from the factors of items."""
        totals = np.zeros(self.expansion.n_states)
        totals[0] = 1.0
        pass_down(self.table, self.order, factors, totals, len(self.order))
        return totals

    @cached_property
    def state_of(self) -> NDArray[np.int32]:
        """The state of every item."""
        n = self.expansion.n_states
        first, last = self.table.first[:n], self.table.last[:n]
        owner = np.zeros(len(self.kind), np.int32)
        filled = np.flatnonzero(last > first)
        by_place = filled[np.argsort(first[filled])]
        owner[:] = np.repeat(by_place, last[by_place] - first[by_place])
        return owner

    def measure(self, quantity: Quantity, by: Key | None) -> dict[Any, Measured] | Measured:
        """Return an integral; see `Scene.measure`."""
        if quantity == "count":
            values = self._count_items()
        elif quantity == "volume":
            self.require_union("the volume")
            values = self._volumes()
        else:
            self.require_union("the area")
            values = self.weigh(self.stretch[0])[self.state_of] * self.own_areas
            if self.is_sampled:
                return self._estimate(by)
        here = np.flatnonzero(self.is_leaf)
        if by is None:
            return Measured(_total(values[here]), 0.0)
        keys = self.labels if by == "label" else self._leaf_numbers
        found: dict[Any, Measured] = {}
        for key in np.unique(keys[here]).tolist():
            found[key] = Measured(_total(values[here][keys[here] == key]), 0.0)
        return found

    @cached_property
    def _leaf_numbers(self) -> NDArray[np.int64]:
        numbers = np.array([*self.expansion.leaf_nodes, -1], np.int64)
        return numbers[np.where(self.is_leaf, self.target, -1)]

    def _count_items(self) -> NDArray[Any]:
        counts = self.weigh(np.ones(len(self.kind)))
        if counts.max(initial=0.0) < _EXACT / max(1, len(self.kind)):
            return counts[self.state_of]
        # In integers of any size.
        exact = [0] * self.expansion.n_states
        exact[0] = 1
        kinds, targets = self.kind.tolist(), self.target.tolist()
        first, last = self.table.first.tolist(), self.table.last.tolist()
        for s in reversed(self.order.tolist()):
            for i in range(first[s], last[s]):
                if kinds[i] == STATE:
                    exact[targets[i]] += exact[s]
        return np.array(exact, object)[self.state_of]

    def _volumes(self) -> Floats:
        sizes = np.abs(np.linalg.det(self.linear))
        faces, which, _ = self.kinds
        unit = np.array([*(face.volume for face in faces), 0.0])
        found: Floats = self.weigh(sizes)[self.state_of] * sizes * unit[which]
        return found

    @cached_property
    def is_sampled(self) -> bool:
        """Whether some area is not exact: a map that stretches stands above a state."""
        above = (self.kind == STATE) & self.stretch[1]
        if not above.any():
            return False
        # What leads to no surface does no harm.
        masses, totals = np.zeros(len(self.kind)), np.zeros(self.expansion.n_states)
        own = np.where(self.is_leaf, 1.0, 0.0)
        ones = np.ones(len(self.kind))
        pass_up(self.table, self.order, ones, own, masses, totals, len(self.order))
        return bool((masses[above] > 0.0).any())

    def _estimate(self, by: Key | None) -> dict[Any, Measured] | Measured:
        rng = np.random.Generator(np.random.Philox(np.random.SeedSequence(0)))
        drawn = self.draw(SAMPLES, rng)
        if by is None:
            return drawn.measure(np.ones(SAMPLES, np.bool_))
        keys = drawn.label if by == "label" else drawn.leaf
        return {key: drawn.measure(keys == key) for key in np.unique(keys).tolist()}

    @cached_property
    def _masses(self) -> tuple[Floats, Floats]:
        """A bound of the area of every item with all below it, and of every state."""
        largest, _ = self.stretch
        faces, which, _ = self.kinds
        # A single flat face has one area; of others points are weighted by how they lie.
        flat = np.array([*(len(face.vectors) == 1 for face in faces), True])
        areas = np.array([*(face.area for face in faces), 0.0])
        own = np.where(flat[which], self.own_areas, areas[which] * largest)
        masses, totals = np.zeros(len(self.kind)), np.zeros(self.expansion.n_states)
        pass_up(self.table, self.order, largest, own, masses, totals, len(self.order))
        return masses, totals

    def draw(self, n: int, rng: np.random.Generator) -> Drawn:
        """Draw points in proportion to bounds of areas."""
        masses, totals = self._masses
        if not totals[0] > 0.0:
            raise UsageError("the scene has no surface to draw points on")
        total_of = totals[self.state_of]
        shares = np.divide(masses, total_of, out=np.zeros_like(masses), where=total_of > 0.0)
        ends = np.concatenate([[0.0], np.cumsum(shares)])
        state = np.zeros(n, np.int64)
        frames = np.tile(np.eye(3, 4), (n, 1, 1))
        bound = np.ones(n)
        item = np.full(n, -1, np.int64)
        going = np.arange(n)
        maps = self.table.matrices.reshape(-1, 3, 4)
        while len(going):
            first, last = self.table.first[state[going]], self.table.last[state[going]]
            wanted = ends[first] + rng.random(len(going)) * (ends[last] - ends[first])
            i = np.clip(np.searchsorted(ends, wanted, side="right") - 1, first, last - 1)
            # An item without area may be met at the very end of a state's share.
            while len(none := np.flatnonzero(masses[i] <= 0.0)):
                i[none] -= 1
            item[going] = i
            number = self.table.matrix[i]
            placed = going[number >= 0]
            frames[placed] = _compose(frames[placed], maps[number[number >= 0]])
            down = self.kind[i] == STATE
            bound[going[down]] *= self.stretch[0][i[down]]
            going = going[down]
            state[going] = self.target[i[down]]
        return self._place(item, frames, bound, totals[0], rng)

    def _place(
        self,
        item: NDArray[np.int64],
        frames: Floats,
        bound: Floats,
        total: float,
        rng: np.random.Generator,
    ) -> Drawn:
        """Draw a point of every item that was drawn."""
        n = len(item)
        faces, which, owners = self.kinds
        u = rng.random((n, 3))
        points, normals = np.zeros((n, 3)), np.zeros((n, 3))
        local = np.zeros(n)
        kinds = which[item]
        for k in np.unique(kinds).tolist():
            here = np.flatnonzero(kinds == k)
            node, args = owners[k]
            drawn: Draw = draw_points(node.solid, node.constants, args, u[here])
            points[here], normals[here] = drawn.points, drawn.normals
            if len(faces[k].vectors) == 1:
                local[here] = self.own_areas[item[here]] / faces[k].area
            else:
                local[here] = self.stretch[0][item[here]]
        linear = frames[:, :, :3]
        a, b, c = np.moveaxis(linear, 1, 0)
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        # The cofactors hold the sign of the determinant, which outward normals do not.
        turned = np.einsum("nij,nj->ni", cofactors, normals)
        sizes = np.linalg.norm(turned, axis=1)
        sign = np.where(np.linalg.det(linear) < 0.0, -1.0, 1.0)
        return Drawn(
            points=np.einsum("nij,nj->ni", linear, points) + frames[:, :, 3],
            normals=turned * (sign / np.maximum(sizes, 1e-300))[:, None],
            label=self.labels[item],
            leaf=self._leaf_numbers[item],
            ratio=np.minimum(1.0, sizes / np.maximum(bound * local, 1e-300)),
            total=total,
        )

    def sample(self, n: int, seed: int) -> Samples:
        """Return points uniform by area; see `Scene.sample`."""
        self.require_union("the surface")
        rng = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed)))
        parts: list[Drawn] = []
        tried, taken = 0, 0
        while taken < n:
            drawn = self.draw(max(256, math.ceil(1.1 * (n - taken))), rng)
            kept = np.flatnonzero(rng.random(len(drawn.ratio)) <= drawn.ratio)
            tried += len(drawn.ratio)
            taken += len(kept)
            parts.append(drawn.take(kept))
            if tried > 1000 * n + 100_000:
                raise UsageError("the scene's maps stretch so much that points cannot be drawn")
        total = parts[0].total
        p = min(1.0, taken / tried)
        exact = not self.is_sampled
        area = self.measure("area", None) if exact else None
        if not isinstance(area, Measured):
            area = Measured(float(total * p), float(total * math.sqrt(p * (1.0 - p) / tried)))
        points, normals, label, leaf = (
            np.concatenate(columns)[:n] for columns in list(zip(*parts, strict=True))[:4]
        )
        return Samples(points, normals, label, leaf, area)


class Drawn(NamedTuple):
    """Points drawn in proportion to bounds of areas.

    Attributes
    ----------
    points, normals : float64 (N, 3)
    label, leaf : int64 (N,)
    ratio : float64 (N,)
        The area there, as a share of the bound.
    total : float
        Of all bounds.
    """

    points: Floats
    normals: Floats
    label: NDArray[np.int64]
    leaf: NDArray[np.int64]
    ratio: Floats
    total: float

    def take(self, which: NDArray[np.int64]) -> Drawn:
        """Return some of the points."""
        return Drawn(
            self.points[which],
            self.normals[which],
            self.label[which],
            self.leaf[which],
            self.ratio[which],
            self.total,
        )

    def measure(self, which: NDArray[np.bool_]) -> Measured:
        """Return the area of some of the points' surfaces, estimated."""
        weights = np.where(which, self.ratio, 0.0)
        se = float(weights.std()) / math.sqrt(len(weights))
        return Measured(float(self.total * weights.mean()), float(self.total * se))


def _compose(a: Floats, b: Floats) -> Floats:
    """Return products of affine maps (N, 3, 4)."""
    out: Floats = np.einsum("nij,njk->nik", a[:, :, :3], b)
    out[:, :, 3] += a[:, :, 3]
    return out


def _total(values: NDArray[Any]) -> Any:
    """Return a sum: of whole numbers exact, of others without needless rounding."""
    if values.dtype == object:
        return int(sum(values.tolist()))
    return math.fsum(values.tolist()) if len(values) < 100_000 else float(values.sum())
