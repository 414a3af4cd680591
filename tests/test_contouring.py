"""Meshes of any solid are closed, oriented outwards, and lie on the surface."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import pcsg
from pcsg.cli import app
from pcsg.contouring import contour
from pcsg.errors import UsageError


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize(
    "text, expected",
    [
        ("sphere", 4.0 / 3.0 * np.pi),
        ("box \\ move(0,0,-2) scale(0.5,0.5,4) cylinder", 8.0 - np.pi / 2.0),
        ("uscale(0.7) sphere | move(2,0,0) box", 8.0 + 0.343 * 4.0 / 3.0 * np.pi),
        ("blob { point(0.8) }", 0.512 * 4.0 / 3.0 * np.pi),
    ],
)
def test_closed_and_on_the_surface(text, expected):
    scene = pcsg.loads(text)
    vertices, faces = contour(scene, 40)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forth = {tuple(e) for e in edges.tolist()}
    assert len(forth) == len(edges) and all((b, a) in forth for a, b in forth)
    assert volume(vertices, faces) == pytest.approx(expected, rel=0.03)
    rng = np.random.default_rng(1)
    direction = rng.normal(size=3)
    near = vertices[rng.integers(0, len(vertices), 200)]
    # A short ray through the vertex crosses the surface there.
    hits = scene.intersect(near - 1e-3 * direction, 2e-3 * np.tile(direction, (200, 1)), 0.0, 1.0)
    assert np.isfinite(hits.t).mean() > 0.95


def test_what_cannot_be_contoured_is_told():
    with pytest.raises(UsageError, match="bounds"):
        contour(pcsg.loads("halfspace"))
    with pytest.raises(UsageError, match="thick"):
        contour(pcsg.loads("scale(0.0001,1,1) box"), 10)
    with pytest.raises(UsageError, match="resolution"):
        contour(pcsg.loads("sphere"), 1)


def test_the_command_writes_what_the_mesh_leaf_reads(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.pcsg").write_text("sphere\n")
    result = CliRunner().invoke(
        app, ["mesh", "ball.pcsg", "--method", "contour", "--resolution", "20", "--json"]
    )
    assert result.exit_code == 0, result.output
    assert json.loads(result.output)["triangles"] > 1_000
    scene = pcsg.loads(f'mesh("{tmp_path}/ball.obj")')
    assert scene.contains([[0.0, 0.0, 0.0], [0.9, 0.9, 0.0]]).tolist() == [True, False]
    for arguments in (["--method", "cubes"], ["--method", "contour", "-o", "x.ply"]):
        refused = CliRunner().invoke(app, ["mesh", "ball.pcsg", *arguments])
        assert refused.exit_code == 2 and "Traceback" not in refused.output
