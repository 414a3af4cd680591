"""The meaning of BlobTree expressions, in NumPy, straight from the formulas.

Values at points (N, 3) by recursion over the expression; roots along a ray by dense sampling and
refinement. Shares nothing with the kernels but the expression's nodes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Generator, Sequence

import numpy as np

from pcsg.blobtree.nodes import (
    Bent,
    Combination,
    Cones,
    Field,
    Painted,
    Placed,
    Primitive,
    children_of,
)

T = 0.5
RATIO = 1.0 / math.sqrt(1.0 - 0.5 ** (1.0 / 3.0))
"""Reach over the radius of a lone primitive."""


def wyvill(d: np.ndarray, reach: float) -> np.ndarray:
    x = 1.0 - (d / reach) ** 2
    return np.where(x > 0.0, np.maximum(x, 0.0) ** 3, 0.0)


def distance_to_segment(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance of points (N, D) to the segment a b."""
    e = b - a
    length2 = float(e @ e)
    s = np.clip((p - a) @ e / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(p))
    return np.linalg.norm(p - a - s[:, None] * e, axis=1)


def distance_to_polygon(p: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance of points (N, 2) to a filled convex polygon, counterclockwise."""
    inside = np.ones(len(p), bool)
    best = np.full(len(p), np.inf)
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        e = b - a
        inside &= e[0] * (p[:, 1] - a[1]) - e[1] * (p[:, 0] - a[0]) >= 0.0
        best = np.minimum(best, distance_to_segment(p, a, b))
    return np.where(inside, 0.0, best)


def cone_distance(p: np.ndarray, length: float, radius: float) -> np.ndarray:
    """Distance to a solid cone: in the half-plane through the axis it is a triangle."""
    q = np.stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]], axis=1)
    if length == 0.0 or radius == 0.0:
        return distance_to_segment(q, np.array([0.0, 0.0]), np.array([radius, length]))
    return distance_to_polygon(q, np.array([[-radius, 0.0], [radius, 0.0], [0.0, length]]))


def primitive_value(node: Primitive, p: np.ndarray) -> np.ndarray:
    name, args = node.skeleton.name, node.args
    if name == "point":
        return wyvill(np.linalg.norm(p, axis=1), RATIO * args[0])
    if name == "segment":
        d = distance_to_segment(p, np.zeros(3), np.array([0.0, 0.0, args[0]]))
        return wyvill(d, RATIO * args[1])
    if name == "cone":
        length, rb, rt = args
        return wyvill(cone_distance(p, length, rb - rt), RATIO * rt)
    if name == "disc":
        rho = np.hypot(p[:, 0], p[:, 1])
        return wyvill(np.hypot(np.maximum(rho - args[0], 0.0), p[:, 2]), RATIO * args[1])
    if name == "box":
        out = np.maximum(np.abs(p) - np.array(args[:3]), 0.0)
        return wyvill(np.linalg.norm(out, axis=1), RATIO * args[3])
    if name == "polygon":
        flat = distance_to_polygon(p[:, :2], np.reshape(args[:-1], (-1, 2)))
        return wyvill(np.hypot(flat, p[:, 2]), RATIO * args[-1])
    if name in ("quartic", "cauchy"):
        return convolution_value(name, args, p)
    raise NotImplementedError(name)


GAUSS = np.polynomial.legendre.leggauss(10)
"""Nodes and weights."""


def convolution_value(name: str, args: tuple[float, ...], p: np.ndarray) -> np.ndarray:
    """The integral along the segment, by Gauss's rule on pieces."""
    length, ra, rb = args
    thick = max(ra, rb)
    # Nothing beyond the support: most points of a ray.
    far = distance_to_segment(p, np.zeros(3), np.array([0.0, 0.0, length]))
    near = far < (2.0 if name == "quartic" else 6.0) * thick
    if not near.all():
        out = np.zeros(len(p))
        if near.any():
            out[near] = convolution_value(name, args, p[near])
        return out
    z, h2 = p[:, 2], p[:, 0] ** 2 + p[:, 1] ** 2
    if name == "quartic":
        reach = 2.0 * thick
        wa, wb = (T / (16 / 15 * (reach**2 - d**2) ** 2.5 / reach**4) for d in (ra, rb))
        c = np.sqrt(np.maximum(reach**2 - h2, 0.0))
        ends, pieces = (np.clip(z - c, 0.0, length), np.clip(z + c, 0.0, length)), 1
    else:
        wa, wb = (T / (math.pi * thick / 2 / (1 + (d / thick) ** 2) ** 1.5) for d in (ra, rb))
        ends, pieces = (np.zeros(len(p)), np.full(len(p), length)), 12
    nodes, weights = GAUSS
    out = np.zeros(len(p))
    for k in range(pieces):
        a = ends[0] + (ends[1] - ends[0]) * k / pieces
        b = ends[0] + (ends[1] - ends[0]) * (k + 1) / pieces
        for node, weight in zip(nodes, weights, strict=True):
            s = 0.5 * (a + b) + 0.5 * (b - a) * node
            r2 = h2 + (z - s) ** 2
            if name == "quartic":
                kernel = np.maximum(1.0 - r2 / (2.0 * thick) ** 2, 0.0) ** 2
            else:
                kernel = 1.0 / (1.0 + r2 / thick**2) ** 2
            out += 0.5 * (b - a) * weight * (wa + (wb - wa) * s / length) * kernel
    if name == "cauchy":
        u = np.clip(far / thick - 5.0, 0.0, 1.0)
        out *= 1.0 - (6.0 * u**5 - 15.0 * u**4 + 10.0 * u**3)
    return out


def swelling(x: np.ndarray, w: float, a0: float) -> np.ndarray:
    """The swelling beside a contact: two cubics, from the conditions on h and h' at 0, w/2, w."""
    # First half: h = c3 x3 + c2 x2 + x with h(w/2) = a0, h'(w/2) = 0; solved, not copied.
    half = w / 2
    c3, c2 = np.linalg.solve(
        np.array([[half**3, half**2], [3 * half**2, 2 * half]]), np.array([a0 - half, -1.0])
    )
    # Second half: a cubic from (a0, slope 0) to (0, slope 0).
    s = np.clip((x - half) / half, 0.0, 1.0)
    second = a0 * (1.0 - s) ** 2 * (1.0 + 2.0 * s)
    first = ((c3 * x + c2) * x + 1.0) * x
    return np.where((x <= 0.0) | (x >= w), 0.0, np.where(x < half, first, second))


def contact(f: np.ndarray, w: float, a0: float) -> np.ndarray:
    """Precise contact of fields (K, N): section 2 of the specification, term by term."""
    best = np.argmax(f, axis=0)
    top = np.max(f, axis=0)
    pressed = np.zeros_like(top)
    swollen = np.zeros_like(top)
    for j in range(len(f)):
        other = best != j
        pressed += np.where(other & (f[j] > T), f[j] - T, 0.0)
        h = np.where(other & (f[j] < T), swelling(T - f[j], w, a0), 0.0)
        swollen = np.maximum(swollen, h)
    kept = np.where(top >= T, T + np.maximum(0.0, (top - T) - pressed), top)
    return kept + swollen


def combined_value(node: Combination, p: np.ndarray) -> np.ndarray:
    name = node.blend.name
    args = node.args
    f = np.array([value(c, p) for c in node.children])
    if name == "sum":
        return f.sum(axis=0)
    if name == "weight":
        return args[0] * f[0]
    if name == "excess":
        f = np.maximum(f, 0.0)
        return contact(f, *contact_numbers(args)) - f.sum(axis=0)
    if name == "joint":
        bounds = np.clip(f[1::2], 0.0, 1.0)
        total = bounds.sum(axis=0)
        free = 1.0 - np.prod(1.0 - bounds, axis=0)
        beta = np.where(total > 0.0, free / np.where(total > 0.0, total, 1.0), 1.0)
        return f[0] + beta * (bounds * f[2::2]).sum(axis=0)
    f = np.maximum(f, 0.0)
    if name == "union":
        return f.max(axis=0)
    if name == "intersect":
        return f.min(axis=0)
    if name == "subtract":
        a, b = f
        high = T + (np.maximum(a, 2 * T) - T) * (T - b) / T
        return np.maximum(np.minimum(a, high), 0.0)
    if name == "ricci":
        return (f ** args[0]).sum(axis=0) ** (1.0 / args[0])
    if name == "pcm":
        return contact(f, *contact_numbers(args))
    if name == "gbb":
        b = np.clip(f[0], 0.0, 1.0)
        return b * f[1] + (1.0 - b) * f[2]
    if name == "controlled":
        n = len(f)
        pairs = {(i, i + 1) for i in range(n - 1)}
        if args:
            pairs = {(int(min(p)), int(max(p))) for p in zip(args[::2], args[1::2], strict=True)}
        best = np.zeros(len(p))
        for chosen in range(1, 2**n):
            members = [k for k in range(n) if chosen >> k & 1]
            if all(pair in pairs for pair in itertools.combinations(members, 2)):
                best = np.maximum(best, f[members].sum(axis=0))
        return best
    x, y = f - T
    if name == "r_union":
        r = x + y + np.sqrt(x * x + y * y)
        end = -T * (2.0 - math.sqrt(2.0))
        return T + r + np.where(r < 0.0, -(T + end) / end**2 * r * r, 0.0)
    if name == "r_intersect":
        r = x + y - np.sqrt(x * x + y * y)
        u = np.clip(1.0 + r / T, 0.0, 1.0)
        return np.where(r > 0.0, T + r, T * u * u * (2.0 - u))
    raise NotImplementedError(name)


def contact_numbers(args: tuple[float, ...]) -> tuple[float, float]:
    w = args[0] if args else 0.4
    return w, args[1] if len(args) > 1 else w / 6.0


def top_of(node: Field) -> float:
    """The highest point of the skeletons below, as warps take it."""
    return box_of(node)[1][2]


def box_of(node: Field) -> tuple[np.ndarray, np.ndarray]:
    """The box of boxes of skeletons."""
    if isinstance(node, Primitive):
        lower, upper = node.skeleton.extent(node.args)
        return np.array(lower), np.array(upper)
    if isinstance(node, Cones):
        turns = np.linspace(0.0, 2.0 * np.pi, 4001)
        corners = []
        for start, axis, foot in zip(node.start, node.axis, node.foot, strict=True):
            corners += [start, start + axis]
            if foot > 0.0:
                # The rim, point by point.
                u = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
                v = np.cross(axis, u)
                u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
                rim = np.outer(np.cos(turns), u) + np.outer(np.sin(turns), v)
                corners += [*(start + foot * rim)]
        return np.min(corners, axis=0), np.max(corners, axis=0)
    boxes = [box_of(c) for c in children_of(node)]
    lower = np.min([b[0] for b in boxes], axis=0)
    upper = np.max([b[1] for b in boxes], axis=0)
    if isinstance(node, Placed):
        corners = np.array(np.meshgrid(*zip(lower, upper, strict=True))).reshape(3, -1)
        moved = node.matrix[:, :3] @ corners + node.matrix[:, 3:]
        return moved.min(axis=1), moved.max(axis=1)
    return lower, upper


def unbend(node: Bent, p: np.ndarray) -> np.ndarray:
    height = node.height if node.height is not None else max(top_of(node.child), 0.0)
    name = node.warp.name
    x, y, z = p.T
    if name == "twist":
        a = -math.radians(node.args[0]) * z
        c, s = np.cos(a), np.sin(a)
        return np.stack([c * x - s * y, s * x + c * y, z], axis=1)
    if name == "taper":
        a, b = node.args
        s = a + (b - a) * np.clip(z / height, 0.0, 1.0) if height > 0.0 else np.full_like(z, a)
        return np.stack([x / s, y / s, z], axis=1)
    total = math.radians(node.args[0])
    k = total / height if height > 0.0 else 0.0
    if abs(k) < 1e-9:
        return p
    # Polar coordinates about the centre of curvature, the angle counted from the middle.
    cx = 1.0 / k
    g = math.copysign(1.0, k)
    angle = np.arctan2(g * z, g * (cx - x))
    middle = total / 2
    angle = middle + (angle - middle + math.pi) % (2 * math.pi) - math.pi
    turn = np.clip(angle, min(total, 0.0), max(total, 0.0))
    c, s = np.cos(turn), np.sin(turn)
    # Turned back by `turn` about the centre, then moved along by the length of the arc.
    dx, dz = x - cx, z
    return np.stack([cx + c * dx - s * dz, y, turn / k + s * dx + c * dz], axis=1)


def cones_value(node: Cones, p: np.ndarray) -> np.ndarray:
    """Branches given as arrays: groups are summed."""
    group = np.zeros(len(node.start), int)
    if node.groups is not None:
        group = np.searchsorted(node.groups, np.arange(len(group)), side="right") - 1
    fields = []
    for start, axis, foot, reach in zip(node.start, node.axis, node.foot, node.reach, strict=True):
        length = np.linalg.norm(axis)
        unit = axis / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
        along = (p - start) @ unit
        across = np.sqrt(np.maximum(((p - start) ** 2).sum(axis=1) - along**2, 0.0))
        local = np.stack([across, np.zeros(len(p)), along], axis=1)
        fields.append(wyvill(cone_distance(local, length, foot), reach))
    total = np.zeros(len(p))
    for k in np.unique(group):
        members = np.array(fields)[group == k]
        total += members.sum(axis=0) if node.blend == "sum" else members.max(axis=0)
    return total


def value(node: Field, p: np.ndarray) -> np.ndarray:
    """The field at points (N, 3)."""
    if isinstance(node, Primitive):
        return primitive_value(node, p)
    if isinstance(node, Cones):
        return cones_value(node, p)
    if isinstance(node, Placed):
        a = np.linalg.inv(node.matrix[:, :3])
        return value(node.child, (p - node.matrix[:, 3]) @ a.T)
    if isinstance(node, Painted):
        return value(node.child, p)
    if isinstance(node, Bent):
        return value(node.child, unbend(node, p))
    assert isinstance(node, Combination)
    return combined_value(node, p)


Samples = Generator[np.ndarray, np.ndarray, np.ndarray]


def find_roots(
    g: Callable[[np.ndarray, np.ndarray], np.ndarray],
    ranges: Sequence[tuple[float, float]],
    samples: int = 1500,
) -> list[np.ndarray]:
    """Sign changes on many lines at a time; ``g(line, t)`` are values of lines at parameters."""
    runs = [search(a, b, samples) for a, b in ranges]
    asked = {k: next(run) for k, run in enumerate(runs)}
    roots: list[np.ndarray] = [np.zeros(0)] * len(runs)
    while asked:
        lines = np.repeat(list(asked), [len(t) for t in asked.values()])
        values = g(lines, np.concatenate(list(asked.values())))
        ends = np.cumsum([len(t) for t in asked.values()])[:-1]
        for k, found in zip(list(asked), np.split(values, ends), strict=True):
            try:
                asked[k] = runs[k].send(found)
            except StopIteration as done:
                roots[k] = done.value
                del asked[k]
    return roots


def search(begin: float, end: float, samples: int) -> Samples:
    """Find the sign changes of a function that is told at parameters asked for.

    Every sample that is a local extremum near zero is refined until it is known which side of zero
    it is on.
    """
    t = np.linspace(begin, end, samples)
    v = yield t
    for _ in range(30):
        inside = v >= 0.0
        # Extrema that point at zero: the middle of three.
        low = (v[1:-1] < 0.0) & (v[1:-1] >= v[:-2]) & (v[1:-1] >= v[2:]) & (v[1:-1] > -0.02)
        high = (v[1:-1] >= 0.0) & (v[1:-1] <= v[:-2]) & (v[1:-1] <= v[2:]) & (v[1:-1] < 0.02)
        k = np.flatnonzero(low | high) + 1
        k = k[(inside[k - 1] == inside[k]) & (inside[k] == inside[k + 1])]
        # A plateau is no extremum: where three press each other the field is T all over.
        k = k[(v[k - 1] != v[k]) | (v[k] != v[k + 1])]
        # Within three samples a parabola rises by less than it falls on its worse side.
        k = k[np.abs(v[k]) < np.maximum(np.abs(v[k] - v[k - 1]), np.abs(v[k] - v[k + 1]))]
        k = k[(t[k + 1] - t[k - 1]) > 1e-9 * max(1.0, abs(end - begin))]
        if not len(k):
            break
        fractions = np.arange(1, 8) / 8
        new = np.concatenate(
            [
                (t[k - 1, None] + (t[k] - t[k - 1])[:, None] * fractions).ravel(),
                (t[k, None] + (t[k + 1] - t[k])[:, None] * fractions).ravel(),
            ]
        )
        t = np.concatenate([t, new])
        told = yield new
        v = np.concatenate([v, told])
        order = np.argsort(t, kind="stable")
        t, v = t[order], v[order]
    inside = v >= 0.0
    at = np.flatnonzero(inside[1:] != inside[:-1])
    a, b = t[at], t[at + 1]
    rising = inside[at + 1]
    for _ in range(36 if len(at) else 0):
        middle = 0.5 * (a + b)
        told = yield middle
        up = (told >= 0.0) == rising
        a, b = np.where(up, a, middle), np.where(up, middle, b)
    roots: np.ndarray = 0.5 * (a + b)
    return roots
