"""Hierarchies hold everything once, within their boxes, and are never deeper than a stack."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pcsg.geometry.bvh import BLOCK, EMPTY, RUN, STACK, Hierarchy, build_hierarchy
from pcsg.simd import WIDTH
from pcsg.trace.binary import BinaryTree, area_of


def visit(made: Hierarchy, boxes: Any, block: int = 0) -> tuple[Any, int]:
    """Return the items below a block, and how many references wait at most; check their boxes."""
    refs = made.refs[WIDTH * block : WIDTH * (block + 1)]
    planes = made.boxes.reshape(-1, 6, WIDTH)[block].astype(float)
    found = []
    used = int((refs != EMPTY).sum())
    assert used > 1 or block == 0  # so many blocks are enough as there are items
    waiting = used
    for k, ref in enumerate(refs.tolist()):
        if ref == EMPTY:
            assert (planes[:3, k] > planes[3:, k]).all()
            continue
        if ref & 7 == BLOCK:
            items, below = visit(made, boxes, ref >> 3)
            waiting = max(waiting, used - 1 + below)
        else:
            assert ref & 7 == RUN
            items = made.order[made.begins[ref >> 3] : made.begins[(ref >> 3) + 1]]
            assert len(items)
        lower, upper = boxes[items, :3].min(axis=0), boxes[items, 3:].max(axis=0)
        room = 2e-6 * np.abs(boxes[items]).max()
        assert (planes[:3, k] <= lower).all() and (planes[:3, k] >= lower - room).all()
        assert (planes[3:, k] >= upper).all() and (planes[3:, k] <= upper + room).all()
        found.append(items)
    return np.concatenate(found), waiting


@pytest.mark.parametrize("most", [1, 8])
@pytest.mark.parametrize("count", [1, 2, 5, 17, 300, 5_000])
def test_a_hierarchy_holds_every_item_once(count: int, most: int) -> None:
    rng = np.random.default_rng(count)
    centers, radii = rng.uniform(-1.0, 1.0, (count, 3)), rng.uniform(0.0, 0.1, (count, 3))
    if count == 5:
        centers[:] = 0.5  # nothing to tell them apart
    boxes = np.hstack([centers - radii, centers + radii])
    made = build_hierarchy(boxes, most)
    assert np.diff(made.begins).max() <= most
    items, _ = visit(made, boxes)
    assert sorted(items.tolist()) == list(range(count))


def test_runs_are_nearly_full() -> None:
    rng = np.random.default_rng(0)
    centers = rng.uniform(-1.0, 1.0, (4_000, 3))
    made = build_hierarchy(np.hstack([centers - 0.01, centers + 0.01]), 8)
    assert len(made.begins) - 1 <= 4_000 / 6


@pytest.mark.parametrize("most", [1, 8])
def test_what_waits_fits_the_stack_however_uneven_boxes_are(most: int) -> None:
    # Every cut by areas takes the outermost off.
    size = 1.01 ** np.arange(-6_900.0, 1_000.0)
    centers = np.stack([size, np.zeros_like(size), np.zeros_like(size)], axis=1)
    boxes = np.hstack([centers * 0.999, centers * 1.001])
    items, waiting = visit(build_hierarchy(boxes, most), boxes)
    assert len(items) == len(size)
    assert waiting <= STACK


@pytest.mark.parametrize("count", [40, 700])
def test_rays_visit_hardly_more_blocks_than_of_the_best_collapse(count: int) -> None:
    rng = np.random.default_rng(count)
    centers = rng.uniform(-1.0, 1.0, (count, 3))
    radii = rng.uniform(0.0, 0.1, (count, 1))
    boxes = np.hstack([centers - radii, centers + radii])
    made = build_hierarchy(boxes)
    planes = made.boxes.reshape(-1, 6, WIDTH).astype(float)
    visits = sum(area_of(np.concatenate([p[:3].min(axis=1), p[3:].max(axis=1)])) for p in planes)
    tree = BinaryTree(boxes)
    best, todo = 0.0, [0]
    while todo:
        node = todo.pop()
        best += area_of(tree.hulls[node])
        todo += [part for part in tree.parts(node) if part not in tree.items]
    assert visits <= 1.08 * best
