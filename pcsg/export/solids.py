"""Solids as shapes: outlines of primitives, Boolean operations, blobs and growing trees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pcsg.contouring import contour
from pcsg.errors import UsageError
from pcsg.export import maps
from pcsg.export.outlines import Outline, outline_of
from pcsg.export.shapes import Floats, Ints, Shape, dress, smooth
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.expr import Number
from pcsg.graph.nodes import Attribute, Leaf, Node, Operation, Transformation, combine
from pcsg.graph.operators import DIFFERENCE, INTERSECTION, UNION, Operator
from pcsg.graph.transforms import TRANSFORMS
from pcsg.leaf.blob import BlobModel
from pcsg.leaf.mesh import MeshModel
from pcsg.scene import Scene

if TYPE_CHECKING:
    from pcsg.treemesh.surface import QuadMesh

MOST_OPERANDS = 4_000
"""Primitives of one operation that is made a mesh."""

_OPERATORS: dict[int, Operator] = {x.kind: x for x in (UNION, INTERSECTION, DIFFERENCE)}


class Primitive(NamedTuple):
    """A primitive in an operation; `look` is its number among the operation's looks."""

    node: Leaf
    args: tuple[float, ...]
    matrix: Floats
    look: int


class Carved(NamedTuple):
    """An operation: the operator's kind, and the operands."""

    kind: int
    operands: tuple[Carved | Primitive, ...]


@dataclass
class Mesher:
    """Makes shapes, each only once.

    Attributes
    ----------
    segments
        Corners of a circle.
    resolution
        Cells along the longest side of what is contoured.
    shapes
        Those that were made.
    notes
        What was left out or is not exact, each once.
    """

    segments: int = 16
    resolution: int = 64
    shapes: list[Shape] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)
    _known: dict[Any, list[tuple[int, int]]] = field(default_factory=dict)
    _leaves: dict[tuple[Any, ...], Outline | None] = field(default_factory=dict)

    def leaf(self, node: Leaf, args: tuple[float, ...]) -> list[tuple[int, int]]:
        """Return numbers of the shapes of a primitive in its own frame, and of their looks."""
        key = _name_of(node, args)
        if key not in self._known:
            found: list[tuple[Shape, int]] = []
            is_blob = node.constants and isinstance(node.model(args), BlobModel)
            outline = None if is_blob else self._outline(node, args)
            if is_blob:
                found = self._blob(node, args)
            elif outline is None:
                self.notes[f"{node.solid.name} was left out: it has no bounds"] = None
            elif len(outline[1]):
                scene = Scene(_leaf(node, args))
                found = dress(node.solid.name, scene, *outline, sheet=node.is_sheet)
            self._known[key] = self._add([(shape, 0) for shape, _ in found])
        return self._known[key]

    def _blob(self, node: Leaf, args: tuple[float, ...]) -> list[tuple[Shape, int]]:
        """Return the shape of a blob: the tubes of a growing tree, else what is contoured."""
        limbs = _limbs(node, args)
        if limbs is None:
            outline = self._outline(node, args)
            uv = None
        else:
            outline = limbs.positions, limbs.triangles
            # Two triangles for each quad, which may be cut along either diagonal.
            quads = np.repeat(np.arange(len(limbs.quads)), 2)
            same = limbs.quads[quads][:, None] == limbs.triangles[:, :, None]
            uv = limbs.uv[quads[:, None], same.argmax(axis=2)].reshape(-1, 2)
        if outline is None or not len(outline[1]):
            return []
        return [(smooth(node.solid.name, Scene(_leaf(node, args)), *outline, uv), 0)]

    def operation(self, carved: Carved) -> tuple[Floats, list[tuple[int, int]]]:
        """Return a frame, and numbers of an operation's shapes there and of their looks.

        Copies of an operation have one shape, wherever they stand.
        """
        primitives = _primitives(carved)
        frame = np.vstack([primitives[0].matrix, [0.0, 0.0, 0.0, 1.0]])
        moved = _moved(carved, np.linalg.inv(frame)[:3])
        key = _key(moved)
        if key not in self._known:
            self._known[key] = self._add(self._carve(moved))
        return primitives[0].matrix, self._known[key]

    def _add(self, found: Sequence[tuple[Shape, int]]) -> list[tuple[int, int]]:
        begin = len(self.shapes)
        self.shapes += [shape for shape, _ in found]
        return [(begin + k, look) for k, (_, look) in enumerate(found)]

    def _carve(self, carved: Carved) -> list[tuple[Shape, int]]:
        """Return the shapes of an operation, one for each look."""
        scene = Scene(_node(carved))
        outline = self._exact(carved)
        if outline is None:
            try:
                outline = contour(scene, self.resolution)
            except UsageError as error:
                self.notes[f"an operation was left out: {error}"] = None
                return []
        return dress(_OPERATORS[carved.kind].name, scene, *outline)

    def _exact(self, carved: Carved) -> Outline | None:
        """Return an operation on the polygons of its operands; None where that cannot be."""
        try:
            import manifold3d
        except ImportError:
            self.notes["operations are contoured; with the extra `export` they are exact"] = None
            return None
        solid = self._manifold(manifold3d, carved)
        if solid is None or solid.status() != manifold3d.Error.NoError:
            return None
        mesh = solid.to_mesh64()
        places = np.asarray(mesh.vert_properties, np.float64)[:, :3]
        return places, np.asarray(mesh.tri_verts, np.int64)

    def _manifold(self, library: Any, part: Carved | Primitive) -> Any:
        if isinstance(part, Primitive):
            outline = None if part.node.is_sheet else self._outline(part.node, part.args)
            if outline is None or not len(outline[1]):
                return None
            vertices, faces = outline
            mesh = library.Mesh64(vertices, faces.astype(np.uint64))
            return library.Manifold(mesh).transform(part.matrix)
        operands = [self._manifold(library, operand) for operand in part.operands]
        if any(operand is None for operand in operands):
            return None
        kinds = library.OpType
        kind = {
            UNION.kind: kinds.Add,
            INTERSECTION.kind: kinds.Intersect,
            DIFFERENCE.kind: kinds.Subtract,
        }[part.kind]
        return library.Manifold.batch_boolean(operands, kind)

    def _outline(self, node: Leaf, args: tuple[float, ...]) -> Outline | None:
        """Return a primitive's outline in its own frame; None for one without bounds."""
        key = _name_of(node, args)
        if key not in self._leaves:
            self._leaves[key] = self._draw(node, args)
        return self._leaves[key]

    def _contoured(self, node: Leaf, args: tuple[float, ...]) -> Outline:
        """Return what rays find of a solid for which there are no polygons."""
        try:
            return contour(Scene(_leaf(node, args)), self.resolution)
        except UsageError as error:
            self.notes[f"{node.solid.name} was left out: {error}"] = None
            return np.zeros((0, 3)), np.zeros((0, 3), np.int64)

    def _draw(self, node: Leaf, args: tuple[float, ...]) -> Outline | None:
        if not node.constants:
            outline = outline_of(node.solid.name, args, self.segments)
            box = node.bounds_of(args)
            if outline is not None or not np.isfinite([box.lower, box.upper]).all():
                return outline
            return self._contoured(node, args)
        model = node.model(args)
        if isinstance(model, MeshModel):
            return model.polygons.vertices, model.triangles
        if isinstance(model, BlobModel):
            limbs = _limbs(node, args)
            if limbs is not None:
                return limbs.positions, limbs.triangles
            return self._contoured(node, args)
        return None


def _limbs(node: Leaf, args: tuple[float, ...]) -> QuadMesh | None:
    """Return the surface of a growing tree's wood, None for any other blob."""
    from pcsg.growth.leaf import Growth
    from pcsg.treemesh import SurfaceOptions, resample, tree_surface

    (source,) = node.constants
    if not isinstance(source, Growth):
        return None
    return tree_surface(resample(source.state(args).skeleton()), SurfaceOptions(levels=1))


def _name_of(node: Leaf, args: tuple[float, ...]) -> tuple[Any, ...]:
    return node.solid.name, args, *(id(constant) for constant in node.constants)


def _primitives(part: Carved | Primitive) -> list[Primitive]:
    if isinstance(part, Primitive):
        return [part]
    return [x for operand in part.operands for x in _primitives(operand)]


def _moved(part: Carved, outer: Floats) -> Carved:
    operands = [
        _moved(x, outer)
        if isinstance(x, Carved)
        else x._replace(matrix=maps.composed(outer, x.matrix))
        for x in part.operands
    ]
    return part._replace(operands=tuple(operands))


def _key(part: Carved | Primitive) -> tuple[Any, ...]:
    if isinstance(part, Carved):
        return part.kind, tuple(_key(operand) for operand in part.operands)
    # Copies differ in the last bits.
    rounded = np.round(part.matrix, 9) + 0.0
    return *_name_of(part.node, part.args), part.look, rounded.tobytes()


def _node(part: Carved | Primitive) -> Node:
    """Return an operation as a graph whose labels are the numbers of its looks."""
    if isinstance(part, Carved):
        operands = [_node(operand) for operand in part.operands]
        if len(operands) == 1:
            return operands[0]
        if part.kind == UNION.kind:
            return combine(UNION, operands)
        return Operation(_OPERATORS[part.kind], tuple(operands))
    label = Attribute(ATTRIBUTES["label"], (Number(float(part.look)),), _leaf(part.node, part.args))
    outer, scale, inner = (x[0] for x in maps.split(part.matrix[None, :, :3]))
    node = _turned(inner, label)
    node = _transformed("scale", scale.tolist(), node)
    return _transformed("move", part.matrix[:, 3].tolist(), _turned(outer, node))


def _leaf(node: Leaf, args: tuple[float, ...]) -> Node:
    return Leaf(node.solid, tuple(Number(x) for x in args), node.constants)


def _turned(rotation: Floats, node: Node) -> Node:
    x, y, z, w = maps.quaternions(rotation[None])[0].tolist()
    size = math.hypot(x, y, z)
    if size < 1e-12:
        return node
    angle = math.degrees(2.0 * math.atan2(size, w))
    return _transformed("rot", [angle, x / size, y / size, z / size], node)


def _transformed(name: str, args: Sequence[float], node: Node) -> Node:
    return Transformation(TRANSFORMS[name], tuple(Number(x) for x in args), node)


__all__ = ["Carved", "Floats", "Ints", "Mesher", "Primitive"]
