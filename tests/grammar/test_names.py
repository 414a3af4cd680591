"""Names are made of the letters of any script, in one form of Unicode."""

from __future__ import annotations

import unicodedata

import pytest

import pcsg
from pcsg.errors import GrammarError
from pcsg.grammar import load_text

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
