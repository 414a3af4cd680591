"""What it means that the walker and the oracle agree on rays."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
import oracle
from oracle import Event

from pcsg.graph.graph import Graph
from pcsg.trace.walker import Walker

Ray = tuple[Sequence[float], Sequence[float]]

LIMITS = (0.0, math.inf)
SAME = 1e-9
HAIR = 1e-8


def cast(walker: Walker, rays: Sequence[Ray], *limits: float) -> Any:
    """Return the walker's hits."""
    return walker.intersect(
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
    """Compares what the walker found for the rays of one graph with the oracle.

    Attributes
    ----------
    forgiven
        Answers that are the oracle's only for a ray a hair beside.
    """

    def __init__(self, graph: Graph, **options: Any) -> None:
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
            slack = 1e-6 * max(1.0, abs(low))
            # An end on a limit, too, is a matter of rounding.
            for lowest, highest in ((low, high), (low + slack, high), (low - slack, high)):
                near.append(oracle.first_of(self.of(other), lowest, highest))
        if leaf < 0:
            assert any(e is None for e in near), ("missed", ray, expected)
            return
        ts = [e.t for e in near if e is not None and e.leaf == leaf]
        assert ts, ("another leaf", ray, expected, t, leaf)
        if expected is not None and expected.leaf == leaf:
            ts.append(expected.t)
        slack = 1e-6 * max(1.0, abs(t))
        assert min(ts) - slack <= t <= max(ts) + slack, ("another place", ray, expected, t)

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
        # On an edge either face may answer, and so may a surface seen edge-on.
        others = [
            np.abs(found.normal[i] - e.normal).max()
            for other in nearby(ray)
            for e in self.of(other)
            if e.leaf == expected.leaf and abs(e.t - expected.t) <= 1e-3 * max(1.0, abs(e.t))
        ]
        assert min(others, default=2.0) <= 1e-3, ("normal", ray, expected, found.normal[i])

    def spans(self, ray: Ray, pairs: Sequence[tuple[float, float]]) -> None:
        """Require the oracle's intervals, or those of a ray a hair beside."""
        if not _same(pairs, _pairs(self.of(ray)), SAME):
            self.forgiven += 1
            loose = 1e-4
            assert any(_same(pairs, _pairs(self.of(other)), loose) for other in nearby(ray)), (
                "spans",
                ray,
                pairs,
                _pairs(self.of(ray)),
            )


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


def _same(
    a: Sequence[tuple[float, float]], b: Sequence[tuple[float, float]], within: float
) -> bool:
    return len(a) == len(b) and all(
        x == y or abs(x - y) <= within * max(1.0, abs(y))
        for p, q in zip(a, b, strict=True)
        for x, y in zip(p, q, strict=True)
    )
