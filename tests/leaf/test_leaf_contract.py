"""The contract of leaves: every solid of the registry, every property, any ray."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from subjects import ModelSubject, Subject, subjects

from pcsg.leaf.dispatch import leaf_crossings, leaf_inside, leaf_normal, leaf_uv
from pcsg.leaf.registry import ALL, LEAVES
from pcsg.vec import Affine, Ray, Vec3, invert, transform_point, transform_ray

SOLIDS = subjects()

every_solid = pytest.mark.parametrize("solid", SOLIDS, ids=lambda subject: subject.name)


def cross(solid: Subject, args: Any, origin: Any, direction: Any) -> list[float]:
    """Return the crossings, having checked what holds for any ray."""
    t = np.full(16, 123.5)
    ray = Ray(*map(float, origin), *map(float, direction), 0.0, math.inf)
    # Arguments begin somewhere, and so does the list.
    end = leaf_crossings(solid.kind, ray, ALL, solid.arguments(args), 1, solid.pool, t, 3)
    found = t[3:end].tolist()
    # None of them has more than two intervals, also while it looks for them; a mesh looks for
    # crossings, of which a ray meets four.
    last = 11 if isinstance(solid, ModelSubject) else 7
    assert (t[:3] == 123.5).all() and (t[last:] == 123.5).all(), "wrote outside its place"
    assert len(found) % 2 == 0
    assert not any(map(math.isnan, found))
    assert all(a < b for a, b in zip(found[::2], found[1::2], strict=True)), found
    assert all(a <= b for a, b in pairwise(found)), found
    bounded = all(map(math.isfinite, solid.bounds_of(args).lower))
    assert not bounded or all(map(math.isfinite, found)), found
    return found


def implicit(solid: Subject, args: Any, p: Any) -> Any:
    return solid.shape.implicit(np.asarray(p, dtype=float), args)


coordinates = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 0.5, -0.5]), st.floats(-1.625, 1.625, width=32)
)
points = st.tuples(coordinates, coordinates, coordinates)
components = st.one_of(
    st.sampled_from([0.0, -0.0, 1.0, -1.0, 2.0]), st.floats(-1.0, 1.0), st.floats(-1e-6, 1e-6)
).map(lambda x: x if abs(x) > 1e-30 else math.copysign(0.0, x))
directions = st.tuples(components, components, components).filter(lambda d: max(map(abs, d)) > 1e-3)
distances = st.sampled_from([0.0, 1.0, -1.0, 3.0, 8.0, 1e3, 1e6])


@st.composite
def lines(draw: Any) -> tuple[Any, Any]:
    """Lines that come near the solids, from close by and from far away."""
    target, direction = np.array(draw(points)), np.array(draw(directions))
    return target - draw(distances) * direction, direction


def draw_args(data: Any, solid: Subject) -> tuple[float, ...]:
    args = data.draw(solid.shape.args, label="args")
    return tuple(args)


def rounding(p: Any) -> float:
    """What rounding may move a point by, of this size or seen from there."""
    return 1e-14 * (4.0 + float(np.abs(p).max()))


def test_every_solid_is_described_a_second_time() -> None:
    # Blobs have an oracle of their own: tests/blobtree.
    solids = {cls for cls in LEAVES.values() if not cls.sheet and cls.name != "blob"}
    assert {subject.solid for subject in SOLIDS} == solids


@every_solid
@given(data=st.data(), line=lines())
def test_ends_lie_on_the_surface(solid: Subject, data: Any, line: Any) -> None:
    args, (o, d) = draw_args(data, solid), line
    for t in cross(solid, args, o, d):
        if math.isfinite(t):
            p = o + t * d
            assert abs(implicit(solid, args, p)) <= rounding(o) + rounding(p)


@every_solid
@given(data=st.data(), line=lines())
def test_spans_are_inside_and_gaps_outside(solid: Subject, data: Any, line: Any) -> None:
    args, (o, d) = draw_args(data, solid), line
    found = cross(solid, args, o, d)
    foot = -np.dot(o, d) / np.dot(d, d)
    reach = solid.shape.reach(args) / np.linalg.norm(d)
    ends = [t for t in found if math.isfinite(t)]
    knots = [min([foot, *ends]) - reach, *ends, max([foot, *ends]) + reach]
    inside = bool(found) and found[0] == -math.inf
    for a, b in pairwise(knots):
        # One ray may meet a long span and another a short one: three places in each.
        for part in (0.05, 0.5, 0.95):
            p = o + (a + part * (b - a)) * d
            f = implicit(solid, args, p)
            e = rounding(o) + rounding(p)
            assert f <= e if inside else f >= -e
            if abs(f) > e:
                arguments = solid.arguments(args)
                assert (
                    leaf_inside(solid.kind, Vec3(*p.tolist()), arguments, 1, solid.pool) is inside
                )
        inside = not inside


@every_solid
@given(data=st.data(), line=lines())
def test_agrees_with_dense_sampling(solid: Subject, data: Any, line: Any) -> None:
    args, (o, d) = draw_args(data, solid), line
    found = np.array(cross(solid, args, o, d))
    unit = np.linalg.norm(d)
    foot, reach = -np.dot(o, d) / unit**2, solid.shape.reach(args) / unit
    t = np.linspace(foot - reach, foot + reach, 2001)
    f = implicit(solid, args, o + t[:, None] * d)
    sure = np.abs(f) > 10.0 * rounding(o)
    within = np.searchsorted(found, t) % 2 == 1
    assert (within[sure] == (f[sure] < 0.0)).all()
    flips = np.flatnonzero(sure[1:] & sure[:-1] & ((f[1:] < 0.0) != (f[:-1] < 0.0)))
    for k in flips:
        root = bisect(lambda s: implicit(solid, args, o + s * d), t[k], t[k + 1])
        around = o + np.outer([root - 1e-7 / unit, root + 1e-7 / unit], d)
        steepness = np.abs(implicit(solid, args, around)).min() / 1e-7 + 1e-12
        error = np.abs(found - root).min() * unit
        assert error <= 10.0 * rounding(o) / min(1.0, steepness)


def bisect(f: Any, a: float, b: float) -> float:
    outside = f(a) > 0.0
    for _ in range(80):
        middle = 0.5 * (a + b)
        a, b = (middle, b) if (f(middle) > 0.0) == outside else (a, middle)
    return 0.5 * (a + b)


def gradient(solid: Subject, args: Any, p: Any, h: float) -> Any:
    steps = h * np.eye(3)
    return (implicit(solid, args, p + steps) - implicit(solid, args, p - steps)) / (2.0 * h)


@every_solid
@given(data=st.data(), line=lines())
def test_normals_are_gradients(solid: Subject, data: Any, line: Any) -> None:
    args, (o, d) = draw_args(data, solid), line
    arguments = solid.arguments(args)
    for t in cross(solid, args, o, d):
        if not math.isfinite(t):
            continue
        p = o + t * d
        n = np.array(leaf_normal(solid.kind, Vec3(*p.tolist()), arguments, 1, solid.pool))
        assert np.isfinite(n).all()
        assert np.linalg.norm(n) > 1e-7
        n /= np.linalg.norm(n)
        h = 1e-5 * min(1.0, *args, 1.0) + 1e-9
        coarse, fine = gradient(solid, args, p, 8.0 * h), gradient(solid, args, p, h)
        near_edge = np.abs(coarse - fine).max() > 1e-3 or abs(np.linalg.norm(fine) - 1.0) > 1e-3
        if near_edge or rounding(o) > 0.1 * h:
            continue
        assert np.abs(n - fine / np.linalg.norm(fine)).max() < 1e-3
        out, into = Vec3(*(p + 4.0 * h * n).tolist()), Vec3(*(p - 4.0 * h * n).tolist())
        assert leaf_inside(solid.kind, into, arguments, 1, solid.pool)
        assert not leaf_inside(solid.kind, out, arguments, 1, solid.pool)


@every_solid
@given(data=st.data(), line=lines())
def test_boxes_and_supports_contain_the_solid(solid: Subject, data: Any, line: Any) -> None:
    args, (o, d) = draw_args(data, solid), line
    box, e = solid.bounds_of(args), rounding(o)
    towards = Vec3(*data.draw(directions, label="towards"))
    for t in cross(solid, args, o, d):
        if math.isfinite(t):
            p = o + t * d
            assert (p >= np.array(box.lower) - e).all() and (p <= np.array(box.upper) + e).all()
            assert np.dot(p, towards) <= solid.support(towards, args) + 4.0 * e


@every_solid
@given(data=st.data())
def test_supports_are_attained(solid: Subject, data: Any) -> None:
    shape, args = solid.shape, draw_args(data, solid)
    towards = data.draw(directions, label="towards")
    if shape.extremes is None:
        box = solid.bounds_of(args)
        if not all(map(math.isfinite, (*box.lower, *box.upper))) or box.lower > box.upper:
            assert math.isinf(solid.support(Vec3(1.0, towards[1], 1.0), args))
        return
    farthest = float((shape.extremes(args) @ np.array(towards)).max())
    support = solid.support(Vec3(*towards), args)
    assert farthest - 1e-12 <= support <= farthest + 4e-4 * (1.0 + sum(args)) * math.hypot(*towards)


@every_solid
@given(data=st.data())
def test_box_is_the_support_along_the_axes(solid: Subject, data: Any) -> None:
    args = draw_args(data, solid)
    box = solid.bounds_of(args)
    for axis in range(3):
        unit = [0.0, 0.0, 0.0]
        unit[axis] = 1.0
        assert solid.support(Vec3(*unit), args) == pytest.approx(box.upper[axis], abs=1e-15)
        unit[axis] = -1.0
        assert solid.support(Vec3(*unit), args) == pytest.approx(-box.lower[axis], abs=1e-15)


@every_solid
@given(data=st.data(), line=lines(), exponent=st.integers(-300, 300), sign=st.sampled_from([1, -1]))
def test_scaling_the_direction_divides_t(
    solid: Subject, data: Any, line: Any, exponent: int, sign: int
) -> None:
    args, (o, d) = draw_args(data, solid), line
    scale = sign * 2.0**exponent
    plain = cross(solid, args, o, d)
    scaled = [t * scale for t in cross(solid, args, o, d * scale)][::sign]
    if abs(exponent) < 250 and sign == 1:
        assert scaled == plain
    for t in scaled:
        if math.isfinite(t):
            p = o + t * d
            assert abs(implicit(solid, args, p)) <= rounding(o) + rounding(p)


@every_solid
@given(data=st.data(), line=lines(), exponent=st.floats(-150.0, 149.5))
def test_directions_of_any_magnitude(solid: Subject, data: Any, line: Any, exponent: float) -> None:
    args, (o, d) = draw_args(data, solid), line
    scale = 10.0**exponent / np.abs(d).max()
    plain = np.array(cross(solid, args, o, d))
    scaled = np.array(cross(solid, args, o, d * scale)) * scale
    ends = np.clip(scaled, -1e12, 1e12)
    middles = 0.5 * (ends[::2] + ends[1::2])
    assert all(implicit(solid, args, o + t * d) <= rounding(o) for t in middles if abs(t) < 1e9)
    if len(plain) != len(scaled):
        # Only a touch may come or go.
        longer = np.clip(max(plain, scaled, key=len), -1e12, 1e12)
        middles = 0.5 * (longer[:-1] + longer[1:])
        grazing = np.abs(implicit(solid, args, o + middles[:, None] * d)) <= 1e-8
        assert grazing.any()


anything = st.floats(-1e150, 1e150)


@every_solid
@given(
    data=st.data(),
    origin=st.tuples(*[st.floats(-1e30, 1e30)] * 3),
    direction=st.tuples(anything, anything, anything),
)
def test_order_for_any_ray(solid: Subject, data: Any, origin: Any, direction: Any) -> None:
    assume(max(map(abs, direction)) > 1e-150)
    cross(solid, draw_args(data, solid), origin, direction)
    # Through the middle, where nothing is lost by distance.
    cross(solid, draw_args(data, solid), (0.0, 0.0, 0.0), direction)


entries = st.floats(-2.0, 2.0).map(lambda x: round(x, 6))


@every_solid
@given(
    data=st.data(),
    line=lines(),
    linear=st.lists(entries, min_size=9, max_size=9),
    shift=st.lists(entries, min_size=3, max_size=3),
)
def test_frames_do_not_change_t(
    solid: Subject, data: Any, line: Any, linear: list[float], shift: list[float]
) -> None:
    args, (o, d) = draw_args(data, solid), line
    a = np.array(linear).reshape(3, 3) + 3.0 * np.eye(3)
    assume(np.linalg.cond(a) < 100.0)
    local_from_world = Affine(*np.hstack([a, np.array(shift)[:, None]]).ravel().tolist())
    world_from_local, good = invert(local_from_world)
    assert good
    local = Ray(*o.tolist(), *d.tolist(), 0.0, math.inf)
    world = transform_ray(world_from_local, local)
    again = transform_ray(local_from_world, world)
    for t in cross(solid, args, again[:3], again[3:6]):
        if math.isfinite(t):
            p = Vec3(*(w + t * v for w, v in zip(world[:3], world[3:6], strict=True)))
            q = transform_point(local_from_world, p)
            assert abs(implicit(solid, args, q)) <= 1e3 * (rounding(o) + rounding(q))


@every_solid
@given(data=st.data(), line=lines())
def test_surface_coordinates_are_numbers(solid: Subject, data: Any, line: Any) -> None:
    args, (o, d) = draw_args(data, solid), line
    for t in cross(solid, args, o, d):
        if math.isfinite(t):
            p = Vec3(*(o + t * d).tolist())
            uv = leaf_uv(solid.kind, p, solid.arguments(args), 1, solid.pool)
            assert all(map(math.isfinite, uv))
            if all(map(math.isfinite, solid.bounds_of(args).lower)):
                assert min(uv) >= -1e-6 and max(uv) <= 1.0 + 1e-6
