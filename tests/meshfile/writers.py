"""Files for the reader, written independently of it."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

Polygons = Sequence[Sequence[int]]


def obj_text(vertices: ArrayLike, polygons: Polygons) -> str:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, float).tolist()]
    lines += ["f " + " ".join(str(v + 1) for v in p) for p in polygons]
    return "\n".join(lines) + "\n"


def ply_bytes(vertices: ArrayLike, polygons: Polygons, form: str, junk: bool = False) -> bytes:
    points = np.asarray(vertices, float)
    head = [
        "ply",
        f"format {form} 1.0",
        "comment made by a test",
        f"element vertex {len(points)}",
        "property double x",
        "property double y",
        "property double z",
        *(["property uchar red", "element edge 2", "property int vertex1"] if junk else []),
        f"element face {len(polygons)}",
        *(["property short flags"] if junk else []),
        "property list uchar int vertex_indices",
        "end_header",
    ]
    data = ("\n".join(head) + "\n").encode()
    if form == "ascii":
        red, flags = (" 7", "-3 ") if junk else ("", "")
        body = [f"{x!r} {y!r} {z!r}{red}" for x, y, z in points.tolist()]
        body += ["5", "6"] if junk else []
        body += [f"{flags}{len(p)} " + " ".join(map(str, p)) for p in polygons]
        return data + ("\n".join(body) + "\n").encode()
    order = "<" if "little" in form else ">"
    for p in points.tolist():
        data += struct.pack(order + "ddd", *p) + (b"\x07" if junk else b"")
    data += struct.pack(order + "ii", 5, 6) if junk else b""
    for polygon in polygons:
        data += struct.pack(order + "h", -3) if junk else b""
        data += struct.pack(f"{order}B{len(polygon)}i", len(polygon), *polygon)
    return data


def stl_bytes(triangles: ArrayLike, text: bool = False) -> bytes:
    corners = np.asarray(triangles, np.float32).reshape(-1, 3, 3)
    if text:
        lines = ["solid rock"]
        for t in corners.tolist():
            lines += ["facet normal 0 0 0", "  outer loop"]
            lines += [f"    vertex {x!r} {y!r} {z!r}" for x, y, z in t]
            lines += ["  endloop", "endfacet"]
        return ("\n".join([*lines, "endsolid rock"]) + "\n").encode()
    data = b"solid, though binary".ljust(80) + struct.pack("<I", len(corners))
    for t in corners:
        data += struct.pack("<12fH", 0, 0, 0, *t.ravel().tolist(), 0)
    return data


def glb_bytes(
    vertices: ArrayLike, triangles: ArrayLike, nodes: Sequence[dict[str, Any]] = ({"mesh": 0},)
) -> bytes:
    """Return a scene of one mesh; the first node is its root."""
    points = np.asarray(vertices, "<f4").tobytes()
    indices = np.asarray(triangles, "<u2").tobytes()
    binary = points + indices
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": list(nodes),
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points) // 12, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": len(indices) // 2, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(indices)},
        ],
        "buffers": [{"byteLength": len(binary)}],
    }
    return pack_glb(document, binary)


def pack_glb(document: Any, binary: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
