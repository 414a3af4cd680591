"""Scenes for other programs, read again by others' readers: counts, places, bounds, materials."""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import pcsg
from pcsg.cli import app
from pcsg.errors import EnvironmentFault, UsageError
from pcsg.export import export
from pcsg.export.maps import quaternions, split
from pcsg.export.prototypes import MOST_NESTED, assemble

trimesh = pytest.importorskip("trimesh")

GRAMMARS = Path(__file__).parent.parent.parent / "grammars"
LIMBS = """{n = 6; w = 0.1} T
T if(n > 0, 2, 1)
1: T -> label(3) color(0.1, 0.5, 0.1) move(0,0,1) uscale(0.3) sphere
2: T -> material(bark) scale(w,w,1) cylinder | {n = n-1} move(0,0,1) uscale(0.7) (
        rotx(-40) T | rotx(30) rotz(50) T)
material bark { color = (0.3, 0.2, 0.1); roughness = 0.9 }
ground { z = 0; material = bark }
"""
SHEARED = "{} rotz(30) scale(2, 1, 1) rotz(40) scale(1, 3, 1) box"
SOLIDS = {
    "sphere": 4 / 3 * np.pi,
    "cylinder": np.pi,
    "cone(0.5)": np.pi * 1.75 / 3,
    "box": 8.0,
    "tetrahedron": 8 / 3,
    "torus(0.3)": 2 * np.pi**2 * 0.09,
}


def read(path):
    return trimesh.load_scene(path)


def points_of(scene, *, without=("ground",)):
    """Return all vertices in the world, z up."""
    found = []
    for name in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[name]
        if not any(word in geometry for word in without):
            mesh = scene.geometry[geometry]
            found.append(trimesh.transform_points(mesh.vertices, matrix))
    points = np.concatenate(found)
    return np.column_stack([points[:, 0], -points[:, 2], points[:, 1]])


@pytest.mark.parametrize("solid", SOLIDS)
def test_primitives_are_closed_and_face_outwards(solid, tmp_path):
    (shape,) = assemble(pcsg.loads(f"{{}} {solid}"), segments=96).shapes
    mesh = trimesh.Trimesh(shape.vertices, shape.triangles)
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(SOLIDS[solid], rel=0.01)
    assert (np.einsum("ij,ij->i", shape.normals, mesh_normals(shape)) > 0.9).all()


def mesh_normals(shape):
    """Return the mean normal of the triangles about every vertex."""
    a, b, c = (shape.vertices[shape.triangles[:, k]] for k in range(3))
    found = np.zeros_like(shape.vertices)
    for k in range(3):
        np.add.at(found, shape.triangles[:, k], np.cross(b - a, c - a))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_surface_coordinates_have_seams():
    (shape,) = assemble(pcsg.loads("{} sphere")).shapes
    u = shape.uv[shape.triangles, 0]
    assert (u.max(axis=1) - u.min(axis=1)).max() < 0.2
    assert u.min() < 0.01
    assert u.max() > 0.99


@pytest.mark.parametrize("instances", [False, True])
def test_glb_has_every_solid_in_its_place(instances, tmp_path):
    scene = pcsg.loads(LIMBS)
    made = export(scene, tmp_path / "a.glb", instances=instances)
    assert made.solids == 63 + 64 + 1
    if instances:
        content = document(tmp_path / "a.glb")
        counts = [
            content["accessors"][n["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"]][
                "count"
            ]
            for n in content["nodes"]
            if "EXT_mesh_gpu_instancing" in n.get("extensions", {})
        ]
        assert sorted(counts) == [63, 64]
        return
    points = points_of(read(tmp_path / "a.glb"))
    exact = scene.bounds
    assert np.abs(np.array([points.min(axis=0), points.max(axis=0)]) - exact).max() < 0.03
    assert [m["extras"] for m in document(tmp_path / "a.glb")["meshes"] if "extras" in m] == [
        {"pcsg:label": 3}
    ]


def document(path):
    data = path.read_bytes()
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def test_shears_survive(tmp_path):
    scene = pcsg.loads(SHEARED)
    export(scene, tmp_path / "a.glb")
    points = points_of(read(tmp_path / "a.glb"), without=())
    ends = np.array([points.min(axis=0), points.max(axis=0)])
    assert ends == pytest.approx(scene.bounds, abs=1e-4)


def test_maps_are_split_and_joined():
    rng = np.random.default_rng(5)
    maps = rng.normal(size=(200, 3, 3))
    outer, scale, inner = split(maps)
    assert np.allclose(outer * scale[:, None] @ inner, maps)
    assert np.allclose(np.linalg.det(outer), 1.0)
    assert np.allclose(np.linalg.det(inner), 1.0)
    x, y, z, w = quaternions(outer).T
    assert np.allclose(1 - 2 * (y * y + z * z), outer[:, 0, 0])
    assert np.allclose(2 * (x * y + z * w), outer[:, 1, 0])


@pytest.mark.parametrize("ending", ["usdc", "usda"])
def test_usd_has_every_solid_once_as_an_instance(ending, tmp_path):
    pxr = pytest.importorskip("pxr.Usd")
    from pxr import UsdGeom, UsdShade

    scene = pcsg.loads(LIMBS)
    made = export(scene, tmp_path / f"a.{ending}")
    stage = pxr.Stage.Open(str(tmp_path / f"a.{ending}"))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    meshes = [
        prim
        for prim in pxr.PrimRange(stage.GetPseudoRoot(), pxr.TraverseInstanceProxies())
        if prim.IsA(UsdGeom.Mesh)
    ]
    assert len(meshes) == made.solids == 128
    materials = {
        UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0].GetPrim().GetName()
        for prim in meshes
    }
    assert materials == {"bark", "plain"}
    labels = [prim.GetAttribute("primvars:pcsg:label").Get() for prim in meshes]
    assert labels.count(3) == 64
    box = UsdGeom.BBoxCache(pxr.TimeCode.Default(), ["default"])
    tops = max(box.ComputeWorldBound(p).ComputeAlignedRange().GetMax()[2] for p in meshes)
    assert tops == pytest.approx(scene.bounds[1, 2], abs=0.02)
    for name in ("camera", "sun", "sky"):
        assert stage.GetPrimAtPath(f"/World/{name}").IsValid()


def test_the_tree_is_as_small_as_its_states(tmp_path):
    pytest.importorskip("pxr.Usd")
    scene = pcsg.load(GRAMMARS / "tree.pcsg")
    made = export(scene, tmp_path / "tree.usdc")
    assert made.solids == 311_298
    assert (tmp_path / "tree.usdc").stat().st_size < 2_000_000
    assert nesting(assemble(scene)) <= MOST_NESTED


def nesting(assembly):
    levels = []
    for prototype in assembly.prototypes:
        levels.append(max((1 + levels[k] for k in prototype.references), default=0))
    return levels[-1]


def test_operations_have_the_looks_of_their_operands(tmp_path):
    pytest.importorskip("manifold3d")
    scene = pcsg.loads("{} color(1, 0, 0) box \\ color(0, 0, 1) scale(0.5, 0.5, 2) box")
    found = assemble(scene)
    volume = 0.0
    for shape, _, _ in found.parts:
        a, b, c = (
            found.shapes[shape].vertices[found.shapes[shape].triangles[:, k]] for k in range(3)
        )
        volume += np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(8.0 - 2.0)
    assert sorted(m.color for m in found.materials) == [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)]


def test_copies_of_an_operation_are_one_shape():
    pytest.importorskip("manifold3d")
    lens = "(move(0.7,0,0) sphere & move(-0.7,0,0) sphere)"
    copies = " | ".join(f"move({3 * k},0,0) rotz({20 * k}) uscale(0.5) {lens}" for k in range(5))
    assert len(assemble(pcsg.loads(f"{{}} {copies}")).shapes) == 1


def test_operations_are_contoured_without_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "manifold3d", None)
    found = assemble(pcsg.loads("{} sphere \\ move(1, 0, 0) sphere"), resolution=24)
    assert any("contoured" in note for note in found.notes)
    assert sum(len(shape.triangles) for shape in found.shapes) > 500


def test_solids_without_polygons_are_contoured():
    found = assemble(pcsg.loads("{} capsule(0.3)"), resolution=16)
    assert len(found.shapes[0].triangles) > 100
    assert found.notes == ()


def test_depth_ends_in_boxes_that_hold_what_follows():
    scene = pcsg.loads(LIMBS)
    found = assemble(scene, depth=3)
    assert found.instances == 1 + 2 + 4 + 1
    assert {"box", "cylinder"} <= {shape.name for shape in found.shapes}


def test_what_is_too_large_names_a_depth_that_fits(tmp_path):
    huge = LIMBS.replace("n = 6", "n = 40")
    scene = pcsg.loads(huge)
    with pytest.raises(UsageError, match=r"2,199,023,255,551 solids, .* --depth 23") as caught:
        export(scene, tmp_path / "a.glb")
    assert not list(tmp_path.iterdir())
    assert "--depth 23" in str(caught.value)
    assert assemble(scene, depth=12).instances == 2**12


def test_deep_recursion_is_no_deep_nesting(tmp_path):
    text = """{n = 900} S
S if(n > 0, 2, 1)
1: S -> box
2: S -> sphere | move(0,0,1) {n = n-1} S"""
    found = assemble(pcsg.loads(text))
    assert found.instances == 901
    assert len(found.prototypes) == 1


def test_a_table_has_a_row_for_each_primitive(tmp_path):
    scene = pcsg.loads(LIMBS)
    assert export(scene, tmp_path / "a.csv").solids == 127
    with (tmp_path / "a.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["label"] for row in rows].count("3") == 64
    matrices = np.concatenate([leaves.matrix for leaves in scene.leaves()]).reshape(-1, 12)
    written = [[float(row[f"m{i}{j}"]) for i in range(3) for j in range(4)] for row in rows]
    assert np.array_equal(matrices, np.array(written))
    assert rows[0]["path"] == "T:2"


@pytest.mark.parametrize(("ending", "up"), [("obj", "y"), ("ply", "z"), ("ply", "y")])
def test_flat_files_have_the_axis_up(ending, up, tmp_path):
    path = tmp_path / f"a.{ending}"
    scene = pcsg.loads("{} scale(1, 2, 4) box")
    export(scene, path, up=up)
    mesh = trimesh.load_mesh(path)
    assert mesh.extents == pytest.approx((2, 4, 8) if up == "z" else (2, 8, 4))
    assert mesh.volume == pytest.approx(64.0)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "a.xyz"], "its name must end in"),
        (["-o", "a.glb", "--up", "z"], "in .glb files y is always up"),
        (["-o", "a.obj", "--up", "x"], "--up takes y or z"),
        (["-o", "a.obj", "--instances"], "--instances is for .glb"),
        (["-o", "a.obj", "--segments", "2"], "segments"),
        (["-o", "a.obj", "--depth", "0"], "depth"),
    ],
)
def test_what_cannot_be_is_told(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("a.pcsg").write_text(LIMBS)
    done = CliRunner().invoke(app, ["export", "a.pcsg", *words])
    assert done.exit_code == 2
    assert message in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.pcsg"]


@pytest.mark.parametrize("text", ["{} empty", "{} halfspace", "{} box & move(5,0,0) box"])
def test_nothing_is_no_fault_of_pcsg(text, tmp_path):
    scene = pcsg.loads(text)
    try:
        export(scene, tmp_path / "a.glb")
    except UsageError as error:
        assert "nothing to export" in str(error)


def test_without_the_library_usd_is_refused_before_the_work(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(EnvironmentFault, match="usd-core"):
        export(pcsg.loads("{} box"), tmp_path / "a.usdc")


BLENDER = """
import json, sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
path = sys.argv[1]
if path.endswith(".glb"):
    bpy.ops.import_scene.gltf(filepath=path)
else:
    bpy.ops.wm.usd_import(filepath=path)
graph = bpy.context.evaluated_depsgraph_get()
count, low, high, looks, uv = 0, [1e9] * 3, [-1e9] * 3, set(), 0
for each in graph.object_instances:
    mesh = each.object
    if mesh.type != "MESH" or abs(mesh.bound_box[6][0]) > 15:
        continue
    count += 1
    uv += len(mesh.data.uv_layers)
    looks.add(mesh.data.materials[0].name)
    for corner in mesh.data.vertices:
        at = each.matrix_world @ corner.co
        low = [min(a, b) for a, b in zip(low, at)]
        high = [max(a, b) for a, b in zip(high, at)]
print("RESULT", json.dumps([count, low, high, sorted(looks), uv]))
"""


@pytest.mark.peer
@pytest.mark.parametrize("ending", ["usdc", "glb"])
def test_blender_imports_it(ending, tmp_path):
    """The interpreter that has bpy is named by PCSG_BLENDER."""
    python = os.environ.get("PCSG_BLENDER")
    if not python:
        pytest.skip("PCSG_BLENDER names no interpreter that has bpy")
    scene = pcsg.loads(LIMBS)
    export(scene, tmp_path / f"a.{ending}")
    script = tmp_path / "look.py"
    script.write_text(BLENDER)
    done = subprocess.run(
        [python, str(script), str(tmp_path / f"a.{ending}")],
        capture_output=True,
        text=True,
        timeout=300,
    )
    (line,) = [x for x in done.stdout.splitlines() if x.startswith("RESULT")]
    count, low, high, looks, uv = json.loads(line.removeprefix("RESULT "))
    assert count == uv == 127
    assert np.abs(np.array([low, high]) - scene.bounds).max() < 0.03
    assert looks == ["bark", "plain"]
