"""GLB, the binary form of glTF 2.0: the triangles of a scene, the nodes' transformations applied.

Format: Khronos Group, "glTF 2.0 Specification", sections 3 and 4. Materials, lights, cameras and
animations are passed over; points and lines too. Morph targets count with their default weights,
skins as the joints stand.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pcsg.inputs import parse_json
from pcsg.meshfile.gltf import FAN, STRIP, TRIANGLES, Document, of_vertices, triangles_of
from pcsg.meshfile.mesh import (
    Floats,
    Integers,
    Mesh,
    MeshFileError,
    Notes,
    checked_vertices,
    finite_rows,
    make_mesh,
)
from pcsg.meshfile.words import shown

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_PASSED_OVER = (
    "KHR_materials_", "EXT_materials_", "ADOBE_materials_", "KHR_texture_", "EXT_texture_",
    "MSFT_texture_", "KHR_lights_", "EXT_lights_", "KHR_animation_", "KHR_xmp", "KHR_audio",
    "KHR_node_", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing",
)  # fmt: skip
"""Beginnings of extensions that a file may require: known, or nothing to do with shapes."""
_COMPRESSION = "KHR_draco_mesh_compression"
MOST_PLACED = 1_000_000
"""Triangles that the nodes of a small file may place."""
MOST_PRIMITIVES = 20_000
"""Primitives of a file: every one takes some ten kilobytes while it is read."""


def read_glb(name: str, data: bytes) -> Mesh:
    """Read a GLB file; `name` is for messages."""
    with np.errstate(all="ignore"):
        document = Document(name, *_split_chunks(name, data))
        return _Reader(document, max(MOST_PLACED, len(data) // 3)).mesh()


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
        document = parse_json(chunks.get(_JSON, b"").decode("utf-8"))
    except ValueError as error:
        raise MeshFileError(name, "byte 20", f"its JSON is damaged: {error}") from None
    return document, chunks.get(_BIN, b"")


class _Part(NamedTuple):
    """A primitive in its own frame; NaN where it gives no value.

    Attributes
    ----------
    points, uv, normals, colors
        Of the vertices that are used, with 3, 2, 3 and 3 columns.
    triangles : int64 (T, 3)
    skin
        Joints (V, 4 k) and their weights, None if it has none.
    """

    points: Floats
    triangles: Integers
    uv: Floats
    normals: Floats
    colors: Floats
    skin: tuple[Integers, Floats] | None


class _Reader:
    def __init__(self, document: Document, most: int) -> None:
        self.document, self.most = document, most
        self.notes = Notes()
        self.kept: dict[tuple[int, int, int], _Part | None] = {}
        self.frames: dict[tuple[int, int, int], tuple[_Part, list[Floats]]] = {}
        self.skinned: list[_Part] = []
        self.count = 0

    def mesh(self) -> Mesh:
        """Return all triangles of the scene."""
        document = self.document
        for needed in document.list_of(document.content, "extensionsRequired"):
            if not isinstance(needed, str) or not needed.startswith(_PASSED_OVER):
                named = shown(str(needed).encode("utf-8", "replace"))
                document.fail(None, f"needs the extension {named}, which is not supported")
        nodes = self._world_from_nodes()
        for k, world_from_node in nodes.items():
            node = document.item("nodes", k)
            if "mesh" in node:
                self._add_mesh(k, node, world_from_node, nodes)
        placed = [_moved(part, np.concatenate(frames)) for part, frames in self.frames.values()]
        placed += self.skinned
        if not placed:
            reason = "; ".join(("no triangles in its scene", *self.notes.texts()))
            document.fail(None, reason)
        sizes = [len(part.points) for part in placed]
        begins = np.cumsum([0, *sizes])
        corners = np.concatenate(
            [p.triangles.ravel() + begin for p, begin in zip(placed, begins, strict=False)]
        )
        points = np.concatenate([p.points for p in placed])

        def place(k: int) -> str:
            return f"vertex {k} of the scene"

        points = checked_vertices(document.name, points, corners, place, self.notes)
        uv, normals, colors = (
            np.concatenate([getattr(p, label) for p in placed])[corners]
            for label in ("uv", "normals", "colors")
        )
        offsets = np.arange(0, len(corners) + 1, 3)
        return make_mesh(points, corners, offsets, uv, normals, colors, self.notes)

    def _world_from_nodes(self) -> dict[int, Floats]:
        """Return the matrices of the nodes that are shown, in the order of the scene."""
        document = self.document
        nodes = document.list_of(document.content, "nodes")
        scenes = document.list_of(document.content, "scenes")
        if scenes:
            chosen = document.item("scenes", document.integer_of(document.content, "scene", "", 0))
            roots = document.list_of(chosen, "nodes")
        else:
            below: set[Any] = set()
            for k in range(len(nodes)):
                children = document.list_of(document.item("nodes", k), "children", f"node {k}")
                below |= {c for c in children if isinstance(c, int)}
            roots = [k for k in range(len(nodes)) if k not in below]
        stack: list[tuple[Any, Floats]] = [(k, np.eye(4)) for k in reversed(roots)]
        found: dict[int, Floats] = {}
        seen: set[int] = set()
        while stack:
            k, world_from_parent = stack.pop()
            node = document.item("nodes", k)
            if k in seen:
                document.fail(f"node {k}", "a node stands twice in the tree of nodes")
            seen.add(k)
            extensions = document.object_of(node, "extensions", f"node {k}")
            seeing = document.object_of(extensions, "KHR_node_visibility", f"node {k}")
            if seeing.get("visible") is False:
                continue
            world_from_node = world_from_parent @ _matrix_of(document, node)
            found[k] = world_from_node
            children = document.list_of(node, "children", f"node {k}")
            stack += [(c, world_from_node) for c in reversed(children)]
        return found

    def _add_mesh(
        self, k: int, node: Mapping[str, Any], world_from_node: Floats, nodes: dict[int, Floats]
    ) -> None:
        """Place the mesh of node k, once for each of its instances."""
        document = self.document
        number = node["mesh"]
        mesh = document.item("meshes", number, f"node {k}")
        frames = world_from_node @ self._instances(k, node)
        weights = node.get("weights", mesh.get("weights"))
        # Nodes of one mesh differ in their weights at most.
        morphed = k if "weights" in node else -1
        for i, primitive in enumerate(document.list_of(mesh, "primitives", f"mesh {number}")):
            place = f"mesh {number}, primitive {i}"
            key = (number, i, morphed)
            if key not in self.kept:
                if not isinstance(primitive, dict):
                    document.fail(place, "it is not an object")
                if len(self.kept) == MOST_PRIMITIVES:
                    document.fail(place, f"more than {MOST_PRIMITIVES:,} primitives; join them")
                self.kept[key] = self._part(place, primitive, weights)
            part = self.kept[key]
            if part is None:
                continue
            self.count += len(part.triangles) * len(frames)
            if self.count > self.most:
                reason = f"the nodes place more than {self.most:,} triangles; let the grammar do it"
                document.fail(place, reason)
            if part.skin is not None and "skin" in node:
                self.skinned.append(_skinned(part, self._joints(node["skin"], nodes), document))
            else:
                self.frames.setdefault(key, (part, []))[1].append(frames)

    def _instances(self, k: int, node: Mapping[str, Any]) -> Floats:
        """Return node_from_instance (n, 4, 4): one if the node has no instances of its own."""
        document, place = self.document, f"node {k}"
        extensions = document.object_of(node, "extensions", place)
        instancing = document.object_of(extensions, "EXT_mesh_gpu_instancing", place)
        attributes = document.object_of(instancing, "attributes", place)
        columns = {
            key: document.accessor(attributes[key], width, place=place)
            for key, width in (("TRANSLATION", 3), ("ROTATION", 4), ("SCALE", 3))
            if key in attributes
        }
        if not columns:
            return np.eye(4)[None]
        count = len(next(iter(columns.values())))
        if any(len(values) != count for values in columns.values()):
            document.fail(place, "the attributes of its instances differ in number")
        return _compose(
            columns.get("TRANSLATION", np.zeros((count, 3))),
            columns.get("ROTATION", np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))),
            columns.get("SCALE", np.ones((count, 3))),
        )

    def _part(self, place: str, primitive: Mapping[str, Any], weights: Any) -> _Part | None:
        """Read a primitive; None if it has no triangles."""
        document = self.document
        mode = document.integer_of(primitive, "mode", place, TRIANGLES)
        attributes = document.object_of(primitive, "attributes", place)
        if mode not in (TRIANGLES, STRIP, FAN):
            self.notes.add("left out: points and lines", place)
            return None
        if "POSITION" not in attributes:
            self.notes.add("left out: primitives without positions", place)
            return None
        extensions = document.object_of(primitive, "extensions", place)
        positions = document.item("accessors", attributes["POSITION"], place)
        if _COMPRESSION in extensions and "bufferView" not in positions:
            document.fail(place, f"its data need {_COMPRESSION}, which is not supported")
        points = document.accessor(attributes["POSITION"], 3, place=place)
        n = len(points)
        indices = np.arange(n)
        if "indices" in primitive:
            said = document.accessor(primitive["indices"], 1, place=place).ravel()
            bad = np.flatnonzero(~((said >= 0) & (said < n) & (np.floor(said) == said)))
            if len(bad):
                document.fail(place, f"there is no vertex {said[bad[0]]:g}: {n} are given")
            indices = said.astype(np.int64)
        triangles = triangles_of(indices, mode)
        if not len(triangles):
            return None
        used, numbers = np.unique(triangles, return_inverse=True)
        normals = self._attribute(place, attributes, "NORMAL", n, 3)
        points, normals = self._morph(place, primitive, weights, points, normals)
        return _Part(
            points[used],
            numbers.reshape(-1, 3),
            self._uv(place, primitive, attributes, n)[used],
            normals[used],
            np.clip(self._attribute(place, attributes, "COLOR_0", n, 3, 4)[used, :3], 0.0, 1.0),
            self._weights_of_joints(place, attributes, n, used),
        )

    def _attribute(
        self, place: str, attributes: Mapping[str, Any], key: str, n: int, *widths: int
    ) -> Floats:
        """Return an attribute, NaN where it is missing or not finite."""
        if key not in attributes:
            return np.full((n, widths[0]), np.nan)
        values = of_vertices(self.document, place, attributes[key], n, *widths)
        wrong = ~finite_rows(values)
        if wrong.any():
            self.notes.add(f"left out: {key} that is not finite", place, int(wrong.sum()))
            values = np.where(wrong[:, None], np.nan, values)
        return values

    def _morph(
        self,
        place: str,
        primitive: Mapping[str, Any],
        weights: Any,
        points: Floats,
        normals: Floats,
    ) -> tuple[Floats, Floats]:
        """Return positions and normals with the morph targets by their default weights."""
        targets = self.document.list_of(primitive, "targets", place)
        if not isinstance(weights, list):
            return points, normals
        for target, weight in zip(targets, weights, strict=False):
            if not isinstance(target, dict) or not isinstance(weight, int | float):
                self.document.fail(place, "its morph targets are damaged")
            if weight == 0 or not abs(weight) < 1e30:
                continue
            if "POSITION" in target:
                more = of_vertices(self.document, place, target["POSITION"], len(points), 3)
                points = points + weight * more
            if "NORMAL" in target:
                more = of_vertices(self.document, place, target["NORMAL"], len(points), 3)
                normals = normals + weight * more
        return points, normals

    def _uv(
        self, place: str, primitive: Mapping[str, Any], attributes: Mapping[str, Any], n: int
    ) -> Floats:
        """Return texture coordinates as those of the base colour; v = 0 is the lowest row."""
        document = self.document
        texture: Mapping[str, Any] = {}
        if "material" in primitive:
            material = document.item("materials", primitive["material"], place)
            shading = document.object_of(material, "pbrMetallicRoughness", place)
            texture = document.object_of(shading, "baseColorTexture", place)
        extensions = document.object_of(texture, "extensions", place)
        change = document.object_of(extensions, "KHR_texture_transform", place)
        number = document.integer_of(texture, "texCoord", place, 0)
        number = document.integer_of(change, "texCoord", place, number)
        uv = self._attribute(place, attributes, f"TEXCOORD_{number}", n, 2)
        if change:
            turn = document.numbers_of(
                {"rotation": [change.get("rotation", 0.0)]}, "rotation", (0,)
            )
            c, s = math.cos(turn[0]), math.sin(turn[0])
            uv = uv * document.numbers_of(change, "scale", (1.0, 1.0))
            uv = uv @ np.array([[c, -s], [s, c]]) + document.numbers_of(change, "offset", (0, 0))
        # Rows of pictures count from the top in glTF, from below here.
        return uv * (1.0, -1.0) + (0.0, 1.0)

    def _weights_of_joints(
        self, place: str, attributes: Mapping[str, Any], n: int, used: Integers
    ) -> tuple[Integers, Floats] | None:
        """Return joints and weights of the vertices that are used."""
        joints: list[Floats] = []
        weights: list[Floats] = []
        while f"JOINTS_{len(joints)}" in attributes and f"WEIGHTS_{len(joints)}" in attributes:
            k = len(joints)
            joints.append(of_vertices(self.document, place, attributes[f"JOINTS_{k}"], n, 4)[used])
            weights.append(
                of_vertices(self.document, place, attributes[f"WEIGHTS_{k}"], n, 4)[used]
            )
        if not joints:
            return None
        numbers, shares = np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)
        total = shares.sum(axis=1, keepdims=True)
        if not (np.isfinite(numbers).all() and (total > 0.0).all() and np.isfinite(total).all()):
            self.notes.add("left out: skins whose weights are damaged", place)
            return None
        return numbers.astype(np.int64), shares / total

    def _joints(self, number: Any, nodes: Mapping[int, Floats]) -> Floats:
        """Return world_from_vertex of every joint of a skin, (J, 4, 4)."""
        document, place = self.document, f"skin {number}"
        skin = document.item("skins", number)
        joints = document.list_of(skin, "joints", place)
        inverse = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
        if "inverseBindMatrices" in skin:
            stored = document.accessor(skin["inverseBindMatrices"], 16, place=place)
            if len(stored) < len(joints):
                document.fail(place, f"{len(stored)} matrices for {len(joints)} joints")
            inverse = stored[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
        for joint in joints:
            document.item("nodes", joint, place)
            if joint not in nodes:
                document.fail(place, "one of its joints is not in the scene")
        world = np.array([nodes[joint] for joint in joints]).reshape(-1, 4, 4)
        found: Floats = world @ inverse
        return found


def _matrix_of(document: Document, node: Mapping[str, Any]) -> Floats:
    """Return parent_from_node: a matrix by columns, or translation, rotation and scale."""
    if "matrix" in node:
        columns = document.numbers_of(node, "matrix", np.eye(4).ravel().tolist())
        return columns.reshape(4, 4).T
    if not {"translation", "rotation", "scale"} & node.keys():
        return np.eye(4)
    matrix: Floats = _compose(
        document.numbers_of(node, "translation", (0.0, 0.0, 0.0))[None],
        document.numbers_of(node, "rotation", (0.0, 0.0, 0.0, 1.0))[None],
        document.numbers_of(node, "scale", (1.0, 1.0, 1.0))[None],
    )[0]
    return matrix


def _compose(translation: Floats, rotation: Floats, scale: Floats) -> Floats:
    """Return matrices (n, 4, 4) that scale, turn by quaternions (x, y, z, w), and move."""
    length = np.sqrt(np.einsum("ni,ni->n", rotation, rotation))
    none = np.array((0.0, 0.0, 0.0, 1.0))
    x, y, z, w = np.where(length[:, None] > 0.0, rotation / length[:, None], none).T
    matrix = np.tile(np.eye(4), (len(translation), 1, 1))
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:, :3, :3] = np.moveaxis(np.array(rows), 2, 0) * scale[:, None, :]
    matrix[:, :3, 3] = translation
    return matrix


def _cofactors(linear: Floats) -> Floats:
    """Return the cofactors of matrices (n, 3, 3): they map normals also where nothing inverts."""
    m = linear[:, [1, 2, 0]], linear[:, [2, 0, 1]]  # np.cross takes long for one matrix
    (a, b), (c, d) = ((x[:, :, [1, 2, 0]], x[:, :, [2, 0, 1]]) for x in m)
    cofactors: Floats = a * d - b * c
    return cofactors


def _moved(part: _Part, world_from_part: Floats) -> _Part:
    """Return copies of a part in other frames (n, 4, 4), one after the other."""
    linear = world_from_part[:, :3, :3]
    copies, vertices = len(linear), len(part.points)
    turned = np.sign(np.linalg.det(linear))
    points = np.einsum("nij,vj->nvi", linear, part.points) + world_from_part[:, None, :3, 3]
    normals = np.einsum("nij,vj->nvi", _cofactors(linear), part.normals)
    normals *= np.where(turned < 0.0, -1.0, 1.0)[:, None, None]
    # A mirrored frame turns triangles round (section 3.7.4).
    mirrored = (turned < 0.0)[:, None, None]
    triangles = np.where(mirrored, part.triangles[:, ::-1], part.triangles)
    triangles = triangles + vertices * np.arange(copies)[:, None, None]
    return _Part(
        points.reshape(-1, 3),
        triangles.reshape(-1, 3),
        np.tile(part.uv, (copies, 1)),
        normals.reshape(-1, 3),
        np.tile(part.colors, (copies, 1)),
        None,
    )


def _skinned(part: _Part, world_from_joints: Floats, document: Document) -> _Part:
    """Return a part as its joints pull it."""
    assert part.skin is not None
    numbers, shares = part.skin
    known = len(world_from_joints)
    if not known or not 0 <= numbers.min() <= numbers.max() < known:
        document.fail(None, "a vertex hangs on a joint that its skin does not have")
    frames = np.einsum("vk,vkij->vij", shares, world_from_joints[numbers])
    linear = frames[:, :3, :3]
    turned = np.sign(np.linalg.det(linear))
    normals = np.einsum("vij,vj->vi", _cofactors(linear), part.normals)
    return part._replace(
        points=np.einsum("vij,vj->vi", linear, part.points) + frames[:, :3, 3],
        triangles=part.triangles[:, ::-1] if turned.sum() < 0.0 else part.triangles,
        normals=normals * np.where(turned < 0.0, -1.0, 1.0)[:, None],
    )
