"""OBJ and PLY: everything flattened to triangles in the world."""

from __future__ import annotations

from pathlib import Path
from typing import IO, Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.export.looks import Material
from pcsg.export.prototypes import Assembly
from pcsg.export.shapes import Floats, Ints
from pcsg.outputs import write_whole

MOST_TRIANGLES = 20_000_000
"""Triangles of a file: gigabytes."""

_AT_ONCE = 10_000
"""Copies of a shape that are made at once."""

_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""The turn from z up to y up."""


def check_triangles(assembly: Assembly, places: dict[int, Floats]) -> None:
    """Raise an error if a scene has too many triangles to be flattened.

    Raises
    ------
    UsageError
        It has.
    """
    count = sum(
        len(assembly.shapes[assembly.parts[part][0]].triangles) * len(maps)
        for part, maps in places.items()
    )
    if count > MOST_TRIANGLES:
        raise UsageError(
            f"{count:,} triangles are too many for a file without instances (at most"
            f" {MOST_TRIANGLES:,}); write .usdc or a .glb with --instances, or fewer --segments"
        )


def write_obj(path: Path, assembly: Assembly, up: str) -> None:
    """Write a scene as .obj, and its materials beside it as .mtl."""
    places = assembly.flattened()
    check_triangles(assembly, places)
    library = path.with_suffix(".mtl")
    text = "".join(map(_material, assembly.materials))
    write_whole(library, lambda file: file.write(text.encode()))

    def write(file: IO[bytes]) -> None:
        file.write(f"# pcsg, {up} up\nmtllib {library.name}\n".encode())
        begin = 1
        for part, maps in places.items():
            shape, material, label = assembly.parts[part]
            about = assembly.shapes[shape]
            words = f"o {about.name}_{part}\n"
            words += f"g label_{label}\n" if label >= 0 else ""
            file.write(f"{words}usemtl {assembly.materials[material].name}\n".encode())
            for some in _pieces(maps):
                points, normals, faces = _flattened(assembly, shape, some, up)
                uv = np.tile(about.uv, (len(some), 1))
                np.savetxt(file, points, "v %.9g %.9g %.9g")
                np.savetxt(file, uv, "vt %.6f %.6f")
                np.savetxt(file, normals, "vn %.5f %.5f %.5f")
                corners = np.repeat(faces + begin, 3, axis=1)
                np.savetxt(file, corners, "f %d/%d/%d %d/%d/%d %d/%d/%d")
                begin += len(points)

    write_whole(path, write)


def write_ply(path: Path, assembly: Assembly, up: str) -> None:
    """Write a scene as binary .ply: vertices with normals, (u, v) and colours, labels of faces."""
    places = assembly.flattened()
    check_triangles(assembly, places)
    sizes = {
        part: (len(shape.vertices), len(shape.triangles))
        for part in places
        for shape in [assembly.shapes[assembly.parts[part][0]]]
    }
    vertex = np.dtype([("p", "<f4", 3), ("n", "<f4", 3), ("t", "<f4", 2), ("c", "u1", 3)])
    face = np.dtype([("n", "u1"), ("v", "<i4", 3), ("label", "<i4")])
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment pcsg, {up} up",
        f"element vertex {sum(sizes[k][0] * len(maps) for k, maps in places.items())}",
        *(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz", "s", "t")),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        f"element face {sum(sizes[k][1] * len(maps) for k, maps in places.items())}",
        "property list uchar int vertex_indices",
        "property int label",
        "end_header",
    ]

    def write(file: IO[bytes]) -> None:
        file.write(("\n".join(header) + "\n").encode())
        for part, maps in places.items():
            shape, material, _ = assembly.parts[part]
            for some in _pieces(maps):
                points, normals, _ = _flattened(assembly, shape, some, up)
                rows = np.empty(len(points), vertex)
                rows["p"], rows["n"] = points, normals
                rows["t"] = np.tile(assembly.shapes[shape].uv, (len(some), 1))
                rows["c"] = np.rint(255.0 * encode_srgb(assembly.materials[material].color))
                file.write(rows.tobytes())
        begin = 0
        for part, maps in places.items():
            shape, _, label = assembly.parts[part]
            for some in _pieces(maps):
                points, _, faces = _flattened(assembly, shape, some, up)
                corners = np.empty(len(faces), face)
                corners["n"], corners["v"], corners["label"] = 3, faces + begin, label
                file.write(corners.tobytes())
                begin += len(points)

    write_whole(path, write)


def encode_srgb(color: tuple[float, float, float]) -> Floats:
    """Return a linear colour as pictures have it, from 0 to 1."""
    from pcsg.render.view import encode_srgb as encode

    return np.asarray(encode(np.clip(np.array(color), 0.0, 1.0)))


def _pieces(maps: Floats) -> list[Floats]:
    return [maps[k : k + _AT_ONCE] for k in range(0, len(maps), _AT_ONCE)]


def _flattened(
    assembly: Assembly, shape: int, maps: Floats, up: str
) -> tuple[Floats, Floats, Ints]:
    """Return vertices, normals and triangles of copies of a shape."""
    about = assembly.shapes[shape]
    linear, shift = maps[:, :, :3], maps[:, :, 3]
    points = np.einsum("nij,vj->nvi", linear, about.vertices) + shift[:, None]
    # Normals are mapped by the transposed inverse, whose sign a mirror does not change.
    normals = np.einsum("nji,vj->nvi", np.linalg.inv(linear), about.normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300)
    faces = np.tile(about.triangles, (len(maps), 1, 1))
    mirrored = np.linalg.det(linear) < 0.0
    faces[mirrored] = faces[mirrored][:, :, ::-1]
    faces += (len(about.vertices) * np.arange(len(maps)))[:, None, None]
    points, normals = points.reshape(-1, 3), normals.reshape(-1, 3)
    if up == "y":
        points, normals = points @ _UP.T, normals @ _UP.T
    return points, normals, faces.reshape(-1, 3)


def _material(material: Material) -> str:
    numbers: list[tuple[str, Any]] = [
        ("Kd", material.color),
        ("Ke", material.emission),
        ("Pr", (material.roughness,)),
        ("Pm", (material.metallic,)),
        ("Ni", (material.ior,)),
        ("d", (1.0 - material.transmission,)),
    ]
    lines = [f"{key} {' '.join(f'{x:.6g}' for x in values)}\n" for key, values in numbers]
    return f"newmtl {material.name}\n{''.join(lines)}\n"
