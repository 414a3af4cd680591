"""Making recipes: what a rule does with its inputs, and what is known without them.

Every rule of an entry is walked once, with an expression over registers and an interval for every
parameter. An assignment becomes a register, a transformation a matrix, a leaf or a module a part;
what the intervals show to be a single number is one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS, ATTRIBUTE_SLOTS
from pcsg.graph.code import compose_affine, invert_affine
from pcsg.graph.expr import Apply, Expr, Number, Parameter, operands, postorder, signature
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.graph import Graph
from pcsg.graph.intervals import evaluate, is_point
from pcsg.graph.liveness import Liveness, attribute_stores, attribute_values
from pcsg.graph.nodes import Attribute, Calculation, Leaf, Operation, Selection, Transformation
from pcsg.graph.operators import UNION
from pcsg.graph.ranges import Key, Ranges, Values
from pcsg.graph.recipes import (
    Entry,
    EntryPart,
    FixedPart,
    LeafPart,
    NoRecipe,
    Place,
    Recipe,
    Recipes,
)
from pcsg.graph.sharing import Assign, register, share_terms
from pcsg.graph.states import Start
from pcsg.graph.transforms import Transform
from pcsg.jit import plain
from pcsg.vec import IDENTITY, Affine

INLINED = 4
"""Most parts of a module whose only rule becomes part of the recipe that leads to it."""

_ATTRIBUTES = frozenset(ATTRIBUTE_SLOTS)

MAX_PARTS = 256
"""Most parts of a recipe; a larger rule is walked."""


def make_recipes(graph: Graph, globals_values: Mapping[str, float] | None = None) -> Recipes:
    """Return the recipes of a graph.

    Raises
    ------
    NoRecipe
        The graph asks for world coordinates, combines what depends on inputs by an intersection or
        a difference, or has more entries than the ranges allow.
    """
    if graph.uses_frame:
        raise NoRecipe("world coordinates")
    for by_values in (True, False):
        ranges = Ranges(graph, by_values)
        if ranges.run(globals_values):
            return _Maker(graph, ranges).make()
    raise NoRecipe("too many entries")


class _Scope(NamedTuple):
    """What is known at a node: expressions over registers, intervals, the matrix so far."""

    exprs: Mapping[str, Expr]
    values: Values
    matrix: int | Affine


class _Maker:
    def __init__(self, graph: Graph, ranges: Ranges) -> None:
        self.graph = graph
        self.ranges = ranges
        self.liveness = Liveness(graph)
        self.slots = {name: k for k, name in enumerate(graph.slots)}
        self.made = Recipes(graph, ranges, [], [])
        self.numbers: dict[Key, int] = {}
        self.fixture_of: dict[Start, int] = {}
        self.fixed = self._find_fixed()
        self.static_nodes: dict[tuple[int, tuple[float, ...]], bool] = {}

    def make(self) -> Recipes:
        self._entry(self.ranges.root)
        for entry in self.made.entries:  # grows meanwhile
            self._fill(entry)
        return self.made

    # Entries

    def _inputs(self, key: Key) -> tuple[str, ...]:
        values = self.ranges.entries[key].values
        live = sorted(self.ranges.live[max(key[0], 0)], key=self.slots.__getitem__)
        return tuple(name for name in live if name in values and not is_point(values[name]))

    def _shaping(self, n: int, values: Values) -> list[str]:
        """Return the names of the live parameters of a node that have values, no attributes."""
        live = sorted(self.ranges.live[n] - _ATTRIBUTES, key=self.slots.__getitem__)
        return [name for name in live if name in values]

    def _find_fixed(self) -> set[Key]:
        """Return the entries at and below which no input shapes anything, cycles apart."""
        fixed: set[Key] = set()
        entries = self.ranges.entries
        changed = True
        while changed:
            changed = False
            for key, entry in reversed(entries.items()):
                shaping = self._shaping(max(key[0], 0), entry.values)
                if key in fixed or not all(is_point(entry.values[name]) for name in shaping):
                    continue
                if all(below in fixed for below, _ in entry.below):
                    fixed.add(key)
                    changed = True
        return fixed

    def _entry(self, key: Key) -> int:
        if key not in self.numbers:
            inputs = self._inputs(key)
            values = self.ranges.entries[key].values
            self.numbers[key] = len(self.made.entries)
            self.made.entries.append(Entry(key, inputs, tuple(values[n] for n in inputs)))
        return self.numbers[key]

    def _fill(self, entry: Entry) -> None:
        """Make the recipes of an entry."""
        values = self.ranges.entries[entry.key].values
        exprs: dict[str, Expr] = {
            name: Number(value[0]) for name, value in values.items() if is_point(value)
        }
        exprs |= {name: register(k) for k, name in enumerate(entry.inputs)}
        start = max(entry.key[0], 0)
        node = self.graph.nodes[start]
        scope = _Scope(exprs, values, IDENTITY)
        if entry.key[0] < 0 or not isinstance(node, Selection):
            entry.rules[0] = self._recipe(start, entry.key[0], scope, len(entry.inputs))
            return
        rules = self.ranges.rules(entry.key, values)
        if len(rules) != 1 and node.select is not None:
            entry.select = _substitute(node.select, exprs)
        for number in rules:
            rule = self.graph.number[node.rules[number]]
            entry.rules[number] = self._recipe(rule, -1, scope, len(entry.inputs))
        entry.stand_in = self._stand_in(node, scope, len(entry.inputs))

    def _stand_in(self, node: Selection, scope: _Scope, inputs: int) -> Recipe | None:
        """Return the terminating rule with the present parameters, if it is a surface."""
        for number in sorted(node.rules):
            rule = self.graph.number[node.rules[number]]
            below = [rule]
            for k in below:
                below.extend(self.graph.successors[k] if self._is_little(rule) else ())
            leaves = [n for n in map(self.graph.nodes.__getitem__, below) if isinstance(n, Leaf)]
            if leaves and all(leaf.is_sheet for leaf in leaves):
                try:
                    return self._recipe(rule, -1, scope, inputs)
                except NoRecipe:
                    return None
        return None

    # Recipes

    def _recipe(self, start: int, opened: int, scope: _Scope, inputs: int) -> Recipe:
        """Return the recipe of an expression; `opened` is the cut that it begins with, if any."""
        recipe = Recipe(registers=inputs)
        known: dict[tuple[object, ...], Parameter] = {}
        stack: list[tuple[int, _Scope, int]] = [(start, scope, opened)]
        while stack:
            n, scope, opened = stack.pop()
            node = self.graph.nodes[n]
            if isinstance(node, Leaf) and node.constants:
                if not self._is_static(n, scope.values):
                    raise NoRecipe("a leaf with data that depends on inputs")
                self._add_fixture(recipe, n, scope)
            elif isinstance(node, Leaf):
                self._add_leaf(recipe, known, n, node, scope)
            elif n in self.ranges.cuts and n != opened:
                self._enter(recipe, known, stack, n, scope)
            elif isinstance(node, Operation):
                is_little = node.operator is UNION and self._is_little(n)
                if not is_little and self._is_static(n, scope.values):
                    self._add_fixture(recipe, n, scope)
                    continue
                if node.operator is not UNION:
                    raise NoRecipe("an operation")
                stack.extend((s, scope, -1) for s in reversed(self.graph.successors[n]))
            else:
                scope = self._below(recipe, known, n, scope)
                stack.append((self.graph.successors[n][0], scope, -1))
            if len(recipe.parts) > MAX_PARTS:
                raise NoRecipe("a rule of many parts")
        assigns = [s if isinstance(s, Assign) else None for s in recipe.steps]
        shared, recipe.registers = share_terms(assigns, recipe.registers)
        steps: list[Assign | Place] = []
        for step, (before, own) in zip(recipe.steps, shared, strict=True):
            steps += [*before, step if own is None else own]
        recipe.steps = steps
        return recipe

    def _below(
        self, recipe: Recipe, known: dict[tuple[object, ...], Parameter], n: int, scope: _Scope
    ) -> _Scope:
        """Return the scope below a calculation, an attribute or a transformation."""
        node = self.graph.nodes[n]
        exprs, values, matrix = scope
        if isinstance(node, Transformation):
            args = tuple(_substitute(e, exprs) for e in node.args)
            return scope._replace(matrix=self._place(recipe, known, matrix, node.transform, args))
        if isinstance(node, Calculation):
            found = dict(exprs)
            now = dict(values)
            for i in self.liveness.used_assignments(n):
                name, expr = node.assignments[i]
                seen = (exprs, values) if node.call else (found, now)
                interval = evaluate(expr, seen[1])
                if is_point(interval):
                    found[name] = Number(interval[0])
                else:
                    found[name] = self._simple(recipe, known, _substitute(expr, seen[0]))
                now[name] = interval
            return _Scope(found, now, matrix)
        assert isinstance(node, Attribute)
        live = self.ranges.live[self.graph.successors[n][0]]
        stores = attribute_stores(node)
        now = self.ranges.attributed(node, values)
        found = dict(exprs)
        for name, expr in zip(stores, attribute_values(self.graph, node), strict=True):
            if name in live:
                found[name] = self._simple(recipe, known, _substitute(expr, exprs))
        return _Scope(found, now, matrix)

    def _simple(
        self, recipe: Recipe, known: dict[tuple[object, ...], Parameter], expr: Expr
    ) -> Expr:
        """Return a number or a register for an expression, which is evaluated once."""
        if not isinstance(expr, Apply):
            return expr
        key = signature(expr)
        if key not in known:
            known[key] = register(recipe.registers)
            recipe.steps.append(Assign(recipe.registers, expr))
            recipe.registers += 1
        return known[key]

    def _place(
        self,
        recipe: Recipe,
        known: dict[tuple[object, ...], Parameter],
        matrix: int | Affine,
        transform: Transform,
        args: tuple[Expr, ...],
    ) -> int | Affine:
        """Return the matrix below a transformation."""
        constant: Affine | None = None
        if all(isinstance(a, Number) for a in args):
            numbers = [a.value for a in args if isinstance(a, Number)]
            constant = plain(transform.kernel)(*numbers)
            if not all(map(math.isfinite, constant)) or not invert_affine(constant)[1]:
                raise NoRecipe("a singular matrix")
            if isinstance(matrix, Affine):
                composed: Affine = compose_affine(matrix, constant)
                return composed
        source = matrix if isinstance(matrix, int) else -1
        if isinstance(matrix, Affine) and matrix != IDENTITY:
            recipe.steps.append(Place(recipe.matrices, -1, matrix, None, ()))
            source = recipe.matrices
            recipe.matrices += 1
        simple = tuple(self._simple(recipe, known, a) for a in args)
        kind = None if constant else transform
        recipe.steps.append(Place(recipe.matrices, source, constant, kind, simple))
        recipe.matrices += 1
        return recipe.matrices - 1

    def _add_leaf(
        self,
        recipe: Recipe,
        known: dict[tuple[object, ...], Parameter],
        n: int,
        node: Leaf,
        scope: _Scope,
    ) -> None:
        if node.solid.primitives == 0:
            return
        exprs, values, matrix = scope
        args = tuple(self._simple(recipe, known, _substitute(e, exprs)) for e in node.args)
        ranges = tuple(evaluate(e, values) for e in node.args)
        recipe.parts.append(LeafPart(matrix, n, args, _attributes(exprs), ranges))

    def _enter(
        self,
        recipe: Recipe,
        known: dict[tuple[object, ...], Parameter],
        stack: list[tuple[int, _Scope, int]],
        n: int,
        scope: _Scope,
    ) -> None:
        """Add an entry as a part, or what it is made of where that is little."""
        key = self.ranges.key(n, scope.values)
        node = self.graph.nodes[n]
        if self._is_static(n, scope.values):
            self._add_fixture(recipe, n, scope)
            return
        if isinstance(node, Selection):
            rules = self.ranges.rules(key, self.ranges.entries[key].values)
            if len(rules) == 1 and self._is_little(rule := self.graph.number[node.rules[rules[0]]]):
                stack.append((rule, scope, -1))
                return
        number = self._entry(key)
        nothing = Number(math.nan)
        values = tuple(
            self._simple(recipe, known, scope.exprs.get(name, nothing))
            for name in self.made.entries[number].inputs
        )
        recipe.parts.append(EntryPart(scope.matrix, number, values))

    def _is_little(self, n: int) -> bool:
        """Return whether an expression is the union of a few leaves."""
        leaves = 0
        stack = [n]
        while stack:
            k = stack.pop()
            node = self.graph.nodes[k]
            leaves += isinstance(node, Leaf)
            stays = isinstance(node, Leaf) and bool(node.constants)
            stays = stays or (isinstance(node, Operation) and node.operator is not UNION)
            if k in self.ranges.cuts or stays or leaves > INLINED:
                return False
            stack.extend(self.graph.successors[k])
        return True

    # Fixtures

    def _is_static(self, n: int, values: Values) -> bool:
        """Return whether no input shapes anything at or below a node."""
        intervals = [values[name] for name in self._shaping(n, values)]
        if not all(map(is_point, intervals)):
            return False
        key = n, tuple(i[0] for i in intervals)
        if key not in self.static_nodes:
            if n in self.ranges.cuts:
                self.static_nodes[key] = self.ranges.key(n, values) in self.fixed
            else:
                below = self.ranges.below(n, values)
                self.static_nodes[key] = all(k in self.fixed for k in below)
        return self.static_nodes[key]

    def _add_fixture(self, recipe: Recipe, n: int, scope: _Scope) -> None:
        known = tuple((k, scope.values[k][0]) for k in self._shaping(n, scope.values))
        start = Start(n, known)
        if start not in self.fixture_of:
            self.fixture_of[start] = len(self.made.fixtures)
            self.made.fixtures.append(start)
        attributes = _attributes(scope.exprs)
        recipe.parts.append(FixedPart(scope.matrix, self.fixture_of[start], attributes))


def _attributes(exprs: Mapping[str, Expr]) -> tuple[Expr, ...]:
    defaults = zip(ATTRIBUTE_SLOTS, ATTRIBUTE_DEFAULTS, strict=True)
    return tuple(exprs.get(name, Number(value)) for name, value in defaults)


def _substitute(expr: Expr, exprs: Mapping[str, Expr]) -> Expr:
    """Return an expression over registers, constants folded."""
    stack: list[Expr] = []
    for e in postorder(expr, operands):
        if isinstance(e, Parameter):
            if e.name not in exprs:
                raise NoRecipe(f"`{e.name}` has no value")
            stack.append(exprs[e.name])
        elif isinstance(e, Apply):
            at = len(stack) - len(e.args)
            args = tuple(stack[at:])
            del stack[at:]
            stack.append(_folded(e.with_args(args)))
        else:
            stack.append(e)
    return stack[0]


def _folded(e: Apply) -> Expr:
    """Return a number for an application to numbers, where that is no fault."""
    if e.function == "if" and isinstance(e.args[0], Number):
        return e.args[1] if e.args[0].value != 0.0 else e.args[2]
    known = all(isinstance(a, Number) for a in e.args)
    if known and FUNCTIONS[e.function].form is not Form.WORLD:
        interval = evaluate(e, {})
        if is_point(interval):
            return Number(interval[0])
    return e
