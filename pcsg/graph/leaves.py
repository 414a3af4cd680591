"""Every primitive of a grammar, placed in the world: what the graph avoids, for small scenes.

For what needs the solids one by one, such as skeletons of trees. There is no recursion on depth:
states that wait are on a stack.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from pcsg.errors import UsageError
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.code import compose_affine
from pcsg.graph.nodes import Leaf
from pcsg.graph.operators import UNION
from pcsg.graph.states import Combine, LeafItem, State, StateGraph, StateItem
from pcsg.vec import IDENTITY, Affine

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
    """

    name: str
    world_from_leaf: Affine
    args: tuple[float, ...]
    label: int
    carved: bool


def placed_leaves(states: StateGraph, limit: int) -> Iterator[PlacedLeaf]:
    """Yield the primitives of a scene in the order of the text.

    Parameters
    ----------
    limit
        Most primitives.

    Raises
    ------
    UsageError
        There are more, or the states could not be enumerated.
    """
    if not (states.finite and states.acyclic):
        raise UsageError("the grammar has too many states to be expanded; lower its order with -D")
    graph = states.graph
    visible = [_operands(state) for state in states.states]
    stack: list[tuple[int, int, Affine, bool]] = [(0, 0, IDENTITY, False)]
    count = 0
    while stack:
        k, at, world, carved = stack.pop()
        items = visible[k]
        while at < len(items):
            item, cut = items[at]
            at += 1
            if isinstance(item, StateItem):
                stack.append((k, at, world, carved))
                place = compose_affine(world, item.state_from_child)
                stack.append((item.state, 0, place, carved or cut))
                break
            node = graph.nodes[item.node]
            assert isinstance(node, Leaf)
            count += 1
            if count > limit:
                raise UsageError(
                    f"the grammar has more than {limit:,} primitives; lower its order with -D"
                )
            place = compose_affine(world, item.state_from_leaf)
            label = item.attributes[_LABEL]
            # An attribute that nothing below reads has no value.
            number = -1 if math.isnan(label) else int(label)
            yield PlacedLeaf(node.solid.name, place, item.args, number, carved or cut)


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
