"""Hypothesis strategies: expressions, CSG trees, whole grammars, and rays that are worth casting.

Half of the solids stand on small integers, so that faces coincide.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import oracle
from hypothesis import strategies as st

from pcsg.graph.build import CONSTRUCTORS, C, Prefix, S
from pcsg.graph.expr import Expr, Number, Parameter, apply, as_expr, call, if_, seeds_first
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Calculation, Node, Selection
from pcsg.leaf import LEAVES

Draw = Any
Ray = tuple[tuple[float, float, float], tuple[float, float, float]]

SOLID_NAMES = (
    *("sphere", "box", "cylinder", "cone", "tetrahedron", "torus", "halfspace", "empty"),
    *("capsule", "superellipsoid", "infcylinder", "infcone"),
)
SHEET_NAMES = tuple(name for name in oracle.SHEETS if name in LEAVES)


def prefix(name: str, *args: Expr | float) -> Prefix:
    """Return a transformation or an attribute by its name."""
    made: Prefix = CONSTRUCTORS[name](*args)  # type: ignore[operator]
    return made


def solid(name: str, *args: Expr | float) -> Node:
    """Return a leaf by its name."""
    made: Node = CONSTRUCTORS[name](*args)  # type: ignore[operator]
    return made


# Arithmetic

NUMBERS = st.one_of(
    st.integers(-4, 4).map(float),
    st.sampled_from([0.0, -0.0, 0.5, -0.5, 1.5, 2.5, 90.0, -270.0, 360.0, 1e-9, 1e9, 1e300]),
    st.floats(-10.0, 10.0),
    st.floats(allow_nan=False, allow_infinity=False),
)

_EAGER = [f for f in FUNCTIONS.values() if f.form not in (Form.LAZY, Form.COLUMN)]


def expressions(params: Sequence[str] = (), *, world: bool = True) -> st.SearchStrategy[Expr]:
    """Return any expression over parameters; its value may be a fault."""
    functions = [f for f in _EAGER if world or f.form is not Form.WORLD]
    leaves = NUMBERS.map(Number)
    if params:
        leaves = st.one_of(leaves, st.sampled_from(list(params)).map(Parameter))

    def larger(below: st.SearchStrategy[Expr]) -> st.SearchStrategy[Expr]:
        def applied(function: Any) -> st.SearchStrategy[Expr]:
            if function.name == "choose":
                few = st.lists(below, min_size=1, max_size=3)
                return st.builds(seeds_first, few, few)
            least, most = function.arity
            args = st.lists(below, min_size=least, max_size=least + 2 if most is None else most)
            return args.map(lambda a: apply(function.name, *a))

        lazy = st.one_of(
            st.builds(if_, below, below, below),
            st.builds(lambda f, a, b: apply(f, a, b), st.sampled_from(["and", "or"]), below, below),
        )
        return st.one_of(lazy, st.sampled_from(functions).flatmap(applied))

    return st.recursive(leaves, larger, max_leaves=12)


@st.composite
def tame_expressions(draw: Draw, params: Sequence[str], *, world: bool) -> Expr:
    """Return an expression that is never a fault and lies in [-3, 3]."""
    value: Expr = as_expr(float(draw(st.integers(-3, 3))))
    for _ in range(draw(st.integers(0, 3))):
        other: Expr = (
            Parameter(draw(st.sampled_from(list(params))))
            if params and draw(st.booleans())
            else as_expr(draw(st.sampled_from([-2.0, -1.0, -0.5, 0.25, 0.5, 1.0, 2.0, 37.5])))
        )
        what = draw(st.integers(0, 8 if world else 7))
        if what == 0:
            value = value + other
        elif what == 1:
            value = value * other
        elif what == 2:
            value = value - other
        elif what == 3:
            value = call(draw(st.sampled_from(["sin", "cos", "floor", "abs", "round"])), value)
        elif what == 4:
            value = call(draw(st.sampled_from(["rand", "gauss"])), value, other)
        elif what == 5:
            value = if_(value < other, other, value)
        elif what == 6:
            value = call(draw(st.sampled_from(["min", "max", "atan2"])), value, other)
        elif what == 7:
            value = value / (1.0 + call("abs", other))
        else:
            query = draw(st.sampled_from(["worldx", "worldz", "wdiry", "wdirz", "localx"]))
            value = call(query, value, other, 1)
    return call("clamp", value, -3, 3)


# Solids

SMALL = st.integers(-2, 2).map(float)
AWKWARD = st.one_of(
    st.floats(-3.0, 3.0).map(lambda x: round(x, 6)),
    st.sampled_from([1.0 / 3.0, 0.1, 1e-3, -1e-7, 3.0, 0.7071067811865476]),
)
ANGLES = st.one_of(
    st.sampled_from([0.0, 90.0, -90.0, 180.0, 270.0, 45.0, 30.0, 1e-3, 720.5]),
    st.floats(-360.0, 360.0).map(lambda x: round(x, 4)),
)


@st.composite
def transformations(draw: Draw, integral: bool = False) -> Prefix:
    """Return a transformation with an inverse that keeps its digits."""
    if integral:
        kind = draw(st.sampled_from(["move", "move", "scale", "uscale", "rotz", "rotx", "flipxy"]))
        if kind == "move":
            return prefix(kind, *(draw(SMALL) for _ in range(3)))
        factor = st.sampled_from([0.5, 1.0, 2.0, -1.0])
        if kind == "scale":
            return prefix(kind, *(draw(factor) for _ in range(3)))
        if kind == "uscale":
            return prefix(kind, draw(factor))
        if kind == "flipxy":
            return prefix(draw(st.sampled_from(["flipxy", "flipxz", "flipyz"])))
        return prefix(kind, draw(st.sampled_from([0.0, 90.0, 180.0, 270.0, -90.0])))
    kind = draw(
        st.sampled_from(["place", "scale", "turn", "rot", "flip", "shear", "align", "matrix"])
    )
    factor = st.one_of(st.floats(0.2, 3.0), st.floats(-3.0, -0.2), st.just(1e-3))
    directions = st.tuples(AWKWARD, AWKWARD, AWKWARD).filter(lambda d: max(map(abs, d)) > 1e-5)
    if kind == "place":
        return prefix("move", *(draw(AWKWARD) for _ in range(3)))
    if kind == "scale":
        if draw(st.booleans()):
            return prefix("uscale", draw(factor))
        return prefix("scale", *(draw(factor) for _ in range(3)))
    if kind == "turn":
        return prefix(draw(st.sampled_from(["rotx", "roty", "rotz"])), draw(ANGLES))
    if kind == "rot":
        return prefix("rot", draw(ANGLES), *draw(directions))
    if kind == "flip":
        return prefix(draw(st.sampled_from(["flipxy", "flipxz", "flipyz"])))
    if kind == "shear":
        name = draw(st.sampled_from(["xshear", "yshear", "zshear"]))
        return prefix(name, draw(AWKWARD), draw(AWKWARD))
    if kind == "align":
        return prefix("align", *draw(directions))
    entries = [draw(st.floats(-0.3, 0.3)) for _ in range(9)]
    a, b, c, d, e, f, g, h, i = entries
    moved = [draw(AWKWARD) for _ in range(3)]
    return prefix("matrix", 1 + a, b, c, moved[0], d, 1 + e, f, moved[1], g, h, 1 + i, moved[2])


@st.composite
def primitives(draw: Draw, integral: bool = False, sheets: bool = False) -> Node:
    """Return a leaf with legal arguments."""
    names = list(SOLID_NAMES)
    if integral:
        names += ["box", "box"]
    if sheets:
        names += SHEET_NAMES
    name = draw(st.sampled_from(names))
    if name in ("cone", "capsule", "infcone"):
        radius = st.sampled_from([0.0, 1.0, 2.0]) if integral else st.floats(0.0, 2.0)
        return solid(name, draw(radius)) if draw(st.booleans()) else solid(name)
    if name == "superellipsoid":
        return solid(name, *(draw(st.sampled_from([0.25, 1.0, 2.0, 0.7])) for _ in range(2)))
    if name == "torus":
        # One of radius 1 touches itself, and a ray through that point has no one answer.
        radius = st.sampled_from([0.25, 0.5, 0.75]) if integral else st.floats(0.05, 0.9)
        return solid(name, draw(radius))
    return solid(name)


@st.composite
def solids(
    draw: Draw,
    integral: bool | None = None,
    sheets: bool = True,
    depth: int = 3,
) -> Node:
    """Return a CSG tree without modules; sheets only where they are legal."""
    if integral is None:
        integral = draw(st.booleans())
    what = draw(st.integers(0, 9)) if depth else 0
    if what <= 1:
        node = draw(primitives(integral, sheets))
    elif what <= 7:
        count = draw(st.sampled_from([2, 2, 2, 3]))
        operator = draw(st.sampled_from(["|", "|", "&", "-"]))
        node = draw(solids(integral, sheets, depth - 1))
        for _ in range(count - 1):
            other = draw(solids(integral, sheets and operator != "-", depth - 1))
            if operator == "|":
                node = node | other
            elif operator == "&":
                node = node & other
            else:
                node = node - other
    else:
        node = draw(solids(integral, sheets, depth - 1))
    for _ in range(draw(st.integers(0, 2))):
        node = draw(transformations(integral)) * node
    if draw(st.integers(0, 4)) == 0:
        node = prefix("label", float(draw(st.integers(0, 9)))) * node
    return node


def solid_graphs(**options: Any) -> st.SearchStrategy[Graph]:
    """Return a graph of a CSG tree."""
    return solids(**options).map(Graph)


# Grammars


@st.composite
def graphs(draw: Draw, world: bool | None = None, unions: bool = False) -> Graph:
    """Return a grammar of one to three modules whose recursion ends by a counter.

    With `unions`, modules are combined by unions only.
    """
    if world is None:
        world = draw(st.integers(0, 3)) == 0
    integral = draw(st.booleans())
    modules = [S(f"M{k}") for k in range(draw(st.integers(1, 3)))]
    params = ("a", "b")

    def tame() -> Expr:
        value: Expr = draw(tame_expressions(("c", *params), world=world))
        return value

    def small() -> Prefix:
        what = draw(st.integers(0, 5))
        if what == 0:
            factor = 0.5 if integral else 0.4 + 0.1 * call("abs", tame())
            return prefix("uscale", factor)
        if what == 1:
            angle: Expr | float = (
                draw(st.sampled_from([90.0, 180.0])) if integral else tame() * 20.0
            )
            return prefix(draw(st.sampled_from(["rotx", "roty", "rotz"])), angle)
        if what == 2:
            return prefix(
                "move", *(call("round", tame()) if integral else tame() for _ in range(3))
            )
        if what == 3:
            return prefix("color", call("abs", tame()), 0.5, Parameter("c"))
        if what == 4:
            return prefix("label", call("round", tame()) + 5.0)
        made: Prefix = draw(transformations(integral))
        return made

    def terminal(sheets: bool) -> Node:
        if draw(st.booleans()):
            node = draw(primitives(integral, sheets))
        elif draw(st.integers(0, 3)) == 0 and "torus" in LEAVES:
            node = solid("torus", call("clamp", call("abs", tame()), 0.125, 0.875))
        else:
            node = draw(solids(integral, sheets, depth=1))
        for _ in range(draw(st.integers(0, 1))):
            node = small() * node
        return node

    def recursive() -> Node:
        """Return a call of a module with a smaller counter."""
        target: Node = draw(st.sampled_from(modules))
        less = Parameter("c") - 1.0
        if draw(st.integers(0, 3)) == 0:
            node: Node = Calculation(
                (("a", tame()), ("c", less), ("b", tame())), target, call=draw(st.booleans())
            )
        else:
            changes = {name: tame() for name in params if draw(st.integers(0, 2)) == 0}
            node = C(c=less, **changes) * target
        for _ in range(draw(st.integers(0, 2))):
            node = small() * node
        return node

    def body() -> Node:
        # No sheets below, because any module may stand on the right of a difference.
        first = recursive()
        other = recursive() if draw(st.booleans()) else terminal(False)
        operator = "|" if unions else draw(st.sampled_from(["|", "|", "|", "&", "-"]))
        left, right = (first, other) if draw(st.booleans()) else (other, first)
        if operator == "|":
            return left | right
        return left & right if operator == "&" else left - right

    for module in modules:
        bodies = draw(st.integers(1, 3))
        what = draw(st.integers(0, 3 if world else 2))
        if what == 0:
            chosen: Expr = 2.0 + call("floor", bodies * call("rand", Parameter("c"), tame()))
        elif what == 1:
            weights = [float(draw(st.integers(0, 2))) for _ in range(bodies - 1)] + [1.0]
            chosen = 1.0 + seeds_first([Parameter("SEED"), Parameter("c"), tame()], weights)
        elif what == 2:
            chosen = 2.0 + call("mod", Parameter("c"), bodies)
        else:
            chosen = if_(call("worldx", 0, 0, 0) > tame(), 2.0, float(1 + bodies))
        module.select = if_(Parameter("c") <= 0.0, 1.0, chosen)
        module.rule(1, terminal(False))
        for k in range(bodies):
            module.rule(2 + k, body())
    start = C(c=float(draw(st.integers(0, 4))), a=tame_start(draw), b=tame_start(draw))
    return Graph(start * modules[0])


def tame_start(draw: Draw) -> Expr:
    """Return a value for a parameter of an axiom."""
    value: Expr = draw(tame_expressions((), world=False))
    return value


def chain(length: int, node: Node) -> Selection:
    """Return a module that passes itself so often before the node comes."""
    module = S("M", if_(Parameter("c") > 1.0, 2.0, 1.0))
    module.rule(1, node)
    module.rule(2, C(c=Parameter("c") - 1.0) * module)
    top = S("TOP")
    top.rule(1, C(c=float(length - 1)) * module)
    return top


# Rays

_UNITS = st.sampled_from(
    [tuple(s if i == k else 0.0 for i in range(3)) for k in range(3) for s in (1.0, -1.0)]
)
_INTEGERS = st.tuples(*(st.integers(-4, 4).map(float) for _ in range(3)))


def reals(low: float, high: float) -> st.SearchStrategy[float]:
    """Return floats, but no tiny ones: rays within rounding of a plane have no one answer."""
    return st.floats(low, high).map(lambda x: 0.0 if abs(x) < 1e-4 else x)


_REALS = st.tuples(*(reals(-4.0, 4.0) for _ in range(3)))
_DIRECTIONS = st.builds(
    lambda unit, d: tuple(
        x + 0.5 * u if x * u >= 0.0 else x - 0.5 * u for x, u in zip(d, unit, strict=True)
    ),
    _UNITS,
    st.tuples(*(reals(-1.0, 1.0) for _ in range(3))),
)
_INTEGER_DIRECTIONS = st.tuples(*(st.integers(-2, 2).map(float) for _ in range(3))).filter(any)
_LENGTHS = st.sampled_from([1.0, 1.0, 0.37, 2.0, 1e-3, 1e3])

# Points of every primitive's neighbourhood: on it, in it, and just outside.
_LOCAL = st.one_of(
    st.tuples(*(reals(-1.1, 1.1) for _ in range(3))),
    st.tuples(*(st.sampled_from([-1.0, 0.0, 0.5, 1.0]) for _ in range(3))),
)


def _aim(origin: Sequence[float], target: Sequence[float], length: float) -> Ray | None:
    d = np.subtract(target, origin)
    size = float(np.linalg.norm(d))
    if not 1e-3 < size < 1e4:
        return None
    d = d * (length / size) if length != 1.0 else d
    return tuple(map(float, origin)), tuple(map(float, d))  # type: ignore[return-value]


@st.composite
def rays(draw: Draw, graph: Graph | None = None) -> Ray:
    """Return a ray: generic, along an axis, through integer points, towards or from a leaf."""
    what = draw(st.integers(0, 6 if graph is not None else 2))
    if what == 0:
        return draw(_REALS), draw(_DIRECTIONS)
    if what == 1:
        unit = draw(_UNITS)
        length = draw(_LENGTHS)
        origin = draw(st.one_of(_INTEGERS, _REALS))
        return origin, tuple(length * x for x in unit)  # type: ignore[return-value]
    if what == 2:
        return draw(_INTEGERS), draw(_INTEGER_DIRECTIONS)
    assert graph is not None
    placed = oracle.leaves(graph)
    if not placed:
        return draw(_REALS), draw(_DIRECTIONS)
    leaf = placed[draw(st.integers(0, len(placed) - 1))]

    def world(p: Sequence[float]) -> list[float]:
        return [r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3] for r in leaf.frame]

    target = world(draw(_LOCAL))
    if what == 3:  # starts inside or very near
        made = _aim(target, draw(_REALS), draw(_LENGTHS))
    elif what == 4:  # passes within a hair of the outline: a tangent plane of sphere or cylinder
        angle = np.deg2rad(draw(st.floats(0.0, 360.0)))
        hair = 1.0 + draw(st.sampled_from([-1e-3, -1e-5, 1e-5, 1e-3]))
        touch = (hair * np.cos(angle), hair * np.sin(angle), draw(st.floats(0.0, 0.9)))
        back = (touch[0] + 5.0 * np.sin(angle), touch[1] - 5.0 * np.cos(angle), touch[2])
        made = _aim(world(back), world(touch), draw(_LENGTHS))
    else:
        made = _aim(draw(_REALS), target, draw(_LENGTHS))
    return made if made is not None else (draw(_REALS), draw(_DIRECTIONS))


def many_rays(graph: Graph | None = None, size: int = 12) -> st.SearchStrategy[list[Ray]]:
    """Return several rays for one graph."""
    return st.lists(rays(graph), min_size=1, max_size=size)
