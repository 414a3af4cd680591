"""Blobs in a grammar: what stands in ``blob { ... }``, and the fields that it derives.

Inside of a blob names mean fields: ``point(r)``, ``cone(l, rb, rt)``, ``a + b``, ``pcm { a , b }``.
Modules and definitions are the grammar's; one that a blob uses consists of fields. A blob is
unrolled for given values of the parameters that it reads from outside, which are the numbers of
its leaf.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from pcsg.blobtree import nodes
from pcsg.blobtree.nodes import Field
from pcsg.blobtree.skeletons import SKELETONS
from pcsg.blobtree.warps import WARPS
from pcsg.errors import SourceSpan, UsageError
from pcsg.grammar import syntax
from pcsg.grammar.fieldtext import write_fields
from pcsg.grammar.names import ModuleEntry, Names
from pcsg.grammar.syntax import Solid
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.expr import Expr, Parameter, parameters_of
from pcsg.graph.flat import Flat, flatten, restore
from pcsg.graph.graph import GLOBALS
from pcsg.graph.tape import Fault, Program
from pcsg.graph.text import BracedText
from pcsg.graph.transforms import TRANSFORMS
from pcsg.jit import plain
from pcsg.leaf.blob import BlobSource

FIELD_PRIMITIVES = {
    name: len(kind.parameters)
    for name, kind in SKELETONS.items()
    if name not in ("polygon", "quartic", "cauchy")
} | {"convolution": 3}
"""Primitives of fields, with the number of their arguments."""

FIELD_UNARY = {"weight": (1, 1)} | {
    name: (len(kind.parameters) - len(kind.defaults), len(kind.parameters))
    for name, kind in WARPS.items()
}
"""Unary operators on fields, with the least and the largest number of their arguments."""

FIELD_BLENDS = {
    "pcm": (0, 2),
    "ricci": (1, 1),
    "controlled": (0, 0),
    "gbb": (0, 0),
    "r_union": (0, 0),
    "r_intersect": (0, 0),
}
"""Operators with braces, with the least and the largest number of their arguments."""

OPERATIONS = {"sum": "sum", "union": "union", "intersection": "intersect"}

DEPTH = 2_000
"""Most modules on a path."""

STEPS = 2_000_000
"""Most nodes of a blob."""


def field_names(names: Names) -> set[str]:
    """Return the modules and definitions that blobs use, directly or through others."""
    return _used_by([blob for body in _bodies(names) for blob in _blobs_in(body)], names)


def _used_by(solids: Iterable[Solid], names: Names) -> set[str]:
    """Return the modules and definitions that expressions use, directly or through others."""
    found: set[str] = set()
    todo = list(solids)
    while todo:
        for part in syntax.inner(todo.pop()):
            if isinstance(part, syntax.Use) and part.name not in found:
                if part.name in names.modules:
                    found.add(part.name)
                    todo += [r for r in names.modules[part.name].solids.values() if r is not None]
                elif part.name in names.definitions:
                    found.add(part.name)
                    solid = names.definitions[part.name].solid
                    todo += [solid] if solid is not None else []
    return found


def _blobs_in(body: Solid) -> list[Solid]:
    found: list[Solid] = []
    stack = [body]
    while stack:
        item = stack.pop()
        if isinstance(item, syntax.Prefixed):
            item = item.operand
        if isinstance(item, syntax.Blob):
            found.append(item)
        stack += _operands(item)
    return found


def _bodies(names: Names) -> Iterator[Solid]:
    solids: list[Solid | None] = [names.axiom.solid] if names.axiom else []
    for entry in names.modules.values():
        solids += entry.solids.values()
    solids += [d.solid for d in names.definitions.values()]
    yield from (s for s in solids if s is not None)


def numbers_read(names: Names, root: Solid, fields: set[str]) -> list[str]:
    """Return the parameters that a blob reads and that may come from outside of it.

    A parameter that is assigned on every path before it is read does not; an equation for the sets
    of modules is solved by iteration.
    """
    live: dict[str, frozenset[str]] = {name: frozenset() for name in fields}
    changed = True
    while changed:
        changed = False
        for name in fields:
            new = _read_by_name(names, name, live)
            if new != live[name]:
                live[name], changed = new, True
    return sorted(_read_by(root, names, live))


def _read_by_name(names: Names, name: str, live: Mapping[str, frozenset[str]]) -> frozenset[str]:
    if name in names.definitions and name not in names.modules:
        solid = names.definitions[name].solid
        return _read_by(solid, names, live) if solid is not None else frozenset()
    entry = names.modules[name]
    found: set[str] = set()
    for rule in entry.solids.values():
        found |= _read_by(rule, names, live) if rule is not None else frozenset()
    if entry.declaration:
        found |= parameters_of(entry.declaration.select)
    for attributed in entry.attributed:
        if attributed.condition is not None:
            found |= parameters_of(attributed.condition)
    return frozenset(found)


def _read_by(solid: Solid, names: Names, live: Mapping[str, frozenset[str]]) -> frozenset[str]:
    """Return what an expression reads; with an explicit stack, since texts may nest deeply."""
    done: list[set[str]] = []
    work: list[tuple[Solid, bool]] = [(solid, False)]
    while work:
        part, below_done = work.pop()
        below = _operands(part)
        if below and not below_done:
            work.append((part, True))
            work += [(operand, False) for operand in below]
            continue
        found: set[str] = set()
        if below:
            found = found.union(*done[len(done) - len(below) :])
            del done[len(done) - len(below) :]
        done.append(_with_own(part, found, names, live))
    return frozenset(done[0])


def _operands(solid: Solid) -> Sequence[Solid]:
    if isinstance(solid, syntax.Combination):
        return solid.operands
    if isinstance(solid, (syntax.Blob, syntax.BlendUse)):
        return solid.fields
    return (solid.operand,) if isinstance(solid, syntax.Prefixed) else ()


def _with_own(
    solid: Solid, below: set[str], names: Names, live: Mapping[str, frozenset[str]]
) -> set[str]:
    """Return what a part reads by itself, and what its operands leave open."""
    if isinstance(solid, syntax.Combination):
        return below
    if isinstance(solid, syntax.Prefixed):
        for prefix in reversed(solid.prefixes):
            if isinstance(prefix, syntax.Block):
                for name, expr in reversed(prefix.assignments):
                    below.discard(name.text)
                    below |= parameters_of(expr)
            elif not isinstance(prefix, syntax.Unary):
                continue  # a loop, which is reported
            elif not (prefix.attribute and ATTRIBUTES[prefix.name].refers_to):
                below |= parameters_of(*prefix.arguments.values)
        return below
    given = parameters_of(*solid.arguments.values) if solid.arguments else frozenset()
    if not isinstance(solid, syntax.Use):
        return below | given
    of_name = live.get(solid.name, frozenset())
    entry = names.modules.get(solid.name)
    if solid.arguments is not None and entry is not None and entry.formals:
        of_name = of_name - set(entry.formals)
    return {*of_name, *given}


class GrammarBlob(BlobSource):
    """The fields of a blob in a grammar.

    Parameters
    ----------
    solid
        What stands in the braces.
    materials
        Numbers of materials and textures, by the kind of setting and name.
    """

    def __init__(
        self, names: Names, solid: Solid, materials: Mapping[str, Mapping[str, int]]
    ) -> None:
        fields = _used_by([solid], names)
        super().__init__(numbers_read(names, solid, fields))
        self._names = names
        self._solid = solid
        self._materials = materials
        every: set[str] = set(self.parameters) | set(GLOBALS)
        for name in fields:
            bodies = (
                names.modules[name].solids.values()
                if name in names.modules
                else [names.definitions[name].solid]
            )
            for body in bodies:
                every |= _names_in(body) if body is not None else set()
            if name in names.modules:
                entry = names.modules[name]
                every |= set(entry.formals or ())
                every |= parameters_of(entry.declaration.select) if entry.declaration else set()
                for rule in entry.attributed:
                    every |= parameters_of(rule.condition) if rule.condition is not None else set()
        every |= _names_in(solid)
        self._slots = {name: k for k, name in enumerate(sorted(every))}
        self._program = Program(self._slots)
        self._code: dict[int, int] = {}
        self._kept: list[object] = []

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore_blob, (flatten((self._names, self._solid, self._materials)),)

    @cached_property
    def braced(self) -> BracedText:
        """The blob, and what it uses, as text."""
        return write_fields(self._names, self._solid)

    @property
    def signature(self) -> object:
        """The text."""
        tokens, modules, definitions = self.braced
        return tuple(tokens), (*modules.items(), *definitions.items())

    def build(self, values: Sequence[float]) -> Field:
        """Unroll the blob for values of what it reads."""
        start = [math.nan] * len(self._slots)
        for name, value in GLOBALS.items():
            start[self._slots[name]] = value
        for name, value in zip(self.parameters, values, strict=True):
            start[self._slots[name]] = value
        return self._unroll(start)

    def _unroll(self, start: list[float]) -> Field:
        """Derive the field with an explicit stack: modules may recurse deeply."""
        done: list[Field] = []
        work: list[tuple[Solid | tuple[str, int, tuple[object, ...]], list[float], int]] = [
            (self._solid, start, 0)
        ]
        steps = 0
        while work:
            item, params, depth = work.pop()
            steps += 1
            if steps > STEPS:
                raise UsageError(f"the blob grows beyond {STEPS:,} nodes; does its recursion end?")
            if isinstance(item, tuple):
                _build(item, done)
            elif isinstance(item, syntax.Combination):
                count = len(item.operands)
                work.append((("combine", count, (item.operator.name,)), params, depth))
                work.extend((o, params, depth) for o in reversed(item.operands))
            elif isinstance(item, syntax.BlendUse):
                numbers = self._numbers(item.arguments.values, params, item.span)
                call = ("blend", len(item.fields), (item.name, numbers, item.span))
                work.append((call, params, depth))
                work.extend((f, params, depth) for f in reversed(item.fields))
            elif isinstance(item, syntax.Prefixed):
                params = list(params)
                for prefix in item.prefixes:
                    if isinstance(prefix, syntax.Block):
                        self._assign(prefix, params)
                    elif isinstance(prefix, syntax.Unary):
                        work.append((("unary", 1, self._unary(prefix, params)), params, depth))
                work.append((item.operand, params, depth))
            elif isinstance(item, syntax.Primitive):
                done.append(self._primitive(item.name, item.arguments, params, item.span))
            elif isinstance(item, syntax.Use):
                self._use(item, params, depth, work, done)
            else:
                raise UsageError(f"{_place(item.span)}a blob cannot stand in a blob")
        return done[0]

    def _use(
        self,
        use: syntax.Use,
        params: list[float],
        depth: int,
        work: list[tuple[Solid | tuple[str, int, tuple[object, ...]], list[float], int]],
        done: list[Field],
    ) -> None:
        entry = self._names.modules.get(use.name)
        definition = self._names.definitions.get(use.name)
        if entry is None and definition is None:
            arguments = use.arguments or syntax.Arguments()
            done.append(self._primitive(use.name, arguments, params, use.span))
            return
        if depth > DEPTH:
            raise UsageError(
                f"{_place(use.span)}`{use.name}` recurses more than {DEPTH} times in a blob"
            )
        if entry is None:
            assert definition is not None and definition.solid is not None
            work.append((definition.solid, params, depth))
            return
        params = list(params)
        if use.arguments is not None and entry.formals:
            numbers = self._numbers(use.arguments.values, params, use.span)
            for name, number in zip(entry.formals, numbers, strict=False):
                params[self._slots[name]] = number
        rules = entry.solids
        solid = rules.get(self._select(entry, params, use.span))
        if solid is None:
            raise UsageError(f"{_place(use.span)}no rule of `{use.name}` is selected")
        work.append((solid, params, depth + 1))

    def _select(self, entry: ModuleEntry, params: list[float], span: SourceSpan) -> int:
        if entry.attributed:
            for k, rule in enumerate(entry.attributed):
                if rule.condition is None or self._numbers((rule.condition,), params, span)[0]:
                    return k + 1
            return 0
        if entry.declaration is None:
            return min(entry.rules, default=0)
        return round(self._numbers((entry.declaration.select,), params, span)[0])

    def _numbers(
        self, exprs: Sequence[Expr], params: list[float], span: SourceSpan
    ) -> tuple[float, ...]:
        if not exprs:
            return ()
        return tuple(self._run(exprs, (), params, span))

    def _assign(self, block: syntax.Block, params: list[float]) -> None:
        if block.assignments:
            names = tuple(name.text for name, _ in block.assignments)
            self._run([expr for _, expr in block.assignments], names, params, block.span)

    def _run(
        self,
        exprs: Sequence[Expr],
        stores: tuple[str, ...],
        params: list[float],
        span: SourceSpan,
    ) -> list[float]:
        key = id(exprs[0])
        if key not in self._code:
            self._code[key] = self._program.add(exprs, stores)
            self._kept.append(exprs[0])
        try:
            return self._program.evaluate(self._code[key], params)
        except Fault:
            known = ", ".join(
                f"{name} = {params[k]:g}"
                for name, k in self._slots.items()
                if not math.isnan(params[k]) and name not in GLOBALS
            )
            raise UsageError(f"{_place(span)}a number has no value here ({known})") from None

    def _primitive(
        self, name: str, arguments: syntax.Arguments, params: list[float], span: SourceSpan
    ) -> Field:
        try:
            return make_primitive(name, self._numbers(arguments.values, params, span))
        except UsageError as error:
            raise UsageError(f"{_place(span)}{error}") from None

    def _unary(self, prefix: syntax.Unary, params: list[float]) -> tuple[object, ...]:
        values = prefix.arguments.values
        if not prefix.attribute:
            return prefix.name, self._numbers(values, params, prefix.span), prefix.span
        kind = ATTRIBUTES[prefix.name]
        numbers: tuple[float, ...] = ()
        if kind.refers_to and values and isinstance(values[0], Parameter):
            numbers = (float(self._materials[kind.refers_to][values[0].name]),)
            values = values[1:]
        numbers += self._numbers(values, params, prefix.span)
        slots = kind.slots[: len(numbers)]
        return "paint", dict(zip(slots, numbers, strict=True)), prefix.span


def _names_in(solid: Solid) -> set[str]:
    """Return every parameter that is read or assigned in an expression."""
    found: set[str] = set()
    for part in syntax.inner(solid):
        if isinstance(part, syntax.Block):
            for name, expr in part.assignments:
                found |= {name.text} | parameters_of(expr)
        elif isinstance(part, (syntax.Unary, syntax.Primitive, syntax.Use, syntax.BlendUse)):
            found |= parameters_of(*part.arguments.values) if part.arguments else set()
    return found


def make_primitive(name: str, numbers: Sequence[float]) -> Field:
    """Return a primitive of a field."""
    if name == "convolution":
        length, ra, rb = numbers
        return nodes.convolution_segment(length, ra, rb)
    return nodes.primitive(name, *numbers)


def _place(span: SourceSpan) -> str:
    return f"line {span.line}: "


def _build(item: tuple[str, int, tuple[object, ...]], done: list[Field]) -> None:
    """Make a node of those that are done last."""
    what, count, details = item
    children = done[len(done) - count :]
    del done[len(done) - count :]
    if what == "combine":
        operator = str(details[0])
        if operator == "difference":
            result = children[0]
            for child in children[1:]:
                result = nodes.subtract(result, child)
        else:
            result = nodes.combine(OPERATIONS[operator], children)
        done.append(result)
        return
    name, numbers, span = details[0], details[1], details[2]
    assert isinstance(span, SourceSpan)
    try:
        if name == "paint":
            assert isinstance(numbers, dict)
            done.append(nodes.Painted(numbers, child=children[0]))
            return
        assert isinstance(numbers, tuple)
        if what == "blend":
            done.append(nodes.combine(str(name), children, *numbers))
        elif name == "weight":
            done.append(nodes.weight(numbers[0], children[0]))
        elif name in WARPS:
            done.append(nodes.warped(str(name), children[0], *numbers))
        else:
            kernel = plain(TRANSFORMS[str(name)].kernel)
            matrix = np.array(kernel(*numbers), np.float64).reshape(3, 4)
            done.append(nodes.place(matrix, children[0]))
    except UsageError as error:
        raise UsageError(f"{_place(span)}{error}") from None


def _restore_blob(flat: Flat) -> GrammarBlob:
    return GrammarBlob(*restore(flat))
