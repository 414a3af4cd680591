"""The VS Code extension: its files fit together, and it can be packaged where its tools are."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

from pcsg.grammar import check_text

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "editors" / "vscode"
PACKAGE = json.loads((FOLDER / "package.json").read_text(encoding="utf-8"))
SNIPPETS = json.loads((FOLDER / "snippets" / "pcsg.json").read_text(encoding="utf-8"))

AROUND = {
    "Axiom": "{0}\n1: S -> sphere\n",
    "Module": "{{n = 2}} S\n{0}\n",
    "Material": "material(bark) sphere\n{0}\n",
    "Texture": "texture(meadow) sphere\n{0}\n",
    "Loop": "{{}} {0}\n",
    "Repeat": "{{}} {0}\n",
    "Blob": "{{}} {0}\n",
}
"""Where a snippet stands; others stand behind an axiom."""


def test_every_file_that_it_names_is_there() -> None:
    given = PACKAGE["contributes"]
    named = [
        PACKAGE["main"],
        *(language["configuration"] for language in given["languages"]),
        *(grammar["path"] for grammar in given["grammars"]),
        *(snippets["path"] for snippets in given["snippets"]),
    ]
    assert all((FOLDER / name).is_file() for name in named)
    json.loads((FOLDER / "language-configuration.json").read_text(encoding="utf-8"))
    grammar = json.loads((FOLDER / given["grammars"][0]["path"]).read_text(encoding="utf-8"))
    assert grammar["scopeName"] == given["grammars"][0]["scopeName"]


def test_it_has_the_version_of_pcsg_and_the_commands_of_the_lenses() -> None:
    project: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert PACKAGE["version"] == project["project"]["version"]
    commands = {c["command"] for c in PACKAGE["contributes"]["commands"]}
    assert commands == {"pcsg.render", "pcsg.view"}


@pytest.mark.parametrize("name", SNIPPETS)
def test_snippets_are_grammar(name: str) -> None:
    body = SNIPPETS[name]["body"]
    text = "\n".join(body) if isinstance(body, list) else body
    filled = re.sub(r"\$\{\d+:([^}]*)\}", r"\1", text)
    assert "$" not in filled
    _, problems = check_text(AROUND.get(name, "sphere\n{0}\n").format(filled))
    assert [p.render() for p in problems] == []


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no Node.js")
def test_the_client_is_javascript() -> None:
    subprocess.run(["node", "--check", str(FOLDER / "extension.js")], check=True, timeout=60)


@pytest.mark.skipif(
    not (FOLDER / "node_modules" / ".bin" / "vsce").exists(),
    reason="`npm install` was not run in editors/vscode",
)
def test_it_can_be_packaged(tmp_path: Path) -> None:
    made = tmp_path / "pcsg.vsix"
    command = [str(FOLDER / "node_modules" / ".bin" / "vsce"), "package", "-o", str(made)]
    subprocess.run(command, check=True, cwd=FOLDER, timeout=300, capture_output=True)
    assert made.stat().st_size > 10_000
