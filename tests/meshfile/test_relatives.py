"""What the formats allow and other programs write, beside the plain files of `test_meshfile`."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from writers import glb_bytes, obj_text, pack_glb, ply_bytes, stl_bytes

from pcsg.leaf.mesh import MeshModel
from pcsg.meshfile import Mesh, MeshFileError
from pcsg.meshfile.polygons import triangulate
from pcsg.meshfile.read import READERS

CORNERS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
FOUR = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def read(data: bytes | str, end: str) -> Mesh:
    return READERS["." + end]("file", data.encode() if isinstance(data, str) else data)


def is_tetrahedron(data: bytes | str, end: str) -> bool:
    mesh = read(data, end)
    return MeshModel(mesh).closed and len(mesh.triangles) == 4


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_line_ends_and_encodings(newline: str, encoding: str) -> None:
    texts = {
        "obj": obj_text(CORNERS, FOUR),
        "ply": ply_bytes(CORNERS, FOUR, "ascii").decode(),
        "stl": stl_bytes(np.array(CORNERS)[FOUR], True).decode(),
    }
    for end, text in texts.items():
        assert is_tetrahedron(text.replace("\n", newline).encode(encoding), end)


def test_utf16_that_is_none_is_told() -> None:
    with pytest.raises(MeshFileError, match="save it as UTF-8"):
        read(b"\xff\xfe\x00\xd8\x00", "obj")


def test_obj_indices_forwards_backwards_and_beyond() -> None:
    for face in (
        "f -3 -2 -1",
        "f 1/1/1 2/1/1 3/1/1 # a comment",
        "f 1//7 2//-9 3//0",
        "f\t1 2 3\t",
    ):
        mesh = read(TRIANGLE + face + "\nv 9 9 9\n", "obj")
        assert mesh.triangles.tolist() == [[0, 1, 2]]
        assert mesh.corner_normals is None
    mesh = read("f 1/1 2/2 3/3\n" + TRIANGLE + "vt 0 0\nvt 1 0\nvt 0 1\n", "obj")
    assert mesh.corner_uv is not None and mesh.notes == ()
    # Counted backwards, vertices that come later are none.
    with pytest.raises(MeshFileError, match="there is no vertex -1"):
        read("f -1 1 2\n" + TRIANGLE, "obj")


def test_obj_colors_up_to_one_and_up_to_255() -> None:
    for words, right in (
        ("1 1 1", 1.0),
        ("255 255 255", 1.0),
        ("0.5 0.5 0.5", 0.21404),
        ("1 1 1 0.2", 1.0),
    ):
        mesh = read(
            "".join(f"v {p} {words}\n" for p in ("0 0 0", "1 0 0", "0 1 0")) + "f 1 2 3", "obj"
        )
        assert mesh.corner_colors is not None
        assert np.allclose(mesh.corner_colors, right, atol=1e-5)


def test_many_continued_lines_take_no_time() -> None:
    assert read("\\\n" * 300_000 + TRIANGLE + "f 1 2 3", "obj").polygon_count == 1


def test_polygons_of_many_corners_take_no_time() -> None:
    n = 20_000
    around = 2 * np.pi * np.arange(n) / n
    radius = np.where(np.arange(n) % 2, 1.0, 0.5)
    star = np.stack([radius * np.cos(around), radius * np.sin(around), 0 * around], axis=1)
    comb = np.array([*((k / n, k % 2 * 0.9, 0.0) for k in range(n - 2)), (1, 1, 0), (0, 1, 0)])
    knot = np.random.default_rng(0).uniform(size=(n, 3))
    for points, crossing in ((star, 0), (comb, 0), (knot, 1)):
        triangles, found = triangulate(points, np.arange(n), np.array([0, n]))
        assert len(triangles) == n - 2 and found == crossing
        assert triangles.min() == 0 and triangles.max() == n - 1


@pytest.mark.parametrize("seed", range(40))
def test_polygons_with_bridges_to_holes(seed: int) -> None:
    """Holes in a row, each joined to the one before: the bridges are passed twice."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 5))
    ring = [(0.0, 0.0), (4.0 * count, 0.0), (4.0 * count, 4.0), (0.0, 4.0)]
    area = 16.0 * count
    at = 0
    for k in range(count):
        n = int(rng.integers(3, 9))
        around = -2.0 * np.pi * (np.arange(n) + 0.5) / n + np.pi
        radius = rng.uniform(0.8, 1.4, n)
        x, y = radius * np.cos(around), radius * np.sin(around)
        hole = [*zip(x + 4.0 * k + 2.0, y + 2.0, strict=True)]
        area += 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
        # From the last corner of the hole before to the first of this one, and back.
        near = int(np.argmin([px for px, _ in hole]))
        hole = hole[near:] + hole[:near]
        ring[at + 1 : at + 1] = [*hole, hole[0], ring[at]]
        at += 1 + int(np.argmax([px for px, _ in hole]))
    points = np.array([(x, y, 0.0) for x, y in ring])
    triangles, crossing = triangulate(points, np.arange(len(ring)), np.array([0, len(ring)]))
    sides = points[triangles]
    areas = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])[:, 2] / 2.0
    assert crossing == 0
    assert areas.sum() == pytest.approx(area) == np.abs(areas).sum()


def test_stl_headers_that_count_wrongly() -> None:
    right = stl_bytes(np.array(CORNERS)[FOUR])
    for count in (0, 2**32 - 1):
        mesh = read(right[:80] + struct.pack("<I", count) + right[84:], "stl")
        assert len(mesh.triangles) == 4
        assert mesh.notes == (f"the header counts {count:,} facets, 4 are there (byte 80)",)
    mesh = read(right[:80] + struct.pack("<I", 3) + right[84:], "stl")
    assert len(mesh.triangles) == 3 and len(mesh.notes) == 1
    with pytest.raises(MeshFileError, match="its 5 facets need 334 bytes"):
        read(right[:80] + struct.pack("<I", 5) + right[84:], "stl")


def test_stl_of_words_in_any_form() -> None:
    text = stl_bytes(np.array(CORNERS)[FOUR], True).decode()
    for written in (
        text.replace("\n", " "),
        text.upper(),
        "# made by hand\n" + text,
        text.replace("solid rock", "solid a facet with a vertex"),
        text.replace("facet normal 0 0 0", "facet normal nan nan nan"),
        text.replace("facet normal 0 0 0", "facet"),
        "\n\n  " + text,
    ):
        assert is_tetrahedron(written, "stl")
    with pytest.raises(MeshFileError, match="line 8: a facet needs three vertices, not 4"):
        read(text.replace("  endloop", "vertex 1 2 3\nendloop", 1), "stl")
    with pytest.raises(MeshFileError, match="line 4: a vertex needs finite numbers"):
        read(text.replace("vertex 0.0", "vertex inf", 1), "stl")
    with pytest.raises(MeshFileError, match="line 2: `rubbish` does not belong here"):
        read(text.replace("facet normal", "rubbish facet normal", 1), "stl")
    with pytest.raises(MeshFileError, match="the file ends inside a facet"):
        read(text[: text.rindex("endloop")], "stl")


def ply(vertex: str, face: str, body: str, before: str = "", size: int = 1) -> str:
    head = "ply\nformat ascii 1.0\n" + before + "element vertex 3\nproperty float x\n"
    head += "property float y\nproperty float z\n" + vertex + f"element face {size}\n"
    return head + "property list uchar int vertex_indices\n" + face + "end_header\n" + body


COLORS = "".join("property {0} " + f"{name}\n" for name in ("red", "green", "blue"))


@pytest.mark.parametrize(
    ("kind", "written", "right"),
    [
        ("uchar", "255 51 0", (1.0, 0.2, 0.0)),
        ("ushort", "65535 32768 0", (1.0, 0.5, 0.0)),
        ("short", "32767 16384 0", (1.0, 0.5, 0.0)),
        ("char", "127 64 -1", (1.0, 64 / 127, 0.0)),
        ("int", "255 51 0", (1.0, 0.2, 0.0)),
        ("uint", "4294967295 2147483648 0", (1.0, 0.5, 0.0)),
        ("float", "1 0.5 0", (1.0, 0.5, 0.0)),
        ("float", "255 51 0", (1.0, 0.2, 0.0)),
    ],
)
@pytest.mark.parametrize("where", ["vertex", "face"])
def test_ply_colors_by_the_range_of_their_type(
    kind: str, written: str, right: Any, where: str
) -> None:
    rows = ["0 0 0", "1 0 0", "0 1 0"]
    if where == "vertex":
        text = ply(
            COLORS.format(kind), "", "\n".join(f"{r} {written}" for r in rows) + "\n3 0 1 2\n"
        )
    else:
        text = ply("", COLORS.format(kind), "\n".join([*rows, "3 0 1 2 " + written]) + "\n")
    mesh = read(text, "ply")
    assert mesh.corner_colors is not None
    shown = 1.055 * mesh.corner_colors ** (1 / 2.4) - 0.055
    assert np.allclose(np.where(mesh.corner_colors < 1e-9, 0.0, shown), right, atol=2e-5)


def test_ply_elements_before_the_vertices_and_lists_in_them() -> None:
    before = "element camera 1\nproperty float view\nproperty list uchar float k\n"
    text = ply("property list uchar int near\n", "property uchar flag\n", "7 2 1 2\n", before)
    text += "0 0 0 0\n1 0 0 3 1 2\n4\n0 1 0 1 9\n3 0 1 2 1\n"
    assert read(text, "ply").triangles.tolist() == [[0, 1, 2]]
    assert read(text.replace("int vertex", "ushort vertex"), "ply").polygon_count == 1


def test_ply_lists_of_many_lengths() -> None:
    points = np.random.default_rng(0).uniform(size=(9, 3))
    faces = [tuple(range(n)) for n in (3, 5, 9, 4, 3)]
    for form in ("ascii", "binary_little_endian", "binary_big_endian"):
        mesh = read(ply_bytes(points, faces, form, True), "ply")
        assert np.diff(mesh.offsets).tolist() == [3, 5, 9, 4, 3]
        assert mesh.corners.tolist() == [v for face in faces for v in face]


def test_ply_strips_turn_every_other_triangle() -> None:
    body = "0 0 0\n1 0 0\n0 1 0\n6 0 1 2 -1 0 1\n"
    text = ply("", "", body).replace("element face", "element tristrips")
    assert read(text, "ply").triangles.tolist() == [[0, 1, 2]]
    text = text.replace("6 0 1 2 -1 0 1", "9 0 1 2 0 -1 -1 1 2 0")
    assert read(text, "ply").triangles.tolist() == [[0, 1, 2], [1, 0, 2], [1, 2, 0]]


def test_ply_promises_that_are_not_kept() -> None:
    text = ply("", "", "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    with pytest.raises(MeshFileError, match="the file ends after 4 of 999999999999999 `face`"):
        read(
            text.replace("face 1", "face 999999999999999").replace("3 0 1 2\n", "3 0 1 2\n" * 4),
            "ply",
        )
    for form in ("binary_little_endian", "binary_big_endian"):
        data = ply_bytes(CORNERS, FOUR, form).replace(b"face 4", b"face 999999999999999")
        with pytest.raises(MeshFileError, match="the file ends after 4 of 999999999999999 `face`"):
            read(data, "ply")
    with pytest.raises(MeshFileError, match="line 11: `0 0` is not a `vertex`"):
        read(text.replace("1 0 0\n", "0 0\n"), "ply")
    signed = ply_bytes(CORNERS, FOUR, "binary_little_endian").replace(b"list uchar", b"list char")
    with pytest.raises(MeshFileError, match="a list of -1 numbers in `face` 3"):
        read(signed[:-13] + b"\xff" + signed[-12:], "ply")


class Builder:
    """A GLB that is put together piece by piece."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "accessors": [],
            "bufferViews": [],
        }
        self.binary = b""

    def view(self, values: Any, kind: str, stride: int = 0) -> int:
        rows = np.atleast_2d(np.asarray(values, kind))
        if stride:
            rows = np.array([r.tobytes().ljust(stride, b"\x7f") for r in rows])
        self.binary += b"\0" * (-len(self.binary) % 4)
        described = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": rows.nbytes}
        self.document["bufferViews"].append(described | ({"byteStride": stride} if stride else {}))
        self.binary += rows.tobytes()
        return len(self.document["bufferViews"]) - 1

    def accessor(self, values: Any, kind: str = "<f4", stride: int = 0, **more: Any) -> int:
        rows = np.asarray(values, kind)
        code = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}[kind[-2:]]
        width = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
        self.document["accessors"].append(
            {
                "bufferView": self.view(rows.reshape(len(rows), -1), kind, stride),
                "componentType": code,
                "count": len(rows),
                "type": width[rows[0].size],
                **more,
            }
        )
        return len(self.document["accessors"]) - 1

    def read(self, primitive: Any, node: Any = None, **more: Any) -> Mesh:
        self.document |= {
            "meshes": [{"primitives": primitive if isinstance(primitive, list) else [primitive]}],
            "buffers": [{"byteLength": len(self.binary)}],
            "nodes": [{"mesh": 0, **(node or {})}],
            "scenes": [{"nodes": [0]}],
            **more,
        }
        return read(pack_glb(self.document, self.binary), "glb")


def with_tetrahedron(kind: str = "<f4", **more: Any) -> tuple[Builder, dict[str, Any]]:
    build = Builder()
    position = build.accessor(CORNERS, kind, **more)
    return build, {
        "attributes": {"POSITION": position},
        "indices": build.accessor(np.ravel(FOUR), "<u1"),
    }


def test_glb_rows_of_pictures_count_from_the_top() -> None:
    build, primitive = with_tetrahedron()
    primitive["attributes"]["TEXCOORD_0"] = build.accessor([(0.25, 0.0), (1, 0), (0, 1), (0, 0.25)])
    mesh = build.read(primitive)
    assert mesh.corner_uv is not None
    at = {int(c): uv for c, uv in zip(mesh.corners, mesh.corner_uv.tolist(), strict=True)}
    assert at == {0: [0.25, 1.0], 1: [1.0, 1.0], 2: [0.0, 0.0], 3: [0.0, 0.75]}


def test_glb_textures_of_the_second_set_and_moved() -> None:
    build, primitive = with_tetrahedron()
    sets = [(0.5, 0.5)] * 4, [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
    for k, uv in enumerate(sets):
        primitive["attributes"][f"TEXCOORD_{k}"] = build.accessor(uv)
    primitive["material"] = 0
    # The example of the extension: the lower left quarter, turned.
    change = {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5], "texCoord": 1}
    texture = {"index": 0, "extensions": {"KHR_texture_transform": change}}
    mesh = build.read(
        primitive, materials=[{"pbrMetallicRoughness": {"baseColorTexture": texture}}]
    )
    assert mesh.corner_uv is not None
    at = dict(zip(mesh.corners.tolist(), mesh.corner_uv.tolist(), strict=True))
    assert np.allclose([at[k] for k in range(4)], [(0, 0), (0, 0.5), (0.5, 0), (0.5, 0.5)])


@pytest.mark.parametrize("stride", [0, 8, 20])
@pytest.mark.parametrize("kind", ["<i1", "<u1", "<i2", "<u2"])
def test_glb_quantized_and_strided(kind: str, stride: int) -> None:
    build, primitive = with_tetrahedron(kind, stride=stride, normalized=False)
    assert build.read(primitive).vertices.tolist() == [list(c) for c in CORNERS]
    top = np.iinfo(kind).max
    build = Builder()
    position = build.accessor(np.array(CORNERS) * top, kind, stride=stride, normalized=True)
    primitive["indices"] = build.accessor(np.ravel(FOUR), "<u2")
    mesh = build.read(primitive | {"attributes": {"POSITION": position}}, {"scale": [1, 1, -1]})
    assert mesh.vertices.tolist() == (np.array(CORNERS) * (1, 1, -1)).tolist()
    model = MeshModel(mesh)
    a, b, c = (mesh.vertices[model.triangles[:, k]] for k in range(3))
    assert model.closed and np.einsum("ij,ij->", a, np.cross(b, c)) == pytest.approx(1.0)


def test_glb_strips_fans_lists_points_and_lines() -> None:
    build, primitive = with_tetrahedron()
    for mode, indices, right in (
        (4, [0, 1, 2, 3], [[0, 1, 2]]),
        (5, [0, 1, 2, 3], [[0, 1, 2], [1, 3, 2]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
    ):
        points = [{"attributes": primitive["attributes"], "mode": m} for m in range(4)]
        shape = primitive | {"mode": mode, "indices": build.accessor(indices, "<u4")}
        mesh = build.read([*points, shape])
        corners = np.array(CORNERS)
        assert mesh.vertices[mesh.triangles].tolist() == corners[right].tolist()
        assert mesh.notes == ("left out: points and lines (4, the first: mesh 0, primitive 0)",)


def test_glb_morph_targets_count_by_their_weights() -> None:
    build, primitive = with_tetrahedron()
    primitive["targets"] = [{"POSITION": build.accessor([(0, 0, 0)] * 3 + [(0, 0, 4)])}]
    assert build.read(primitive).vertices[:, 2].max() == 1.0
    assert build.read(primitive, {"weights": [0.5]}).vertices[:, 2].max() == 3.0


def test_glb_instances() -> None:
    build, primitive = with_tetrahedron()
    half = 0.5**0.5
    columns = {
        "TRANSLATION": build.accessor([(0, 0, 0), (5, 0, 0)]),
        "ROTATION": build.accessor([(0, 0, 0, 1), (0, 0, half, half)]),
        "SCALE": build.accessor([(1, 1, 1), (2, 2, 2)]),
    }
    node = {
        "extensions": {"EXT_mesh_gpu_instancing": {"attributes": columns}},
        "translation": [0, 0, 1],
    }
    mesh = build.read(primitive, node)
    second = [(5, 0, 1), (5, 2, 1), (3, 0, 1), (5, 0, 3)]
    assert np.allclose(
        mesh.vertices, np.concatenate([np.add(CORNERS, (0, 0, 1)), second]), atol=1e-6
    )
    accessor = build.document["accessors"][columns["TRANSLATION"]]
    del accessor["bufferView"]
    accessor["count"] = 300_000
    many = {"TRANSLATION": columns["TRANSLATION"]}
    node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": many}}
    with pytest.raises(MeshFileError, match="the nodes place more than"):
        build.read(primitive, node)


def test_glb_skins_stand_as_their_joints_do() -> None:
    build, primitive = with_tetrahedron()
    primitive["attributes"] |= {
        "JOINTS_0": build.accessor([(0, 0, 0, 0), (1, 0, 0, 0), (1, 0, 0, 0), (0, 1, 0, 0)], "<u1"),
        "WEIGHTS_0": build.accessor([(1, 0, 0, 0)] * 3 + [(0.5, 0.5, 0, 0)]),
    }
    away = np.eye(4)
    away[3, :3] = (0, 0, -1)
    skin = {"joints": [1, 2], "inverseBindMatrices": build.accessor([np.eye(4), away])}
    nodes = [
        # Where the node itself stands does not matter.
        {"mesh": 0, "skin": 0, "translation": [100, 0, 0]},
        {"translation": [0, 0, 10]},
        {"translation": [0, 0, 1], "scale": [2, 2, 2]},
    ]
    mesh = build.read(primitive, nodes=nodes, skins=[skin], scenes=[{"nodes": [0, 1, 2]}])
    assert np.allclose(mesh.vertices, [(0, 0, 10), (2, 0, -1), (0, 2, -1), (0, 0, 6)])


def test_glb_hidden_nodes_are_not_seen() -> None:
    build, primitive = with_tetrahedron()
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    with pytest.raises(MeshFileError, match="no triangles in its scene"):
        build.read(primitive, hidden)


def test_glb_accessors_without_data_are_zero() -> None:
    build, primitive = with_tetrahedron()
    accessor = build.document["accessors"][0]
    del accessor["bufferView"]
    three = {
        "count": 3,
        "indices": {"bufferView": build.view([1, 2, 3], "<u1"), "componentType": 5121},
    }
    accessor["sparse"] = three | {"values": {"bufferView": build.view(CORNERS[1:], "<f4")}}
    assert build.read(primitive).vertices.tolist() == [list(c) for c in CORNERS]
    accessor["count"] = 10**12
    with pytest.raises(MeshFileError, match="1000000000000 values without data"):
        build.read(primitive)


def test_glb_buffers_as_data_in_the_text_and_elsewhere() -> None:
    build, primitive = with_tetrahedron()
    uri = "data:application/gltf-buffer;base64," + base64.b64encode(build.binary).decode()
    assert build.read(
        primitive, buffers=[{"byteLength": len(build.binary), "uri": uri}]
    ).polygon_count
    for outside in ("../../etc/passwd", "file:///etc/passwd", "https://example.org/a.bin"):
        with pytest.raises(MeshFileError, match="its data lie in another file"):
            build.read(primitive, buffers=[{"byteLength": 60, "uri": outside}])
    with pytest.raises(MeshFileError, match="its data are damaged"):
        build.read(primitive, buffers=[{"byteLength": 60, "uri": "data:;base64,A"}])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"extensionsRequired": ["EXT_meshopt_compression"]}, "needs the extension EXT_meshopt"),
        ({"extensionsRequired": ["ACME_shape"]}, "needs the extension ACME_shape"),
        ({"nodes": [{"mesh": -1}]}, "there is no -1 in `meshes`"),
        ({"nodes": [{"mesh": True}]}, "`True` is not a number of `meshes`"),
        ({"nodes": [{"mesh": 0, "scale": [1, 1]}]}, "`scale` needs 3 numbers"),
        ({"nodes": [{"mesh": 0, "scale": [1, 1, 10**400]}]}, "`scale` needs finite numbers"),
        ({"nodes": [{"mesh": 0, "scale": [1e50, 1e50, 1e50], "children": [0]}]}, "stands twice"),
        ({"nodes": [{"mesh": 0, "scale": [1e80, 1, 1]}]}, "a vertex needs finite numbers"),
        ({"nodes": {"0": {"mesh": 0}}}, "`nodes` is not a list"),
        ({"nodes": [7]}, "0 in `nodes` is not an object"),
        ({"scene": 10**30}, "`scene` is not a number"),
    ],
)
def test_glb_documents_that_are_none(change: Any, told: str) -> None:
    build, primitive = with_tetrahedron()
    with pytest.raises(MeshFileError, match=told):
        build.read(primitive, **change)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"count": 10**15}, "needs bytes 0 to"),
        ({"byteOffset": 2**50}, "needs bytes"),
        ({"byteOffset": -4}, "`byteOffset` is not a number from 0"),
        ({"componentType": 5130}, "unknown `componentType`"),
        ({"type": "VEC2"}, "the type `VEC2` does not fit"),
        ({"type": ["VEC3"]}, "does not fit here"),
        ({"bufferView": 99}, "there is no 99 in `bufferViews`"),
    ],
)
def test_glb_accessors_that_reach_beyond(change: Any, told: str) -> None:
    build, primitive = with_tetrahedron()
    build.document["accessors"][0] |= change
    with pytest.raises(MeshFileError, match=told):
        build.read(primitive)


def test_glb_accessors_that_overlap_again_and_again_are_refused() -> None:
    build = Builder()
    position = build.accessor(np.zeros((100_000, 3)))
    accessors = build.document["accessors"]
    accessors += [dict(accessors[position]) for _ in range(60)]
    indices = build.accessor([0, 1, 2], "<u1")
    primitives = [{"attributes": {"POSITION": k}, "indices": indices} for k in range(61)]
    with pytest.raises(MeshFileError, match="accessors overlap"):
        build.read(primitives)
    # One that many share is read once.
    shared = {"attributes": {"POSITION": position}, "indices": indices}
    assert build.read([shared] * 500).polygon_count == 0


def test_glb_skins_with_joints_that_are_none() -> None:
    build, primitive = with_tetrahedron()
    primitive["attributes"] |= {
        "JOINTS_0": build.accessor([(0, 0, 0, 0)] * 4, "<u1"),
        "WEIGHTS_0": build.accessor([(1, 0, 0, 0)] * 4),
    }
    for joints, told in (
        ([[]], "is not a number of `nodes`"),
        ([7], "there is no 7 in `nodes`"),
        ([], "a vertex hangs on a joint"),
    ):
        with pytest.raises(MeshFileError, match=told):
            build.read(primitive, {"skin": 0}, skins=[{"joints": joints}])


def test_glb_chains_of_nodes_may_be_long(tmp_path: Path) -> None:
    nodes: list[dict[str, Any]] = [{"children": [k + 1]} for k in range(5000)]
    data = glb_bytes(CORNERS, FOUR, [*nodes, {"mesh": 0}])
    (tmp_path / "long.glb").write_bytes(data)
    assert is_tetrahedron(data, "glb")


def test_a_glb_has_a_bounded_number_of_primitives(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pcsg.meshfile.glb.MOST_PRIMITIVES", 3)
    data = glb_bytes(CORNERS, FOUR)
    size = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    document["meshes"][0]["primitives"] *= 3
    assert len(read(pack_glb(document, binary), "glb").triangles) == 12
    document["meshes"][0]["primitives"] *= 2
    with pytest.raises(MeshFileError, match="more than 3 primitives; join them"):
        read(pack_glb(document, binary), "glb")
