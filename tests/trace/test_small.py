"""Small operations as truth tables, and what holds for all blocks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import oracle
import pytest
import strategies as cases
from hypothesis import given
from hypothesis import strategies as st

from pcsg.grammar import load_text
from pcsg.graph.graph import Graph
from pcsg.graph.hulls import Hulls
from pcsg.graph.nodes import Node
from pcsg.graph.operators import DIFFERENCE, INTERSECTION
from pcsg.graph.unroll import enumerate_states
from pcsg.simd import WIDTH
from pcsg.trace.blocks import Blocks, build_blocks
from pcsg.trace.groups import (
    BLOCK,
    EMPTY,
    INSTANCE,
    LEAF,
    OPERATION,
    SMALL,
    Groups,
    OperationRecord,
    gather,
)
from pcsg.trace.small import MAX_PRIMITIVES, flatten_operation

BALLS = [cases.prefix("move", 0.25 * k, 0, 0) * cases.solid("sphere") for k in range(7)]


def groups_of(node: Node) -> Groups:
    states = enumerate_states(Graph(node))
    return gather(states, Hulls(states))


def truth(groups: Groups, operation: int, members: Iterator[bool]) -> tuple[bool, list[bool]]:
    """Evaluate an operation; take the membership in each leaf from an iterator, in text order."""
    record: OperationRecord = groups.operations[operation]
    operands = []
    flips: list[bool] = []
    for k, operand in enumerate(record.operands):
        inside = False
        for r in groups.groups[operand]:
            if r.kind == LEAF:
                value, below = next(members), [False]
            else:
                value, below = truth(groups, r.target, members)
            inside = inside or value
            flips += [f != (record.operator is DIFFERENCE and k > 0) for f in below]
        operands.append(inside)
    if record.operator is DIFFERENCE:
        return operands[0] and not any(operands[1:]), flips
    assert record.operator is INTERSECTION
    return all(operands), flips


@st.composite
def few_balls(draw: cases.Draw, count: int) -> Node:
    if count == 1:
        return draw(st.sampled_from(BALLS))
    left = draw(st.integers(1, count - 1))
    a, b = draw(few_balls(left)), draw(few_balls(count - left))
    operator = draw(st.sampled_from(["|", "&", "-"]))
    return a | b if operator == "|" else a & b if operator == "&" else a - b


@given(data=st.data())
def test_tables_are_the_operators(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, MAX_PRIMITIVES - 1))
    groups = groups_of(data.draw(few_balls(count)) & cases.prefix("uscale", 9) * BALLS[0])
    for k in range(len(groups.operations)):
        small = flatten_operation(groups, k)
        assert small is not None
        n = len(small.primitives)
        required = (1 << n) - 1
        for m in range(1 << n):
            expected, flips = truth(groups, k, iter([bool(m >> j & 1) for j in range(n)]))
            assert bool(small.table >> m & 1) == expected
            assert [p.flipped for p in small.primitives] == flips
            if expected:
                required &= m
        assert small.required == required
        assert small.table >> (1 << n) == 0


def test_large_operations_have_no_table() -> None:
    union = BALLS[0]
    for ball in BALLS[1:6]:
        union = union | ball
    # Seven primitives; one fewer has a table.
    assert flatten_operation(groups_of(union - BALLS[6]), 0) is None
    fits = flatten_operation(groups_of((BALLS[0] | BALLS[1]) - BALLS[6]), 0)
    assert fits is not None
    assert len(fits.primitives) == 3
    assert fits.table == 0b0000_1110  # in the first or the second, not in the third
    assert fits.required == 0


# Blocks


def make_blocks(graph: Graph) -> Blocks:
    return build_blocks(graph, enumerate_states(graph))


def successors(blocks: Blocks, block: int) -> Iterator[tuple[int, int, int]]:
    """Yield place in the block, kind and index of what a block holds."""
    for k in range(WIDTH):
        code = int(blocks.refs[WIDTH * block + k])
        if code & 7 != EMPTY:
            yield k, code & 7, code >> 3


def reachable(blocks: Blocks) -> tuple[set[int], set[int], set[int], set[int]]:
    """Return the blocks, references, operations and smalls that the root leads to."""
    seen: set[int] = set()
    references: set[int] = set()
    operations: set[int] = set()
    smalls: set[int] = set()
    todo = [blocks.root]
    while todo:
        block = todo.pop()
        if block in seen:
            continue
        seen.add(block)
        for _, kind, index in successors(blocks, block):
            if kind == BLOCK:
                todo.append(index)
                continue
            references.add(index)
            target = int(blocks.targets[index])
            if kind == INSTANCE:
                todo.append(target)
            elif kind == OPERATION:
                operations.add(target)
                count = int(blocks.operations[target + 1])
                todo += blocks.operations[target + 3 : target + 3 + count].tolist()
            elif kind == SMALL:
                smalls.add(target)
                entries = blocks.smalls[target + 3 :][: 3 * int(blocks.smalls[target])]
                references.update(entries[::3].tolist())
            else:
                assert kind == LEAF
                assert 4 * target < len(blocks.leaves)
    return seen, references, operations, smalls


def assert_all_reachable(blocks: Blocks, is_empty: bool) -> None:
    seen, references, operations, smalls = reachable(blocks)
    assert seen == set(range(blocks.n_blocks))
    if not is_empty:
        assert references == set(range(len(blocks.targets)))
    assert sum(int(blocks.operations[k + 1]) + 3 for k in operations) in (
        len(blocks.operations),
        len(blocks.operations) - 1,  # the place that stands for none
    )
    assert len(smalls) == (len(blocks.tables) if smalls else 0) or len(blocks.tables) == 1


def check_boxes(blocks: Blocks) -> None:
    """Require that the boxes of a block's children lie in the block's box above them."""
    for block in range(blocks.n_blocks):
        planes = blocks.boxes[6 * WIDTH * block :][: 6 * WIDTH].reshape(6, WIDTH)
        for k, kind, index in successors(blocks, block):
            low, high = planes[:3, k], planes[3:, k]
            assert (low <= high).all()
            if kind == BLOCK:
                below = blocks.boxes[6 * WIDTH * index :][: 6 * WIDTH].reshape(6, WIDTH)
                assert (below[:3].min(axis=1) >= low).all()
                assert (below[3:].max(axis=1) <= high).all()


CORNERS = list(itertools.product((-0.999, 0.999), repeat=3))
INNER_POINTS = {
    "box": CORNERS,
    "sphere": [(0.577 * x, 0.577 * y, 0.577 * z) for x, y, z in CORNERS],
}


def assert_points_are_in_boxes(graph: Graph, blocks: Blocks) -> None:
    """Require a way through boxes to a leaf for points of the solid."""
    for leaf in oracle.leaves(graph):
        for p in INNER_POINTS.get(leaf.name, []):
            x = np.array([np.dot(row[:3], p) + row[3] for row in leaf.frame])
            if oracle.contains(graph, tuple(x)):
                assert is_covered(blocks, x), (leaf, p)


def is_covered(blocks: Blocks, point: np.ndarray) -> bool:
    stack = [(blocks.root, point)]
    while stack:
        block, x = stack.pop()
        planes = blocks.boxes[6 * WIDTH * block :][: 6 * WIDTH].reshape(6, WIDTH)
        for k, kind, index in successors(blocks, block):
            if not ((planes[:3, k] <= x) & (x <= planes[3:, k])).all():
                continue
            if kind == BLOCK:
                stack.append((index, x))
            elif kind == INSTANCE:
                m = blocks.inverses[12 * index :][:12].reshape(3, 4)
                stack.append((int(blocks.targets[index]), m[:, :3] @ x + m[:, 3]))
            else:
                return True
    return False


@given(data=st.data())
def test_blocks_of_random_graphs(data: st.DataObject) -> None:
    graph = data.draw(st.one_of(cases.solid_graphs(), cases.graphs()))
    blocks = make_blocks(graph)
    assert_all_reachable(blocks, blocks.refs[WIDTH * blocks.root] & 7 == EMPTY)
    check_boxes(blocks)
    assert_points_are_in_boxes(graph, blocks)


GRID = """
{{c={order}}} M
M if(c > 0, 2, 1)
1: M -> (sphere - move(0.5,0,0) box) | uscale(0.5) box
2: M -> {{c=c-1}} move(2,0,0) uscale(0.5) M | {{c=c-1}} move(-2,0,0) uscale(0.5) rotz(90) M
      | {{c=c-1}} move(0,2,1) uscale(0.5) M | (box - {{c=c-1}} uscale(0.5) M)
"""


@pytest.mark.parametrize("order", [1, 3, 6])
def test_blocks_of_a_grammar_with_operations(order: int) -> None:
    graph = load_text(GRID.format(order=order))
    blocks = make_blocks(graph)
    seen, *_ = reachable(blocks)
    assert len(seen) > 1
    assert_all_reachable(blocks, False)
    check_boxes(blocks)
    if order == 1:
        assert_points_are_in_boxes(graph, blocks)
    kinds = {kind for b in seen for _, kind, _ in successors(blocks, b)}
    assert {SMALL, LEAF} <= kinds
    assert (BLOCK in kinds) == (order > 1)
    assert order == 1 or OPERATION in kinds


def test_the_blocks_of_nothing() -> None:
    empty = make_blocks(Graph(cases.solid("empty")))
    assert empty.n_blocks == 1
    assert list(successors(empty, empty.root)) == []
    # Its operands are not empty, but nothing leads to them.
    apart = make_blocks(Graph(cases.solid("box") & cases.prefix("move", 9, 0, 0) * BALLS[0]))
    assert list(successors(apart, apart.root)) == []
    assert apart.n_blocks == 1


def test_unbounded_references_have_unbounded_boxes() -> None:
    blocks = make_blocks(Graph(cases.solid("halfspace") | cases.solid("sphere")))
    check_boxes(blocks)
    assert math.inf in np.abs(blocks.boxes[:24])[np.isfinite(blocks.boxes[:24]) == 0]
    assert is_covered(blocks, np.array([1e9, -1e9, -5.0]))
