from __future__ import annotations

import ast
import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from paper_graphs import fig5a, move, random_graph, sierpinski, sphere, tetrahedron
from strategies import expressions, graphs, solid_graphs

from pcsg.errors import UsageError
from pcsg.grammar import load_text
from pcsg.graph.build import CONSTRUCTORS, C, S, define
from pcsg.graph.expr import Apply, Expr, Number, P, Parameter, apply, call, seeds_first, signature
from pcsg.graph.exprtext import expr_text, number_text
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import AttributedForm, Calculation, Leaf, Operation, Transformation
from pcsg.graph.operators import DIFFERENCE, UNION
from pcsg.graph.pretty import Mark, format_tokens
from pcsg.graph.text import to_pcsg
from pcsg.graph.transforms import TRANSFORMS

_SIGNS = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Mod: "%",
    ast.Pow: "^",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}


def read_as_python(text: str) -> Expr:
    """Return what Python's own parser makes of an expression: the precedences are the same."""

    def read(tree: ast.expr) -> Expr:
        if isinstance(tree, ast.Constant):
            return Number(float(tree.value))
        if isinstance(tree, ast.Name):
            return Parameter(tree.id)
        if isinstance(tree, ast.UnaryOp):
            name = "neg" if isinstance(tree.op, ast.USub) else "not"
            return apply(name, read(tree.operand))
        if isinstance(tree, ast.BinOp):
            return apply(_SIGNS[type(tree.op)], read(tree.left), read(tree.right))
        if isinstance(tree, ast.Compare):
            assert len(tree.ops) == 1, "comparisons do not chain"
            return apply(_SIGNS[type(tree.ops[0])], read(tree.left), read(tree.comparators[0]))
        if isinstance(tree, ast.BoolOp):
            name = "and" if isinstance(tree.op, ast.And) else "or"
            value = read(tree.values[0])
            for other in tree.values[1:]:
                value = apply(name, value, read(other))
            return value
        assert isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name)
        name = "if" if tree.func.id == "if_" else tree.func.id
        args = [read(a) for a in tree.args if not isinstance(a, ast.Starred)]
        seeds = [k for k, a in enumerate(tree.args) if isinstance(a, ast.Starred)]
        return Apply(name, tuple(args), seeds[0] if seeds else 0)

    # A starred argument stands for the semicolon of `choose`.
    python = text.replace("^", "**").replace("if(", "if_(").replace(";", ", *semicolon,")
    return read(ast.parse(python, mode="eval").body)


infix = st.sampled_from(["+", "-", "*", "/", "%", "^", "<", "<=", "==", "!=", "and", "or"])
operator_trees = st.recursive(
    st.one_of(st.sampled_from([P.a, P.b]), st.sampled_from([2.0, -3.0, 0.5, -0.0]).map(Number)),
    lambda below: st.one_of(
        st.builds(apply, infix, below, below),
        st.builds(apply, st.sampled_from(["neg", "not"]), below),
    ),
    max_leaves=12,
)


@given(st.one_of(expressions(("a", "b")), operator_trees))
def test_arithmetic_reads_back_as_the_same_tree(expr: Expr) -> None:
    assert signature(read_as_python(expr_text(expr))) == signature(expr)


@pytest.mark.parametrize(
    ("expr", "text"),
    [
        (P.a - (P.b - 1), "a - (b - 1)"),
        (P.a - P.b - 1, "a - b - 1"),
        ((P.a + P.b) * 2, "(a + b) * 2"),
        (-(P.a**2), "-a^2"),
        ((-P.a) ** 2, "(-a)^2"),
        (P.a**-P.b, "a^-b"),
        (Number(-2.0) ** 2, "(-2)^2"),
        ((P.a**P.b) ** 2, "(a^b)^2"),
        (P.a ** (P.b**2), "a^b^2"),
        (apply("not", P.a == 1), "not a == 1"),
        (apply("==", apply("not", P.a), 1), "(not a) == 1"),
        (apply("<", P.a < P.b, 3), "(a < b) < 3"),
        (apply("and", apply("or", P.a, P.b), 1), "(a or b) and 1"),
        (call("if", P.c > 0, 2, 1), "if(c > 0, 2, 1)"),
        (call("mod", P.c, 2), "mod(c, 2)"),
        (seeds_first([P.c, 3], [1, 2.5]), "choose(c, 3; 1, 2.5)"),
    ],
)
def test_no_parentheses_that_are_not_needed(expr: Expr, text: str) -> None:
    assert expr_text(expr) == text


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_exact_and_integers_have_no_point(value: float) -> None:
    text = number_text(value)
    assert float(text).hex() == value.hex()
    assert "." not in text or not value.is_integer() or abs(value) >= 1e16


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_numbers_that_are_none_are_refused(value: float) -> None:
    with pytest.raises(UsageError, match="cannot hold"):
        expr_text(Number(value))


def test_sierpinski_reads_as_in_the_paper() -> None:
    assert to_pcsg(sierpinski()) == (
        "{c = 6} S\n"
        "\n"
        "S if(c > 0, 2, 1)\n"
        "1: S -> tetrahedron\n"
        "2: S -> {c = c - 1} (move(0.5, 0.5, 0.5) uscale(0.5) S\n"
        "                     | move(-0.5, -0.5, 0.5) uscale(0.5) S\n"
        "                     | move(0.5, -0.5, -0.5) uscale(0.5) S\n"
        "                     | move(-0.5, 0.5, -0.5) uscale(0.5) S)\n"
    )


def test_fig5a_keeps_its_definitions() -> None:
    text = to_pcsg(fig5a())
    for line in (
        "leaf = move(0, dy, dz) scale(fx, fy, fz) cylinder & connected_balls",
        "3: SG -> segment | {segments = segments - 1} move(0, 0, dSG) rotz(-90) SG",
        " dSG = 1 / segments;",
    ):
        assert line in text.splitlines()
    assert all(len(line) <= 100 for line in text.splitlines())


def test_operators_bind_as_in_python() -> None:
    a, b, c = (move(k, 0, 0) * sphere() for k in (1, 2, 3))
    assert "\n" not in to_pcsg(Graph(a | b & c - sphere())).strip()
    x = Graph(a - (b - c))
    assert to_pcsg(x) == "move(1, 0, 0) sphere \\ (move(2, 0, 0) sphere \\ move(3, 0, 0) sphere)\n"
    assert to_pcsg(Graph(a & (b | c))).count("(m") == 1


def test_an_axiom_does_not_begin_with_a_parenthesis() -> None:
    text = to_pcsg(Graph((sphere() | tetrahedron()) & sphere()))
    assert text == "axiom: (sphere | tetrahedron) & sphere\n"


def test_what_is_shared_becomes_a_definition() -> None:
    ball = sphere()
    part = move(1, P.part_1, 0) * ball
    text = to_pcsg(Graph(C(part_1=1) * (part | part - ball)))
    assert text.splitlines()[2:] == ["part_2 = move(1, part_1, 0) part_3", "part_3 = sphere"]
    assert text.splitlines()[0] == "{part_1 = 1} (part_2 | part_2 \\ part_3)"


def test_operations_that_are_not_flattened_keep_their_form() -> None:
    inner = Operation(UNION, (sphere(), tetrahedron()))
    text = to_pcsg(Graph(Operation(UNION, (sphere(), inner))))
    assert text == "sphere | part_1\n\npart_1 = sphere | tetrahedron\n"
    inner = Operation(DIFFERENCE, (sphere(), tetrahedron()))
    text = to_pcsg(Graph(Operation(DIFFERENCE, (inner, sphere()))))
    assert text == "part_1 \\ sphere\n\npart_1 = sphere \\ tetrahedron\n"


def test_defaults_are_not_written() -> None:
    cone = CONSTRUCTORS["cone"]
    assert to_pcsg(Graph(cone(0))) == "cone\n"  # type: ignore[operator]
    assert to_pcsg(Graph(cone(0.5))) == "cone(0.5)\n"  # type: ignore[operator]


@pytest.mark.parametrize("name", ["sphere", "move", "color", "else", "pi", "a b", "1a", "a\u00b2"])
def test_names_that_the_language_has_not_are_refused(name: str) -> None:
    with pytest.raises(UsageError, match="cannot be called"):
        to_pcsg(Graph(S(name).rule(1, tetrahedron())))
    with pytest.raises(UsageError, match="cannot be called"):
        to_pcsg(Graph(define(name, move(1, 2, 3) * sphere())))
    with pytest.raises(UsageError, match="cannot be called"):
        to_pcsg(Graph(C(**{name: 1}) * sphere()))
    with pytest.raises(UsageError, match="cannot be called"):
        to_pcsg(Graph(move(Parameter(name), 0, 0) * sphere()))


def test_other_things_that_the_language_cannot_say_are_refused() -> None:
    with pytest.raises(UsageError, match="two things are called `S`"):
        to_pcsg(Graph(S("S").rule(1, S("S").rule(1, sphere()))))
    with pytest.raises(UsageError, match="no selection function"):
        to_pcsg(Graph(S("S").rule(1, sphere()).rule(2, sphere())))
    with pytest.raises(UsageError, match="it has 1, 3"):
        to_pcsg(Graph(S("S", P.c).rule(1, sphere()).rule(3, sphere())))
    with pytest.raises(UsageError, match="it has none"):
        to_pcsg(Graph(S("S", P.c)))
    loop = Transformation(TRANSFORMS["flipxy"], (), sphere())
    loop.successor = loop
    with pytest.raises(UsageError, match="contains itself"):
        to_pcsg(Graph(loop))


def test_an_attributed_module_is_written_with_its_calls() -> None:
    module = S("S", call("if", P.c > 0, 1, 2))
    module.attributed = AttributedForm(("c",), ("p1", "p2"), (P.c > 0, None))
    module.rule(1, Calculation((("c", P.c - 1),), module, call=True)).rule(2, sphere())
    lines = to_pcsg(Graph(C(c=2) * module)).splitlines()
    assert lines == ["{c = 2} S", "", "p1: S(c): c > 0 -> S(c - 1)", "p2: S(c): else -> sphere"]
    module.select = call("if", P.c > 1, 1, 2)
    with pytest.raises(UsageError, match="differs from its conditions"):
        to_pcsg(Graph(C(c=2) * module))
    module.attributed = None
    with pytest.raises(UsageError, match="a call must assign the formals"):
        to_pcsg(Graph(C(c=2) * module))


def test_nesting_has_no_limit() -> None:
    node = sphere()
    for _ in range(100_000):
        node = move(1, 0, 0) * node
    text = to_pcsg(Graph(node))
    assert text.count("move(1, 0, 0)") == 100_000
    assert max(map(len, text.splitlines())) <= 100
    expr: Expr = P.a
    for _ in range(50_000):
        expr = 1 - (-expr)
    text = expr_text(expr)
    assert text == "1 - -(" * 49_999 + "1 - -a" + ")" * 49_999


def test_the_negative_of_a_constant_is_the_negative_constant() -> None:
    assert signature(-Number(2.0)) == signature(Number(-2.0))
    assert signature(apply("neg", -Number(2.0))) == signature(Number(2.0))
    assert signature(-Number(0.0)) == signature(Number(-0.0)) != signature(Number(0.0))
    assert signature(-P.a) != signature(P.a)
    assert signature(-(P.a + 2)) != signature(P.a + -Number(2.0))


def test_deep_parentheses_do_not_indent_without_end() -> None:
    node: Leaf | Operation = sphere()
    for k in range(3000):
        node = (node | sphere()) if k % 2 else (sphere() & node)
    assert len(to_pcsg(Graph(node))) < 3000 * 100


@given(st.integers(0, 10_000))
def test_lines_are_broken_at_operators_and_fit(seed: int) -> None:
    text = to_pcsg(random_graph(seed))
    lines = text.splitlines()
    assert all(len(line) <= 110 for line in lines)
    assert text == "\n".join(lines) + "\n"


def test_groups_break_together() -> None:
    row = [Mark.OPEN, "aaaa", Mark.BREAK, "| bbbb", Mark.BREAK, "| cccc", Mark.CLOSE]
    assert format_tokens(["x = ", *row], width=40) == "x = aaaa | bbbb | cccc"
    assert format_tokens(["x = ", *row], width=15) == "x = aaaa\n    | bbbb\n    | cccc"
    chain = ["aaaa", Mark.FILL, "bbbb", Mark.FILL, "cccc"]
    assert format_tokens(chain, width=10) == "aaaa bbbb\n    cccc"


def test_every_function_of_the_registry_can_be_written() -> None:
    for name, function in FUNCTIONS.items():
        if function.form is Form.COLUMN:
            continue  # a `scatter` stands for it
        count = max(function.arity[0], 1)
        expr = Apply(name, tuple(Parameter(f"x{k}") for k in range(count)), seeds=name == "choose")
        assert signature(read_as_python(expr_text(expr))) == signature(expr)


# Through the parser and back.


def assert_round_trip(graph: Graph) -> None:
    text = to_pcsg(graph)
    again = load_text(text)
    assert again == graph, text
    assert to_pcsg(again) == text


@given(graphs())
def test_any_graph_reads_back_equal(graph: Graph) -> None:
    for node in graph.nodes:
        if isinstance(node, Calculation):
            node.call = False  # text has calls of attributed modules only
    assert_round_trip(graph)


def test_the_attributed_form_reads_back_equal() -> None:
    text = (
        "S(6, 1)\n"
        "\n"
        "p1: S(c, d): c == 0 -> tetrahedron\n"
        "p2: S(c, d): c > 3 and d < 2 -> move(0.5, 0.5, 0.5) S(c - 1, d)\n"
        "p3: S(c, d): else -> one | one\n"
        "\n"
        "one = uscale(d) S(c - 1, d / 2)\n"
    )
    assert to_pcsg(load_text(text)) == text
    assert_round_trip(load_text(text))


def test_settings_read_back_equal() -> None:
    text = (
        "{c = 2} material(bark) texture(rings, 2) color(1, 0.5, 0) label(3) sphere\n"
        "\n"
        "camera {eye = (c, -2, 3); fov = 40;}\n"
        "\n"
        "material bark {roughness = 0.9; texture = rings;}\n"
        "\n"
        "texture rings {kind = wood; scale = 1 / c;}\n"
        "\n"
        'sky {kind = image; file = "sky.png";}\n'
    )
    assert to_pcsg(load_text(text)) == text
    assert_round_trip(load_text(text))


@given(solid_graphs())
def test_any_solid_reads_back_equal(graph: Graph) -> None:
    assert_round_trip(graph)


@given(st.integers(0, 100_000))
def test_graphs_with_sharing_read_back_equal(seed: int) -> None:
    assert_round_trip(random_graph(seed))


@given(st.one_of(expressions(("a", "b")), operator_trees))
def test_any_expression_reads_back_equal(expr: Expr) -> None:
    assert_round_trip(Graph(C(a=1, b=2) * C(c=expr) * sphere()))


@pytest.mark.parametrize("make", [sierpinski, fig5a])
def test_listings_read_back_equal(make: Callable[[], Graph]) -> None:
    assert_round_trip(make())


def test_forms_that_need_care_read_back_equal() -> None:
    select = S("S", -P.c + 3).rule(1, sphere()).rule(2, tetrahedron())
    assert_round_trip(Graph(C(c=2) * select))
    inner = Operation(UNION, (sphere(), tetrahedron()))
    assert_round_trip(Graph(Operation(UNION, (sphere(), inner))))
    assert_round_trip(Graph((sphere() | tetrahedron()) & sphere()))
    shared = sphere()
    assert_round_trip(Graph(shared | move(1, 0, 0) * shared))
    assert_round_trip(Graph(define("axiom", shared | move(1, 0, 0) * shared)))
    assert_round_trip(Graph(C() * C(sin=math.pi, if_=-0.0) * sphere()))
