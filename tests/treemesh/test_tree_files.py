"""Files of skeletons and surfaces, read back by other means."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tree_shapes import forked_tree, wild_skeleton

from pcsg.errors import UsageError
from pcsg.meshfile import read_mesh
from pcsg.treemesh import Skeleton, load_skeleton, save_skeleton, tree_surface
from pcsg.treemesh.files import report_text
from pcsg.treemesh.surface import QuadMesh


@cache
def surface() -> QuadMesh:
    skel = forked_tree(np.random.default_rng(4), forks=2)
    return tree_surface(skel.replaced(tags={"label": np.arange(skel.n_edges) % 3}))


@pytest.mark.parametrize("ending", ["json", "swc"])
def test_skeletons_come_back(tmp_path: Path, ending: str) -> None:
    skel = wild_skeleton(np.random.default_rng(3), 40)
    skel = skel.replaced(tags={"label": np.arange(40) % 5})
    back = load_skeleton(save_skeleton(skel, tmp_path / f"a.{ending}"))
    order = np.lexsort(skel.pos.T)
    again = np.lexsort(back.pos.T)
    assert np.array_equal(back.pos[again], skel.pos[order])
    assert np.array_equal(back.radius[again], skel.radius[order])

    def pairs(s: Skeleton) -> set[tuple[Any, ...]]:
        return {
            (*sorted([tuple(s.pos[a]), tuple(s.pos[b])]), int(label))
            for (a, b), label in zip(s.edges, s.tags["label"], strict=True)
        }

    assert pairs(back) == pairs(skel)
    assert np.array_equal(back.pos[back.root], skel.pos[skel.root])


def test_swc_of_others(tmp_path: Path) -> None:
    path = tmp_path / "a.swc"
    path.write_text("# neuron\n\n 7 1 0 0 0 0.5 -1\n3 3 0 0 2 0.25 7 # tip\n")
    skel = load_skeleton(path)
    assert skel.pos.tolist() == [[0, 0, 0], [0, 0, 2]]
    assert skel.tags["label"].tolist() == [3]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "{", "not JSON"),
        ("a.json", "[]", "a JSON object"),
        ("a.json", '{"nodes": []}', "no `edges`"),
        ("a.json", '{"nodes": [[0,0,0]], "edges": [[0,1]]}', "a list"),
        ("a.json", '{"nodes": "x", "edges": [[0,1]]}', "are lists"),
        ("a.json", '{"nodes": [[0,0,0,1],[0,0,1,1]], "edges": [[0,3]]}', "does not exist"),
        ("a.swc", "1 1 0 0 0\n", "line 1: expected the 7 numbers"),
        ("a.swc", "1 1 0 0 0 1 -1\n1 1 0 0 1 1 1\n", "line 2: the id 1 is there already"),
        ("a.swc", "1 1 0 0 0 1 -1\n2 1 0 0 1 1 9\n", "line 2: there is no node 9"),
        ("a.swc", "1 1 0 0 0 1 -1\n2 1 0 0 1 1 -1\n", "one root"),
        ("a.swc", "1 1 0 0 0 1 -1\n2 1 0 0 1 0 1\n", "radius 0"),
    ],
)
def test_mistakes_in_skeleton_files(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(UsageError, match=message):
        load_skeleton(tmp_path / name)
    with pytest.raises(UsageError, match="there is no such file"):
        load_skeleton(tmp_path / "none.json")


def test_loops_do_not_fit_into_swc(tmp_path: Path) -> None:
    ring = Skeleton.make([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [0.1] * 3, [[0, 1], [1, 2], [2, 0]])
    with pytest.raises(UsageError, match="trees only"):
        save_skeleton(ring, tmp_path / "a.swc")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("ending", "tolerance"), [("obj", 1e-8), ("ply", 0.0)])
def test_quads_stay_quads(tmp_path: Path, ending: str, tolerance: float) -> None:
    surf = surface()
    mesh = read_mesh(surf.save(tmp_path / f"a.{ending}"))
    assert mesh.polygon_count == len(surf.quads)
    assert set(np.diff(mesh.offsets).tolist()) == {4}
    ours = surf.positions[np.sort(surf.quads, axis=1)].sum(axis=(1, 2))
    theirs = mesh.vertices[np.sort(mesh.corners.reshape(-1, 4), axis=1)].sum(axis=(1, 2))
    assert np.sort(theirs) == pytest.approx(np.sort(ours), abs=20 * tolerance)
    assert len(mesh.vertices) == len(surf.verts)
    assert mesh.corner_uv is not None


def test_labels_are_groups_and_properties(tmp_path: Path) -> None:
    surf = surface()
    text = surf.save(tmp_path / "a.obj").read_text()
    assert [line for line in text.splitlines() if line.startswith("g ")] == [
        "g label_0",
        "g label_1",
        "g label_2",
    ]
    assert b"property int label" in surf.save(tmp_path / "a.ply").read_bytes()[:600]


def test_glb_is_what_trimesh_reads(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="a cross-check")
    surf = surface()
    loaded = trimesh.load(surf.save(tmp_path / "a.glb"), force="mesh", process=False)
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    assert len(loaded.faces) == 2 * len(surf.quads)
    assert loaded.is_watertight
    assert loaded.is_winding_consistent
    # y is up there.
    assert loaded.bounds[1][1] == pytest.approx(surf.verts[:, 2].max(), abs=1e-5)
    tri = surf.positions[surf.triangles]
    volume = np.einsum("ij,ij->", tri[:, 0], np.cross(tri[:, 1], tri[:, 2])) / 6
    assert loaded.volume == pytest.approx(volume, rel=1e-4)
    assert volume > 0


def test_usd_is_text_with_the_scheme(tmp_path: Path) -> None:
    text = surface().save(tmp_path / "a.usda").read_text()
    assert text.startswith("#usda 1.0")
    assert 'subdivisionScheme = "catmullClark"' in text
    counts = text.split("faceVertexCounts = [")[1].split("]")[0].split(",")
    assert len(counts) == len(surface().quads)


def test_usd_is_what_usd_reads(tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd", reason="needs usd-core")
    from pxr import UsdGeom

    surf = surface()
    stage = usd.Stage.Open(str(surf.save(tmp_path / "a.usda")))
    mesh = UsdGeom.Mesh(stage.GetDefaultPrim())
    assert len(mesh.GetPointsAttr().Get()) == len(surf.verts)
    assert mesh.GetSubdivisionSchemeAttr().Get() == "catmullClark"


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"must end in \.obj, \.ply, \.glb"):
        surface().save(tmp_path / "a.fbx")
    with pytest.raises(UsageError, match="no folder"):
        surface().save(tmp_path / "none" / "a.obj")


def test_reports_are_json() -> None:
    report = surface().report()
    back = json.loads(report_text({**report, "more": [float("nan"), float("inf"), 1.5]}))
    assert back["more"] == [None, None, 1.5]
    assert back["quads"] == len(surface().quads)
    assert set(back["times"]) == {"cage", "subdivision", "coordinates", "weights", "projection"}
    for key in ("smallest_angle", "aspect_ratio", "edge_flow", "radius_error", "notes"):
        assert key in back


def test_a_skeleton_that_hides_in_itself_is_told(tmp_path: Path) -> None:
    path = tmp_path / "thick.swc"
    rows = ["1 0 0 0 0 .5 -1", "2 0 1000 0 2 .4 1", "3 0 .5 0 4 .4 2", "4 0 1.8 0 3.2 .15 2"]
    rows += ["5 0 2.7 0 4 .1 1", "6 1 1 1 5 .2 3", "7 1 -1 .5 4.8 .2 3"]
    path.write_text("\n".join(rows), encoding="utf-8")
    skeleton = load_skeleton(path)
    with pytest.raises(UsageError, match="ends inside a thicker one"):
        tree_surface(skeleton)
