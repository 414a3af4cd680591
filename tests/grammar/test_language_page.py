"""The language reference: its examples load, and it names everything that there is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pcsg.grammar import check_text
from pcsg.grammar.check import CALLABLE
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.settings import SETTINGS
from pcsg.graph.transforms import TRANSFORMS
from pcsg.leaf import LEAF_NAMES

PAGE = (Path(__file__).parents[2] / "docs" / "language.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```pcsg\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("text", EXAMPLES, ids=[f"example{k}" for k in range(len(EXAMPLES))])
def test_examples_load_without_a_word(text: str) -> None:
    graph, diagnostics = check_text(text)
    assert graph is not None, "\n".join(d.render() for d in diagnostics)
    assert not diagnostics


def test_the_page_has_examples() -> None:
    assert len(EXAMPLES) >= 12


def test_the_page_names_everything() -> None:
    words = set(re.findall(r"[A-Za-z_][A-Za-z0-9_]*", " ".join(re.findall(r"`[^`\n]+`", PAGE))))
    # Models are leaves too, with pages of their own.
    primitives = {
        name for name, solid in LEAF_NAMES.items() if solid.__module__.startswith("pcsg.leaf")
    }
    keys = {key for kind in SETTINGS.values() for key in kind.keys}
    wanted = primitives | set(TRANSFORMS) | set(ATTRIBUTES) | set(SETTINGS) | set(CALLABLE) | keys
    assert wanted <= words


def test_defaults_of_settings_are_those_of_the_table() -> None:
    for kind in SETTINGS.values():
        for name, key in kind.keys.items():
            rows = re.findall(
                rf"^\| `{name}` \| .* \| (.*) \| {re.escape(key.summary)} \|$", PAGE, re.M
            )
            assert rows, f"{kind.name}.{name}"
            if isinstance(key.default, float):
                assert f"{key.default:g}" in rows
