"""Subtrees by themselves, with size and place taken out, to make other trees of."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.inputs import parse_json, read_text
from pcsg.outputs import check_output, write_whole
from pcsg.treemesh.editing import subtree
from pcsg.treemesh.files import skeleton_from_json, skeleton_to_json
from pcsg.treemesh.pruning import branch_orders
from pcsg.treemesh.skeleton import Floats, Skeleton


@dataclass(frozen=True, eq=False)
class Entry:
    """A limb of a joint with everything behind it.

    Attributes
    ----------
    skeleton
        Attached at the origin, in direction +z, the bearer's direction towards +x; the longest path
        to a tip has the length 1, and radii are in proportion.
    order
        Of its first edge; see `pruning.branch_orders`.
    species
        Where it comes from.
    """

    skeleton: Skeleton
    order: int
    species: str

    @property
    def segments(self) -> int:
        """Number of segments."""
        return self.skeleton.n_edges

    @property
    def radius(self) -> float:
        """Radius at the base, over the length."""
        return base_radius(self.skeleton)


def base_radius(skel: Skeleton) -> float:
    """Return the radius of the node after the root: the root's own is its bearer's."""
    ptr, others, _ = skel.incidence
    return float(skel.radius[others[ptr[skel.root]]])


def longest_path(skel: Skeleton) -> float:
    """Return the path length from the root to the farthest tip."""
    parent, up, order = skel.parents
    length = np.zeros(skel.n_nodes)
    for node in order[1:].tolist():
        length[node] = length[parent[node]] + skel.lengths[up[node]]
    return float(length.max())


def frame(direction: Floats, reference: Floats) -> Floats:
    """Return the matrix with columns x, y, z: z the direction, x the reference made orthogonal."""
    z = direction / np.linalg.norm(direction)
    x = reference - z * (z @ reference)
    if np.linalg.norm(x) < 1e-9 * np.linalg.norm(reference):
        x = np.eye(3)[int(np.argmin(np.abs(z)))]
        x = x - z * (z @ x)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


@dataclass
class Library:
    """Subtrees to choose from.

    Attributes
    ----------
    entries
        In the order they were added.
    """

    entries: list[Entry] = field(default_factory=list)

    def add(self, skel: Skeleton, species: str = "tree") -> None:
        """Add every limb that starts at a joint of a tree."""
        if skel.loops:
            raise UsageError("subtrees are taken from trees, and the skeleton has a loop")
        orders = branch_orders(skel)
        parent, up, order = skel.parents
        for node in order.tolist():
            if parent[node] < 0 or skel.degree[parent[node]] < 3 or parent[parent[node]] < 0:
                continue
            edge, joint = int(up[node]), int(parent[node])
            nodes, edges = subtree(skel, edge)
            part = skel.subset(np.append(nodes, joint), np.append(edges, edge), joint)
            bearer = skel.pos[joint] - skel.pos[parent[joint]]
            turn = frame(skel.pos[node] - skel.pos[joint], bearer)
            scale = 1.0 / longest_path(part)
            part = part.replaced(
                pos=scale * (part.pos - skel.pos[joint]) @ turn,
                radius=scale * part.radius,
                mapping=None,
            )
            self.entries.append(Entry(part, int(orders[edge]), species))

    def like(self, order: int, segments: int) -> list[Entry]:
        """Return the entries that could take the place of a subtree.

        They have its order, or one more or less, and half to twice as many segments: most subtrees
        are twigs, and a twig as long as a limb would leave the crown bare. If there are none, those
        whose number of segments is nearest.
        """
        near = [e for e in self.entries if abs(e.order - order) <= 1]
        alike = [e for e in near if 0.5 <= e.segments / segments <= 2.0]
        if alike or not near:
            return alike
        least = min(abs(e.segments - segments) for e in near)
        return [e for e in near if abs(e.segments - segments) == least]

    def save(self, path: str | Path) -> Path:
        """Write the library as JSON."""
        path = Path(path)
        check_output(path, (".json",))
        data = [
            {
                "species": e.species,
                "order": e.order,
                "segments": e.segments,
                "skeleton": skeleton_to_json(e.skeleton),
            }
            for e in self.entries
        ]
        text = json.dumps({"library": data}) + "\n"
        write_whole(path, lambda file: file.write(text.encode()))
        return path

    @classmethod
    def load(cls, path: str | Path) -> Library:
        """Read a library.

        Raises
        ------
        UsageError
            The file is not there or holds no library.
        """
        path = Path(path)
        try:
            data: Any = parse_json(read_text(path, "library"))
            rows: Iterable[Any] = data["library"]
            return cls(
                [
                    Entry(
                        skeleton_from_json(row["skeleton"], str(path)),
                        int(row["order"]),
                        str(row["species"]),
                    )
                    for row in rows
                ]
            )
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            if isinstance(error, UsageError):
                raise
            raise UsageError(f"{path}: not a library of subtrees") from None
