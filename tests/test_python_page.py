"""docs/python.md has every public name, and its examples run; help says what a function takes."""

from __future__ import annotations

import importlib
import inspect
import pydoc
import re
from pathlib import Path

import pytest

import pcsg

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)

FOR_THE_RENDERER = {
    "Scene": {
        *("boxes", "reach", "setting_numbers", "setting_values", "sheets", "shining_covers"),
        *("source_hash", "states", "tracer"),
    },
    "Hits": {"columns", "replaced", "take"},
    "Crossings": {"columns", "replaced", "take"},
}
"""Public members that users need not know. A new one is on the page, or here."""


def told(name: str) -> bool:
    """Whether a name stands on the page as code."""
    spans = re.findall(r"`[^`\n]+`", PAGE) + re.findall(
        r"^```python\n(.*?)^```$", PAGE, re.M | re.S
    )
    return any(re.search(rf"\b{name}\b", span) for span in spans)


@pytest.mark.parametrize("name", pcsg.__all__)
def test_every_public_name_is_on_the_page(name):
    assert told(name)


@pytest.mark.parametrize("name", ["Scene", "Image", "Hits", "Crossings", "Spans"])
def test_every_member_is_on_the_page(name):
    kind = getattr(pcsg, name)
    members = {m for m in (*dir(kind), *getattr(kind, "__annotations__", ())) if m[0] != "_"}
    hidden = FOR_THE_RENDERER.get(name, set())
    # Columns of rare use are told by the docstring.
    rare = {m for m in members if re.search(rf"\b{m}\b", inspect.getdoc(kind) or "")}
    assert [m for m in sorted(members - hidden - rare) if not told(m)] == []
    if name in ("Scene", "Image"):
        assert [m for m in sorted(members - hidden) if not told(m)] == []
    assert hidden <= members


def test_the_examples_run(tmp_path, monkeypatch):
    (tmp_path / "grammars").symlink_to(ROOT / "grammars")
    monkeypatch.chdir(tmp_path)
    known: dict[str, object] = {}
    for code in EXAMPLES:
        exec(compile(code, "python.md", "exec", dont_inherit=True), known)
    for name in ("balls.png", "spiral.png"):
        assert (tmp_path / name).stat().st_size > 0
    assert list(known["hits"].t) == [2.0, 8.0] and list(known["hits"].label) == [1, 2]
    assert known["found"].t.tolist() == pytest.approx([2, 4, 6, 8, 8, 10])
    assert known["thickness"].tolist() == pytest.approx([4, 2])


def test_help_says_what_render_takes():
    """The name is the function until the package of that name is imported; both are called."""
    importlib.import_module("pcsg.render")
    text = pydoc.plain(pydoc.render_doc(pcsg.render))
    assert "samples: int = 16" in text and "Largest number of samples per pixel" in text
    assert list(inspect.signature(pcsg.render).parameters)[:4] == [
        "scene",
        "size",
        "samples",
        "seed",
    ]
    from pcsg.render import job

    assert pcsg.render.job is job


def test_help_of_the_package_names_everything():
    text = pydoc.plain(pydoc.render_doc(pcsg))
    missing = [n for n in pcsg.__all__ if not re.search(rf"\b{n}\b", text)]
    assert missing == []
    assert "pcsg.load(" in text
