"""Names are made of the letters of any script, in one form of Unicode."""

from __future__ import annotations

import unicodedata

import pytest

import pcsg
from pcsg.errors import GrammarError, UsageError
from pcsg.grammar import check_text, load_text
from pcsg.graph.nodes import Leaf
from pcsg.graph.text import to_pcsg

FOREST = """{ größe = 2; ħ = 0.5 } БЕРЁЗА
БЕРЁЗА if(größe > 0, 2, 1)
1: БЕРЁЗА -> kugel
2: БЕРЁЗА -> { größe = größe - 1 } ( material(blätter) kugel | move(0,0,ħ) БЕРЁЗА )
kugel = sphere
material blätter { color = (0, ħ, 0) }
"""


def test_letters_of_any_script() -> None:
    scene = pcsg.loads(FOREST)
    assert scene.parameters["größe"] == 2.0
    assert scene.bounds[1][2] == pytest.approx(2.0)
    assert load_text(scene.to_pcsg()) == scene.graph
    assert pcsg.loads(FOREST, größe=0).bounds[1][2] == pytest.approx(1.0)


def test_both_forms_of_an_umlaut_are_one_name() -> None:
    apart = unicodedata.normalize("NFD", FOREST)
    assert apart != FOREST
    assert load_text(apart) == load_text(FOREST)
    mixed = FOREST.replace("größe = 2", unicodedata.normalize("NFD", "größe") + " = 2")
    assert load_text(mixed) == load_text(FOREST)
    values = {unicodedata.normalize("NFD", "größe"): 1.0}
    assert pcsg.loads(FOREST, parameters=values).parameters["größe"] == 1.0


@pytest.mark.parametrize(
    ("text", "shown"),
    [("{x²=1} sphere", "²"), ("{☂=1} sphere", "☂"), ("\u19daphere", "\u19da")],
)
def test_signs_that_are_no_letters(text: str, shown: str) -> None:
    with pytest.raises(GrammarError, match=f"stray character `{shown}`"):
        load_text(text)


def test_digits_of_other_scripts_are_no_numbers() -> None:
    with pytest.raises(GrammarError, match="stray character"):
        load_text("{c=\u0663} sphere")


def test_names_end_where_blanks_do() -> None:
    with pytest.raises(GrammarError, match="bad-number"):
        load_text("{c=1ä} sphere")


@pytest.mark.parametrize(
    "text",
    [
        "{disc = 2} uscale(disc) sphere",
        "disc | box\ndisc = sphere",
        "disc\ndisc if(1, 1, 1)\n1: disc -> sphere",
        "w: disc(2)\np: disc(n) -> uscale(n) sphere",
        "material(disc) sphere\nmaterial disc { color = (1,0,0) }",
        "{rectangle = 4} label(rectangle) sphere",
    ],
)
def test_names_of_new_primitives_are_free_for_those_who_use_them(text: str) -> None:
    graph, problems = check_text(text)
    assert problems == []
    assert graph is not None
    assert {n.solid.name for n in graph.nodes if isinstance(n, Leaf)} <= {"sphere", "box"}


def test_new_primitives_are_known_where_nobody_else_has_the_name() -> None:
    graph, problems = check_text("disc | rotx(90) rectangle\n1: B -> disc\n")
    assert [p.code for p in problems] == ["never-used"]
    assert graph is not None
    assert {n.solid.name for n in graph.nodes if isinstance(n, Leaf)} == {"disc", "rectangle"}
    assert check_text("disc(2)")[1][0].hint == (
        "size and place are transformations before it: `uscale(2) disc`"
    )


def test_what_is_called_like_a_new_primitive_is_written_back() -> None:
    text = "material(disc) sphere | part | rectangle\npart = box\nmaterial disc { color = (1,0,0) }"
    graph = load_text(text)
    assert to_pcsg(load_text(to_pcsg(graph))) == to_pcsg(graph)
    own = pcsg.S("disc").rule(1, pcsg.sphere)
    assert "1: disc -> sphere" in to_pcsg(pcsg.Graph(own))
    with pytest.raises(UsageError, match="two things are called `disc`"):
        to_pcsg(pcsg.Graph(own | pcsg.disc))
