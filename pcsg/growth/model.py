"""The growth model: all years at once, and the tree at any time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.arguments import whole
from pcsg.errors import UsageError
from pcsg.growth.chance import derive
from pcsg.growth.geometry import (
    Drawn,
    Instant,
    check_nodes,
    draw_order,
    instant,
    seats_of,
    thickness,
)
from pcsg.growth.lengths import Order, grow_orders
from pcsg.growth.organs import find_buds, find_leaves
from pcsg.growth.pipes import leaves_carried, pipe_radii
from pcsg.growth.species import SEEDS, Species, load_species
from pcsg.growth.state import Branches, Joints, Laterals, Nodes, State, Stubs

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Counts:
    """What a tree has at the end of a year, in the categories of the paper.

    Attributes
    ----------
    operators
        Living branches.
    primitives
        Internodes, leaves of the year's shoots, and a bounding primitive for each lateral.
    branches
        By order.
    """

    year: int
    operators: int
    primitives: int
    shoots: int
    internodes: int
    leaves: int
    branches: tuple[int, ...]


class GrowthModel:
    """A tree of a species over all its years.

    Parameters
    ----------
    species
        Numbers and curves.
    seed
        Of directions and of the fall of leaves, in place of the species'.

    Raises
    ------
    UsageError
        The seed is no whole number of at most 2^53.
    """

    def __init__(self, species: Species, seed: int | None = None) -> None:
        if seed is not None:
            species = replace(species, seed=whole(seed, "seed", -SEEDS, SEEDS))
        self.species = species
        self.orders: tuple[Order, ...] = grow_orders(self.species)
        keys = [derive(np.zeros(1, np.uint64), self.species.seed)]
        for order in self.orders[1:]:
            keys.append(derive(keys[-1][order.parent], order.metamer))
        self.keys = tuple(keys)

    @classmethod
    def load(cls, what: str | Path, seed: int | None = None) -> GrowthModel:
        """Return the model of a file, or of a shipped species by its name.

        Raises
        ------
        GrammarError
            Mistakes in the file, all at once.
        UsageError
            There is no such file or name.
        """
        return cls(load_species(what), seed)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        arrays = [a for o in self.orders for a in vars(o).values()]
        return sum(a.nbytes for a in (*arrays, *self.keys))

    def counts(self, year: int) -> Counts:
        """Return what the tree has at the end of a year."""
        if not 0 <= year <= self.species.ymax:
            raise UsageError(f"years go from 0 to {self.species.ymax}, not {year}")
        living = [o.living(year) for o in self.orders]
        pairs = list(zip(self.orders, living, strict=True))
        shoots = sum(int((year - o.born[a]).sum()) for o, a in pairs)
        internodes = sum(int(o.metamers[a, : year + 1].sum()) for o, a in pairs)
        leaves = sum(int(o.metamers[a, year].sum()) for o, a in pairs)
        branches = tuple(int(a.sum()) for a in living)
        operators = sum(branches)
        bounds = max(0, operators - 1)
        return Counts(
            year, operators, internodes + leaves + bounds, shoots, internodes, leaves, branches
        )

    @cached_property
    def caps(self) -> tuple[Floats, ...]:
        """Caps of the radii at the ends of all years, (n, Y + 1) for every order."""
        found = [np.ones_like(self.orders[0].lengths)]
        for below, order in zip(self.orders, self.orders[1:], strict=False):
            p, b = order.parent, order.born
            l0, l1 = below.lengths[p, b - 1], below.lengths[p, b]
            seat = l0 + order.along * (l1 - l0)
            bearer = found[-1][p] * thickness(self.species, below.lengths[p] - seat[:, None])
            own = thickness(self.species, order.lengths)
            found.append(np.minimum(1.0, self.species.radius.cap * bearer / own))
        return tuple(found)

    @property
    def has_pipes(self) -> bool:
        """Whether radii follow from the leaves that limbs carry."""
        return self.species.radius.rule == "pipe"

    @cached_property
    def carried(self) -> tuple[Floats, ...]:
        """Leaves that branches have carried by the ends of years, (n, Y + 1) for every order."""
        return leaves_carried(self.orders)

    def radius_then(self, order: int, rows: Ints, year: Ints, along: Floats) -> Floats:
        """Return radii of branches of an order at places at the ends of years.

        By the pipe model a mean along the branch, as only sizes of scars depend on it.
        """
        length = self.orders[order].lengths[rows, year]
        if self.has_pipes:
            left = self.carried[order][rows, year] * (1.0 - along / length)
            return np.asarray(self.species.radius.r_tip * np.sqrt(np.maximum(left, 1.0)))
        return np.asarray(self.caps[order][rows, year] * thickness(self.species, length - along))

    def at(self, t: float) -> State:
        """Return the tree at a time in (0, ymax] years.

        Raises
        ------
        UsageError
            The time is no such one, or the tree has too many internodes then.
        """
        if not 0.0 < t <= self.species.ymax:
            raise UsageError(f"a time lies in (0, {self.species.ymax}] years, not at {t:g}")
        now = instant(t)
        drawn: list[Drawn] = []
        of_parent = np.zeros(0, np.int64)
        for k, order in enumerate(self.orders):
            above = drawn[-1] if drawn else None
            new = draw_order(self.species, order, self.keys[k], now, k, above, of_parent)
            if not len(new.rows):
                break
            drawn.append(new)
            check_nodes(sum(len(d.branch) for d in drawn), now)
            of_parent = np.full(len(order), -1)
            alive = len(new.rows) - new.ghosts
            of_parent[new.rows[:alive]] = np.arange(alive)
        if not drawn:
            raise UsageError(f"at {t:g} years there is nothing of the tree yet")
        if self.has_pipes:
            drawn = pipe_radii(self.species, self.orders, self.carried, now, drawn)
        return _Assembly(self, now, drawn).state()


class _Assembly:
    """One state from the branches of all orders; ghosts leave only their stubs."""

    def __init__(self, model: GrowthModel, now: Instant, drawn: list[Drawn]) -> None:
        self.model, self.now, self.drawn = model, now, drawn
        self.alive = [len(d.rows) - d.ghosts for d in drawn]
        self.n_nodes = [int(d.count[:n].sum()) for d, n in zip(drawn, self.alive, strict=True)]
        self.branch0 = np.concatenate([[0], np.cumsum(self.alive)]).astype(np.int64)
        self.node0 = np.concatenate([[0], np.cumsum(self.n_nodes)]).astype(np.int64)
        # Rows of an order to branches of the state.
        self.local = []
        for d, n, order in zip(drawn, self.alive, model.orders, strict=False):
            local = np.full(len(order), -1)
            local[d.rows[:n]] = np.arange(n)
            self.local.append(local)

    def state(self) -> State:
        branches, nodes = self._branches(), self._nodes()
        factor = branches.factor[nodes.branch]
        nodes = replace(nodes, radius=nodes.radius * factor)
        species, now = self.model.species, self.now
        shoots = list(zip(self.model.orders, self.model.keys, self.drawn, self.alive, strict=False))
        return State(
            species=species,
            time=now.t,
            year=now.year,
            season=now.tau,
            branches=branches,
            nodes=nodes,
            laterals=self._laterals(branches, nodes),
            joints=self._joints(branches, nodes),
            leaves=find_leaves(species, now, shoots),
            buds=find_buds(species, now, shoots),
            stubs=self._stubs(),
        )

    def _per_order(self, name: str, nodes: bool) -> NDArray[Any]:
        n = self.n_nodes if nodes else self.alive
        return np.concatenate([getattr(d, name)[:k] for d, k in zip(self.drawn, n, strict=True)])

    def _branches(self) -> Branches:
        parent, seat, born, death, order, keys = [], [], [], [], [], []
        for k, (d, n) in enumerate(zip(self.drawn, self.alive, strict=True)):
            about, rows = self.model.orders[k], d.rows[:n]
            born.append(about.born[rows])
            death.append(about.death[rows])
            order.append(np.full(n, k))
            keys.append(self.model.keys[k][rows])
            if k == 0:
                parent.append(np.full(n, -1))
                seat.append(np.full(n, -1))
                continue
            above = self.local[k - 1][about.parent[rows]]
            parent.append(self.branch0[k - 1] + above)
            seat.append(self.node0[k - 1] + seats_of(about, rows, self.drawn[k - 1], above))
        first = [
            d.first[:n] + self.node0[k]
            for k, (d, n) in enumerate(zip(self.drawn, self.alive, strict=True))
        ]
        return Branches(
            parent=_joined(parent),
            order=_joined(order),
            born=_joined(born),
            death=_joined(death),
            seat=_joined(seat),
            factor=self._per_order("factor", False),
            first=_joined(first),
            count=self._per_order("count", False),
            length=self._per_order("length", False),
            start=self._per_order("start", False),
            axis=self._per_order("axis", False),
            key=_joined(keys),
        )

    def _nodes(self) -> Nodes:
        branch = [
            d.branch[:n] + self.branch0[k]
            for k, (d, n) in enumerate(zip(self.drawn, self.n_nodes, strict=True))
        ]
        of = [
            np.where(d.of_shoot[:n] >= 0, d.shoot_m[d.of_shoot[:n]], 0)
            for d, n in zip(self.drawn, self.n_nodes, strict=True)
        ]
        return Nodes(
            position=self._per_order("position", True),
            radius=self._per_order("radius", True),
            branch=_joined(branch),
            along=self._per_order("along", True),
            year=self._per_order("year", True),
            direction=self._per_order("direction", True),
            metamer=self._per_order("metamer", True),
            of=_joined(of),
        )

    def _row_tables(self, branches: Branches) -> tuple[Ints, Ints]:
        """Return the order and the row there of every branch."""
        rows = _joined([d.rows[:n] for d, n in zip(self.drawn, self.alive, strict=True)])
        return branches.order, rows

    def _radius_then(self, branches: Branches, branch: Ints, year: Ints, along: Floats) -> Floats:
        """Return radii of branches at places at the ends of years."""
        order, rows = self._row_tables(branches)
        found = np.zeros(len(branch))
        for k in range(len(self.drawn)):
            here = np.flatnonzero(order[branch] == k)
            found[here] = self.model.radius_then(k, rows[branch[here]], year[here], along[here])
        return found

    def _laterals(self, branches: Branches, nodes: Nodes) -> Laterals:
        branch = np.flatnonzero(branches.parent >= 0)
        foot, seat = branches.first[branch], branches.seat[branch]
        born = branches.born[branch]
        age = self.now.t - (born + self.model.species.season.burst)
        radius = nodes.radius[foot]
        then = self._radius_then(branches, branch, born + 1, np.zeros(len(branch)))
        return Laterals(
            branch=branch,
            seat=seat,
            bearer=nodes.direction[seat],
            direction=nodes.direction[foot],
            bearer_radius=nodes.radius[seat],
            radius=radius,
            first_radius=np.where(age >= 1.0, np.minimum(then, radius), radius),
            age=np.maximum(age, 0.0),
        )

    def _joints(self, branches: Branches, nodes: Nodes) -> Joints:
        n = len(nodes.branch)
        inner = np.arange(n - 1)
        same = nodes.branch[:-1] == nodes.branch[1:]
        node = inner[same & (nodes.year[:-1] > 0) & (nodes.year[:-1] != nodes.year[1:])]
        branch, year = nodes.branch[node], nodes.year[node + 1]
        age = self.now.t - (year - 1 + self.model.species.season.burst)
        axis = nodes.direction[node] + nodes.direction[node + 1]
        radius = nodes.radius[node]
        then = self._radius_then(branches, branch, year, nodes.along[node])
        return Joints(
            branch=branch,
            node=node,
            axis=axis / np.linalg.norm(axis, axis=1, keepdims=True),
            radius=radius,
            first_radius=np.where(age >= 1.0, np.minimum(then, radius), radius),
            age=np.maximum(age, 0.0),
        )

    def _stubs(self) -> Stubs:
        parts = []
        for k in range(1, len(self.drawn)):
            d, n, order = self.drawn[k], self.alive[k], self.model.orders[k]
            rows = d.rows[n:]
            above = self.local[k - 1][order.parent[rows]]
            bearers = self.drawn[k - 1]
            seat = seats_of(order, rows, bearers, above)
            death = order.death[rows]
            radius = self.model.radius_then(k, rows, death, np.zeros(len(rows)))
            age = self.now.t - (death - 1 + self.model.species.season.shed[0])
            parts.append(
                Stubs(
                    position=bearers.position[seat],
                    axis=d.start[n:],
                    bearer=bearers.direction[seat],
                    bearer_radius=bearers.radius[seat] * bearers.factor[above],
                    branch=self.branch0[k - 1] + above,
                    radius=radius,
                    age=np.asarray(age, np.float64),
                )
            )
        if not parts:
            none = np.zeros((0, 3))
            return Stubs(
                none, none, none, none[:, 0], np.zeros(0, np.int64), none[:, 0], none[:, 0]
            )
        names = Stubs.__dataclass_fields__
        return Stubs(**{k: np.concatenate([getattr(p, k) for p in parts]) for k in names})


def _joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return np.concatenate(parts)
