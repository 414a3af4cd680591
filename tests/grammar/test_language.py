"""What texts mean: items, precedence, macros, forms, definitions, settings, overrides."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pcsg.errors import Diagnostic, GrammarError, UsageError
from pcsg.grammar import check_text, load_file, load_text
from pcsg.graph.build import CONSTRUCTORS as K
from pcsg.graph.build import C, S, define
from pcsg.graph.expr import Expr, Number, P, if_, same
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import (
    Attribute,
    Calculation,
    Leaf,
    Node,
    Operation,
    Selection,
    Transformation,
)
from pcsg.graph.tape import Program

move, uscale, rotz = K["move"], K["uscale"], K["rotz"]
sphere, box, cylinder, cone = K["sphere"], K["box"], K["cylinder"], K["cone"]


def codes(text: str) -> list[str]:
    return [d.code for d in check_text(text)[1]]


def value(text: str, **parameters: float) -> float:
    """Evaluate an expression of the language in the reference evaluator."""
    block = "".join(f"{k}={v!r};" for k, v in parameters.items())
    graph = load_text(f"{{{block} result = {text}}} sphere")
    root = graph.root
    assert isinstance(root, Calculation)
    program = Program(graph.slots)
    names = [name for name, _ in root.assignments]
    at = program.add([e for _, e in root.assignments], names)
    values = [0.0] * len(graph.slots)
    program.evaluate(at, values)
    return values[graph.slots["result"]]


# Arithmetic.

_OPERATORS = st.sampled_from(["+", "-", "*", "<", "<=", ">", ">=", "==", "!=", "and", "or"])
_ATOMS = st.sampled_from(["a", "b", "c", "2", "0.5", "3"])


def _python(text: str) -> str:
    return text.replace("^", "**")


@st.composite
def arithmetic(draw: st.DrawFn) -> str:
    parts: list[str] = []
    compared = False
    for k in range(draw(st.integers(1, 7))):
        if k:
            operator = draw(_OPERATORS)
            if operator in ("and", "or"):
                compared = False
            elif operator in ("<", "<=", ">", ">=", "==", "!="):
                # Comparisons chain in Python and are refused here.
                operator = "+" if compared else operator
                compared = compared or operator != "+"
            parts.append(operator)
        starts = not parts or parts[-1] in ("and", "or")
        if starts and draw(st.booleans()):
            parts.append("not")
        atom = draw(_ATOMS)
        if draw(st.booleans()):
            atom = f"({draw(_ATOMS)} {draw(st.sampled_from('+-*'))} {atom})"
        sign = draw(st.sampled_from(["", "-", "--"]))
        power = draw(st.sampled_from(["", "", "^2", "^2^2", "^-1"]))
        parts.append(f"{sign}{atom}{power}")
    return " ".join(parts)


@given(arithmetic())
def test_precedence_is_that_of_python(text: str) -> None:
    parameters = {"a": 1.5, "b": -0.25, "c": 4.0}
    try:
        wanted = eval(_python(text), {}, parameters)
    except ZeroDivisionError:
        return
    if any(word in text.split() for word in ("and", "or", "not")):
        # Python's words return an operand; here they are 0 or 1 as a whole.
        assert bool(value(text, **parameters)) == bool(wanted)
    else:
        assert value(text, **parameters) == wanted


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("2 ^ 3 ^ 2", 512.0),
        ("-2 ^ 2", -4.0),
        ("2 ^ -1", 0.5),
        ("2 ^ -2 ^ 2", 2.0**-4),
        ("-3 % 5", 2.0),
        ("7 / 2 * 4", 14.0),
        ("1 - 2 - 3", -4.0),
        ("not 1 == 2", 1.0),
        ("!0 && !0 || 0", 1.0),
        ("1 < 2 and 2 < 3", 1.0),
        ("(1 < 2) == 1", 1.0),
        ("if(1 > 2, 1/0, 5)", 5.0),
        ("true + false", 1.0),
        ("2 * pi", 2 * math.pi),
        ("e", math.e),
        (".5 + 1. + 1e-1", 1.6),
        ("max(1, 2, 3) - min(4)", -1.0),
        ("choose(3; 0, 0, 1)", 3.0),
        ("sin(30 + 60)", 1.0),
        ("1 - -1", 2.0),
    ],
)
def test_arithmetic(text: str, wanted: float) -> None:
    assert value(text) == wanted


# Solids.


def same_graph(text: str, node: Node) -> None:
    assert load_text(text) == Graph(node)


def test_prefixes_bind_tighter_than_operators() -> None:
    graph = load_text("{c=1} move(1,0,0) sphere | box")
    assert graph == Graph((C(c=1) * move(1, 0, 0) * sphere()) | box)
    assert isinstance(graph.root, Operation)


def test_operators_bind_as_in_python() -> None:
    a, b, c, d = sphere, box, cylinder, cone
    same_graph("sphere | box & cylinder \\ cone", a | b & c - d)
    same_graph("sphere \\ box - cylinder", a - b - c)
    same_graph("sphere \\ (box \\ cylinder)", a - (b - c))
    same_graph("{} ((sphere | box) | (cylinder | cone))", C() * (a | b | c | d))
    same_graph("sphere | (box | cylinder) & cone", a | (b | c) & d)
    same_graph("{} ( sphere \u222a box \u2229 cylinder \u2216 cone )", C() * (a | b & c - d))


def test_mirrors_take_no_arguments() -> None:
    same_graph("flipxy (sphere | box)", K["flipxy"]() * (sphere | box))


def test_primitives_have_defaults() -> None:
    same_graph("cone | cone(0.5) | cube", cone() | cone(0.5) | box)


def test_blocks_take_commas_and_spare_separators() -> None:
    same_graph("{a=1, b=a;; c=b;} sphere", C(a=1, b=P.a, c=P.b) * sphere)


def test_definitions_are_shared_and_keep_their_names() -> None:
    graph = load_text("stone | move(1,0,0) stone | pebble\nstone = sphere | box\npebble = stone")
    stones = [n for n in graph.nodes if n.definition == "stone"]
    assert len(stones) == 1
    stone = define("stone", sphere | box)
    assert graph == Graph(stone | move(1, 0, 0) * stone | stone)
    assert {n.definition for n in graph.nodes} == {"stone", None}


def test_names_are_found_whatever_the_order_and_case() -> None:
    graph = load_text("S2 | s2\ns2 = box\n1: S2 -> sphere\n")
    assert [m.name for m in graph.selections] == ["S2"]


def test_functions_and_settings_are_ordinary_names_elsewhere() -> None:
    graph = load_text(
        "{if=1; camera=if; sin=2} camera | sin\ncamera = uscale(sin(sin)) box\nsin = box"
    )
    assert graph.parameters == ("if", "camera", "sin")


def test_reserved_words_match_whole_words_only() -> None:
    graph = load_text("spheres | movement | boxed\nspheres=sphere\nmovement=box\nboxed=box")
    assert len(graph.nodes) == 4


# Items.


def test_items_need_no_separator() -> None:
    text = (
        "{c=2} S box\nS if(c > 0, 2, 1) 1: S -> sphere 2: S -> {c=c-1} uscale(2) S "
        "stone = box camera { fov = 3 } sun {} p1: T(c) -> box"
    )
    assert codes(text) == ["two-axioms", "never-used", "never-used"]
    # Only a name that is first on its line declares a module.
    assert codes("{c=2} S S 1 1: S -> sphere")[0] == "unexpected-token"
    assert codes("{c=2} S\nS 1 1: S -> sphere") == []


def test_a_module_declaration_is_first_on_its_line_and_followed_by_a_blank() -> None:
    module = S("T", P.c)
    module.rule(1, sphere).rule(2, box)
    rules = "1: T -> sphere 2: T -> box"
    same_graph(f"{{c=1}} T\nT c\n{rules}", C(c=1) * module)
    same_graph(f"{{c=1}} T\nT (c)\n{rules}", C(c=1) * module)
    assert load_text(f"{{c=1}} T\nT not c\n{rules}") == load_text(f"{{c=1}} T\nT !c\n{rules}")
    # Not with `-`: there it is difference.
    assert load_text("T\n- box\n1: T -> sphere") == Graph(S("T").rule(1, sphere) - box)


def test_an_expression_goes_on_over_lines() -> None:
    text = "a\n| b\n& move(1,0,0)\nb\na = sphere\nb = box"
    b = define("b", box())
    assert load_text(text) == Graph(define("a", sphere()) | b & move(1, 0, 0) * b)


def test_a_module_with_one_rule_needs_no_selection_function() -> None:
    same_graph("S\n1: S -> sphere", S("S").rule(1, sphere))


def test_number_and_colon_of_a_rule_may_stand_apart() -> None:
    same_graph("S\n1  : S \u2192 sphere", S("S").rule(1, sphere))


def test_carriage_returns_byte_order_mark_and_comments(tmp_path: Path) -> None:
    text = "\ufeff{c=1} /* a\r\nb */ S // the axiom\r\nS c\r\n1: S -> sphere\r\n"
    plain = "{c=1} S\nS c\n1: S -> sphere\n"
    path = tmp_path / "grammar.pcsg"
    path.write_bytes(text.encode())
    assert load_file(path) == load_text(text) == load_text(plain)
    assert load_file(str(path)).root.span is not None


# The attributed form.


def test_attributed_form() -> None:
    graph = load_text(
        "w: S(6, 0)\n"
        "p1: S(c, d) : c = 0 -> sphere\n"
        "p2: S(c, d) : (c = 1) and d -> box\n"
        "p3: S(c, d) : else -> uscale(0.5) S(c-1, c) | {d=d-1} S"
    )
    module = graph.selections[0]
    assert module.attributed is not None and module.select is not None
    assert module.attributed.formals == ("c", "d")
    assert module.attributed.labels == ("p1", "p2", "p3")
    assert module.attributed.conditions[2] is None
    first, second = module.attributed.conditions[:2]
    assert isinstance(first, Expr) and isinstance(second, Expr)
    assert same(module.select, if_(first, 1, if_(second, 2, 3)))
    assert isinstance(graph.root, Calculation) and graph.root.call
    assert [name for name, _ in graph.root.assignments] == ["c", "d"]
    last = module.rules[3]
    assert isinstance(last, Operation) and last.operands[1].successors == (module,)


def test_without_a_condition_that_holds_the_selection_is_zero() -> None:
    module = load_text("w: S(1)\np1: S(c) : c > 0 -> sphere").selections[0]
    assert module.select is not None and same(module.select, if_(P.c > 0, 1, Number(0.0)))


def test_a_call_assigns_in_parallel() -> None:
    graph = load_text("w: S(1, 2)\np1: S(a, b) : a > 0 -> sphere\np2: S(a, b) -> uscale(2) S(b, a)")
    calls = [n for n in graph.nodes if isinstance(n, Calculation)]
    assert all(n.call for n in calls)
    assert same(calls[1].assignments[0][1], P.b) and same(calls[1].assignments[1][1], P.a)


# Macros and includes.


def test_macros_hold_before_and_after_their_place() -> None:
    text = "uscale(size) stone\n#define size half + half\n#define half 0.25\n#define stone sphere"
    same_graph(text, uscale(Number(0.25) + 0.25) * sphere)


def test_a_macro_takes_a_brace_block() -> None:
    text = "#define go\n{\n a = 1;\n b = 2;\n} move(1,0,0)\ngo stone\nstone = box"
    same_graph(text, C(a=1, b=2) * move(1, 0, 0) * define("stone", box()))
    text = "#define go { a = 1; {\n} b = 2;\n} sphere\n{} box"
    assert load_text(text) == Graph(C() * box)


def test_macros_replace_whole_tokens_only() -> None:
    same_graph("#define a box\nab | a\nab = sphere", define("ab", sphere()) | box)


def test_a_body_ends_with_its_line() -> None:
    assert load_text("#define a box \\ sphere\na \\\n cone") == Graph(box - sphere - cone)
    assert codes("#define a box \\\nsphere\na cone") == ["two-axioms"]


def test_comments_are_gone_before_macros_end() -> None:
    same_graph("#define a box // \\ sphere\na", box())
    same_graph("#define a box /* over\ntwo lines */ | sphere\na", box | sphere)


def test_spans_survive_macros() -> None:
    graph = load_text("#define y 2\n#define x 3\nmove(x,x,x) sphere")
    root = graph.root
    assert isinstance(root, Transformation) and root.span is not None
    assert root.span.text == "move(x,x,x)"
    argument = root.args[1]
    assert isinstance(argument, Number) and argument.span is not None
    assert str(argument.span) == "<text>:3:8" and argument.span.body is not None
    assert str(argument.span.body) == "<text>:2:11"


def test_a_macro_may_hold_items() -> None:
    text = "#define rules 1: S -> sphere 2: S -> box\n{c=1} S\nS c\nrules"
    assert load_text(text) == Graph(C(c=1) * S("S", P.c).rule(1, sphere).rule(2, box))


def test_includes(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    other = tmp_path / "elsewhere"
    other.mkdir()
    root = tmp_path / "scene" / "root.pcsg"
    root.parent.mkdir()
    (root.parent / "parts").mkdir()
    (root.parent / "parts" / "a.pcsg").write_text('#include "b.pcsg"\n#define size 3\n')
    (root.parent / "parts" / "b.pcsg").write_text("stone = uscale(size) box\nsun { angle = 1 }\n")
    root.write_text(
        '#include "parts/a.pcsg"\n#include "parts/b.pcsg"\nstone\nsky { strength = size }\n'
    )
    graph = load_file(root)
    assert isinstance(graph.root, Transformation)
    assert [s.kind.name for s in graph.settings] == ["sky", "sun"]
    (other / "c.pcsg").write_text("pebble = sphere\n")
    root.write_text('#include "../elsewhere/c.pcsg"\npebble\n')
    with pytest.raises(GrammarError, match="include-outside"):
        load_file(root)
    assert isinstance(load_file(root, include=[other]).root, Leaf)
    (root.parent / "link.pcsg").symlink_to(other / "c.pcsg")
    root.write_text('#include "link.pcsg"\npebble\n')
    with pytest.raises(GrammarError, match="include-outside"):
        load_file(root)


def test_an_axiom_in_an_included_file_counts(tmp_path: Path) -> None:
    (tmp_path / "part.pcsg").write_text("sphere\n")
    root = tmp_path / "root.pcsg"
    root.write_text('#include "part.pcsg"\n')
    assert isinstance(load_file(root).root, Leaf)
    root.write_text('#include "part.pcsg"\nbox\n')
    with pytest.raises(GrammarError, match="two-axioms"):
        load_file(root)


# Settings and attributes.


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("translate(1, 0, 0) sphere", "write `move(x,y,z)`"),
        ("ball", "did you mean `sphere`?"),
        ("sphere camera { look_at = (0, 0, 0) }", "did you mean `target`?"),
        ("sphere\nbackground { }", "did you mean `sky`?"),
        ("scale(2) sphere", "`uscale` scales alike in all directions"),
        ("sphere(2)", "size and place are transformations before it: `uscale(2) sphere`"),
        ("box(1, 2, 3)", "size and place are transformations before it: `scale(1,2,3) box`"),
        ("sphere color(1, 0, 0)", "stand before their solid"),
        ("{n = 3} sphere | move(n, 0, 0) box", "`{n = ...} ( ... | ... )`"),
    ],
)
def test_what_other_programs_would_take_is_told_in_our_words(text: str, hint: str) -> None:
    with pytest.raises(GrammarError) as caught:
        load_text(text)
    assert hint in str(caught.value)


def test_auto_stands_for_what_is_found_automatically() -> None:
    graph = load_text("sphere ground { z = auto } camera { eye = auto, fov = 30; focus = auto }")
    assert [set(s.values) for s in graph.settings] == [set(), {"fov"}]
    named = load_text("sphere material m { relief = auto; texture = auto } texture auto {}")
    assert named.settings[0].values == {"relief": "auto", "texture": "auto"}
    with pytest.raises(GrammarError, match="never-assigned"):
        load_text("sphere sun { strength = auto }")


def test_settings() -> None:
    graph = load_text(
        "{h=3} material(bark) texture(oak, 2) color(h/3,0,0) label(7) sphere\n"
        'camera { eye = (1, -h, h^2), fov = 2*h;; } sky { kind = image; file = "a b.png" }\n'
        "material bark { texture = oak; color = (1,0,0) }\ntexture oak { kind = wood; scale = h }\n"
        "ground { material = bark } light {} light { radius = 1 }"
    )
    names = [(s.kind.name, s.name) for s in graph.settings]
    assert names == [
        ("camera", None),
        ("sky", None),
        ("material", "bark"),
        ("texture", "oak"),
        ("ground", None),
        ("light", None),
        ("light", None),
    ]
    camera, sky, bark = graph.settings[:3]
    assert len(camera.values["eye"]) == 3 and len(camera.values["fov"]) == 1
    assert sky.values == {"kind": "image", "file": "a b.png"}
    assert bark.values["texture"] == "oak"
    attributes = [n for n in graph.nodes if isinstance(n, Attribute)]
    assert [(n.kind.name, n.reference, len(n.args)) for n in attributes] == [
        ("material", "bark", 0),
        ("texture", "oak", 1),
        ("color", None, 3),
        ("label", None, 1),
    ]


# The axiom's block and overrides.


def test_overrides_of_the_leading_block() -> None:
    text = "{segments = 2; dSG = 1/segments; segments = 3} uscale(dSG) sphere | box"
    graph = load_text(text).override({"segments": 4.0})
    wanted = load_text("{segments = 4; dSG = 1/segments} uscale(dSG) sphere | box")
    assert graph == wanted
    with pytest.raises(UsageError, match="did you mean `segments`"):
        load_text(text).override({"segmets": 4.0})
    with pytest.raises(UsageError, match="no parameter `x`"):
        load_text("{} ({x=1} uscale(x) sphere)").override({"x": 2.0})


def test_global_parameters_are_readable_everywhere() -> None:
    text = "{a = SEED + TIME} uscale(SUNX + SUNY + SUNZ + a) sphere\nsun { strength = 1 + TIME }"
    assert load_text(text).parameters == ("a",)


# Data flow.


def test_what_some_path_assigns_may_be_read() -> None:
    assert codes("{c=1} S\nS c\n1: S -> {d=1} T\n2: S -> T\n1: T -> uscale(d) sphere") == []
    assert codes("{d=1} sphere | uscale(d) box") == ["parameter-never-assigned"]
    assert codes("{c=d; d=1} sphere") == ["parameter-never-assigned"]
    assert codes("{c=1; d=c} sphere") == []
    assert codes("w: S(1)\np1: S(c) -> uscale(c) sphere") == []
    assert codes("S\n1: S -> {d=1} T\n2: S -> box\nS 1\n1: T -> uscale(d) sphere") == []


def first_error(text: str) -> Diagnostic:
    with pytest.raises(GrammarError) as caught:
        load_text(text)
    return caught.value.diagnostics[0]


def test_a_selection_that_names_no_rule_by_its_constant() -> None:
    assert first_error("S\nS 3\n1: S -> box\n2: S -> sphere").code == "selection-range"


def test_modules_and_nodes_know_their_places() -> None:
    graph = load_text("{c=1} S\nS c\n1: S -> move(1,0,0) sphere", "name.pcsg")
    spans = {type(n): n.span for n in graph.nodes}
    assert str(spans[Selection]) == "name.pcsg:2:1"
    assert str(spans[Transformation]) == "name.pcsg:3:9"
    assert {t: s.text for t, s in spans.items() if s} == {
        Calculation: "{c=1}",
        Selection: "S",
        Transformation: "move(1,0,0)",
        Leaf: "sphere",
    }


@pytest.mark.parametrize("select", ["iff(c>0,2,1)", "c + foo(2)", "neg(c, 1)", "sin(c, 1)"])
def test_a_wrong_function_on_a_cycle_is_told(select: str) -> None:
    with pytest.raises(GrammarError, match=r"unknown function|takes 1 argument"):
        load_text(f"{{c=3}} S\nS if({select}, 2, 1)\n1: S -> sphere\n2: S -> {{c=c-1}} S")


# An axiom in brackets.


@pytest.mark.parametrize(
    "text",
    [
        "(sphere | box)",
        "1: A -> box\n(A | sphere)",
        "(A | sphere)\n1: A -> box",
        "1: A -> box\n({n = 2} A)\ncamera { fov = 30 }",
        "part = box\n(part | sphere)\n1: B -> part\n",
        "1: A -> move(1,0,0)\n(box | sphere)\nA",
    ],
)
def test_an_axiom_may_begin_with_a_bracket(text: str) -> None:
    assert [d for d in check_text(text)[1] if d.severity == "error"] == []


def test_numbers_in_brackets_on_the_next_line_are_a_call() -> None:
    text = "w: B\n(2)\np: B(n) : n > 1 -> box | B\n(n - 1)\nq: B(n) -> sphere"
    assert check_text(text)[1] == []
    assert load_text(text).override({}).root is not None
