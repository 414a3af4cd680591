"""Flattening: an expression of fields becomes the arrays that kernels read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.blobtree.blends import BLENDS
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
from pcsg.blobtree.bvh import build_hierarchy
from pcsg.blobtree.evaluate import frame_of
from pcsg.blobtree.fields import REACH, T
from pcsg.blobtree.layout import (
    ABOUT,
    ARGS,
    ATTRIBUTES,
    ATTRIBUTES_AT,
    CHAIN,
    CONSTANT,
    COUNT,
    FLOATS,
    FULL_ROW,
    HEADER,
    NODES,
    NODES_AT,
    OPERATOR,
    OPERATORS,
    OPERATORS_AT,
    PARENT,
    PRIMITIVE,
    ROW,
    SLIM,
    SLIM_ROW,
    UV_AT,
    Pool,
)
from pcsg.blobtree.native import (
    CROSSINGS,
    DESCRIPTION,
    FIELD,
    GRADIENT,
    MOST,
    address,
    ask_batch,
)
from pcsg.blobtree.nodes import Bent, Combination, Cones, Field, Painted, Placed, Primitive
from pcsg.blobtree.points import ATTRIBUTE_COLUMNS, BOUND, MODEL_SLOTS, U, V
from pcsg.blobtree.skeletons import SKELETONS
from pcsg.blobtree.trace import ALL, ANY, FIRST
from pcsg.errors import EnvironmentFault
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


class Flattener:
    """Collects the arrays of one expression."""

    def __init__(self, root: Field) -> None:
        self.boxes = find_boxes(root)
        self.segments: list[_Rows] = []
        self.count = 0
        self.floats: list[float] = []
        self.chains: list[int] = []
        self.chain_numbers: dict[tuple[int, ...], tuple[int, float, float]] = {}
        self.operators: list[list[int]] = []
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
                self.operators[at][1] = self.count
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
        at = len(self.floats)
        self.floats.extend(blend.arguments(args, children))
        number = len(self.operators)
        anchor = number
        if blend.alone:
            anchor = self.operators[parent][5] if parent >= 0 else -1
        self.operators.append([parent, 0, blend.kind, slot, at, anchor])
        return number

    def _add_operator(
        self, node: Combination, at: _Place, todo: list[tuple[Field | None, Any]]
    ) -> None:
        blend = node.blend
        if blend.name == "weight" and _is_lone(node.children[0]):
            todo.append((node.children[0], at._replace(weight=at.weight * node.args[0])))
            return
        if blend.flat and blend.alone and self.operators[at.parent][2] == blend.kind:
            number = at.parent
        else:
            number = self._open(blend.name, at.parent, at.slot, node.args, len(node.children))
            todo.append((None, number))
        order = list(range(len(node.children)))
        if not blend.slotted and len(order) > 8:
            order = self._spatial(node)
        for slot in reversed(order):
            child = node.children[slot]
            place = at._replace(parent=number, slot=slot)
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
        if at.weight == 1.0 and skeleton.slim and similar is not None:
            length, foot = skeleton.slim_row(args)
            axis = similar[1] * at.matrix[:, 2] / similar[0]
            scale = similar[0]
            # A length of zero keeps the direction; the reach's sign says so.
            vector = axis * (scale * length if length > 0.0 else 1.0)
            signed = scale * reach * (1.0 if length > 0.0 else -1.0)
            row = np.array([*at.matrix[:, 3], *vector, scale * foot, signed])[None]
            lower, upper = cone_boxes(row[:, :3], row[:, 3:6], row[:, 6], row[:, 7])
            about = skeleton.kind + SLIM + ATTRIBUTES * at.attributes
            turn = _turn_of(at.matrix[:, 0] / scale, axis)
            uv = np.array([[turn, 0.0]], np.float32)
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
        about = skeleton.kind + ATTRIBUTES * at.attributes
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
        about = SKELETONS["cone"].kind + SLIM + ATTRIBUTES * at.attributes
        uv = np.zeros((len(rows), 2), np.float32) if node.uv is None else node.uv
        if node.groups is not None:
            self._add_groups(node, at, rows, about, lower, upper, uv)
            return
        parent = at.parent
        if self.operators[parent][2] != BLENDS[node.blend].kind:
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
        outer = self.operators[parent][2] != BLENDS["sum"].kind
        if outer:
            parent = self._open("sum", at.parent, at.slot, (), len(node.groups))
        ends = [*node.groups[1:].tolist(), len(rows)]
        for a, b in zip(node.groups.tolist(), ends, strict=True):
            number = self._open(node.blend, parent, at.slot, (), b - a)
            place = at._replace(parent=number)
            self._add(rows[a:b], about, place, lower[a:b], upper[a:b], uv[a:b])
            self.operators[number][1] = self.count
        if outer:
            self.operators[parent][1] = self.count

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
    a = matrix[:, :3]
    square = a.T @ a
    scale2 = float(np.trace(square)) / 3.0
    if np.abs(square - scale2 * np.eye(3)).max() > 1e-13 * scale2:
        return None
    return math.sqrt(scale2), math.copysign(1.0, float(np.linalg.det(a)))


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


class Model:
    """A field, flattened; immutable.

    Parameters
    ----------
    root
        The expression.

    Attributes
    ----------
    primitives, operators
        Their numbers; operators that merely group do not count.
    pool
        The three arrays, float64, float32, int32.
    bounds : float64 (2, 3)
        A box that contains the solid.
    """

    def __init__(self, root: Field) -> None:
        flat = Flattener(root)
        n = flat.count
        self.primitives = n
        self.operators = sum(1 for op in flat.operators if op[2] != BLENDS["sum"].kind or op[0] < 0)
        lower = np.concatenate([s.lower for s in flat.segments] or [np.zeros((0, 3))])
        upper = np.concatenate([s.upper for s in flat.segments] or [np.zeros((0, 3))])
        box = (lower.min(axis=0), upper.max(axis=0)) if n else (np.zeros(3), np.zeros(3))
        boxes, codes = build_hierarchy(np.concatenate([lower, upper], axis=1))
        # float64: header, operators' numbers and chains, attributes, rows.
        extra = np.array([*(0.5 * (box[0] + box[1])), 0.5 * float(np.linalg.norm(box[1] - box[0]))])
        operators_numbers = np.array(flat.floats, np.float64)
        attributes = np.array(flat.attribute_rows, np.float64).ravel()
        shift = FLOATS
        attributes_at = shift + len(operators_numbers)
        rows_at = attributes_at + len(attributes)
        widths = [(SLIM_ROW if s.about & SLIM else FULL_ROW) for s in flat.segments]
        rows, at = [], rows_at
        table = np.empty((n, PRIMITIVE), np.int32)
        k = 0
        chains_at = PRIMITIVE * n
        for segment, width in zip(flat.segments, widths, strict=True):
            m = len(segment.rows)
            block = np.asarray(segment.rows, np.float64).reshape(m, width)
            if width == FULL_ROW:
                block = block.copy()
                block[:, CHAIN] += np.where(block[:, CHAIN] >= 0.0, chains_at, 0.0)
                if (segment.about & (SLIM - 1)) == SKELETONS["polygon"].kind:
                    block[:, CONSTANT + 1] += shift
            table[k : k + m, ROW] = at + width * np.arange(m)
            table[k : k + m, PARENT] = segment.parent
            table[k : k + m, ABOUT] = segment.about
            rows.append(block.ravel())
            at, k = at + m * width, k + m
        ops = np.array(flat.operators, np.int32).reshape(-1, OPERATOR)
        ops[:, ARGS] += shift
        chains = np.array(flat.chains, np.int32)
        _shift_chains(chains, shift)
        uv = np.concatenate([s.uv for s in flat.segments] or [np.zeros((0, 2), np.float32)])
        uv_at = boxes.size if np.any(uv) else -1
        header = np.zeros(HEADER, np.int32)
        header[COUNT], header[OPERATORS], header[NODES] = n, len(ops), len(codes)
        header[OPERATORS_AT] = HEADER + table.size + chains.size
        header[NODES_AT] = header[OPERATORS_AT] + ops.size
        header[UV_AT], header[ATTRIBUTES_AT] = uv_at, attributes_at
        self.pool: Pool = (
            np.concatenate([extra, operators_numbers, attributes, *rows]),
            np.concatenate([boxes.ravel(), uv.ravel() if uv_at >= 0 else uv.ravel()[:0]]),
            np.concatenate([header, table.ravel(), chains, ops.ravel(), codes]),
        )
        self.support = np.stack(box)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays in bytes."""
        return sum(a.nbytes for a in self.pool)

    @property
    def bounds(self) -> Array:
        """A box (2, 3) that contains the solid."""
        return self.support.copy()

    def field(self, points: ArrayLike) -> Array:
        """Return the field at points (N, 3); the solid is where it is 0.5 or more."""
        return self._ask(FIELD, points, 1)[:, 0]

    def gradient(self, points: ArrayLike) -> Array:
        """Return the gradient (N, 3) of the field at points (N, 3); it points inwards."""
        return self._ask(GRADIENT, points, 3)

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether points (N, 3) are in the solid."""
        inside: NDArray[np.bool_] = self.field(points) >= T
        return inside

    def attributes(self, points: ArrayLike) -> dict[str, Array]:
        """Return attributes of points (N, 3).

        Returns
        -------
        dict
            ``color`` (N, 3), mixed by what primitives contribute, and ``label`` (N,), the
            strongest primitive's, NaN where there is none; ``bound`` (N,), the share of bounded
            blends; ``uv`` (N, 2); every other attribute by the name of its slot.
        """
        out = self._ask(DESCRIPTION, points, ATTRIBUTE_COLUMNS)
        named = {name: out[:, k] for k, name in enumerate(MODEL_SLOTS) if k >= 3}
        named["label"] = named.pop("@label")
        return named | {"color": out[:, :3], "bound": out[:, BOUND], "uv": out[:, [U, V]]}

    def _ask(self, asked: int, points: ArrayLike, columns: int) -> Array:
        where = np.asarray(points, np.float64).reshape(-1, 3)
        rays = np.zeros((len(where), 8))
        rays[:, :3] = where
        out = np.zeros(len(where) * columns)
        counts = np.zeros(len(where), np.int64)
        done, _used = ask_batch(
            address(), asked, 0, self.pool, rays, 0, len(where), columns, out, counts, 0
        )
        if done < len(where):
            raise EnvironmentFault(_CROWDED)
        return out.reshape(-1, columns)

    def shoot(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        want: int = ALL,
        t_min: float = 0.0,
        t_max: float = math.inf,
    ) -> tuple[NDArray[np.int64], Array]:
        """Return the crossings of rays.

        Parameters
        ----------
        origins, directions : array_like (N, 3)
            Directions of any length but zero; t counts in them.
        want
            `ALL` crossings of the whole line, alternately entering and leaving, or the `FIRST` in
            [t_min, t_max].

        Returns
        -------
        counts : int64 (N,)
        t : float64
            One ray's after the other's.
        """
        o = np.asarray(origins, np.float64).reshape(-1, 3)
        d = np.asarray(directions, np.float64).reshape(-1, 3)
        n = len(o)
        limits = np.broadcast_to(np.array([t_min, t_max]), (n, 2))
        rays = np.ascontiguousarray(np.concatenate([o, d, limits], axis=1))
        counts, t = np.zeros(n, np.int64), np.empty(4 * n + 64)
        done, used, seen = 0, 0, -1
        while done < n:
            done, used = ask_batch(
                address(), CROSSINGS, want, self.pool, rays, done, n, 0, t, counts, used
            )
            if done < n:
                if done == seen and len(t) - used > MOST:
                    raise EnvironmentFault(_CROWDED)
                seen = done
                t = np.concatenate([t, np.empty(len(t) + MOST)])
        return counts, t[:used]

    def intersect(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: float = 0.0,
        t_max: float = math.inf,
    ) -> Array:
        """Return the first crossing of every ray in [t_min, t_max], infinite if there is none."""
        counts, t = self.shoot(origins, directions, FIRST, t_min, t_max)
        out = np.full(len(counts), math.inf)
        out[counts > 0] = t
        return out

    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: float = 0.0,
        t_max: float = math.inf,
    ) -> NDArray[np.bool_]:
        """Return whether every ray crosses the surface in [t_min, t_max]."""
        counts, _t = self.shoot(origins, directions, ANY, t_min, t_max)
        hit: NDArray[np.bool_] = counts > 0
        return hit


_CROWDED = f"a ray crosses more than {MOST} fields"


def _shift_chains(chains: NDArray[np.int32], shift: int) -> None:
    """Count the numbers of warps from the beginning of the floats, in place."""
    at = 0
    while at < len(chains):
        count = int(chains[at])
        chains[at + 2 : at + 2 * count + 1 : 2] += shift
        at += 2 * count + 1
