"""Primitives that name files: what names are relative to, and back to text."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import pcsg
from pcsg import Scene, UsageError, render
from pcsg.errors import GrammarError
from pcsg.grammar import load_file, load_text
from pcsg.graph.build import CONSTRUCTORS
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Leaf
from pcsg.graph.text import node_text, to_pcsg
from pcsg.leaf.mesh import MeshModel

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


def meshes(graph: Graph) -> list[MeshModel]:
    return [n.constants[0] for n in graph.nodes if isinstance(n, Leaf) and n.constants]  # type: ignore[misc]


def sizes(graph: Graph) -> list[int]:
    return [len(mesh.triangles) for mesh in meshes(graph)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "parts").mkdir()
    (tmp_path / "one.obj").write_text(TRIANGLE)
    (tmp_path / "parts" / "one.obj").write_text(SQUARE)
    (tmp_path / "parts" / "square.pcsg").write_text(
        '#define MACRO mesh("one.obj")\nsq = mesh("one.obj")'
    )
    return tmp_path


def test_names_are_relative_to_the_file_they_are_written_in(folder: Path) -> None:
    root = folder / "root.pcsg"
    root.write_text(
        '#include "parts/square.pcsg"\nmesh("one.obj") | sq | MACRO | mesh("parts/one.obj")'
    )
    assert sizes(load_file(root)) == [1, 2, 2, 2]


def test_names_in_a_text_are_relative_to_the_working_directory(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert sizes(load_text('mesh("one.obj")', name="elsewhere/x.pcsg")) == [1]
    assert sizes(Graph(CONSTRUCTORS["mesh"]("parts/one.obj"))) == [2]  # type: ignore[operator]


def test_a_file_is_read_once_and_again_when_it_changes(folder: Path) -> None:
    root = folder / "root.pcsg"
    root.write_text('mesh("one.obj") | move(2, 0, 0) mesh("one.obj")')
    graph = load_file(root)
    first, second = meshes(graph)
    assert first is second
    (folder / "one.obj").write_text(SQUARE)
    assert sizes(load_file(root)) == [2, 2]
    assert sizes(graph) == [1, 1]


def test_back_to_text(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    graph = load_text(
        '{c = 2} M\nM if(c > 0, 2, 1)\n1: M -> mesh("one.obj")\n'
        '2: M -> mesh("parts/one.obj") | {c = c-1} M'
    )
    text = to_pcsg(graph)
    assert 'mesh("one.obj")' in text and 'mesh("parts/one.obj")' in text
    assert load_text(text) == graph
    assert load_text(text.replace("parts/", "")) != graph


def test_arrays_have_no_text() -> None:
    leaf = CONSTRUCTORS["mesh"]([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])  # type: ignore[operator]
    assert node_text(leaf) == "mesh(...)"  # in drawings
    with pytest.raises(UsageError, match="a grammar cannot hold the data of this `mesh`"):
        to_pcsg(Graph(leaf))


def test_the_digest_of_a_scene_knows_the_content_of_files(folder: Path) -> None:
    root = folder / "root.pcsg"
    root.write_text('mesh("one.obj")')
    before = Scene(load_file(root)).source_hash
    assert Scene(load_file(root)).source_hash == before
    (folder / "one.obj").write_text(SQUARE)
    assert Scene(load_file(root)).source_hash != before


def test_a_missing_file_hides_no_other_mistake(folder: Path) -> None:
    root = folder / "root.pcsg"
    root.write_text('mesh("none.obj") | mesh("none.obj") | spere | rotz(1, 2) mesh("one.obj")')
    with pytest.raises(GrammarError) as caught:
        load_file(root)
    codes = [d.code for d in caught.value.diagnostics]
    assert codes == ["bad-file", "bad-file", "unknown-primitive", "wrong-arguments"]


def test_a_solid_mesh_can_be_subtracted_and_a_sheet_cannot(folder: Path) -> None:
    root = folder / "root.pcsg"
    (folder / "closed.obj").write_text(
        "v 1 1 1\nv -1 -1 1\nv 1 -1 -1\nv -1 1 -1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n"
    )
    root.write_text('box \\ mesh("closed.obj")')
    assert load_file(root).nodes
    root.write_text('box \\ mesh("one.obj")')
    with pytest.raises(GrammarError, match="sheet-subtracted"):
        load_file(root)


SECRET = "root:x:0:0:hunter2:/root:/bin/sh\n"
EXTERNAL = [
    '#include "NAME"\nsphere',
    'mesh("NAME")',
    'blob("NAME")',
    'tree("NAME", 3)',
    'sphere\nsky { kind = image; file = "NAME" }',
    'sphere\ntexture t { kind = image; file = "NAME" }',
    'sphere\ntexture t { kind = normals; file = "NAME" }',
]
ENDINGS = ("", ".pcsg", ".obj", ".ply", ".stl", ".glb", ".lsys", ".swc", ".json", ".png", ".hdr")


def told(grammar: Path, include: tuple[Path, ...] = ()) -> str:
    """Return all that is said of a grammar that is wrong."""
    with pytest.raises(GrammarError) as caught:
        load_file(grammar, include=include)
    return str(caught.value)


@pytest.mark.parametrize("text", EXTERNAL)
def test_no_file_outside_is_read(tmp_path: Path, text: str) -> None:
    inner = tmp_path / "grammars"
    inner.mkdir()
    (inner / "sub").mkdir()
    root = inner / "root.pcsg"
    for ending in ENDINGS:
        secret = tmp_path / f"secret{ending}"
        secret.write_text(SECRET)
        link = inner / f"link{ending}"
        link.symlink_to(secret)
        for name in (secret, f"../secret{ending}", f"sub/../../secret{ending}", link.name):
            root.write_text(text.replace("NAME", str(name)))
            message = told(root)
            assert "-outside]" in message and "--include DIR" in message
            assert "hunter2" not in message


@pytest.mark.parametrize("text", EXTERNAL)
def test_what_is_no_model_is_not_quoted_inside_either(tmp_path: Path, text: str) -> None:
    (tmp_path / ".env").write_text(SECRET)
    (tmp_path / "notes.txt").write_text(SECRET)
    root = tmp_path / "root.pcsg"
    for name in (".env", "notes.txt"):
        root.write_text(text.replace("NAME", name))
        if "file =" in text:
            scene = Scene(load_file(root))
            with pytest.raises(UsageError) as caught:
                render(scene, (4, 4), 1)
            message = str(caught.value)
        else:
            message = told(root)
        assert name in message and "hunter2" not in message


def test_folders_that_the_user_allows(tmp_path: Path) -> None:
    (tmp_path / "one.obj").write_text(TRIANGLE)
    (tmp_path / "in").mkdir()
    root = tmp_path / "in" / "root.pcsg"
    root.write_text('mesh("../one.obj")')
    assert "file-outside" in told(root)
    assert sizes(load_file(root, include=[tmp_path])) == [1]
    assert "file-outside" in told(root, (tmp_path / "none",))


def test_links_inside_may_be_followed(folder: Path) -> None:
    (folder / "link.obj").symlink_to(folder / "parts" / "one.obj")
    (folder / "loop.obj").symlink_to(folder / "loop.obj")
    root = folder / "root.pcsg"
    root.write_text('mesh("link.obj")')
    assert sizes(load_file(root)) == [2]
    root.write_text('mesh("loop.obj")')
    assert "file-outside" in told(root)


def test_what_users_name_themselves_is_theirs(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder / "parts")
    assert sizes(Graph(CONSTRUCTORS["mesh"]("../one.obj"))) == [1]  # type: ignore[operator]
    (folder / "plant.lsys").write_text("axiom: F\n")
    link = folder / "parts" / "link.lsys"
    link.symlink_to(folder / "plant.lsys")
    assert load_file(link).nodes
    root = folder / "root.pcsg"
    root.write_text('mesh("one.obj")')
    (folder / "parts" / "link.pcsg").symlink_to(root)
    assert sizes(load_file("link.pcsg")) == [2]  # names are relative to where it was found


@pytest.mark.skipif(os.name != "posix", reason="no file can have such a name")
@pytest.mark.parametrize("name", ['a"b.lsys', "a\nb.lsys", "a\rb.lsys"])
def test_models_whose_names_no_grammar_can_say(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("axiom: F\n")
    with pytest.raises(GrammarError) as caught:
        load_file(tmp_path / name)
    assert [d.code for d in caught.value.diagnostics] == ["file-missing"]
    assert "has quotes or ends of lines" in str(caught.value)


def test_texts_are_held_to_the_working_directory(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder / "parts")
    with pytest.raises(GrammarError, match="file-outside"):
        pcsg.loads('mesh("../one.obj")')
    assert sizes(pcsg.loads('mesh("../one.obj")', include=[folder]).graph) == [1]


def test_pictures_are_named_from_where_they_are_written(folder: Path) -> None:
    (folder / "parts" / "sky.pcsg").write_text('sky { kind = image; file = "sky.png" }')
    root = folder / "root.pcsg"
    root.write_text('#include "parts/sky.pcsg"\nsphere\ntexture t { kind = image; file = "a.png" }')
    scene = Scene(load_file(root))
    assert scene.setting_values("sky")[0]["file"] == str(folder / "parts" / "sky.png")
    assert scene.setting_values("texture")[0]["file"] == str(folder / "a.png")
    assert 'file = "sky.png"' in scene.to_pcsg()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
@pytest.mark.parametrize("text", EXTERNAL)
def test_a_pipe_is_not_waited_for(tmp_path: Path, text: str) -> None:
    root = tmp_path / "root.pcsg"
    for ending in ENDINGS:
        os.mkfifo(tmp_path / f"pipe{ending}")
        root.write_text(text.replace("NAME", f"pipe{ending}"))
        with pytest.raises((GrammarError, UsageError)):
            render(Scene(load_file(root)), (4, 4), 1)
