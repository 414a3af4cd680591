"""GLB, the binary form of glTF 2.0: the triangles of a scene, the nodes' transformations applied.

Format: Khronos Group, "glTF 2.0 Specification", sections 3 and 4. Skins, morph targets,
materials and cameras are passed over; points and lines too.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from typing import Any, NoReturn

import numpy as np

from pcsg.meshfile.mesh import Floats, Integers, Mesh, MeshFileError, make_mesh

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_JSON, _BIN = 0x4E4F534A, 0x004E4942
_KNOWN_EXTENSIONS = {"KHR_mesh_quantization", "KHR_materials_unlit", "KHR_texture_transform"}


def read_glb(name: str, data: bytes) -> Mesh:
    """Read a GLB file; `name` is for messages."""
    with np.errstate(all="ignore"):
        return _Reader(name, *_split_chunks(name, data)).mesh()


def _split_chunks(name: str, data: bytes) -> tuple[Any, bytes]:
    """Return the JSON document and the binary chunk."""
    if data[:4] != b"glTF" or len(data) < 20:
        raise MeshFileError(name, "byte 0", "a GLB file begins with `glTF`")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise MeshFileError(name, "byte 4", f"glTF {version} is not supported, only 2")
    if length > len(data):
        reason = f"the file ends; its header promises {length} bytes"
        raise MeshFileError(name, f"byte {len(data)}", reason)
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            reason = f"a chunk of {size} bytes reaches beyond the end"
            raise MeshFileError(name, f"byte {at}", reason)
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    try:
        document = json.loads(chunks.get(_JSON, b"").decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise MeshFileError(name, "byte 20", f"its JSON is damaged: {error}") from None
    return document, chunks.get(_BIN, b"")


class _Reader:
    def __init__(self, name: str, document: Any, binary: bytes) -> None:
        self.name, self.document, self.binary = name, document, binary
        self.points: list[Floats] = []
        self.triangles: list[Integers] = []
        self.uvs: list[Floats] = []
        self.normals: list[Floats] = []
        self.colors: list[Floats] = []
        self.count = 0

    def fail(self, place: str | None, reason: str) -> NoReturn:
        raise MeshFileError(self.name, place, reason)

    def mesh(self) -> Mesh:
        """Return all triangles of the scene."""
        try:
            missing = set(self.document.get("extensionsRequired", ())) - _KNOWN_EXTENSIONS
            if missing:
                self.fail(None, f"needs the extension {min(missing)}, which is not supported")
            for mesh, world_from_mesh in self._placed_meshes():
                for k, primitive in enumerate(self.document["meshes"][mesh]["primitives"]):
                    self._add(f"mesh {mesh}, primitive {k}", primitive, world_from_mesh)
        except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
            # The document is a tree of JSON without a schema, so anything may be missing in it.
            what = f"no {error}" if isinstance(error, KeyError) else f"{error}"
            self.fail(None, f"its JSON is not a glTF document: {what}")
        if not self.triangles:
            self.fail(None, "no triangles in its scene")
        corners = np.concatenate(self.triangles)
        offsets = np.arange(0, len(corners) + 1, 3)
        points = np.concatenate(self.points)
        uv, normals, colors = (
            np.concatenate(values)[corners] for values in (self.uvs, self.normals, self.colors)
        )
        return make_mesh(points, corners, offsets, uv, normals, colors)

    def _placed_meshes(self) -> Iterator[tuple[int, Floats]]:
        """Yield meshes with their matrices, in the order of the scene."""
        nodes = self.document.get("nodes", [])
        scenes = self.document.get("scenes")
        if scenes:
            roots = scenes[self.document.get("scene", 0)].get("nodes", [])
        else:
            below = {c for node in nodes for c in node.get("children", ())}
            roots = [k for k in range(len(nodes)) if k not in below]
        stack = [(k, np.eye(4)) for k in reversed(roots)]
        seen: set[int] = set()
        while stack:
            k, world_from_parent = stack.pop()
            if k in seen:
                self.fail(f"node {k}", "a node stands twice in the tree of nodes")
            seen.add(k)
            node = nodes[k]
            world_from_node = world_from_parent @ _matrix_of(node)
            if "mesh" in node:
                yield node["mesh"], world_from_node
            stack += [(c, world_from_node) for c in reversed(node.get("children", []))]

    def _add(self, place: str, primitive: Mapping[str, Any], world_from_mesh: Floats) -> None:
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            return
        attributes = primitive["attributes"]
        points = self._accessor(place, attributes["POSITION"], 3)
        n = len(points)
        indices = np.arange(n)
        if "indices" in primitive:
            indices = self._accessor(place, primitive["indices"], 1).ravel().astype(np.int64)
            if len(indices) and indices.max() >= n:
                self.fail(place, f"there is no vertex {indices.max()}: {n} are given")
        linear = world_from_mesh[:3, :3]
        points = points @ linear.T + world_from_mesh[:3, 3]
        if not np.isfinite(points).all():
            self.fail(place, "a vertex needs finite numbers")
        triangles = _triangles_of(indices, mode)
        if np.linalg.det(linear) < 0.0:
            # A mirrored frame turns triangles round (section 3.7.4).
            triangles = triangles[:, ::-1]
        self.points.append(points)
        self.triangles.append(triangles.ravel() + self.count)
        self.uvs.append(self._of_vertices(place, attributes.get("TEXCOORD_0"), n, 2))
        normals = self._of_vertices(place, attributes.get("NORMAL"), n, 3)
        # The matrix of cofactors maps normals also where the frame has no inverse.
        cofactors = np.stack([np.cross(linear[k - 2], linear[k - 1]) for k in range(3)])
        self.normals.append(normals @ cofactors.T * np.sign(np.linalg.det(linear) or 1.0))
        colors = self._of_vertices(place, attributes.get("COLOR_0"), n, 3)
        self.colors.append(np.clip(colors, 0.0, 1.0))
        self.count += n

    def _of_vertices(self, place: str, accessor: int | None, n: int, width: int) -> Floats:
        if accessor is None:
            return np.full((n, width), np.nan)
        values = self._accessor(place, accessor, width)
        if len(values) != n:
            self.fail(place, f"{len(values)} values for {n} vertices")
        return values

    def _accessor(self, place: str, number: int, width: int) -> Floats:
        """Return the values of an accessor as float64 (count, width)."""
        accessor = self.document["accessors"][number]
        if "sparse" in accessor:
            self.fail(f"accessor {number}", "sparse accessors are not supported")
        present = _WIDTHS.get(accessor["type"], 0)
        if present != width and (width, present) != (3, 4):  # colours may have an opacity
            self.fail(f"accessor {number}", f"{accessor['type']} does not fit here")
        kind = np.dtype(_COMPONENTS[accessor["componentType"]])
        count = accessor["count"]
        if "bufferView" not in accessor:
            self.fail(f"accessor {number}", "has no data")
        view = self.document["bufferViews"][accessor["bufferView"]]
        buffer = self.document["buffers"][view["buffer"]]
        if view["buffer"] != 0 or "uri" in buffer:
            self.fail(place, "its data lie in another file; pack everything into the GLB")
        begin = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        size = kind.itemsize * present
        stride = view.get("byteStride") or size
        end = begin + (stride * (count - 1) + size if count else 0)
        if begin < 0 or count < 0 or stride < size or end > len(self.binary):
            reason = f"needs bytes {begin} to {end}, the data are {len(self.binary)} long"
            self.fail(f"accessor {number}", reason)
        values = np.ndarray((count, width), kind, self.binary, begin, (stride, kind.itemsize))
        numbers = values.astype(np.float64)
        if accessor.get("normalized") and kind.kind in "iu":
            numbers = np.maximum(numbers / np.iinfo(kind).max, -1.0)
        return numbers


def _matrix_of(node: Mapping[str, Any]) -> Floats:
    """Return parent_from_node: a matrix by columns, or translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), np.float64)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)), np.float64)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _triangles_of(indices: Integers, mode: int) -> Integers:
    """Return triangles (T, 3) of a list, a strip or a fan."""
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    k = np.arange(max(0, len(indices) - 2))
    if mode == _FAN:
        return indices[np.stack([k + 1, k + 2, np.zeros_like(k)], axis=1)]
    odd = k % 2
    return indices[np.stack([k, k + 1 + odd, k + 2 - odd], axis=1)]
