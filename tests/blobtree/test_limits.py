"""Limits, smoothness and figures that can be derived by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pcsg import blobtree as b
from pcsg.blobtree.fields import LEVEL, REACH, bound_below, smooth_hull
from pcsg.blobtree.model import Model
from pcsg.blobtree.nodes import Cones, Field
from pcsg.errors import UsageError


def at(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    return np.array([[1.0, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z]])


def turned(angle: float, z: float = 0.0) -> np.ndarray:
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, z]])


POINTS = np.random.default_rng(0).uniform(-1.6, 1.6, (4000, 3))
PAIR = (b.place(at(-0.3), b.cone(1.0, 0.5, 0.4)), b.place(at(0.4), b.segment(1.0, 0.4)))


def same(one: Field, two: Field, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(
        Model(one).field(POINTS), Model(two).field(POINTS), rtol=0.0, atol=tolerance
    )


def test_a_lone_primitive_has_its_radius() -> None:
    assert pytest.approx(0.4542021, abs=1e-7) == LEVEL
    assert pytest.approx(2.2016632, abs=1e-6) == REACH
    assert Model(b.point(0.7)).intersect([[-5, 0, 0]], [[1, 0, 0]])[0] == pytest.approx(4.3)


def test_bounded_blending_is_its_parts_where_the_bound_is_0_and_1() -> None:
    contact, blend = b.pcm(*PAIR), b.total(*PAIR)
    same(b.gbb(b.place(at(50.0), b.point(1.0)), contact, blend), blend)
    same(b.gbb(b.weight(1.0, b.box(9.0, 9.0, 9.0, 1.0)), contact, blend), contact)


def test_contact_of_one_is_the_child() -> None:
    same(b.pcm(PAIR[0]), PAIR[0])


def test_contact_of_two_is_the_printed_form() -> None:
    # Galbraith, MacMurchy, Wyvill 2004, eq. 3: F = f_max + d(f_other).
    w, a0 = 0.4, 0.4 / 6.0
    c3, c2 = 4.0 * (w - 4.0 * a0) / w**3, 4.0 * (3.0 * a0 - w) / w**2
    points = 0.5 * POINTS + [0.0, 0.0, 0.5]
    values = np.array([Model(part).field(points) for part in PAIR])
    most, other = values.max(axis=0), values.min(axis=0)
    x = 0.5 - other
    near = c3 * x**3 + c2 * x**2 + x
    far = 4.0 * a0 * (x - w) ** 2 * (4.0 * x - w) / w**3
    d = np.where(x <= 0.0, x, np.where(x < 0.5 * w, near, np.where(x < w, far, 0.0)))
    expected = most + d
    assert ((x < 0.0) & (most > 0.5)).sum() > 20 and ((x > 0.0) & (x < w)).sum() > 100
    np.testing.assert_allclose(Model(b.pcm(*PAIR)).field(points), expected, rtol=0.0, atol=1e-12)


def test_joint_with_a_bound_is_bounded_blending() -> None:
    bound = b.weight(0.9, b.place(at(0.0, 0.0, 0.5), b.point(0.6)))
    same(b.joint(b.total(*PAIR), (bound, *PAIR)), b.gbb(bound, b.pcm(*PAIR), b.total(*PAIR)))


def test_ricci_is_the_sum_for_one_and_nearly_the_greatest_for_many() -> None:
    same(b.ricci(1.0, *PAIR), b.total(*PAIR))
    same(b.ricci(800.0, *PAIR), b.union(*PAIR), 2e-3)


def test_controlled_is_sum_and_union_at_its_ends() -> None:
    three = (*PAIR, b.place(at(0.0, 0.5), b.point(0.5)))
    same(b.controlled(*three, pairs=[(0, 1), (0, 2), (1, 2)]), b.total(*three))
    same(b.controlled(*three, pairs=[]), b.union(*three))


def test_operators_do_not_depend_on_the_order_of_children() -> None:
    three = (*PAIR, b.place(at(0.0, 0.5), b.point(0.5)))
    for combine in (b.total, b.union, b.intersect, b.pcm):
        same(combine(*three), combine(*three[::-1]))


def test_the_sheet_of_contact_is_no_surface() -> None:
    model = Model(b.pcm(b.place(at(-0.4), b.point(0.8)), b.place(at(0.4), b.point(0.8))))
    x, y = np.meshgrid(np.linspace(-0.3, 0.3, 41), np.linspace(-0.3, 0.3, 41))
    o = np.stack([np.full(x.size, -4.0), x.ravel(), y.ravel()], axis=1)
    counts, _ = model.shoot(o, np.tile([1.0, 0.0, 0.0], (x.size, 1)))
    assert np.all(counts == 2)
    sheet = np.stack([np.zeros(x.size), x.ravel(), y.ravel()], axis=1)
    assert np.all(model.field(sheet) >= 0.5)


@pytest.mark.parametrize(
    "field",
    [
        b.total(*PAIR),
        b.ricci(2.5, *PAIR),
        b.pcm(PAIR[0]),
        b.gbb(b.weight(0.8, b.point(0.5)), b.total(*PAIR), b.ricci(2.0, *PAIR)),
        b.twist(40.0, PAIR[0]),
        b.convolution_segment(1.0, 0.4, 0.3),
        b.convolution_segment(1.0, 0.4, 0.3, kernel="cauchy"),
    ],
    ids=["sum", "ricci", "pcm1", "gbb", "twist", "quartic", "cauchy"],
)
def test_fields_are_continuously_differentiable(field: Field) -> None:
    model = Model(field)
    step = 1e-5 * np.random.default_rng(1).normal(size=POINTS.shape)
    change = np.abs(model.gradient(POINTS + step) - model.gradient(POINTS)).max(axis=1)
    assert change.max() < 60.0 * 1e-5 * 4.0


def widest(field: Field, low: float, high: float) -> float:
    """Greatest distance of the surface from the z axis."""
    z = np.linspace(low, high, 400)
    o = np.stack([np.full(400, 5.0), np.zeros(400), z], axis=1)
    return 5.0 - float(Model(field).intersect(o, np.tile([-1.0, 0, 0], (400, 1))).min())


@pytest.mark.parametrize(
    ("offset", "expected"),
    [(0.0, 1.339), (1.5, 1.110), (1.70, 1.035), (1.75, 1.014), (1.80, 1.005)],
)
def test_bulge_of_two_collinear_pieces(offset: float, expected: float) -> None:
    below = b.place(at(0.0, 0.0, -8.0), b.segment(8.0 - offset, 1.0))
    assert widest(below + b.segment(8.0, 1.0), -4.0, 4.0) == pytest.approx(expected, abs=2e-3)


def test_bend_keeps_the_ends_and_the_length() -> None:
    straight, bent = b.segment(3.0, 0.2), b.bend(60.0, b.segment(3.0, 0.2))
    k = math.radians(60.0) / 3.0
    s = np.linspace(0.0, 3.0, 50)
    axis = np.stack([(1 - np.cos(k * s)) / k, 0 * s, np.sin(k * s) / k], axis=1)
    np.testing.assert_allclose(Model(bent).field(axis), 1.0, atol=1e-12)
    np.testing.assert_allclose(
        Model(straight).field(np.stack([0 * s, 0 * s, s], axis=1)), 1.0, atol=1e-12
    )


def test_too_much_bend_is_refused() -> None:
    with pytest.raises(UsageError, match="too much"):
        Model(b.bend(120.0, b.segment(0.3, 0.2)))


def test_colours_are_mixed_by_contribution_and_the_label_is_the_strongest() -> None:
    left = b.label(1, b.color(1.0, 0.0, 0.0, b.place(at(-0.5), b.point(0.5))))
    right = b.label(2, b.color(0.0, 0.0, 1.0, b.place(at(0.5), b.point(0.5))))
    found = Model(left + right).attributes([[-0.9, 0, 0], [0.0, 0.0, 0.0], [0.9, 0, 0], [9, 9, 9]])
    np.testing.assert_allclose(found["color"][1], [0.5, 0.0, 0.5], atol=1e-12)
    assert found["color"][0, 0] > 0.9
    np.testing.assert_array_equal(found["label"][[0, 2]], [1.0, 2.0])
    assert np.isnan(found["label"][3])


def test_the_share_of_a_bound_is_an_attribute() -> None:
    bound = b.weight(0.8, b.place(at(0.0, 0.0, 0.5), b.point(0.6)))
    model = Model(b.gbb(bound, b.pcm(*PAIR), b.total(*PAIR)))
    points = POINTS[:200]
    found = model.attributes(points)["bound"]
    wood = Model(b.total(*PAIR)).field(points) > 0.0
    np.testing.assert_allclose(found[wood], Model(bound).field(points)[wood], atol=1e-12)


@given(
    coefficients=st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4),
    h=st.floats(0.01, 2.0),
)
def test_bounds_from_ends_hold_for_cubics(coefficients: list[float], h: float) -> None:
    p = np.polynomial.Polynomial(coefficients)
    d, dd = p.deriv(), p.deriv(2)
    s = np.linspace(0.0, h, 300)
    m, k = max(0.0, -dd(s).min()), max(0.0, dd(s).max())
    slack = 1e-9
    assert bound_below(p(0.0), d(0.0), d(h), h, m, k) <= p(s).min() + slack
    low, high, slope_low, slope_high = smooth_hull(p(0.0), d(0.0), p(h), d(h), h, m, k)
    assert low <= p(s).min() + slack and high >= p(s).max() - slack
    assert slope_low <= d(s).min() + slack and slope_high >= d(s).max() - slack


def test_memory_of_a_primitive() -> None:
    rng = np.random.default_rng(0)
    parts = [b.place(at(*rng.uniform(0, 50, 3)), b.cone(1.0, 0.3, 0.2)) for _ in range(4000)]
    assert Model(b.total(*parts)).nbytes / 4000 <= 110


def test_the_hierarchy_of_a_sum_does_not_depend_on_the_order_of_its_cones() -> None:
    # Before: it followed the order given, and rays through shuffled ones took 30 times as long.
    rng = np.random.default_rng(3)
    start, axis = rng.uniform(0.0, 10.0, (300, 3)), rng.normal(0.0, 0.1, (300, 3))
    foot, reach = np.zeros(300), rng.uniform(0.1, 0.2, 300)
    order = rng.permutation(300)
    given = b.Model(Cones(start, axis, foot, reach))
    shuffled = b.Model(Cones(start[order], axis[order], foot[order], reach[order]))
    np.testing.assert_array_equal(given.pool[1], shuffled.pool[1])
