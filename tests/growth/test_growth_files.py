"""Files of species that nobody would write, and trees that nobody could hold."""

from __future__ import annotations

import json

import pytest

from pcsg.errors import GrammarError, UsageError
from pcsg.growth.geometry import MOST_NODES
from pcsg.growth.model import GrowthModel
from pcsg.growth.species import load_species, read_species


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"seed": 1' + "0" * 400 + "}", "this cannot be `seed`"),
        ('{"seed": ' + "9" * 5000 + "}", "this cannot be `seed`"),
        ('{"seed": 1\u0661}', "cannot stand here"),
        ('{"lmin": -' + "9" * 5000 + "}", "this cannot be `lmin`"),
        ('{"curves": {"G_h": {"points": [[0, 1' + "0" * 400 + "], [1, 1]]}}}", "no point"),
        ('{"curves": ' + "[" * 100_000 + "]" * 100_000 + "}", "brackets within brackets"),
        ('{"a":' * 50_000 + "1" + "}" * 50_000, "brackets within brackets"),
        ('{"curves": {"G_h": {"points": [[0, 0.1], [1e-320, 0.5], [1, 1]]}}}', "x above 1e-06"),
    ],
)
def test_numbers_and_brackets_of_species(text: str, told: str) -> None:
    with pytest.raises(GrammarError, match=told) as caught:
        read_species(text, "odd.json")
    assert str(caught.value).startswith("odd.json:1:")


def test_brackets_in_texts_do_not_count() -> None:
    assert read_species('{"species": "' + "[{" * 100 + '"}').species == "[{" * 100


@pytest.mark.parametrize(
    "changes",
    [
        {"ymax": 100, "order_max": 20, "smin": 0.001, "trunk_scale": 10_000},
        {"ymax": 500, "curves": {"G_m": {"points": [[0, 1000], [1, 1000]]}}},
    ],
)
def test_trees_beyond_all_measure_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(UsageError, match=r"too many branches of order \d; a larger `smin`"):
        GrowthModel(read_species(json.dumps(changes)))


def test_a_tree_with_too_many_internodes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    model = GrowthModel(load_species("populus"))
    assert len(model.at(9.5).nodes.branch) < MOST_NODES
    monkeypatch.setattr("pcsg.growth.geometry.MOST_NODES", 1000)
    with pytest.raises(UsageError, match="more than 1,000 internodes at t = 9"):
        model.at(9.5)
