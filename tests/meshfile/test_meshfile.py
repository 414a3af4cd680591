"""The reader of mesh files, against files that the tests write themselves."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from writers import glb_bytes, obj_text, pack_glb, ply_bytes, stl_bytes

from pcsg.errors import UsageError
from pcsg.meshfile import Mesh, MeshFileError, read_mesh
from pcsg.meshfile.polygons import triangulate
from pcsg.meshfile.read import READERS

CUBE = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
PYRAMID = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (1, 1, 3)]
MIXED = [(3, 2, 1, 0), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
TETRAHEDRON = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]


def read(data: bytes | str, end: str, tmp_path: Path) -> Mesh:
    path = tmp_path / f"file.{end}"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return read_mesh(path)


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def polygons(mesh: Mesh) -> list[tuple[int, ...]]:
    return [
        tuple(mesh.corners[a:b].tolist())
        for a, b in zip(mesh.offsets[:-1], mesh.offsets[1:], strict=True)
    ]


@pytest.mark.parametrize("junk", [False, True])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(("points", "faces"), [(CUBE, FACES), (PYRAMID, MIXED)])
def test_ply(form: str, junk: bool, points, faces, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    mesh = read(ply_bytes(points, faces, form, junk), "ply", tmp_path)
    assert mesh.vertices.tolist() == np.array(points, float).tolist()
    assert polygons(mesh) == faces
    assert len(mesh.triangles) == sum(len(f) - 2 for f in faces)
    assert volume(mesh) == pytest.approx(8.0 if points is CUBE else 4.0)


def test_obj_polygons_negative_indices_and_continued_lines(tmp_path: Path) -> None:
    text = obj_text(PYRAMID, MIXED[:3]) + "f -3 -2 \\\n  -1 # back\ng top\nusemtl x\nf 4//  1 5\n"
    mesh = read(text.replace("4//", "4"), "obj", tmp_path)
    assert polygons(mesh) == MIXED
    assert mesh.corner_uv is None and mesh.corner_normals is None


def test_obj_coordinates_and_normals(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt .25 .5\nvt 1 0 9\nvn 0 0 2\n"
    mesh = read(text + "f 1/1/1 2/-1/1 3//1\nf 3 2 1\n", "obj", tmp_path)
    assert mesh.corner_uv is not None and mesh.corner_normals is not None
    assert mesh.corner_uv[:2].tolist() == [[0.25, 0.5], [1.0, 0.0]]
    assert np.isnan(mesh.corner_uv[2:]).all()
    assert mesh.corner_normals[:3].tolist() == [[0.0, 0.0, 2.0]] * 3
    assert np.isnan(mesh.corner_normals[3:]).all()


def test_colors_of_vertices_become_linear(tmp_path: Path) -> None:
    mesh = read("v 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0 0 0 0.04\nf 1 2 3\n", "obj", tmp_path)
    assert mesh.corner_colors is not None
    assert np.allclose(mesh.corner_colors[0], [1.0, ((0.5 + 0.055) / 1.055) ** 2.4, 0.0])
    assert np.isnan(mesh.corner_colors[1]).all()
    assert np.allclose(mesh.corner_colors[2], [0.0, 0.0, 0.04 / 12.92])
    text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    text += "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    text += "element face 1\nproperty list uchar int vertex_index\nend_header\n"
    mesh = read(text + "0 0 0 255 0 51\n1 0 0 0 0 0\n0 1 0 0 0 0\n3 0 1 2\n", "ply", tmp_path)
    assert mesh.corner_colors is not None
    assert np.allclose(mesh.corner_colors[0], [1.0, 0.0, ((0.2 + 0.055) / 1.055) ** 2.4])


@pytest.mark.parametrize("text", [False, True])
def test_stl_merges_vertices(text: bool, tmp_path: Path) -> None:
    corners = np.array([[CUBE[v] for v in (f[0], f[k], f[k + 1])] for f in FACES for k in (1, 2)])
    mesh = read(stl_bytes(corners, text), "stl", tmp_path)
    assert len(mesh.vertices) == 8
    assert volume(mesh) == pytest.approx(8.0)
    assert (mesh.vertices[mesh.triangles] == corners).all()


def test_signs_of_zero_are_one_vertex(tmp_path: Path) -> None:
    mesh = read(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv -0.0 0 0\nv 0 0 1\nf 1 2 3\nf 4 3 5\n", "obj", tmp_path
    )
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize("mirrored", [False, True])
def test_glb_applies_the_transformations_of_nodes(mirrored: bool, tmp_path: Path) -> None:
    half = math.sqrt(0.5)
    scale = [2.0, 2.0, -2.0] if mirrored else [2.0, 2.0, 2.0]
    nodes = [
        {"children": [1], "translation": [10.0, 0.0, 0.0], "rotation": [0.0, 0.0, half, half]},
        {"mesh": 0, "scale": scale},
    ]
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    mesh = read(glb_bytes(points, TETRAHEDRON, nodes), "glb", tmp_path)
    # A quarter turn about z takes x to y and y to -x.
    expected = [(10, 0, 0), (10, 2, 0), (8, 0, 0), (10, 0, -2 if mirrored else 2)]
    assert np.allclose(mesh.vertices, expected)
    assert volume(mesh) == pytest.approx(8.0 / 6.0)


def test_glb_matrix_by_columns(tmp_path: Path) -> None:
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    data = glb_bytes(points, TETRAHEDRON, [{"mesh": 0, "matrix": matrix}])
    assert read(data, "glb", tmp_path).vertices[0].tolist() == [5.0, 6.0, 7.0]


@given(
    st.integers(3, 9).flatmap(
        lambda n: st.tuples(
            st.lists(st.floats(0.2, 1.0), min_size=n, max_size=n),
            st.integers(0, n - 1),
            st.tuples(*(st.floats(-1.0, 1.0) for _ in range(3))),
        )
    )
)
def test_ears_cover_star_shaped_polygons(drawn) -> None:  # type: ignore[no-untyped-def]
    radii, first, axis = drawn
    n = len(radii)
    angles = 2.0 * np.pi * np.arange(n) / n
    flat = np.stack([radii * np.cos(angles), radii * np.sin(angles), np.zeros(n)], axis=1)
    flat = np.roll(flat, first, axis=0)
    # Turned somehow into space.
    q, _ = np.linalg.qr(np.eye(3) + 0.9 * np.outer(axis, (0.3, 0.5, 0.7)))
    q *= np.sign(np.linalg.det(q))
    points = flat @ q.T
    triangles, crossing = triangulate(points, np.arange(n), np.array([0, n]))
    assert crossing == 0
    assert len(triangles) == n - 2
    areas = (
        np.cross(
            points[triangles[:, 1]] - points[triangles[:, 0]],
            points[triangles[:, 2]] - points[triangles[:, 0]],
        )
        @ q[:, 2]
    )
    whole = np.cross(flat, np.roll(flat, -1, axis=0)).sum(axis=0)[2]
    assert areas.sum() == pytest.approx(whole)
    assert (areas > -1e-12).all()


def test_a_quadrilateral_is_cut_along_the_diagonal_inside(tmp_path: Path) -> None:
    arrow = [(0, 0, 0), (2, 1, 0), (0, 2, 0), (0.5, 1, 0)]
    for turn in range(4):
        points = arrow[turn:] + arrow[:turn]
        mesh = read(obj_text(points, [(0, 1, 2, 3)]), "obj", tmp_path)
        p = mesh.vertices[mesh.triangles]
        areas = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])[:, 2] / 2.0
        assert (areas > 0.0).all() and areas.sum() == pytest.approx(1.5)


GOOD = {
    "obj": obj_text(PYRAMID, MIXED).encode() + b"vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 5/1/1\n",
    "ply": ply_bytes(PYRAMID, MIXED, "binary_little_endian", True),
    "stl": stl_bytes(np.array([PYRAMID[:3]])),
    "glb": glb_bytes(CUBE, [f[:3] for f in FACES]),
}
TEXTS = {"ply": ply_bytes(PYRAMID, MIXED, "ascii", True), "stl": stl_bytes(PYRAMID[:3], True)}


@pytest.mark.parametrize(
    ("end", "data", "told"),
    [
        ("obj", b"v 0 0\n", "line 1: `v` needs 3 number(s), not 2"),
        ("obj", b"v 0 0 0\nv 1 x 0\n", "line 2: `1 x 0` are not numbers"),
        ("obj", b"v 0 0 0\nv 0 0 nan\nf 1 1 2\n", "line 2: a vertex needs finite numbers"),
        ("obj", b"v 0 0 1e31\nf 1 1 1\n", "line 1: a vertex needs finite numbers of at most 1e+30"),
        ("obj", b"v 0 0 0\n\nf 1 1 2\n", "line 3: there is no vertex 2: 1 are given"),
        ("obj", b"v 0 0 0\nf 1 1 0\n", "line 2: there is no vertex 0: 1 are given"),
        ("obj", b"v 0 0 0\nf 1 1 -2\nv 0 0 0\n", "line 2: there is no vertex -2: 2 are given"),
        ("obj", b"v 0 0 0\nf 1 1 9" + b"9" * 99, "line 2: there is no vertex 999999999999"),
        ("obj", b"v 0 0 0\nf 1 a 1\n", "line 2: `a` is not a corner"),
        ("obj", b"v 0 0 0\nf 1 1\n", "left out: faces of fewer than three corners (line 2)"),
        ("obj", b"v 0 0 0\nf\n", "line 2: a face needs at least 3 corners, not 0"),
        ("obj", b"v 0 0 0\n", "no polygons"),
        ("ply", b"plx\n", None),
        ("ply", b"", "line 1: a PLY file begins with `ply`"),
        ("ply", b"ply\nformat ascii 1.0\n", "the header has no `end_header`"),
        ("ply", b"ply\nformat ebcdic 1.0\nend_header\n", "line 2: unknown format `ebcdic`"),
        ("ply", GOOD["ply"][:-3], "the file ends after 4 of 5 `face`"),
        ("ply", TEXTS["ply"].replace(b"-3 3 3 0 4", b"-3 3 3 0 5"), "face 4: there is no vertex 5"),
        ("ply", TEXTS["ply"].replace(b"-3 3 3 0 4", b"-3 3 3 0"), "line 26: `-3 3 3 0` is not a"),
        ("stl", GOOD["stl"][:-1], "byte 133: the file ends; its 1 facets need 134 bytes"),
        ("stl", b"short", "a binary STL file has at least 84 bytes, this one has 5"),
        ("stl", b"solid\nouter loop\nvertex 1 2\n", "line 3: a vertex needs three finite numbers"),
        (
            "stl",
            b"solid\nouter loop\nvertex 1 2 3\nendloop",
            "line 4: a facet needs three vertices",
        ),
        ("glb", GOOD["glb"][:-4], "the file ends"),
        ("glb", b"GLTF", "byte 0: a GLB file begins with `glTF`"),
        ("glb", pack_glb({}, b""), "no triangles in its scene"),
        (
            "glb",
            pack_glb({"scenes": [{"nodes": [3]}]}, b""),
            "there is no 3 in `nodes`",
        ),
        (
            "glb",
            pack_glb({"extensionsRequired": ["KHR_draco_mesh_compression"]}, b""),
            "needs the extension KHR_draco_mesh_compression, which is not supported",
        ),
        (
            "glb",
            pack_glb(
                {"nodes": [{"children": [1]}, {"children": [0]}], "scenes": [{"nodes": [0]}]}, b""
            ),
            "node 0: a node stands twice",
        ),
    ],
)
def test_damaged_files(end: str, data: bytes, told: str | None, tmp_path: Path) -> None:
    with pytest.raises(MeshFileError) as caught:
        read(data, end, tmp_path)
    assert str(tmp_path / f"file.{end}") in str(caught.value)
    assert (told or "") in str(caught.value)


def test_missing_and_unknown_files(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no such file"):
        read_mesh(tmp_path / "nothing.obj")
    with pytest.raises(MeshFileError, match=r"ends in one of \.obj, \.ply, \.stl, \.glb"):
        read_mesh(tmp_path / "picture.png")
    for wrong in (tmp_path, tmp_path / "with\0nul"):
        with pytest.raises(UsageError):
            read_mesh(wrong.with_suffix(".obj"))


@given(
    st.sampled_from([*GOOD.items(), *TEXTS.items()]),
    st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=4),
    st.integers(0, 40),
)
def test_damage_never_ends_in_a_traceback(good, changes, cut) -> None:  # type: ignore[no-untyped-def]
    end, data = good
    damaged = bytearray(data)
    for at, value in changes:
        damaged[at % len(damaged)] = value
    del damaged[len(damaged) - cut :]
    try:
        mesh = READERS[f".{end}"]("damaged", bytes(damaged))
    except MeshFileError:
        return
    assert np.isfinite(mesh.vertices).all()
    assert mesh.triangles.size == 0 or mesh.triangles.max() < len(mesh.vertices)
