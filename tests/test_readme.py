"""What the README and the gallery say is so: their code runs, their numbers and links are right."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import sys
import tomllib
from pathlib import Path

import pytest
import typer
from PIL import Image
from typer.testing import CliRunner

import pcsg
from pcsg.cli import app
from pcsg.commands.options import parse_setting
from pcsg.grammar import load_file, load_text
from pcsg.graph.graph import Graph

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
GALLERY = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", ROOT / "grammars" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
QUICK = {"--size": "16x12", "--samples": "1"}


def blocks(kind: str, text: str = README) -> list[str]:
    found = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return [block for language, block in found if language == kind]


def commands(text: str) -> list[list[str]]:
    whole = [block.replace("\\\n", " ") for block in blocks("sh", text)]
    lines = [shlex.split(line, comments=True) for b in whole for line in b.splitlines()]
    return [words[1:] for words in lines if words and words[0] == "pcsg"]


def quick(words: list[str], order: str | None) -> list[str]:
    """The same command for a small picture of a simpler scene."""
    words = [word for word in words if word not in {"640x480", "--size", "--samples", "16"}]
    extra = [part for option in QUICK.items() for part in option]
    return [*words, *extra, *(["-D", order] if order else [])]


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the grammars in which commands may leave files."""
    (tmp_path / "grammars").symlink_to(ROOT / "grammars")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("code", blocks("python"), ids=lambda code: code.split("\n")[0])
def test_python_of_the_readme_runs(code: str, checkout: Path) -> None:
    known: dict[str, object] = {}
    exec(compile(code, "README.md", "exec", dont_inherit=True), known)
    if "hits" in known:
        scene, hits, spans, shadow = (known[n] for n in ("scene", "hits", "spans", "shadow"))
        assert isinstance(scene, pcsg.Scene) and isinstance(hits, pcsg.Hits)
        assert isinstance(spans, pcsg.Spans)
        assert scene.stats()["primitives"] == 256
        assert 0 < hits.mask.sum() < len(hits.t)
        # Along a ray from outside the first hit is the first end of the first span.
        first = spans.t_in[spans.offsets[:-1][hits.mask]]
        assert first == pytest.approx(hits.t[hits.mask])
        assert (shadow == (hits.t <= 2.5)).all()
        assert list(known["inside"]) == [True, False]  # type: ignore[call-overload]
    else:
        scene = known["scene"]
        assert isinstance(scene, pcsg.Scene)
        assert pcsg.loads(scene.to_pcsg()).graph == scene.graph
        assert (checkout / "twig.png").stat().st_size > 0


def test_grammar_of_the_readme_is_the_one_of_the_file() -> None:
    (text,) = blocks("pcsg")
    assert load_text(text) == Graph(load_file(ROOT / "grammars" / "sierpinski.pcsg").root)


def test_mistake_of_the_readme_is_reported_like_that() -> None:
    (shown,) = (b for b in blocks("") if "error[" in b)
    source = [""] * 3 + [re.findall(r"^ +4 \| (.*)$", shown, re.MULTILINE)[0]]
    text = "{c = 3} S\n\nS if(c > 0, 2, 1)\n" + source[3] + "\n2: S -> {c = c-1} uscale(0.5) S\n"
    with pytest.raises(pcsg.GrammarError) as caught:
        pcsg.loads(text, name="mistake.pcsg")
    assert str(caught.value).strip() == shown.strip()


@pytest.mark.parametrize("words", commands(README), ids=" ".join)
def test_commands_of_the_readme_work(words: list[str], checkout: Path) -> None:
    simpler = "cnt=3" if words[0] == "render" and "tree" in words[1] else None
    run = quick(words, simpler) if words[0] == "render" else words
    result = CliRunner().invoke(app, run)
    assert result.exit_code == 0, result.output
    if words[0] == "render":
        with Image.open(checkout / f"{Path(words[1]).stem}.png") as picture:
            assert picture.size == (16, 12)
    if "c=40" in words:
        assert str(4**40) in result.stdout


SECTIONS = re.split(r"^## ", GALLERY, flags=re.MULTILINE)[1:]


@pytest.mark.parametrize("section", SECTIONS, ids=lambda s: s.split("\n")[0])
def test_gallery(section: str) -> None:
    (words,) = commands(section)
    assert words[0] == "render" and words[-2:] == ["--size", "640x480"]
    values = {k: float(v) for k, v in re.findall(r"-D (\w+)=(\S+)", " ".join(words))}
    stats = pcsg.load(ROOT / words[1], parameters=values).stats()
    (primitives,) = re.findall(r"([\d,]+)\s+primitive\s+equivalents", section)
    assert int(primitives.replace(",", "")) == stats["primitives"]
    for nodes in re.findall(r"(\d+) nodes", section):
        assert int(nodes) == stats["nodes"]["total"]
    (name,) = re.findall(r"!\[[^]]+\]\(pictures/([\w-]+\.png)\)", section)
    file = ROOT / "docs" / "pictures" / name
    assert Path(words[1]).stem == file.stem
    assert file.stat().st_size < 400_000
    with Image.open(file) as picture:
        assert picture.size == (640, 480)


def test_every_grammar_is_in_the_gallery_and_in_its_folder_s_readme() -> None:
    listed = (ROOT / "grammars" / "README.md").read_text(encoding="utf-8")
    for file in (ROOT / "grammars").glob("*.pcsg"):
        assert file.name in GALLERY and f"`{file.name}`" in listed


def test_every_page_is_in_the_index() -> None:
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert page.name == "README.md" or f"]({page.name})" in index


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#\s]+)\)", page.read_text(encoding="utf-8")):
        assert "://" in link or (page.parent / link).exists(), link


WRITTEN = [
    (page, words)
    for page in PAGES
    for words in commands(page.read_text(encoding="utf-8"))
    if "..." not in " ".join(words)
]


@pytest.mark.parametrize(
    ("page", "words"), WRITTEN, ids=[f"{p.name}: {' '.join(w)}" for p, w in WRITTEN]
)
def test_commands_of_all_pages_are_taken(page: Path, words: list[str]) -> None:
    """Verbs and options are there, and settings are settings; nothing is run."""
    command, rest = typer.main.get_command(app), list(words)
    while hasattr(command, "commands"):
        command = command.commands[rest.pop(0)]
    context = command.make_context(words[0], rest)
    for kind in ("camera", "sun", "sky", "ground"):
        parse_setting(kind, context.params.get(kind) or "")
    file = context.params.get("file")
    if file and Path(file).parts[0] == "grammars":
        assert (ROOT / file).exists()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_python_of_all_pages_compiles_and_names_what_is_there(page: Path) -> None:
    for code in blocks("python", page.read_text(encoding="utf-8")):
        tree = ast.parse(code)
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "pcsg":
                module = importlib.import_module(node.module or "")
                for name in node.names:
                    assert hasattr(module, name.name), name.name


def test_nobody_is_told_to_install_what_is_not_ours() -> None:
    """The name on the package index is another project's, and ours is not published."""
    files = [*ROOT.glob("*.md"), *ROOT.glob("*.toml"), *(ROOT / ".github").rglob("*.yml")]
    for folder, kind in (("docs", "*.md"), ("pcsg", "*.py"), ("benchmarks", "*.md")):
        files += (ROOT / folder).rglob(kind)
    wrong = re.compile(r"install\s+(?:-\S+\s+)*['\"`]?pcsg|['\"`]pcsg\[")
    for file in files:
        assert not wrong.search(file.read_text(encoding="utf-8")), file
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["name"] == "pcsg-raytracer" and project["version"] == pcsg.__version__
    assert project["scripts"] == {"pcsg": "pcsg.cli:main"}
    assert f"{project['name']}[mesh]" in project["optional-dependencies"]["dev"]


def test_numbers_of_the_readme() -> None:
    stats = pcsg.load(ROOT / "grammars" / "tree.pcsg").stats()
    assert f"{stats['primitives']:,} solids, its graph {stats['nodes']['total']} nodes" in " ".join(
        README.split()
    )
    assert sys.version_info >= (3, 11) and "Python 3.11 or newer" in README


def test_pictures_of_the_documentation_tell_no_folder_of_a_machine() -> None:
    for file in (ROOT / "docs" / "pictures").glob("*.png"):
        with Image.open(file) as picture:
            words = str(getattr(picture, "text", {}).get("pcsg:command", "")).split()
        assert not [word for word in words if Path(word).is_absolute()], file
