"""Boxes by interval arithmetic over the rules, for graphs with too many states.

The graph is interpreted with an interval for every parameter (Cousot and Cousot 1977, "Abstract
interpretation"). An *entry* is a module together with those values of its selection-live
parameters that are single numbers and not drawn at random, such as a counter: entries follow the
derivation level by level, and everything else is joined over all ways that lead to them. Fig 8's
terrain of order 10 has 22 entries.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS, ATTRIBUTE_SLOTS
from pcsg.graph.expr import Number, functions_of, operands, parameters_of, postorder
from pcsg.graph.extents import (
    ANY_EXTENT,
    NO_EXTENT,
    Extent,
    combine_extents,
    inflate_extent,
    join_extents,
    leaf_extent,
    lies_within,
    transform_extent,
)
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.graph import FRAME_SLOTS, GLOBALS, Graph, expressions
from pcsg.graph.hulls import EMPTY, EVERYTHING, INF, Bounds, join
from pcsg.graph.intervals import (
    ALL,
    Interval,
    Matrix,
    compose_matrices,
    evaluate,
    hull,
    is_point,
    keeps_distances,
    transform_matrix,
)
from pcsg.graph.liveness import Liveness, attribute_stores, attribute_values
from pcsg.graph.nodes import Attribute, Calculation, Leaf, Operation, Selection, Transformation
from pcsg.graph.operators import UNION, Operator
from pcsg.graph.ordering import successors_first
from pcsg.graph.unroll import cuts
from pcsg.vec import IDENTITY

ENTRIES = 600
"""Most entries; with more, a module is one entry whatever its parameters are."""

_SWEEPS = 8
_JOINS_BEFORE_WIDENING = 3
_FIXPOINT_ROUNDS = 40
_INFLATE_AFTER = 6

Values = dict[str, Interval]
Key = tuple[int, tuple[float | None, ...]]


class _Visit(NamedTuple):
    """A visit to a node, in postfix order; `arity` solids below it are combined."""

    node: int
    arity: int
    operator: Operator | None = None
    matrix: Matrix | None = None
    extent: Extent | None = None
    entry: Key | None = None


@dataclass
class _Entry:
    """What is known of a module for some values.

    Attributes
    ----------
    values
        Joined over all ways that lead here.
    visits
        Of all rules that the values allow.
    below
        Entries that are visited, with the values that are passed.
    joins
        How often the values grew while a cycle was iterated.
    """

    values: Values
    visits: list[_Visit] = field(default_factory=list)
    below: list[tuple[Key, Values]] = field(default_factory=list)
    joins: int = 0


def range_boxes(
    graph: Graph, globals_values: Mapping[str, float] | None = None
) -> tuple[list[Bounds], Bounds, Bounds]:
    """Return a box for every node in its own frame, of the scene, and of its bounded solids.

    They contain all visits, whatever values the parameters take on the way.
    """
    for by_values in (True, False):
        ranges = Ranges(graph, by_values)
        if ranges.run(globals_values):
            return ranges.boxes()
    boxes = [EVERYTHING] * len(graph.nodes)
    return boxes, EVERYTHING, EMPTY


def random_parameters(graph: Graph) -> set[str]:
    """Return the parameters that random numbers, or places in the world, can flow into."""
    assignments = [a for n in graph.nodes if isinstance(n, Calculation) for a in n.assignments]
    drawn = {slot for slot in FRAME_SLOTS if graph.uses_frame}
    changed = True
    while changed:
        changed = False
        for name, expr in assignments:
            if name not in drawn and (
                parameters_of(expr) & drawn
                or any(FUNCTIONS[f].form in _DRAWN for f in functions_of(expr))
            ):
                drawn.add(name)
                changed = True
    return drawn


_DRAWN = (Form.RANDOM, Form.WORLD, Form.COLUMN)


class Ranges:
    """The entries of a graph.

    Parameters
    ----------
    graph
        The graph.
    by_values
        Whether entries are told apart by the values of parameters that selections read, those left
        out that are drawn at random.

    Attributes
    ----------
    entries
        All of them after `run`; the axiom's has the key `root`.
    live
        Names of the live slots of every node.
    cuts
        Nodes where entries begin.
    """

    def __init__(self, graph: Graph, by_values: bool) -> None:
        self.graph = graph
        self.live = Liveness(graph).live
        selecting = Liveness(graph, selections_only=True).live if by_values else None
        drawn = random_parameters(graph)
        order = tuple(n for n in graph.slots if n not in drawn)
        self.keyed = [
            tuple(n for n in order if n in selecting[k]) if selecting else ()
            for k in range(len(graph.nodes))
        ]
        self.cuts = cuts(graph)
        self.root: Key = (-1, ())
        self.entries: dict[Key, _Entry] = {}
        self.above: dict[Key, dict[Key, None]] = {}
        constants = {
            e.value
            for node in graph.nodes
            for expr in expressions(node)
            for e in postorder(expr, operands)
            if isinstance(e, Number)
        }
        self.thresholds = sorted(constants | {-INF, -1.0, 0.0, 1.0, INF})

    def run(self, globals_values: Mapping[str, float] | None) -> bool:
        """Find all entries and their joined values; False if there are too many."""
        start: Values = {
            name: (value, value)
            for name, value in (
                *(GLOBALS | dict(globals_values or {})).items(),
                *zip(ATTRIBUTE_SLOTS, ATTRIBUTE_DEFAULTS, strict=True),
                *(zip(FRAME_SLOTS, IDENTITY, strict=True) if self.graph.uses_frame else ()),
            )
        }
        if not self._discover(self.root, start):
            return False
        # Sweeps in the order of the derivation join all ways to an entry before it is used;
        # joined values may reach new entries, which the next sweep puts into the order.
        for _ in range(_SWEEPS):
            known = len(self.entries)
            for component in self._components():
                if not self._settle(component):
                    return False
            if len(self.entries) == known:
                return True
        return False

    def _discover(self, key: Key, values: Values) -> bool:
        """Interpret an entry and those below it that are new, each once."""
        todo = [(key, values)]
        while todo:
            key, values = todo.pop()
            if key in self.entries:
                continue
            if len(self.entries) >= ENTRIES:
                return False
            entry = self.entries[key] = _Entry(values)
            self._interpret(key, entry)
            todo.extend(reversed(entry.below))
        return True

    def _components(self) -> list[list[Key]]:
        """Return the strongly connected components of the entries, those above first."""
        keys = list(self.entries)
        number = {key: k for k, key in enumerate(keys)}
        below = [list(dict.fromkeys(number[key] for key, _ in self.entries[k].below)) for k in keys]
        # Kosaraju's algorithm: collect against the edges, in the reverse order of finishing.
        above: list[list[int]] = [[] for _ in keys]
        for k, successors in enumerate(below):
            for s in successors:
                above[s].append(k)
        component = [-1] * len(keys)
        found: list[list[Key]] = []
        for k in reversed(successors_first(below)):
            if component[k] >= 0:
                continue
            members = [k]
            component[k] = len(found)
            for member in members:
                for s in above[member]:
                    if component[s] < 0:
                        component[s] = len(found)
                        members.append(s)
            found.append([keys[m] for m in members])
        return found

    def _settle(self, component: list[Key]) -> bool:
        """Join what is passed into a component, and iterate it until nothing grows."""
        inside = set(component)
        todo = list(component)
        for key in component:
            self.entries[key].joins = 0
        while todo:
            key = todo.pop(0)
            entry = self.entries[key]
            if key != self.root:
                values = self._joined(key)
                if entry.joins:
                    values = self._grown(entry, values)
                    if values == entry.values:
                        continue
                entry.values = values
            entry.joins += 1
            self._interpret(key, entry)
            for below, values in entry.below:
                if not self._discover(below, values):
                    return False
                if below in inside and below not in todo:
                    todo.append(below)
        return True

    def _joined(self, key: Key) -> Values:
        """Return the values that all ways to an entry pass."""
        joined: Values = {}
        for above in self.above[key]:
            for below, values in self.entries[above].below:
                if below == key:
                    for name, value in values.items():
                        joined[name] = hull(joined[name], value) if name in joined else value
        return joined

    def _grown(self, entry: _Entry, values: Values) -> Values:
        """Return an entry's values with those that arrive; ends that keep growing leap."""
        for name, value in entry.values.items():
            values[name] = hull(values[name], value) if name in values else value
        if entry.joins > _JOINS_BEFORE_WIDENING:
            return self._widen(entry.values, values)
        return values

    def _widen(self, old: Values, new: Values) -> Values:
        """Move ends that still grow to the next threshold, so that iteration ends."""
        found: Values = {}
        for name, (lower, upper) in new.items():
            a, b = old.get(name, (lower, upper))
            if lower < a:
                a = self.thresholds[bisect_right(self.thresholds, lower) - 1]
            if upper > b:
                b = self.thresholds[bisect_left(self.thresholds, upper)]
            found[name] = a, b
        return found

    def _interpret(self, key: Key, entry: _Entry) -> None:
        """Walk all rules that the entry's values allow."""
        entry.visits, entry.below = [], []
        start = max(key[0], 0)
        node = self.graph.nodes[start]
        if key[0] < 0 or not isinstance(node, Selection):
            self._walk(start, key, entry, opened=key[0])
            return
        rules = self.rules(key, entry.values)
        for number in rules:
            self._walk(self.graph.number[node.rules[number]], key, entry, opened=-1)
        entry.visits.append(_Visit(start, len(rules), UNION))

    def _walk(self, start: int, home: Key, entry: _Entry, opened: int) -> None:
        graph = self.graph
        stack: list[tuple[int, Values] | _Visit] = [(start, entry.values)]
        while stack:
            top = stack.pop()
            if isinstance(top, _Visit):
                entry.visits.append(top)
                continue
            n, values = top
            node = graph.nodes[n]
            below = graph.successors[n]
            if n in self.cuts and n != opened:
                passed = {name: values[name] for name in self.live[n] if name in values}
                key = self.key(n, values)
                entry.below.append((key, passed))
                self.above.setdefault(key, {})[home] = None
                entry.visits.append(_Visit(n, 0, entry=key))
                continue
            opened = -1
            if isinstance(node, Leaf):
                args = [evaluate(e, values) for e in node.args]
                entry.visits.append(_Visit(n, 0, extent=leaf_extent(node, args)))
            elif isinstance(node, Operation):
                stack.append(_Visit(n, len(below), node.operator))
                stack.extend((s, values) for s in reversed(below))
            elif isinstance(node, Transformation):
                matrix = transform_matrix(node.transform, [evaluate(e, values) for e in node.args])
                if FRAME_SLOTS[0] in self.live[below[0]]:
                    values = self.framed(matrix, values)
                stack.append(_Visit(n, 1, matrix=matrix))
                stack.append((below[0], values))
            else:
                if isinstance(node, Calculation):
                    values = self.assigned(node, values)
                elif isinstance(node, Attribute):
                    values = self.attributed(node, values)
                stack.append(_Visit(n, 1))
                stack.append((below[0], values))

    def key(self, n: int, values: Values) -> Key:
        """Return the key of the entry that begins at a cut with these values."""
        return n, tuple(self._point(values, name) for name in self.keyed[n])

    def rules(self, key: Key, values: Values) -> list[int]:
        """Return the numbers of the rules that a module's selection may take."""
        node = self.graph.nodes[key[0]]
        assert isinstance(node, Selection)
        lower, upper = ALL if node.select is None else evaluate(node.select, values)
        first = round(lower) if math.isfinite(lower) else lower
        last = round(upper) if math.isfinite(upper) else upper
        return [number for number in sorted(node.rules) if first <= number <= last]

    def below(self, n: int, values: Values) -> list[Key]:
        """Return the entries that an expression leads to directly."""
        entry = _Entry(values)
        self._walk(n, self.root, entry, opened=n)
        return [key for key, _ in entry.below]

    @staticmethod
    def _point(values: Values, name: str) -> float | None:
        interval = values.get(name)
        return interval[0] if interval and is_point(interval) else None

    def assigned(self, node: Calculation, values: Values) -> Values:
        """Return the values below a calculation."""
        below = dict(values)
        for name, expr in node.assignments:
            below[name] = evaluate(expr, values if node.call else below)
        return below

    @staticmethod
    def framed(matrix: Matrix, values: Values) -> Values:
        """Return the values below a transformation where somebody asks for the frame."""
        frame = tuple(values.get(slot, ALL) for slot in FRAME_SLOTS)
        inner = compose_matrices(frame, matrix)
        return values | dict(zip(FRAME_SLOTS, inner, strict=True))

    def boxes(self) -> tuple[list[Bounds], Bounds, Bounds]:
        """Return the boxes of all nodes, of the axiom, and of its bounded solids."""
        extents = self.extents(bounded_only=False)
        boxes = [EMPTY] * len(self.graph.nodes)
        for entry in self.entries.values():
            for visit, extent in self._measure(entry, extents, bounded_only=False):
                boxes[visit.node] = join(boxes[visit.node], extent.box)
        scene = bounded = extents[self.root].box
        if any(map(math.isinf, scene)) and scene != EMPTY:
            bounded = self.extents(bounded_only=True)[self.root].box
            if any(map(math.isinf, bounded)):
                bounded = EMPTY
        return boxes, scene, bounded

    def attributed(self, node: Attribute, values: Values) -> Values:
        """Return the values below an attribute."""
        args = attribute_values(self.graph, node)
        found = [evaluate(expr, values) for expr in args]
        return values | dict(zip(attribute_stores(node), found, strict=True))

    def extents(self, bounded_only: bool = False) -> dict[Key, Extent]:
        """Measure all entries from below."""
        extents = dict.fromkeys(self.entries, NO_EXTENT)
        for component in reversed(self._components()):
            self._measure_component(component, extents, bounded_only)
        return extents

    def _measure_component(
        self, component: list[Key], extents: dict[Key, Extent], bounded_only: bool
    ) -> None:
        """Find extents that contain what the rules make of them.

        Iteration from below approaches the smallest ones; as it need not arrive, they are blown up
        a little, and hold if the rules map them into themselves.
        """
        one = component[0]
        cyclic = len(component) > 1 or any(key == one for key, _ in self.entries[one].below)
        if not cyclic:
            extents[one] = self._result(one, extents, bounded_only)
            return
        for k in range(_FIXPOINT_ROUNDS):
            before = {key: extents[key] for key in component}
            if k >= _INFLATE_AFTER:
                by = 1e-6 * 1.5 ** (k - _INFLATE_AFTER)
                for key in component:
                    extents[key] = inflate_extent(extents[key], by)
            tried = {key: extents[key] for key in component}
            results = {key: self._result(key, extents, bounded_only) for key in component}
            if all(lies_within(results[key], tried[key]) for key in component):
                # One more application only makes them tighter.
                extents.update(results)
                return
            for key in component:
                extents[key] = join_extents(before[key], results[key])
        for key in component:
            extents[key] = ANY_EXTENT

    def _result(self, key: Key, extents: dict[Key, Extent], bounded_only: bool) -> Extent:
        return self._measure(self.entries[key], extents, bounded_only)[-1][1]

    def _measure(
        self, entry: _Entry, extents: dict[Key, Extent], bounded_only: bool
    ) -> list[tuple[_Visit, Extent]]:
        found: list[tuple[_Visit, Extent]] = []
        stack: list[Extent] = []
        for visit in entry.visits:
            at = len(stack) - visit.arity
            below = stack[at:]
            del stack[at:]
            if visit.extent is not None:
                extent = visit.extent
            elif visit.entry is not None:
                extent = extents[visit.entry]
            elif visit.operator is not None:
                extent = combine_extents(visit.operator, below, bounded_only)
            elif visit.matrix is not None:
                node = self.graph.nodes[visit.node]
                assert isinstance(node, Transformation)
                extent = transform_extent(visit.matrix, below[0], keeps_distances(node.transform))
            else:
                extent = below[0]
            stack.append(extent)
            found.append((visit, extent))
        return found
