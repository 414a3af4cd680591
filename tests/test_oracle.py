"""The oracle against membership along rays, hand-made lists, and the reference evaluator."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
import oracle
import pytest
import strategies as cases
from hypothesis import given
from hypothesis import strategies as st
from oracle import Event, combine

from pcsg.graph.build import C, S
from pcsg.graph.expr import P, call
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Attribute, Calculation, Leaf, Node, Operation, Transformation
from pcsg.graph.tape import Fault, Program
from pcsg.graph.transforms import TRANSFORMS
from pcsg.vec import Affine, compose

Array = np.ndarray

# A third account of the solids: implicit functions on arrays of points, negative inside.

IMPLICIT: dict[str, Callable[..., Array]] = {
    "sphere": lambda p: (p**2).sum(1) - 1,
    "box": lambda p: np.abs(p).max(1) - 1,
    "cylinder": lambda p: np.maximum(np.hypot(p[:, 0], p[:, 1]) - 1, np.abs(p[:, 2] - 0.5) - 0.5),
    "cone": lambda p, r: np.maximum(
        np.hypot(p[:, 0], p[:, 1]) - (1 + (r - 1) * p[:, 2]), np.abs(p[:, 2] - 0.5) - 0.5
    ),
    "torus": lambda p, r: np.hypot(np.hypot(p[:, 0], p[:, 1]) - 1, p[:, 2]) - r,
    "halfspace": lambda p: p[:, 2],
    "superellipsoid": lambda p, e, n: (
        (np.abs(p[:, 0]) ** (2 / e) + np.abs(p[:, 1]) ** (2 / e)) ** (e / n)
        + np.abs(p[:, 2]) ** (2 / n)
        - 1
    ),
    "infcylinder": lambda p: np.hypot(p[:, 0], p[:, 1]) - 1,
    "infcone": lambda p, r: np.hypot(p[:, 0], p[:, 1]) - (1 + (r - 1) * p[:, 2]),
    "capsule": lambda p, r: np.min(
        [
            np.linalg.norm(p - [0.0, 0.0, h], axis=1) - (1 + (r - 1) * h)
            for h in np.linspace(0.0, 1.0, 1001)
        ],
        axis=0,
    ),
    "empty": lambda p: np.full(len(p), np.inf),
    **dict.fromkeys(oracle.SHEETS, lambda p: np.full(len(p), np.inf)),
    # Barycentric coordinates with respect to the corners
    "tetrahedron": lambda p: (
        -np.linalg.solve(
            np.vstack([np.array(oracle._CORNERS).T, np.ones(4)]), np.vstack([p.T, np.ones(len(p))])
        ).min(0)
    ),
}


def members(node: Node, points: Array, world_from_local: Array) -> Array:
    """Return which world points a tree without modules contains; one inverse for each leaf."""
    if isinstance(node, Transformation):
        m = np.eye(4)
        m[:3] = np.reshape(node.transform.kernel.py_func(*(a.value for a in node.args)), (3, 4))
        return members(node.successor, points, world_from_local @ m)
    if isinstance(node, Attribute):
        return members(node.successor, points, world_from_local)
    if isinstance(node, Operation):
        parts = [members(n, points, world_from_local) for n in node.operands]
        fold = {
            "union": np.logical_or,
            "intersection": np.logical_and,
            "difference": lambda a, b: a & ~b,
        }[node.operator.name]
        for part in parts[1:]:
            parts[0] = fold(parts[0], part)
        return parts[0]
    assert isinstance(node, Leaf)
    local = (np.linalg.inv(world_from_local) @ np.c_[points, np.ones(len(points))].T)[:3].T
    return IMPLICIT[node.solid.name](local, *(a.value for a in node.args)) <= 0.0


def inside_at(found: Sequence[Event], t: float) -> bool:
    return sum(1 for e in found if e.kind != "sheet" and e.t < t) % 2 == 1


@given(data=st.data())
def test_events_are_where_membership_changes(data: st.DataObject) -> None:
    graph = data.draw(cases.solid_graphs())
    o, d = data.draw(cases.rays(graph))
    found = oracle.events(graph, o, d)
    turns = [e.t for e in found if e.kind != "sheet"]
    finite = [t for t in turns if math.isfinite(t)]
    low, high = min([0.0, *finite]) - 3.0, max([0.0, *finite]) + 3.0
    ts = np.linspace(low, high, 501) + 0.1234567e-3
    ends = [low, *finite, high]
    ts = np.concatenate([ts, [0.5 * (a + b) for a, b in itertools.pairwise(ends)]])
    # Near an end, and where a ray glides along a face, rounding decides.
    for t in finite:
        ts = ts[np.abs(ts - t) > 1e-6 * (1.0 + abs(t))]
    expected = np.array([inside_at(found, t) for t in ts])
    reach = 1e-9 * (1.0 + np.abs(ts).max()) * (1.0 + max(map(abs, d))) + 1e-9 * max(map(abs, o))
    sure = np.ones(len(ts), bool)
    points = np.array(o) + ts[:, None] * np.array(d)
    is_member = members(graph.root, points, np.eye(4))
    for shift in np.vstack([np.eye(3), -np.eye(3)]) * reach:
        sure &= members(graph.root, points + shift, np.eye(4)) == is_member
    assert (expected == is_member)[sure].all()
    kinds = [e.kind for e in found if e.kind != "sheet"]
    assert kinds == ["enter", "leave"] * (len(kinds) // 2)
    assert turns == sorted(turns)


@given(data=st.data())
def test_contains_is_the_membership_of_points(data: st.DataObject) -> None:
    graph = data.draw(cases.solid_graphs())
    points = np.array(data.draw(st.lists(st.tuples(*[st.floats(-3, 3)] * 3), min_size=1)))
    expected = members(graph.root, points, np.eye(4))
    sure = np.ones(len(points), bool)
    for shift in np.vstack([np.eye(3), -np.eye(3)]) * 1e-7:
        sure &= members(graph.root, points + shift, np.eye(4)) == expected
    got = np.array([oracle.contains(graph, p) for p in points])
    assert (got == expected)[sure].all()


@given(data=st.data())
def test_normals_point_from_inside_to_outside(data: st.DataObject) -> None:
    graph = data.draw(cases.solid_graphs(sheets=False))
    o, d = data.draw(cases.rays(graph))
    size = math.sqrt(sum(x * x for x in d))
    for e in oracle.events(graph, o, d):
        if not math.isfinite(e.t) or e.normal == (0.0, 0.0, 0.0):
            continue
        assert math.isclose(sum(x * x for x in e.normal), 1.0, rel_tol=1e-12)
        along = sum(a * b for a, b in zip(e.normal, d, strict=True)) / size
        if abs(along) > 1e-6:
            assert (along > 0) == (e.kind == "leave")


@pytest.mark.parametrize(
    "name", ["sphere", "cylinder", "cone", "torus", "capsule", "superellipsoid", "infcone"]
)
@given(data=st.data())
def test_gradients_are_those_of_the_implicit_functions(name: str, data: st.DataObject) -> None:
    args = {"sphere": [], "cylinder": [], "superellipsoid": [0.8, 0.5]}.get(name, [0.4])
    point = data.draw(st.tuples(st.floats(0.3, 1.2), st.floats(-1, 1), st.floats(0.1, 0.9)))
    h = 1e-6
    nearby = np.array(point) + np.vstack([np.eye(3), -np.eye(3)]) * h
    p = np.array(point)
    if name in ("cylinder", "cone", "infcone"):  # the mantle only, continued through the caps
        k = 1.0 - args[0] if args else 0.0
        f = np.hypot(nearby[:, 0], nearby[:, 1]) - (1 - k * nearby[:, 2])
        # The gradient is that of x2 + y2 - (1 - k z)2, on the surface parallel to the mantle's.
        scale = (1 - k * p[2]) / math.hypot(p[0], p[1])
        p[:2] *= scale
    else:
        f = IMPLICIT[name](nearby, *args)
    numeric = (f[:3] - f[3:]) / (2 * h)
    exact = np.array(oracle.gradient(name, args, tuple(p)))
    if np.linalg.norm(numeric) < 1e-2:
        return
    cosine = exact @ numeric / np.linalg.norm(exact) / np.linalg.norm(numeric)
    assert cosine > 1 - 1e-6


# Lists by hand


def crossings(leaf: int, *ts: float) -> list[Event]:
    kinds = ["enter", "leave"] * len(ts)
    return [Event(t, k, leaf, False, (0.0, 0.0, 1.0), {}) for t, k in zip(ts, kinds, strict=False)]


def sheets(leaf: int, *ts: float) -> list[Event]:
    return [Event(t, "sheet", leaf, False, (0.0, 0.0, 1.0), {}) for t in ts]


def told(found: Sequence[Event]) -> list[tuple[float, str, int]]:
    return [(e.t, e.kind, e.leaf) for e in found]


BEFORE, AFTER, BOTH, NEITHER = (0.0, 5.0), (5.0, 9.0), (0.0, 9.0), (7.0, 9.0)


@pytest.mark.parametrize(
    ("operator", "sheet_first", "staying"),
    [
        ("union", True, (BEFORE, AFTER, NEITHER)),
        ("union", False, (BEFORE, AFTER, NEITHER)),
        ("intersection", True, (BEFORE, AFTER, BOTH)),
        ("intersection", False, (BEFORE, AFTER, BOTH)),
        ("difference", True, (BEFORE, AFTER, NEITHER)),
        ("difference", False, ()),
    ],
)
@pytest.mark.parametrize("other", [BEFORE, AFTER, BOTH, NEITHER])
def test_sheets_stay_as_the_table_says(
    operator: str, sheet_first: bool, staying: tuple[object, ...], other: tuple[float, float]
) -> None:
    lists = (sheets(1, 5.0), crossings(2, *other))
    found = combine(operator, *(lists if sheet_first else lists[::-1]))
    assert ((5.0, "sheet", 1) in told(found)) == (other in staying)


def test_sheet_with_sheet() -> None:
    a, b = sheets(1, 5.0), sheets(2, 5.0)
    assert told(combine("intersection", a, b)) == []
    assert told(combine("union", a, b)) == [(5.0, "sheet", 1), (5.0, "sheet", 2)]
    assert told(combine("difference", a, b)) == [(5.0, "sheet", 1)]


def test_of_sheet_and_face_the_first_in_the_text_stands_first() -> None:
    sheet, faces = sheets(1, 5.0), crossings(2, 5.0, 9.0)
    assert told(combine("union", sheet, faces)) == [
        (5.0, "sheet", 1), (5.0, "enter", 2), (9.0, "leave", 2)
    ]  # fmt: skip
    assert told(combine("union", faces, sheet)) == [
        (5.0, "enter", 2), (5.0, "sheet", 1), (9.0, "leave", 2)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("operator", "b", "expected"),
    [
        # Faces that touch: the union is one piece, the rest is empty or whole.
        ("union", (5.0, 9.0), [(1.0, "enter", 1), (9.0, "leave", 2)]),
        ("intersection", (5.0, 9.0), []),
        ("difference", (5.0, 9.0), [(1.0, "enter", 1), (5.0, "leave", 1)]),
        # The same interval: everything from the first operand.
        ("union", (1.0, 5.0), [(1.0, "enter", 1), (5.0, "leave", 1)]),
        ("intersection", (1.0, 5.0), [(1.0, "enter", 1), (5.0, "leave", 1)]),
        ("difference", (1.0, 5.0), []),
        # One end in common.
        ("union", (1.0, 9.0), [(1.0, "enter", 1), (9.0, "leave", 2)]),
        ("intersection", (1.0, 9.0), [(1.0, "enter", 1), (5.0, "leave", 1)]),
        ("difference", (1.0, 3.0), [(3.0, "enter", 2), (5.0, "leave", 1)]),
        ("difference", (3.0, 5.0), [(1.0, "enter", 1), (3.0, "leave", 2)]),
        # Unbounded.
        ("difference", (-math.inf, math.inf), []),
        ("union", (-math.inf, 3.0), [(-math.inf, "enter", 2), (5.0, "leave", 1)]),
        ("intersection", (-math.inf, 3.0), [(1.0, "enter", 1), (3.0, "leave", 2)]),
    ],
)
@pytest.mark.parametrize("gap", [0.0, 4e-10, -4e-10])
def test_coincidence(
    operator: str, b: tuple[float, float], expected: list[tuple[float, str, int]], gap: float
) -> None:
    # At t = 5 the tolerance is 5e-10, at 1 it is 1e-10.
    shifted = tuple(t + (gap if abs(t) == 5.0 else 0.1 * gap) for t in b)
    found = combine(operator, crossings(1, 1.0, 5.0), crossings(2, *shifted))
    assert [(k, leaf) for _, k, leaf in told(found)] == [(k, leaf) for _, k, leaf in expected]
    for e, (t, _, leaf) in zip(found, expected, strict=True):
        # What coincides takes its place from the first operand.
        assert e.t == t if leaf == 1 else e.t == pytest.approx(t, abs=1e-9)


def test_two_unbounded_lists() -> None:
    a, b = crossings(1, -math.inf, math.inf), crossings(2, -math.inf, 3.0, 4.0, math.inf)
    assert told(combine("union", a, b)) == told(a)
    assert told(combine("intersection", a, b)) == [
        (-math.inf, "enter", 1), (3.0, "leave", 2), (4.0, "enter", 2), (math.inf, "leave", 1)
    ]  # fmt: skip
    assert told(combine("difference", a, b)) == [(3.0, "enter", 2), (4.0, "leave", 2)]


@pytest.mark.parametrize("k", [-60, 0, 20])
def test_tolerance_follows_the_ray_and_is_just_that_large(k: int) -> None:
    origin, direction = (3.0, 4.0 * 2.0**k, 0.0), (0.0, 1.0, -4.0)
    of_ray = oracle.precision(origin, direction)
    assert of_ray == (1e-10 * max(origin) / 4.0, 1e-10)
    for t in (0.0, 1.0, -1.0, 5.0, 1e6):
        size = max(max(origin) / 4.0, abs(t)) * 1e-10
        for factor, merged in ((0.9, True), (1.1, False)):
            for sign in (1.0, -1.0):
                a, b = crossings(1, t - 10.0, t), crossings(2, t + sign * factor * size, t + 10.0)
                pieces = len(combine("union", a, b, of_ray)) // 2
                overlapping = sign < 0.0
                assert pieces == (1 if merged or overlapping else 2)
                common = len(combine("intersection", a, b, of_ray)) // 2
                assert common == (1 if overlapping and not merged else 0)


def test_what_is_thinner_than_the_tolerance_toggles_twice() -> None:
    wide, hair = crossings(1, 1.0, 5.0), crossings(2, 5.0 - 1e-11, 5.0 + 1e-11)
    assert told(combine("union", wide, hair)) == told(wide)
    assert told(combine("difference", wide, hair)) == told(wide)
    assert told(combine("intersection", wide, hair)) == []
    alone = crossings(2, 3.0, 3.0 + 1e-11)
    assert told(combine("union", wide, alone)) == told(wide)
    assert len(combine("difference", wide, alone)) == 4


def test_differences_flip_and_flip_back() -> None:
    a, b, c = crossings(1, 0.0, 9.0), crossings(2, 2.0, 8.0), crossings(3, 4.0, 6.0)
    ring = combine("difference", a, combine("difference", b, c))
    assert told(ring) == [
        (0.0, "enter", 1), (2.0, "leave", 2), (4.0, "enter", 3), (6.0, "leave", 3),
        (8.0, "enter", 2), (9.0, "leave", 1),
    ]  # fmt: skip
    assert [e.flipped for e in ring] == [False, True, False, False, True, False]
    assert [e.normal[2] for e in ring] == [1.0, -1.0, 1.0, 1.0, -1.0, 1.0]


# Whole solids by hand


def test_first_any_and_spans() -> None:
    graph = Graph(cases.solid("sphere") | cases.prefix("move", 5, 0, 0) * cases.solid("sphere"))
    ray = (-3.0, 0.0, 0.0), (2.0, 0.0, 0.0)
    found = oracle.events(graph, *ray)
    assert [e.t for e in found] == [1.0, 2.0, 3.5, 4.5]
    assert list(oracle.spans(found)) == [(1.0, 2.0), (3.5, 4.5)]
    hit = oracle.first(graph, *ray, 1.0)
    assert hit is not None
    assert (hit.t, hit.kind, hit.normal) == (1.0, "enter", (-1.0, 0.0, 0.0))
    inner = oracle.first(graph, *ray, np.nextafter(1.0, 2.0))
    assert inner is not None
    assert (inner.t, inner.kind) == (2.0, "leave")
    assert oracle.any_(graph, *ray, 2.5, 3.5)
    assert not oracle.any_(graph, *ray, 2.5, np.nextafter(3.5, 0.0))


def test_an_infinite_end_is_no_hit() -> None:
    graph = Graph(cases.solid("halfspace"))
    assert [e.t for e in oracle.events(graph, (0, 0, -1), (0, 0, -1))] == [-1.0, math.inf]
    assert oracle.first(graph, (0, 0, -1), (0, 0, -1)) is None
    assert oracle.first(graph, (0, 0, -1), (1, 0, 0)) is None


def test_tangents_have_no_length() -> None:
    for name in ("sphere", "cylinder"):
        assert oracle.pieces(name, [], (1.0, -5.0, 0.5), (0.0, 1.0, 0.0)) == [] or name == "sphere"
    assert oracle.pieces("sphere", [], (1.0, -5.0, 0.0), (0.0, 1.0, 0.0)) == []
    # Closed: a ray in a face or along a mantle is inside.
    assert len(oracle.pieces("box", [], (1.0, -5.0, 0.0), (0.0, 1.0, 0.0))) == 1
    assert len(oracle.pieces("cylinder", [], (1.0, 0.0, -5.0), (0.0, 0.0, 1.0))) == 1


def test_torus_is_crossed_four_times() -> None:
    found = [p[0::2] for p in oracle.pieces("torus", [0.25], (-3.0, 0.0, 0.0), (1.0, 0.0, 0.0))]
    assert np.allclose(found, [(1.75, 2.25), (3.75, 4.25)], atol=1e-14, rtol=0)


def test_cones_to_a_point_and_widening() -> None:
    assert oracle.pieces("cone", [0.0], (-3.0, 0.0, 0.5), (1.0, 0.0, 0.0))[0][0::2] == (2.5, 3.5)
    assert oracle.pieces("cone", [3.0], (-3.0, 0.0, 0.5), (1.0, 0.0, 0.0))[0][0::2] == (1.0, 5.0)
    assert oracle.pieces("cone", [0.0], (0.0, 0.0, 5.0), (0.0, 0.0, -1.0))[0][0::2] == (4.0, 5.0)


def test_parameters_are_seen_below_only() -> None:
    ball = cases.prefix("move", P.x, 0, 0) * cases.solid("sphere")
    graph = Graph(C(x=1, y=P.x + 1) * ((C(x=P.x + P.y) * ball) | ball))
    assert [p.frame[0][3] for p in oracle.leaves(graph)] == [3.0, 1.0]


def test_calls_assign_in_parallel() -> None:
    module = S("M").rule(1, cases.prefix("move", P.x, P.y, 0) * cases.solid("sphere"))
    swap = (("x", P.y), ("y", P.x))
    for call_, expected in ((True, (2.0, 1.0)), (False, (2.0, 2.0))):
        graph = Graph(C(x=1, y=2) * Calculation(swap, module, call=call_))
        (leaf,) = oracle.leaves(graph)
        assert (leaf.frame[0][3], leaf.frame[1][3]) == expected


def test_attributes_innermost_wins_field_by_field() -> None:
    node = cases.prefix("color", 1, 2, 3) * (
        cases.prefix("label", 4) * cases.prefix("color", 5, 6, 7) * cases.solid("sphere")
    )
    event = oracle.events(Graph(node), (-3, 0, 0), (1, 0, 0))[0]
    assert (event.color, event.label, event.material) == ((5.0, 6.0, 7.0), 4.0, -1.0)


def test_shrunk_modules_are_empty() -> None:
    module = S("M", 1 + (P.c > 0))
    module.rule(1, cases.solid("sphere"))
    module.rule(2, C(c=P.c - 1) * cases.prefix("uscale", 0.5) * module)
    for depth, count in ((40, 1), (498, 1), (499, 0), (600, 0)):
        graph = Graph(C(c=depth) * module)
        assert len(oracle.events(graph, (0, 0, 0), (0, 0, 1))) == 2 * count
    moved = S("N", 1 + (P.c > 0))
    moved.rule(1, cases.solid("sphere"))
    moved.rule(
        2, C(c=P.c - 1) * cases.prefix("move", 1, 0, 0) * cases.prefix("uscale", 0.5) * moved
    )
    for depth, count in ((50, 1), (51, 1), (52, 0), (60, 0)):
        graph = Graph(C(c=depth) * moved)
        centre = 2.0 - 2.0 ** (1 - depth)
        assert len(oracle.events(graph, (centre, 0, 0), (0, 0, 1))) == 2 * count


def test_depth_limit_counts_selections() -> None:
    ball = cases.solid("sphere")
    assert len(oracle.leaves(Graph(cases.chain(9, ball)), depth_limit=9)) == 1
    with pytest.raises(oracle.Fault, match="depth"):
        oracle.leaves(Graph(cases.chain(10, ball)), depth_limit=9)
    assert len(oracle.leaves(Graph(cases.chain(9_000, ball)))) == 1


def test_world_queries_see_the_place() -> None:
    place = cases.prefix("move", 3, 0, 0) * cases.prefix("rotz", 90)
    shown = C(x=call("worldx", 1, 2, 0), y=call("wdiry", 1, 0, 0), z=call("localx", 0, 1, 0))
    graph = Graph(place * shown * cases.prefix("move", P.x, P.y, P.z) * cases.solid("sphere"))
    (leaf,) = oracle.leaves(graph)
    # Locally (1, 1, 1), a quarter turn and 3 along x away.
    assert leaf.frame[0][3] == 3.0 - 1.0
    assert (leaf.frame[1][3], leaf.frame[2][3]) == (1.0, 1.0)


# Bits


@given(expr=cases.expressions(("a", "b")), a=st.floats(-9, 9), b=st.floats(-9, 9))
def test_values_are_those_of_the_reference_evaluator_bit_for_bit(
    expr: object, a: float, b: float
) -> None:
    frame = ((1.5, 0.25, 0.0, 3.0), (0.1, -2.0, 0.5, 1.0), (0.0, 0.3, 1.0, -1.0))
    slots = {"a": 0, "b": 1, **{f"@frame{k}": 2 + k for k in range(12)}}
    program = Program(slots, 2)
    start = program.add([expr])  # type: ignore[list-item]
    expected: float | None = None
    with contextlib.suppress(Fault):
        (expected,) = program.evaluate(start, [a, b, *frame[0], *frame[1], *frame[2]])
    try:
        got = oracle.evaluate(expr, {"a": a, "b": b}, frame)  # type: ignore[arg-type]
    except oracle.Fault:
        assert expected is None
    else:
        assert expected is not None
        assert got.hex() == expected.hex()


@pytest.mark.parametrize("name", TRANSFORMS)
@given(data=st.data())
def test_matrices_are_those_of_the_kernels_bit_for_bit(name: str, data: st.DataObject) -> None:
    transform = TRANSFORMS[name]
    numbers = st.one_of(st.floats(-720, 720), st.sampled_from([0.0, 90.0, -180.0, 1e-9]))
    args = [data.draw(numbers) for _ in transform.parameters]
    if name in ("rot", "align") and not any(args[-3:]):
        with pytest.raises(oracle.Fault):
            oracle.matrix(name, args)
        return
    expected = transform.kernel.py_func(*args)
    rows = oracle.matrix(name, args)
    assert [x + 0.0 for x in sum(rows, ())] == [x + 0.0 for x in expected]
    again = compose.py_func(expected, expected)
    assert sum(oracle.compose(rows, rows), ()) == tuple(again)
    assert isinstance(again, Affine)


# Frozen: these numbers mean the same plants for ever.


def test_random_numbers_of_the_first_arguments() -> None:
    values = [
        oracle.evaluate(e, {}, oracle.IDENTITY)
        for e in (
            call("rand", 0),
            call("rand", -0.0),
            call("rand", 1, 2),
            call("rand", 2, 1),
            call("randedge", 1, 2, 3, 4),
            call("randedge", 3, 4, 1, 2),
            call("choose", 7, 0, 0, 5, seeds=1),
        )
    ]
    assert values[0] == values[1]
    assert values[2] != values[3]
    assert values[4] == values[5]
    assert values[6] == 3.0
    assert all(0.0 <= x < 1.0 for x in values[:6])
