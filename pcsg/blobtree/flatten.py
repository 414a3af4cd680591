"""Flattening: an expression of fields becomes rows of primitives and operators, depth first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.blends import BLENDS, Blend
from pcsg.blobtree.boxes import (
    Corners,
    along_curve,
    clip_of,
    cone_boxes,
    find_boxes,
    intersect,
    is_empty,
    range_of,
    transform,
)
from pcsg.blobtree.fields import REACH
from pcsg.blobtree.layout import ANCHOR, ATTRIBUTES, LOOSE, SILENT, SLIM, SLOT
from pcsg.blobtree.meeting import frame_of
from pcsg.blobtree.nodes import Bent, Combination, Cones, Field, Painted, Placed, Primitive
from pcsg.blobtree.points import MODEL_SLOTS
from pcsg.blobtree.skeletons import SKELETONS
from pcsg.jit import plain
from pcsg.vec import Vec3

Array = NDArray[np.float64]

IDENTITY = np.eye(3, 4)


class _Link(NamedTuple):
    """A map or a warp between a node's frame and the next one towards the root."""

    matrix: Array | None
    node: Bent | None
    support: Corners | None
    height: float


class _Place(NamedTuple):
    """Where a node stands: what it hands down to its children."""

    parent: int
    slot: int
    links: tuple[_Link, ...]
    matrix: Array
    weight: float
    attributes: int
    clip: Corners | None
    silent: bool = False

    @property
    def flags(self) -> int:
        """What a primitive here says of itself besides its kind."""
        return SILENT * self.silent + ATTRIBUTES * self.attributes


def invert(m: Array) -> Array:
    """Return the inverse of a map (3, 4)."""
    a = np.linalg.inv(m[:, :3])
    return np.concatenate([a, (-a @ m[:, 3])[:, None]], axis=1)


def compose(a: Array, b: Array) -> Array:
    """Return the map p -> a(b(p))."""
    return np.concatenate([a[:, :3] @ b[:, :3], (a[:, :3] @ b[:, 3] + a[:, 3])[:, None]], axis=1)


def push_box(links: tuple[_Link, ...], matrix: Array, box: Corners) -> Corners:
    """Return a box of a box in the frame behind all links, in the frame of the root."""
    box = transform(matrix, box)
    for link in reversed(links):
        if is_empty(box):
            return box
        if link.node is not None:
            assert link.support is not None
            inside = intersect(box, link.support)
            if is_empty(inside):
                return inside
            *_, box = link.node.warp.constants(link.node.args, link.height, inside)
        assert link.matrix is not None
        box = transform(link.matrix, box)
    return box


class _Rows(NamedTuple):
    """Consecutive primitives of one operator.

    Attributes
    ----------
    rows
        One list of numbers each, or an array of slim rows.
    about
        Kind, flags and attributes, the same for all.
    lower, upper : (N, 3)
        Supports, as far as they matter.
    """

    rows: list[list[float]] | Array
    about: int
    parent: int
    lower: Array
    upper: Array
    uv: NDArray[np.float32]


@dataclass
class _Operator:
    """An operator; the numbers of its primitives end at `end`."""

    parent: int
    blend: type[Blend]
    slot: int
    args: int
    loose: bool
    end: int = 0

    def row(self, shift: int) -> tuple[int, int, int, int]:
        """Return it as the arrays have it, its numbers behind `shift` others."""
        what = self.blend.kind + SLOT * self.slot
        what += ANCHOR * (not self.blend.alone) + LOOSE * self.loose
        return self.parent, self.end, what, self.args + shift


class Flattener:
    """Collects the arrays of one expression."""

    def __init__(self, root: Field) -> None:
        self.boxes = find_boxes(root)
        self.segments: list[_Rows] = []
        self.count = 0
        self.floats: list[float] = []
        self.chains: list[int] = []
        self.chain_numbers: dict[tuple[int, ...], tuple[int, float, float]] = {}
        self.operators: list[_Operator] = []
        self.args_at: dict[tuple[float, ...], int] = {}
        self.attribute_rows: list[tuple[float, ...]] = [(math.nan,) * len(MODEL_SLOTS)]
        self.attribute_numbers = {self.attribute_rows[0]: 0}
        # What is known by its identity must stay.
        self._keep: list[Field] = []
        self._links: list[tuple[_Link, ...]] = []
        self._walk(root)

    def _walk(self, root: Field) -> None:
        top = self._open("sum", -1, 0, (), 1)
        first = _Place(top, 0, (), IDENTITY, 1.0, 0, None)
        todo: list[tuple[Field | None, Any]] = [(None, top), (root, first)]
        while todo:
            node, at = todo.pop()
            if node is None:
                self.operators[at].end = self.count
                continue
            if at.clip is not None and is_empty(at.clip):
                continue
            if isinstance(node, Placed):
                todo.append((node.child, at._replace(matrix=compose(at.matrix, node.matrix))))
            elif isinstance(node, Painted):
                number = self._attributes(at.attributes, node.attributes)
                todo.append((node.child, at._replace(attributes=number)))
            elif isinstance(node, Bent):
                support, core = self.boxes[id(node.child)]
                if not is_empty(support):
                    link = _Link(at.matrix, node, support, range_of(node, core))
                    links = (*at.links, link)
                    todo.append((node.child, at._replace(links=links, matrix=IDENTITY)))
            elif isinstance(node, Primitive):
                self._add_primitive(node, at)
            elif isinstance(node, Cones):
                self._add_cones(node, at, todo)
            elif isinstance(node, Combination):
                self._add_operator(node, at, todo)

    def _attributes(self, number: int, changes: Mapping[str, float]) -> int:
        # The innermost wins, field by field.
        row = list(self.attribute_rows[number])
        for name, value in changes.items():
            row[MODEL_SLOTS.index(name)] = float(value)
        key = tuple(row)
        if key not in self.attribute_numbers:
            self.attribute_numbers[key] = len(self.attribute_rows)
            self.attribute_rows.append(key)
        return self.attribute_numbers[key]

    def _open(
        self, name: str, parent: int, slot: int, args: tuple[float, ...], children: int
    ) -> int:
        blend = BLENDS[name]
        numbers = tuple(blend.arguments(args, children))
        if numbers not in self.args_at:
            self.args_at[numbers] = len(self.floats)
            self.floats.extend(numbers)
        loose = blend.alone and (parent < 0 or self.operators[parent].loose)
        self.operators.append(_Operator(parent, blend, slot, self.args_at[numbers], loose))
        return len(self.operators) - 1

    def _add_operator(
        self, node: Combination, at: _Place, todo: list[tuple[Field | None, Any]]
    ) -> None:
        blend = node.blend
        if blend.name == "weight" and _is_lone(node.children[0]):
            todo.append((node.children[0], at._replace(weight=at.weight * node.args[0])))
            return
        above = self.operators[at.parent].blend
        if len(node.children) == 1 and blend.name == "sum" and not above.slotted:
            todo.append((node.children[0], at))
            return
        if blend.flat and blend.alone and above is blend:
            number = at.parent
        else:
            number = self._open(blend.name, at.parent, at.slot, node.args, len(node.children))
            todo.append((None, number))
        order = list(range(len(node.children)))
        if not blend.slotted and len(order) > 8:
            order = self._spatial(node)
        for slot in reversed(order):
            child = node.children[slot]
            silent = at.silent or blend.is_silent(slot)
            place = at._replace(parent=number, slot=slot, silent=silent)
            clip = clip_of(node, slot, self.boxes)
            if clip is not None:
                box = push_box(at.links, at.matrix, clip)
                place = place._replace(clip=box if at.clip is None else intersect(at.clip, box))
            if blend.slotted:
                # An operator of its own tells which child it is; primitives do not.
                child = Combination(BLENDS["sum"], (child,))
                self._keep.append(child)
            todo.append((child, place))

    def _spatial(self, node: Combination) -> list[int]:
        """Return the children in the order of a space-filling curve."""
        boxes = [self.boxes[id(child)][0] for child in node.children]
        centres = np.array([0.5 * (b[0] + b[1]) for b in boxes])
        centres[~np.isfinite(centres)] = 0.0
        return [int(k) for k in along_curve(centres)]

    def _add_primitive(self, node: Primitive, at: _Place) -> None:
        skeleton, args = node.skeleton, node.args
        reach = skeleton.reach(args)
        similar = _similarity(at.matrix) if not at.links else None
        if at.weight == 1.0 and skeleton.slim and similar is not None and similar[1] > 0.0:
            # Not mirrored: a slim row knows no other way round its axis.
            length, foot = skeleton.slim_row(args)
            scale = similar[0]
            axis = at.matrix[:, 2] / scale
            # A length of zero keeps the direction; the reach's sign says so.
            vector = axis * (scale * length if length > 0.0 else 1.0)
            signed = scale * reach * (1.0 if length > 0.0 else -1.0)
            row = np.array([*at.matrix[:, 3], *vector, scale * foot, signed])[None]
            lower, upper = cone_boxes(row[:, :3], row[:, 3:6], row[:, 6], row[:, 7])
            about = skeleton.kind + SLIM + at.flags
            turn = _turn_of(at.matrix[:, 0] / scale, axis)
            uv = np.array([[-turn, 0.0]], np.float32)
            self._add(row, about, at, lower, upper, uv)
            return
        support = self.boxes[id(node)][0]
        chain, speed, acceleration, local = -1, 1.0, 0.0, invert(at.matrix)
        if at.links:
            chain, speed, acceleration = self._chain(at.links)
            size = float(np.linalg.norm(local[:, :3], 2))
            speed, acceleration = speed * size, acceleration * size
        box = push_box(at.links, at.matrix, support)
        if is_empty(box):
            return
        kept = box if at.links else support
        constants = skeleton.constants(args, self.floats)
        full = [
            *local.ravel(), *kept[0], *kept[1], at.weight, 1.0 / reach**2, chain, speed,
            acceleration, *constants, *skeleton.curvature(args),
        ]  # fmt: skip
        about = skeleton.kind + at.flags
        self._add([full], about, at, box[0][None], box[1][None], np.zeros((1, 2), np.float32))

    def _add_cones(self, node: Cones, at: _Place, todo: list[tuple[Field | None, Any]]) -> None:
        similar = _similarity(at.matrix) if not at.links else None
        slim = at.weight == 1.0 and similar is not None and similar[1] >= 0.0
        if node.groups is not None and not (slim and at.clip is None):
            groups = node.parts
            for group in groups:
                self.boxes.update(find_boxes(group))
            self._keep.extend(groups)
            whole = Combination(BLENDS["sum"], groups)
            self._keep.append(whole)
            todo.append((whole, at))
            return
        if not slim or similar is None:
            parts = [_lone_cone(*values) for values in zip(
                node.start, node.axis, node.foot, node.reach, strict=True
            )]  # fmt: skip
            for part in parts:
                self.boxes.update(find_boxes(part))
            self._keep.extend(parts)
            whole = Combination(BLENDS[node.blend], tuple(parts))
            self._keep.append(whole)
            todo.append((whole, at))
            return
        scale, matrix = similar[0], at.matrix
        rows = np.empty((len(node.start), 8))
        rows[:, :3] = node.start @ matrix[:, :3].T + matrix[:, 3]
        rows[:, 3:6] = node.axis @ matrix[:, :3].T
        rows[:, 6], rows[:, 7] = scale * node.foot, scale * node.reach
        lower, upper = cone_boxes(rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7])
        about = SKELETONS["cone"].kind + SLIM + at.flags
        uv = np.zeros((len(rows), 2), np.float32) if node.uv is None else node.uv
        if node.groups is not None:
            self._add_groups(node, at, rows, about, lower, upper, uv)
            return
        # Their order does not matter, but the hierarchy follows it.
        order = along_curve(rows[:, :3] + 0.5 * rows[:, 3:6])
        rows, lower, upper, uv = rows[order], lower[order], upper[order], uv[order]
        parent = at.parent
        if len(rows) > 1 and self.operators[parent].blend is not BLENDS[node.blend]:
            parent = self._open(node.blend, at.parent, at.slot, (), len(node.start))
            todo.append((None, parent))
        self._add(rows, about, at._replace(parent=parent), lower, upper, uv)

    def _add_groups(
        self,
        node: Cones,
        at: _Place,
        rows: Array,
        about: int,
        lower: Array,
        upper: Array,
        uv: NDArray[np.float32],
    ) -> None:
        """Add an operator for each group, under a sum."""
        assert node.groups is not None
        parent = at.parent
        outer = self.operators[parent].blend is not BLENDS["sum"]
        if outer:
            parent = self._open("sum", at.parent, at.slot, (), len(node.groups))
        ends = [*node.groups[1:].tolist(), len(rows)]
        for a, b in zip(node.groups.tolist(), ends, strict=True):
            number = self._open(node.blend, parent, at.slot, (), b - a)
            place = at._replace(parent=number)
            self._add(rows[a:b], about, place, lower[a:b], upper[a:b], uv[a:b])
            self.operators[number].end = self.count
        if outer:
            self.operators[parent].end = self.count

    def _add(
        self,
        rows: list[list[float]] | Array,
        about: int,
        at: _Place,
        lower: Array,
        upper: Array,
        uv: NDArray[np.float32],
    ) -> None:
        if at.clip is not None:
            lower, upper = np.maximum(lower, at.clip[0]), np.minimum(upper, at.clip[1])
            if np.any(lower > upper):
                # Outside of what matters; the box must not be turned inside out.
                seen = ~np.any(lower > upper, axis=1)
                if not seen.any():
                    return
                rows = [r for r, s in zip(rows, seen, strict=True) if s]
                lower, upper, uv = lower[seen], upper[seen], uv[seen]
        self.segments.append(_Rows(rows, about, at.parent, lower, upper, uv))
        self.count += len(rows)

    def _chain(self, links: tuple[_Link, ...]) -> tuple[int, float, float]:
        """Return where a chain of warps is, and bounds of speed and acceleration behind it."""
        key = tuple(id(x) for link in links for x in (link.node, link.matrix))
        if key in self.chain_numbers:
            return self.chain_numbers[key]
        speed, acceleration = 1.0, 0.0
        entries: list[int] = []
        for link in links:
            assert link.matrix is not None
            assert link.node is not None
            assert link.support is not None
            local = invert(link.matrix)
            size = float(np.linalg.norm(local[:, :3], 2))
            speed, acceleration = speed * size, acceleration * size
            numbers, stretch, bend, _ = link.node.warp.constants(
                link.node.args, link.height, link.support
            )
            entries += [link.node.warp.kind, len(self.floats)]
            self.floats.extend([*local.ravel(), *numbers, speed])
            speed, acceleration = (
                stretch * speed,
                bend * speed * speed + stretch * acceleration,
            )
        self._links.append(links)
        at = len(self.chains)
        self.chains.extend([len(links), *entries])
        self.chain_numbers[key] = at, speed, acceleration
        return self.chain_numbers[key]


def _is_lone(node: Field) -> bool:
    """Return whether nothing but maps, warps and attributes stands above a single primitive."""
    while isinstance(node, (Placed, Bent, Painted)) or (
        isinstance(node, Combination) and node.blend.name == "weight"
    ):
        node = node.children[0] if isinstance(node, Combination) else node.child
    return isinstance(node, Primitive)


def _similarity(matrix: Array) -> tuple[float, float] | None:
    """Return scale and handedness of a map that keeps angles, None for another."""
    if matrix is IDENTITY:
        return 1.0, 1.0
    a = matrix[:, :3]
    square = a.T @ a
    scale2 = (float(square[0, 0]) + float(square[1, 1]) + float(square[2, 2])) / 3.0
    if np.abs(square - scale2 * IDENTITY[:, :3]).max() > 1e-13 * scale2:
        return None
    x, y, z = (Vec3(*row) for row in a.tolist())
    volume = (
        x.x * (y.y * z.z - y.z * z.y)
        - x.y * (y.x * z.z - y.z * z.x)
        + x.z * (y.x * z.y - y.y * z.x)
    )
    return math.sqrt(scale2), math.copysign(1.0, volume)


def _turn_of(x: Array, axis: Array) -> float:
    """Return the angle, in turns, from a slim primitive's own x to a direction across its axis."""
    u, w = plain(frame_of)(Vec3(*(float(v) for v in axis)))
    return math.atan2(float(x @ np.array(w)), float(x @ np.array(u))) / (2.0 * math.pi)


def _lone_cone(start: Array, axis: Array, foot: float, reach: float) -> Field:
    """Return one of `Cones` as a node of its own."""
    length = float(np.linalg.norm(axis))
    unit = axis / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    u, w = plain(frame_of)(Vec3(*(float(v) for v in unit)))
    rt = float(reach) / REACH
    matrix = np.stack([np.array(u), np.array(w), unit, start], axis=1)
    return Placed(matrix, Primitive(SKELETONS["cone"], (length, rt + float(foot), rt)))
