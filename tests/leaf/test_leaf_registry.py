"""The registry, and what is made from it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from pcsg.leaf.reference import reference_page
from pcsg.leaf.registry import LEAF_NAMES, LEAVES, LeafParameter, Solid, leaf

SPECIFIED = {
    "sphere": 0,
    "cylinder": 0,
    "cone": 1,
    "box": 0,
    "cube": 0,
    "tetrahedron": 0,
    "torus": 1,
    "halfspace": 0,
    "tri1": 0,
    "tri2": 0,
    "empty": 0,
    "disc": 0,
    "rectangle": 0,
    "capsule": 1,
    "infcylinder": 0,
    "infcone": 1,
    "superellipsoid": 2,
    "heightfield": 0,
}


def test_names_and_arguments() -> None:
    assert SPECIFIED.items() <= {n: len(cls.parameters) for n, cls in LEAF_NAMES.items()}.items()
    assert LEAF_NAMES["cube"] is LEAF_NAMES["box"]


def test_kinds_number_the_leaves() -> None:
    assert [cls.kind for cls in LEAVES.values()] == list(range(len(LEAVES)))


def test_primitive_equivalents() -> None:
    assert {name for name, cls in LEAVES.items() if cls.primitives == 0} == {"empty"}


def test_legal_arguments() -> None:
    (top,), (tube,) = LEAVES["cone"].parameters, LEAVES["torus"].parameters
    assert (top.default, top.condition) == (0.0, "0 <= r")
    assert (tube.default, tube.condition) == (None, "0 < r <= 1")


@pytest.mark.parametrize("name", LEAVES)
def test_every_leaf_says_what_it_is(name: str) -> None:
    assert (LEAVES[name].__doc__ or "").strip()


def test_the_reference_page_is_up_to_date() -> None:
    page = Path(__file__).parents[2] / "docs" / "primitives.md"
    assert page.read_text(encoding="utf-8") == reference_page()


def test_a_primitive_of_too_many_parameters_is_refused() -> None:
    class Wide(Solid):
        parameters = tuple(LeafParameter(f"p{k}") for k in range(9))

    with pytest.raises(TypeError, match="9 parameters: a primitive has at most 8"):
        leaf(Wide)
    assert "wide" not in LEAVES


SIX_NUMBERS = """
import sys
sys.path.insert(0, sys.argv[1])
from pcsg.leaf.registry import LeafParameter, Solid, leaf
from pcsg.leaf import polyhedra

@leaf
class Brick(Solid):
    '''A box of six numbers: the lower corner and the upper one.'''

    parameters = tuple(LeafParameter(f"p{k}") for k in range(6))
    apart = True

from pcsg.trace.tables import MAX_LEAF_ARGS
from pcsg.trace.walk_space import ARGUMENTS_AT, RECORD
assert MAX_LEAF_ARGS == RECORD - ARGUMENTS_AT == 6
"""


def test_engines_make_room_for_the_primitive_of_most_numbers() -> None:
    command = [sys.executable, "-c", SIX_NUMBERS, str(Path(__file__).parents[2])]
    subprocess.run(command, check=True, timeout=120)
