"""What it means that an engine and the oracle agree on rays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import oracle
import strategies as cases
from oracle import Event

from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.unroll import enumerate_states
from pcsg.trace.choice import SUSPENDED_MEMORY
from pcsg.trace.expand.expansion import Expansion
from pcsg.trace.expand.pack import pack_expansion
from pcsg.trace.expand.partial import NotSuspended, PartialExpansion
from pcsg.trace.expand.suspended import SuspendedBlocks
from pcsg.trace.pool import pool_of
from pcsg.trace.tracer import StatesTracer, trace_states
from pcsg.trace.walker import Walker

Ray = tuple[Sequence[float], Sequence[float]]
Tracer = Walker | StatesTracer
Make = Callable[..., Tracer]


def make_states(
    graph: Graph,
    values: Mapping[str, float] = GLOBALS,
    *,
    threads: int | None = None,
    walker: Walker | None = None,
) -> StatesTracer:
    """Return the engine of states; a graph that it cannot take is a mistake of the test.

    Who has a walker of the graph may give it, as to the other engines: it takes long to make.
    """
    states = enumerate_states(graph, values)
    assert states.finite and states.acyclic and not states.diagnostics
    make_walker = lambda: walker or Walker(graph, values, threads=threads)  # noqa: E731
    return trace_states(graph, states, make_walker, threads)


def make_expanded(
    graph: Graph,
    values: Mapping[str, float] = GLOBALS,
    *,
    threads: int | None = None,
    walker: Walker | None = None,
) -> StatesTracer:
    """Return the engine of states, prepared in compiled code."""
    models = pool_of(graph)
    packed = pack_expansion(Expansion(graph, values, models, 1 << 30))
    return StatesTracer(
        packed.blocks,
        models,
        lambda: walker or Walker(graph, values, threads=threads),
        threads,
        lambda: packed.may_shrink,
    )


def make_suspended(
    graph: Graph,
    values: Mapping[str, float] = GLOBALS,
    *,
    threads: int | None = 2,
    block_memory: int = 0,
    walker: Walker | None = None,
) -> StatesTracer:
    """Return the engine of states, of which only some are prepared."""
    models = pool_of(graph)
    expansion = PartialExpansion(graph, values, models, block_memory)
    suspended = SuspendedBlocks(expansion, threads or 2)
    make_walker = lambda: walker or Walker(graph, values, threads=threads)  # noqa: E731
    return StatesTracer(suspended.packed.blocks, models, make_walker, threads, suspended=suspended)


def make_without_memory(
    graph: Graph,
    values: Mapping[str, float] = GLOBALS,
    *,
    threads: int | None = None,
    walker: Walker | None = None,
) -> StatesTracer:
    """Return the engine of states with all of them suspended, where that can be."""
    try:
        return make_suspended(graph, values, threads=threads, walker=walker)
    except NotSuspended:
        return make_expanded(graph, values, threads=threads, walker=walker)


def make_any_states(graph: Graph, values: Mapping[str, float] = GLOBALS) -> Tracer:
    """Return the engine of states, some of them suspended where they are too many."""
    states = enumerate_states(graph, values)
    if states.finite:
        return make_states(graph, values)
    return make_suspended(graph, values, block_memory=SUSPENDED_MEMORY)


ENGINES: dict[str, Make] = {
    "cyclic": Walker,
    "states": make_states,
    "expanded": make_expanded,
    "suspended": make_without_memory,
}

LIMITS = (0.0, math.inf)
SAME = 1e-9
_TURNS = np.array([(0.6, 0.5, 0.7), (-0.8, 0.4, 0.5), (0.3, -0.9, 0.4), (0.5, 0.3, -0.9)])
_TURNS = np.concatenate([_TURNS, -_TURNS])
HAIR = 1e-8


def cast(tracer: Tracer, rays: Sequence[Ray], *limits: float) -> Any:
    """Return the hits of an engine."""
    return tracer.intersect(
        np.array([o for o, _ in rays]), np.array([d for _, d in rays]), *(limits or LIMITS)
    )


def nearby(ray: Ray) -> Iterator[Ray]:
    """Yield rays that differ from a ray by a hair: what rounding may decide differs among them."""
    o, d = np.array(ray[0]), np.array(ray[1])
    place = HAIR * max(1.0, float(np.abs(o).max()))
    turn = HAIR * float(np.abs(d).max())
    signs = [[i >> k & 1 for k in range(3)] for i in range(8)]
    for s in np.array(signs) * 2.0 - 1.0:
        for turned in (-s[[1, 2, 0]], s[[2, 0, 1]], 0.0 * s):
            # Uneven factors, so that no edge or corner lies on all of them.
            yield (
                tuple(o + place * s * (1.0, 0.83, 0.71)),
                tuple(d + turn * turned * (0.79, 1.0, 0.87)),
            )


class Judge:
    """Compares what an engine found for the rays of one graph with the oracle.

    Attributes
    ----------
    forgiven
        Answers that are the oracle's only for a ray a hair beside.
    """

    def __init__(self, tracer: Tracer, graph: Graph, **options: Any) -> None:
        self.tracer = tracer
        self.graph = graph
        self.forgiven = 0
        self.events = cache(lambda o, d: oracle.events(graph, o, d, **options))

    def of(self, ray: Ray) -> list[Event]:
        """Return the oracle's events of a ray."""
        return self.events(tuple(ray[0]), tuple(ray[1]))  # type: ignore[no-any-return]

    def hit(self, ray: Ray, found: Any, i: int, *limits: float) -> None:
        """Require that hit i is the oracle's."""
        low, high = limits or LIMITS
        expected = oracle.first_of(self.of(ray), low, high)
        t, leaf = float(found.t[i]), int(found.leaf[i])
        if expected is None:
            if leaf < 0:
                assert math.isinf(t)
                return
        elif leaf == expected.leaf and abs(t - expected.t) <= SAME * max(1.0, abs(expected.t)):
            self.surface(ray, found, i, expected)
            return
        self.forgiven += 1
        near = []
        for other in nearby(ray):
            slack = 1e-6 * max(1.0, abs(low)) + 10.0 * HAIR / max(map(abs, ray[1]))
            # An end on a limit, too, is a matter of rounding.
            for lowest, highest in ((low, high), (low + slack, high), (low - slack, high)):
                near.append(oracle.first_of(self.of(other), lowest, highest))
        if leaf < 0:
            right = any(e is None for e in near) or self.glides(ray)
            assert right, ("missed", ray, expected)
            return
        if self.is_sliver(ray, t):
            return
        ts = [e.t for e in near if e is not None and e.leaf == leaf]
        if self.glides(ray):
            return
        # Where faces of several leaves coincide exactly, the engine of states may name another one
        # of them (docs/engines.md); the place must be right.
        loose = isinstance(self.tracer, StatesTracer) and expected is not None
        if loose and abs(t - expected.t) <= SAME * max(1.0, abs(t)):
            return
        slack = 1e-6 * max(1.0, abs(t))
        if loose and any(e is not None and abs(t - e.t) <= slack for e in near):
            return
        assert ts, ("another leaf", ray, expected, t, leaf)
        if expected is not None and expected.leaf == leaf:
            ts.append(expected.t)
        assert min(ts) - slack <= t <= max(ts) + slack, ("another place", ray, expected, t)

    def is_sliver(self, ray: Ray, t: float) -> bool:
        """Return whether the engine's piece at t is thinner than the tolerance.

        Where a ray touches a corner, rounding may leave a piece of one ulp. If it is a piece of A,
        then A - A keeps it: of A a group takes what is exactly at t, of B what is within eps.
        """
        found = self.tracer.spans([ray[0]], [ray[1]])
        width = 4.0 * oracle.tolerance(t, oracle.precision(*ray))
        return any(
            a - width <= t <= b + width and a < b <= a + width
            for a, b in zip(found.t_in, found.t_out, strict=True)
        )

    def surface(self, ray: Ray, found: Any, i: int, expected: Event) -> None:
        """Require the same normal away from edges, and the same attributes."""
        o, d = np.array(ray[0]), np.array(ray[1])
        size = max(1.0, float(np.abs(o).max()), float(np.abs(expected.t * d).max()))
        assert np.abs(found.position[i] - (o + expected.t * d)).max() <= 1e-8 * size
        assert tuple(found.color[i]) == expected.color
        assert int(found.label[i]) == expected.label
        assert int(found.material[i]) == expected.material
        assert (int(found.texture[i]), float(found.texture_scale[i])) == expected.texture
        normal = np.array(expected.normal)
        if np.abs(found.normal[i] - normal).max() <= 1e-6:
            return
        # On an edge either face may answer: what other rays see of the leaf within a hair of the
        # point.
        point = o + expected.t * d
        hair = 1e-6 * size
        others = []
        for alone in self.alone(expected.leaf):
            for turn in _TURNS:
                for aside in 0.3 * hair * _TURNS:
                    found_there = oracle.events(alone, point + aside - turn, turn)
                    others += [e.normal for e in found_there if abs(e.t - 1.0) <= hair]
        flip = -1.0 if expected.flipped else 1.0
        least = min((np.abs(found.normal[i] - flip * np.array(n)).max() for n in others), default=2)
        if least > 1e-3 and not self.glides(ray):
            raise AssertionError(("normal", ray, expected, found.normal[i]))

    def alone(self, number: int | None = None) -> list[Graph]:
        """Return a graph for every place of a leaf, or of all leaves."""
        return [
            Graph(cases.prefix("matrix", *sum(leaf.frame, ())) * leaf.alone())
            for leaf in oracle.leaves(self.graph)
            if number is None or leaf.number == number
        ]

    def glides(self, ray: Ray) -> bool:
        """Return whether a ray runs along a surface, so that rounding may end it anywhere."""
        o, d = np.array(ray[0]), np.array(ray[1])
        for leaf in oracle.leaves(self.graph):
            linear, shift = np.array(leaf.frame)[:, :3], np.array(leaf.frame)[:, 3]
            local_o, local_d = np.linalg.solve(linear, np.array([o - shift, d]).T).T
            planes = oracle._PLANES.get(leaf.name, [])
            if leaf.node.constants:
                planes = [_unit_plane(t) for t in oracle.triangles_of(leaf.node)]
            if leaf.name in oracle.SHEETS:
                planes = oracle._PLANES["halfspace"]
            hair = 1e-6 * max(1.0, np.abs(local_o).max())
            for n, c in planes:
                level = abs(np.dot(n, local_o) - c) <= hair
                if level and abs(np.dot(n, local_d)) <= 1e-6 * np.linalg.norm(local_d):
                    return True
        # A ray that touches a ball of radius 1, moved by a hair, meets it at about this angle.
        angle = 2.0 * math.sqrt(2.0 * HAIR)
        size = float(np.linalg.norm(d))
        return any(
            math.isfinite(e.t) and abs(np.dot(e.normal, d)) <= angle * size
            for alone in self.alone()
            for other in (ray, *nearby(ray))
            for e in oracle.events(alone, *other)
        )

    def spans(self, ray: Ray, pairs: Sequence[tuple[float, float]]) -> None:
        """Require the oracle's intervals, or those of a ray a hair beside."""
        # A sheet in a face is an interval of its own: which one stands first may be rounding.
        if not _same(sorted(pairs), sorted(_pairs(self.of(ray))), SAME):
            self.forgiven += 1
            loose = 1e-4
            thick = _without_slivers(pairs)
            others = [_without_slivers(_pairs(self.of(other))) for other in nearby(ray)]
            right = any(_same(thick, other, loose) for other in others) or self.glides(ray)
            assert right, ("spans", ray, pairs, _pairs(self.of(ray)))


def _unit_plane(triangle: oracle.Triangle) -> tuple[Any, float]:
    n, c = oracle.plane_of(triangle)
    size = float(np.linalg.norm(n))
    return np.array(n) / size, c / size


def _pairs(found: Sequence[Event]) -> list[tuple[float, float]]:
    """Return intervals in the order in which they begin; a sheet is one without length."""
    pairs: list[list[float]] = []
    entered: list[float] | None = None
    for e in found:
        if e.kind == "sheet":
            pairs.append([e.t, e.t])
        elif entered is None:
            entered = [e.t, math.nan]
            pairs.append(entered)
        else:
            entered[1] = e.t
            entered = None
    return [(a, b) for a, b in pairs]


def _without_slivers(pairs: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Drop pieces of almost no length; sheets, of none, stay."""
    return [(a, b) for a, b in pairs if a == b or b - a > 1e-6 * max(1.0, abs(a))]


def _same(
    a: Sequence[tuple[float, float]], b: Sequence[tuple[float, float]], within: float
) -> bool:
    return len(a) == len(b) and all(
        x == y or abs(x - y) <= within * max(1.0, abs(y))
        for p, q in zip(a, b, strict=True)
        for x, y in zip(p, q, strict=True)
    )
