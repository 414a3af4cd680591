"""A tree at one instant, as arrays.

Lengths in metres, z up, the trunk's foot at the origin; unit vectors; times in years. Branches
stand in order of their order, bearers before what they bear; nodes of a branch follow each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pcsg.growth.species import Species

if TYPE_CHECKING:
    from pcsg.blobtree.model import Model
    from pcsg.treemesh.skeleton import Skeleton

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Branches:
    """Living branches, B of them.

    Attributes
    ----------
    parent
        Branch that bears it, -1 for the trunk.
    order
        0 for the trunk.
    born, death
        Year of the bearing shoot, and the last year.
    seat
        Node of the parent at which it leaves, -1 for the trunk.
    factor
        1; falls to 0 in the last months of the last year. Radii contain it.
    first, count
        Its nodes are rows first .. first + count - 1; two at least.
    length
        From its base to its tip.
    start : (B, 3)
        Direction in which it leaves its bearer: h0.
    axis : (B, 3)
        Axis about which it bends.
    key : uint64
        Name that does not change with time.
    """

    parent: Ints
    order: Ints
    born: Ints
    death: Ints
    seat: Ints
    factor: Floats
    first: Ints
    count: Ints
    length: Floats
    start: Floats
    axis: Floats
    key: NDArray[np.uint64]


@dataclass(frozen=True)
class Nodes:
    """Ends of internodes, N of them: those of a branch from its base to its tip.

    Attributes
    ----------
    position : (N, 3)
    radius
        Of the limb there.
    branch
        Row in `Branches`.
    along
        Arc length from the branch's base.
    year
        Of the shoot whose internode ends here; 0 for a base.
    direction : (N, 3)
        Of the internode that ends here; of a base, of the first one.
    metamer, of
        Number of the metamer in its shoot, from 1, and of how many when it is grown; 0 for a base.
    """

    position: Floats
    radius: Floats
    branch: Ints
    along: Floats
    year: Ints
    direction: Floats
    metamer: Ints
    of: Ints


@dataclass(frozen=True)
class Laterals:
    """Where branches leave their bearers, one for each living branch but the trunk.

    Attributes
    ----------
    branch, seat
        Rows in `Branches` and `Nodes`.
    bearer, direction : (L, 3)
        Directions of the bearer and of the branch.
    bearer_radius, radius
        There and now.
    first_radius
        That of the branch at the age of a year, or now if it is younger.
    age
        Since its first bud burst.
    """

    branch: Ints
    seat: Ints
    bearer: Floats
    direction: Floats
    bearer_radius: Floats
    radius: Floats
    first_radius: Floats
    age: Floats


@dataclass(frozen=True)
class Joints:
    """Where a shoot goes on from the last year's of its branch: apical bud scale scars.

    Attributes
    ----------
    branch, node
        Rows in `Branches` and `Nodes`.
    axis : (J, 3)
        Mean direction.
    radius, first_radius, age
        As in `Laterals`.
    """

    branch: Ints
    node: Ints
    axis: Floats
    radius: Floats
    first_radius: Floats
    age: Floats


@dataclass(frozen=True)
class Leaves:
    """Leaves, F of them.

    Attributes
    ----------
    position : (F, 3)
        Where the petiole leaves the shoot: on its bark.
    axis, outward : (F, 3)
        Direction of the shoot, and away from it.
    size
        Length of the blade.
    autumn
        0 green, 1 in the colour of autumn.
    key : uint64
    """

    position: Floats
    axis: Floats
    outward: Floats
    size: Floats
    autumn: Floats
    key: NDArray[np.uint64]


@dataclass(frozen=True)
class Buds:
    """Buds: position of the foot (U, 3), direction (U, 3), length."""

    position: Floats
    axis: Floats
    size: Floats


@dataclass(frozen=True)
class Stubs:
    """What lost branches leave behind, K of them.

    Attributes
    ----------
    position, axis : (K, 3)
        Place on the bearer's axis; direction in which the branch left it.
    bearer, bearer_radius
        Direction (K, 3) and radius of the bearer there.
    branch
        The bearer, a row in `Branches`.
    radius
        Of the branch when it was lost.
    age
        Years since then.
    """

    position: Floats
    axis: Floats
    bearer: Floats
    bearer_radius: Floats
    branch: Ints
    radius: Floats
    age: Floats


@dataclass(frozen=True)
class State:
    """A tree at time t.

    Attributes
    ----------
    time, year, season
        t; the year it lies in, from 1; the part of that year that is over, in (0, 1].
    """

    species: Species
    time: float
    year: int
    season: float
    branches: Branches
    nodes: Nodes
    laterals: Laterals
    joints: Joints
    leaves: Leaves
    buds: Buds
    stubs: Stubs

    @property
    def height(self) -> float:
        """Greatest height of the wood."""
        return float(self.nodes.position[:, 2].max(initial=0.0))

    def blobtree(self, finest: float = 0.004) -> Model:
        """Return the wood as an implicit model, with `field`, `intersect` and the rest.

        Parameters
        ----------
        finest
            Junctions of limbs thinner than this, in metres, are smooth.
        """
        from pcsg.blobtree.model import Model
        from pcsg.growth.wood import wood_field

        return Model(wood_field(self, finest))

    def skeleton(self) -> Skeleton:
        """Return the axes with radii, for meshes and other programs; labels are orders.

        Branches begin at their seats; those that fade are thinner.
        """
        from pcsg.treemesh.skeleton import Skeleton

        b, n = self.branches, self.nodes
        number = np.full(len(n.branch), -1)
        inner = np.ones(len(n.branch), np.bool_)
        inner[b.first[1:]] = False  # bases of laterals are their seats
        kept = np.flatnonzero(inner)
        number[kept] = np.arange(len(kept))
        number[b.first[1:]] = number[b.seat[1:]]
        ends = np.ones(len(n.branch), np.bool_)
        ends[b.first] = False
        upper = np.flatnonzero(ends)
        edges = np.stack([number[upper - 1], number[upper]], axis=1)
        return Skeleton.make(
            n.position[kept],
            n.radius[kept],
            edges,
            root=0,
            tags={"label": b.order[n.branch[upper]]},
        )
