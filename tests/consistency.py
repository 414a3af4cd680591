"""What answers of one scene have to do with each other, and those of the engines."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import oracle
from agreement import Tracer, make_expanded, make_states, make_suspended

from pcsg.graph.graph import Graph
from pcsg.scene import Scene
from pcsg.trace import blocks
from pcsg.trace.expand.partial import NotSuspended
from pcsg.trace.walker import Walker

Rays = tuple[np.ndarray, np.ndarray]
SAME = 1e-9


def rays_through(graph: Graph, rng: np.random.Generator, n: int) -> Rays:
    """Return n rays from outside, n from inside and n from surfaces, in this order."""
    low, high = np.clip(Scene(graph).bounds, -6.0, 6.0)
    size = np.maximum(high - low, 1e-3)
    targets = low + rng.random((3 * n, 3)) * size
    origins = (low + high) / 2 + rng.normal(size=(3 * n, 3)) * size.max()
    origins[n : 2 * n] = low + rng.random((n, 3)) * size
    found = Walker(graph).intersect(origins[:n], targets[:n] - origins[:n])
    origins[2 * n :][found.mask] = found.position[found.mask]
    return origins, targets - origins


@contextmanager
def opened(whole: int, references: int) -> Iterator[None]:
    """Open groups of blocks up to so many references."""
    names = "OPEN_WHOLE", "OPEN_ROOT", "OPEN_GROUP"
    before = [getattr(blocks, name) for name in names]
    try:
        for name, value in zip(names, (whole, references, references), strict=True):
            setattr(blocks, name, value)
        yield
    finally:
        for name, value in zip(names, before, strict=True):
            setattr(blocks, name, value)


def fast_tracers(graph: Graph, walker: Walker) -> Iterator[tuple[str, Tracer]]:
    """Yield the engines of states: opened, not opened, and suspended where that can be."""
    yield "states", make_states(graph, walker=walker)
    yield "expanded", make_expanded(graph, walker=walker)
    with opened(0, 0):
        yield "states, closed", make_states(graph, walker=walker)
        yield "expanded, closed", make_expanded(graph, walker=walker)
    with suppress(NotSuspended):
        yield "suspended", make_suspended(graph, walker=walker)


def check_engines(graph: Graph, rays: Rays) -> int:
    """Require that all engines answer alike; return the number of hits."""
    walker = Walker(graph)
    expected = walker.intersect(*rays)
    check_walker(walker, rays, expected)
    for name, tracer in fast_tracers(graph, walker):
        if name == "states":
            check_limits(walker, tracer, rays)
        found = tracer.intersect(*rays)
        blocked = tracer.occluded(*rays)
        same = np.abs(found.normal - expected.normal).max(axis=1) <= 1e-6
        same &= np.isclose(found.t, expected.t, rtol=SAME, atol=SAME)
        same &= (found.leaf == expected.leaf) & (blocked == expected.mask)
        for i in np.flatnonzero(~same):
            if not is_rounding(walker, rays[0][i], rays[1][i], found.t[i]):
                raise AssertionError(
                    f"{name}: {rays[0][i].tolist()} {rays[1][i].tolist()}:"
                    f" t {found.t[i]} leaf {found.leaf[i]} normal {found.normal[i]}"
                    f" occluded {blocked[i]}; cyclic: t {expected.t[i]} leaf {expected.leaf[i]}"
                    f" normal {expected.normal[i]}"
                )
    return int(expected.mask.sum())


def check_limits(walker: Walker, tracer: Tracer, rays: Rays) -> None:
    """Require that engines agree between limits about the first hits.

    Whether a ray that starts on a surface meets it is a matter of rounding, so these stay out.
    """
    rays = rays[0][: 2 * len(rays[0]) // 3], rays[1][: 2 * len(rays[1]) // 3]
    found = walker.intersect(*rays)
    t = np.where(found.mask & (found.t > 1e-6), found.t, 1.0)
    for low, high in ((0.0, 0.9 * t), (0.9 * t, 1.1 * t), (1.1 * t, 5.0 + t)):
        low = np.broadcast_to(low, t.shape)
        a, b = walker.intersect(*rays, low, high), tracer.intersect(*rays, low, high)
        blocked = tracer.occluded(*rays, low, high)
        for i in np.flatnonzero((a.leaf != b.leaf) | (a.mask != blocked)):
            o, d = (x[i] for x in rays)
            raise AssertionError(
                f"limits {low[i]} {high[i]}: {o.tolist()} {d.tolist()}: t {b.t[i]} leaf {b.leaf[i]}"
                f" occluded {blocked[i]}; cyclic: t {a.t[i]} leaf {a.leaf[i]}"
            )


def check_walker(walker: Walker, rays: Rays, found: Any) -> None:
    """Require that what a walker tells of rays goes together."""
    spans = walker.spans(*rays)
    blocked = walker.occluded(*rays)
    assert (blocked == found.mask).all()
    points, inside = [], []
    for i, (o, d) in enumerate(zip(*rays, strict=True)):
        own = slice(spans.offsets[i], spans.offsets[i + 1])
        ends = np.stack([spans.t_in[own], spans.t_out[own]], axis=1).ravel()
        ahead = ends[(ends >= 0.0) & np.isfinite(ends)]
        first = ahead[0] if len(ahead) else math.inf
        assert found.t[i] == first, (o.tolist(), d.tolist(), found.t[i], ends)
        # The normal looks out of the solid.
        if found.mask[i] and (ends == first).sum() == 1:
            into = np.flatnonzero(ends == first)[0] % 2 == 0
            assert (found.normal[i] @ d < 0.0) == into, (o.tolist(), d.tolist(), first)
        inner = np.flatnonzero(np.isfinite(ends[:-1]) & np.isfinite(ends[1:]))
        thick = inner[ends[inner + 1] - ends[inner] > 1e-6]
        for k in thick:
            # Not in the middle, where by symmetry there may be a face between two solids.
            points.append(o + (0.437 * ends[k] + 0.563 * ends[k + 1]) * d)
            inside.append(k % 2 == 0)
    if points:
        contained = walker.contains(np.array(points))
        assert (contained == np.array(inside)).all()


def is_rounding(walker: Walker, o: np.ndarray, d: np.ndarray, t: float) -> bool:
    """Return whether an answer is right but for pieces and gaps thinner than the tolerance."""
    spans = walker.spans([o], [d])
    ends = np.stack([spans.t_in, spans.t_out], axis=1).ravel().tolist()
    width = 4.0 * oracle.tolerance(0.0)
    if abs(t) <= width and any(abs(e) <= width for e in ends):
        return True  # it starts on what it meets, perhaps a sheet
    k = 0
    thin = False
    while k + 1 < len(ends):
        if ends[k + 1] - ends[k] <= 4.0 * oracle.tolerance(ends[k]):
            del ends[k : k + 2]
            thin = True
            k = max(0, k - 1)
        else:
            k += 1
    ahead = [e for e in ends if e >= -width and math.isfinite(e)] + [math.inf]
    starts_on = abs(ahead[0]) <= width
    return (thin or starts_on) and any(
        t == e or abs(t - e) <= SAME * max(1.0, abs(e)) for e in ahead[: 2 if starts_on else 1]
    )
