"""`pcsg mesh`, `pcsg skeleton` and `pcsg compose` as a user types them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tree_shapes import GRAMMARS, species, tubes
from typer.testing import CliRunner, Result

from pcsg.cli import app
from pcsg.meshfile import read_mesh
from pcsg.treemesh import load_skeleton, save_skeleton

Run = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.chdir(tmp_path)
    save_skeleton(species("quercus"), tmp_path / "oak.json")

    def call(*arguments: str) -> Result:
        result = CliRunner().invoke(app, list(arguments))
        assert result.exception is None or isinstance(result.exception, SystemExit)
        assert "Traceback" not in result.output
        return result

    return call


def write_tubes(path: Path, **change: Any) -> None:
    verts, faces = tubes(species("quercus"), **change)
    lines = ["v {} {} {}".format(*v) for v in verts]
    lines += ["f {} {} {}".format(*(f + 1)) for f in faces]
    path.write_text("\n".join(lines))


@pytest.mark.parametrize("verb", ["mesh", "skeleton", "compose"])
def test_help(run: Run, verb: str) -> None:
    result = run(verb, "--help")
    assert result.exit_code == 0
    assert "Usage" in result.stdout


def test_a_grammar_becomes_a_mesh_with_a_report(run: Run) -> None:
    result = run("mesh", str(GRAMMARS / "quercus.pcsg"), "--report", "r.json")
    assert result.exit_code == 0
    assert "quads about" in result.output
    report = json.loads(Path("r.json").read_text())
    mesh = read_mesh("quercus.obj")
    assert mesh.polygon_count == report["quads"]
    assert report["euler_characteristic"] == 2
    assert set(np.diff(mesh.offsets).tolist()) == {4}


def test_options_of_mesh(run: Run) -> None:
    dense = run("mesh", "oak.json", "-o", "a.ply", "--json")
    sparse = run(
        "mesh", "oak.json", "-o", "b.glb", "--max-aspect", "0", "--kernel", "quartic", "--json"
    )
    a, b = json.loads(dense.stdout), json.loads(sparse.stdout)
    assert a["files"] == ["a.ply"]
    assert b["quads"] < a["quads"]
    assert "GLB knows no quads" in b["notes"][-1]
    assert run("mesh", "oak.json", "--levels", "1", "-q").output == ""
    assert Path("oak.obj").exists()
    foot = run("mesh", "oak.json", "-o", "c.obj", "--foot")
    assert foot.exit_code == 0
    low = {n: read_mesh(n).vertices[:, 2].min() for n in ("oak.obj", "c.obj")}
    assert low["c.obj"] < low["oak.obj"] - 0.05


def test_open_tubes_are_mended(run: Run, tmp_path: Path) -> None:
    write_tubes(tmp_path / "soup.obj", flip=0.3, soup=True)
    result = run("mesh", "soup.obj", "-o", "fixed.obj", "--offsets", "--report", "r.json")
    assert result.exit_code == 0
    assert "31 parts were joined" in result.output
    assert "62 open ends were capped" in result.output
    report = json.loads(Path("r.json").read_text())
    assert (report["closed"], report["euler_characteristic"]) == (True, 2)
    assert "after_offsets" in report["distance"]


def test_skeletons_of_everything(run: Run, tmp_path: Path) -> None:
    write_tubes(tmp_path / "soup.obj")
    assert run("skeleton", "soup.obj", "-o", "a.swc", "--no-resample").exit_code == 0
    assert load_skeleton("a.swc").n_edges == 129
    said = json.loads(run("skeleton", str(GRAMMARS / "acer.pcsg"), "--json").stdout)
    assert said["joints"] == 13
    assert run("skeleton", "oak.json", "-o", "b.json", "--max-order", "1").exit_code == 0
    assert load_skeleton("b.json").n_edges < 129


def test_composed_trees(run: Run) -> None:
    result = run("compose", "oak.json", "--seed", "7", "-n", "3")
    assert result.exit_code == 0
    trees = [load_skeleton(f"oak-composed-{k}.json") for k in (1, 2, 3)]
    assert not np.array_equal(trees[0].pos, trees[1].pos)
    again = run("compose", "oak.json", "--seed", "8", "-o", "one.json", "--json")
    assert json.loads(again.stdout)["seed"] == 8
    assert np.array_equal(load_skeleton("one.json").pos, trees[1].pos)
    mixed = run("compose", "oak.json", "--with", str(GRAMMARS / "acer.pcsg"), "-o", "m.obj")
    assert mixed.exit_code == 0
    assert read_mesh("m.obj").polygon_count > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mesh", "oak.xyz"], "must end in one of .obj, .ply, .stl, .glb, .json, .swc, .pcsg"),
        (["mesh", "none.obj"], "`none.obj`: there is no such file"),
        (["mesh", "none.json"], "`none.json`: there is no such file"),
        (["mesh", "oak.json", "-o", "a.fbx"], "must end in .obj, .ply, .glb, .usda, .usd"),
        (["mesh", "oak.json", "-o", "no/a.obj"], "there is no folder"),
        (["mesh", "oak.json", "--kernel", "gauss"], "unknown kernel"),
        (["mesh", "oak.json", "--levels", "0"], "levels must lie between"),
        (["mesh", "oak.json", "--offsets"], "needs a mesh"),
        (["mesh", "oak.json", "--report", "r.txt"], "must end in .json"),
        (["mesh", "oak.json", "--min-radius", "9"], "nothing is left"),
        (["skeleton", "oak.json"], "oak.json is the input"),
        (["skeleton", "oak.json", "-o", "a.obj"], "must end in .json, .swc"),
        (["compose", "oak.json", "-n", "0"], "-n takes"),
        (["compose", "oak.json", "--replace", "3"], "p_replace"),
    ],
)
def test_mistakes(run: Run, arguments: list[str], message: str) -> None:
    before = set(Path().iterdir())
    result = run(*arguments)
    assert result.exit_code == 2
    assert message in result.output
    assert set(Path().iterdir()) == before
