"""Skeletons and quad meshes as files.

| ending | holds |
| --- | --- |
| `.json` | a skeleton: nodes [x, y, z, r], edges, root, tags |
| `.swc` | a skeleton that is a tree: id, type, x, y, z, r, parent |
| `.obj`, `.ply` | quads as they are, with normals, (u, v) and labels |
| `.glb` | cut into triangles, since glTF knows no quads; y up, as glTF wants it |
| `.usda`, `.usd` | quads with the Catmull-Clark scheme, as text, z up |
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pcsg.errors import UsageError
from pcsg.meshfile.container import Buffers, write_container
from pcsg.outputs import check_output, write_whole
from pcsg.skeletonfile import (
    SKELETON_ENDINGS,
    SkeletonRows,
    load_rows,
    rows_from_json,
    rows_from_swc,
)
from pcsg.treemesh.skeleton import Floats, Ints, Skeleton

if TYPE_CHECKING:
    from pcsg.treemesh.surface import QuadMesh


class Shape(NamedTuple):
    """What mesh writers write.

    Attributes
    ----------
    verts : float64 (v, 3)
    faces : int64 (f, 4)
    normals : float64 (v, 3)
    uv : float64 (f, 4, 2)
    labels : int64 (f,)
    triangles : int64 (2 f, 3)
        Two for each face, in order.
    """

    verts: Floats
    faces: Ints
    normals: Floats
    uv: Floats
    labels: Ints
    triangles: Ints


# -- skeletons -----------------------------------------------------------------------------------


def skeleton_to_json(skel: Skeleton) -> dict[str, Any]:
    """Return a skeleton as an object that JSON can carry."""
    nodes = np.column_stack([skel.pos, skel.radius])
    found = {"nodes": nodes.tolist(), "edges": skel.edges.tolist(), "root": skel.root}
    if skel.tags:
        found["tags"] = {name: t.tolist() for name, t in skel.tags.items()}
    return found


def skeleton_from_json(data: Any, name: str = "skeleton") -> Skeleton:
    """Return the skeleton of a JSON object.

    Raises
    ------
    UsageError
        Names what is missing or wrong.
    """
    return _checked(rows_from_json(data, name), name)


def skeleton_to_swc(skel: Skeleton) -> str:
    """Return a tree in the SWC format; parents come before their children.

    Raises
    ------
    UsageError
        The skeleton has loops.
    """
    if skel.loops:
        raise UsageError("SWC files hold trees only, and the skeleton has a loop; write .json")
    parent, up, order = skel.parents
    number = np.empty(skel.n_nodes, dtype=np.int64)
    number[order] = np.arange(1, skel.n_nodes + 1)
    label = skel.tags.get("label")
    lines = ["# pcsg skeleton: id type x y z radius parent"]
    for a in order.tolist():
        kind = 0 if label is None or up[a] < 0 else max(0, int(label[up[a]]))
        x, y, z = (repr(c) for c in skel.pos[a].tolist())
        above = -1 if parent[a] < 0 else int(number[parent[a]])
        lines.append(f"{number[a]} {kind} {x} {y} {z} {skel.radius[a].item()!r} {above}")
    return "\n".join(lines) + "\n"


def skeleton_from_swc(text: str, name: str = "skeleton") -> Skeleton:
    """Return the skeleton of an SWC file.

    Raises
    ------
    UsageError
        With the line that is wrong.
    """
    return _checked(rows_from_swc(text, name), name)


def _checked(rows: SkeletonRows, name: str) -> Skeleton:
    try:
        return Skeleton.make(rows.pos, rows.radius, rows.edges, rows.root, tags=rows.tags)
    except UsageError as error:
        raise UsageError(f"{name}: {error}") from None


def load_skeleton(path: str | Path) -> Skeleton:
    """Read a skeleton, .json or .swc.

    Raises
    ------
    UsageError
        The file is not there or not a skeleton.
    """
    return _checked(load_rows(Path(path)), str(path))


def save_skeleton(skel: Skeleton, path: str | Path) -> Path:
    """Write a skeleton, .json or .swc."""
    path = Path(path)
    check_output(path, SKELETON_ENDINGS)
    if path.suffix.lower() == ".swc":
        text = skeleton_to_swc(skel)
    else:
        text = json.dumps(skeleton_to_json(skel)) + "\n"
    write_whole(path, lambda file: file.write(text.encode()))
    return path


# -- meshes --------------------------------------------------------------------------------------


def save_surface(surf: QuadMesh, path: str | Path) -> Path:
    """Write a surface with its offsets; the ending names the format.

    Raises
    ------
    UsageError
        The ending is unknown, or the folder does not exist.
    EnvironmentFault
        The system refuses.
    """
    path = Path(path)
    check_output(path, tuple(WRITERS))
    shape = Shape(surf.positions, surf.quads, surf.normals, surf.uv, surf.labels, surf.triangles)
    write = WRITERS[path.suffix.lower()]
    write_whole(path, lambda file: write(shape, file))
    return path


def _rows(form: str, values: Any) -> str:
    """Return one line for each row of numbers."""
    return "".join(form % tuple(row) for row in values.tolist())


def _distinct_uv(uv: Floats) -> tuple[Floats, Ints]:
    """Return distinct texture coordinates, and which one every corner has."""
    flat = np.round(uv.reshape(-1, 2), 6)
    found, number = np.unique(flat, axis=0, return_inverse=True)
    return found, number.reshape(uv.shape[:2])


def write_obj(shape: Shape, file: IO[bytes]) -> None:
    """Write faces with four corners; labels are groups."""
    uv, number = _distinct_uv(shape.uv)
    file.write(b"# pcsg tree mesh: quads\n")
    file.write(_rows("v %.9g %.9g %.9g\n", shape.verts).encode())
    file.write(_rows("vt %.6f %.6f\n", uv).encode())
    file.write(_rows("vn %.5f %.5f %.5f\n", shape.normals).encode())
    corner = np.stack([shape.faces, number, shape.faces], axis=2).reshape(-1, 12) + 1
    form = "f" + " %d/%d/%d" * 4 + "\n"
    for label in np.unique(shape.labels).tolist():
        if label >= 0:
            file.write(f"g label_{label}\n".encode())
        file.write(_rows(form, corner[shape.labels == label]).encode())


def write_ply(shape: Shape, file: IO[bytes]) -> None:
    """Write binary little-endian PLY: double places, float normals, quads with labels."""
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment pcsg tree mesh: quads",
        f"element vertex {len(shape.verts)}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property float n{axis}" for axis in "xyz"),
        f"element face {len(shape.faces)}",
        "property list uchar int vertex_indices",
        "property int label",
        "property list uchar float texcoord",
        "end_header",
    ]
    file.write(("\n".join(header) + "\n").encode())
    vertex = np.empty(len(shape.verts), dtype=[("p", "<f8", 3), ("n", "<f4", 3)])
    vertex["p"], vertex["n"] = shape.verts, shape.normals
    face = np.empty(
        len(shape.faces),
        dtype=[("n", "u1"), ("v", "<i4", 4), ("label", "<i4"), ("m", "u1"), ("t", "<f4", 8)],
    )
    face["n"], face["v"], face["label"] = 4, shape.faces, shape.labels
    face["m"], face["t"] = 8, shape.uv.reshape(-1, 8)
    file.write(vertex.tobytes())
    file.write(face.tobytes())


def write_glb(shape: Shape, file: IO[bytes]) -> None:
    """Write glTF 2.0 binary: triangles, y up."""
    uv, number = _distinct_uv(shape.uv)
    # A vertex with two texture coordinates is two vertices there.
    pair = np.stack([shape.faces.ravel(), number.ravel()], axis=1)
    corner, which = np.unique(pair, axis=0, return_inverse=True)
    which = which.reshape(shape.faces.shape)
    rank = shape.faces[np.arange(len(shape.triangles)) // 2][:, None] == shape.triangles[:, :, None]
    slot = rank.argmax(axis=2)
    index = which[np.arange(len(shape.triangles))[:, None] // 2, slot].astype("<u4")
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    place = (shape.verts @ turn)[corner[:, 0]].astype("<f4")
    normal = (shape.normals @ turn)[corner[:, 0]].astype("<f4")
    texture = uv[corner[:, 1]].astype("<f4")
    texture[:, 1] = 1.0 - texture[:, 1]
    buffers = Buffers()
    attributes = {
        "POSITION": buffers.add(place, "VEC3", bounds=True),
        "NORMAL": buffers.add(normal, "VEC3"),
        "TEXCOORD_0": buffers.add(texture, "VEC2"),
    }
    indices = buffers.add(index.reshape(-1), "SCALAR", indices=True)
    document = {
        "asset": {"version": "2.0", "generator": "pcsg"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "tree"}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
    }
    write_container(file, document, buffers)


def write_usda(shape: Shape, file: IO[bytes]) -> None:
    """Write USD as text: quads that a renderer subdivides by Catmull-Clark, z up."""

    def tuples(values: Any, form: str) -> str:
        return "[" + ", ".join(form % tuple(row) for row in values.tolist()) + "]"

    def numbers(values: Any) -> str:
        return "[" + ", ".join(map(str, values.ravel().tolist())) + "]"

    low, high = shape.verts.min(axis=0), shape.verts.max(axis=0)
    uv = shape.uv.reshape(-1, 2)
    file.write(
        "\n".join(
            [
                "#usda 1.0",
                '(\n    defaultPrim = "tree"\n    upAxis = "Z"\n    metersPerUnit = 1\n)',
                'def Mesh "tree"\n{',
                '    uniform token subdivisionScheme = "catmullClark"',
                f"    float3[] extent = {tuples(np.stack([low, high]), '(%.9g, %.9g, %.9g)')}",
                f"    point3f[] points = {tuples(shape.verts, '(%.9g, %.9g, %.9g)')}",
                f"    int[] faceVertexCounts = {numbers(np.full(len(shape.faces), 4))}",
                f"    int[] faceVertexIndices = {numbers(shape.faces)}",
                f"    texCoord2f[] primvars:st = {tuples(uv, '(%.6f, %.6f)')} (",
                '        interpolation = "faceVarying"\n    )',
                f"    int[] primvars:label = {numbers(shape.labels)} (",
                '        interpolation = "uniform"\n    )',
                "}\n",
            ]
        ).encode()
    )


WRITERS: dict[str, Callable[[Shape, IO[bytes]], None]] = {
    ".obj": write_obj,
    ".ply": write_ply,
    ".glb": write_glb,
    ".usda": write_usda,
    ".usd": write_usda,
}
"""Writers by the end of the file's name."""


def report_text(report: dict[str, Any]) -> str:
    """Return a report as JSON; numbers that are not finite become null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: plain(v) for k, v in value.items()}
        if isinstance(value, list | tuple):
            return [plain(v) for v in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return json.dumps(plain(report), indent=2, allow_nan=False) + "\n"
