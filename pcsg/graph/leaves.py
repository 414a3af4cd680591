"""Every primitive of a grammar, placed in the world: what the graph avoids, for small scenes.

For what needs the solids one by one, such as skeletons of trees. There is no recursion on depth:
states that wait are on a stack.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.code import compose_affine
from pcsg.graph.nodes import Leaf, Selection
from pcsg.graph.operators import UNION
from pcsg.graph.states import Combine, LeafItem, State, StateGraph, StateItem
from pcsg.vec import IDENTITY, Affine

Path = tuple[tuple[str, int], ...]
"""Modules on the way to a primitive, and the numbers of the rules taken."""

_LABEL = ATTRIBUTE_SLOTS.index("@label")


class PlacedLeaf(NamedTuple):
    """A primitive in the world.

    Attributes
    ----------
    name
        As the language calls it.
    world_from_leaf
        Its place.
    args
        Its arguments.
    label
        -1 for none.
    carved
        Whether it is an operand of a difference or an intersection, and so not seen as it is.
    node
        Number of the leaf node in the graph.
    path
        Modules on the way, and the numbers of the rules taken.
    """

    name: str
    world_from_leaf: Affine
    args: tuple[float, ...]
    label: int
    carved: bool
    node: int
    path: Path


@dataclass(frozen=True)
class Leaves:
    """Some primitives of a scene, placed in the world.

    Attributes
    ----------
    leaf : int64 (N,)
        Numbers of the leaf nodes in the graph.
    name : tuple of str
        What the language calls them.
    matrix : float64 (N, 3, 4)
        Places in the world of points of the unit primitives: ``matrix @ (x, y, z, 1)``.
    label : int64 (N,)
        -1 for none.
    arguments : tuple of tuple of float
    carved : bool (N,)
        Whether it is an operand of a difference or an intersection, and so not seen as it is.
    path : sequence of tuple of (str, int)
        How the grammar derives it: modules, and the numbers of the rules taken. Where there are
        many states each is made when it is asked for, so that deep ones take no memory.
    """

    leaf: NDArray[np.int64]
    name: tuple[str, ...]
    matrix: NDArray[np.float64]
    label: NDArray[np.int64]
    arguments: tuple[tuple[float, ...], ...]
    carved: NDArray[np.bool_]
    path: Sequence[Path]

    def __len__(self) -> int:
        return len(self.leaf)


def batches_of_leaves(states: StateGraph, size: int) -> Iterator[Leaves]:
    """Yield the primitives of a scene in the order of the text, some at a time.

    Raises
    ------
    UsageError
        The states could not be enumerated.
    """
    placed = placed_leaves(states, None)
    while some := tuple(islice(placed, size)):
        yield Leaves(
            leaf=np.array([x.node for x in some], np.int64),
            name=tuple(x.name for x in some),
            matrix=np.array([x.world_from_leaf for x in some]).reshape(-1, 3, 4),
            label=np.array([x.label for x in some], np.int64),
            arguments=tuple(x.args for x in some),
            carved=np.array([x.carved for x in some]),
            path=tuple(x.path for x in some),
        )


def placed_leaves(states: StateGraph, limit: int | None) -> Iterator[PlacedLeaf]:
    """Yield the primitives of a scene in the order of the text.

    Memory follows the depth of the derivation, not the number of primitives.

    Parameters
    ----------
    limit
        Most primitives; None for any number.

    Raises
    ------
    UsageError
        There are more, or the states could not be enumerated.
    """
    if not (states.finite and states.acyclic):
        raise UsageError("the grammar has too many states to be expanded; lower its order with -D")
    graph = states.graph
    visible = [_operands(state) for state in states.states]
    stack: list[tuple[int, int, Affine, bool, Path]] = [(0, 0, IDENTITY, False, ())]
    count = 0
    while stack:
        k, at, world, carved, path = stack.pop()
        items = visible[k]
        while at < len(items):
            item, cut = items[at]
            at += 1
            if isinstance(item, StateItem):
                stack.append((k, at, world, carved, path))
                place = compose_affine(world, item.state_from_child)
                state = states.states[item.state]
                module = graph.nodes[state.node]
                way = (*path, (module.name, state.rule)) if isinstance(module, Selection) else path
                stack.append((item.state, 0, place, carved or cut, way))
                break
            node = graph.nodes[item.node]
            assert isinstance(node, Leaf)
            count += 1
            if limit is not None and count > limit:
                raise UsageError(
                    f"the grammar has more than {limit:,} primitives; lower its order with -D"
                )
            place = compose_affine(world, item.state_from_leaf)
            label = item.attributes[_LABEL]
            # An attribute that nothing below reads has no value.
            number = -1 if math.isnan(label) else int(label)
            yield PlacedLeaf(
                node.solid.name, place, item.args, number, carved or cut, item.node, path
            )


def _operands(state: State) -> list[tuple[LeafItem | StateItem, bool]]:
    """Return the items of a state, and whether a difference or intersection changes them."""
    stack: list[list[tuple[LeafItem | StateItem, bool]]] = []
    for item in state.content or ():
        if not isinstance(item, Combine):
            stack.append([(item, False)])
            continue
        first = len(stack) - item.arity
        operands = stack[first:]
        del stack[first:]
        cut = item.operator is not UNION
        stack.append([(x, before or cut) for operand in operands for x, before in operand])
    return [x for operand in stack for x in operand]
