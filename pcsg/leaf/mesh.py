"""Triangle meshes: closed ones are solids, others are sheets."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array as array_of
from pcsg.errors import UsageError
from pcsg.geometry.bvh import build_hierarchy
from pcsg.geometry.packets import LANES, pack_triangles
from pcsg.leaf.places import (
    corners_of_part,
    face_normal,
    interpolate,
    is_part,
    locate,
    normal_at,
)
from pcsg.leaf.registry import (
    NO_PART,
    Array,
    Box,
    Constant,
    Data,
    LeafConstant,
    Model,
    Pool,
    Solid,
    leaf,
)
from pcsg.leaf.triangles import (
    BLOCKS,
    CLOSED,
    CORNERS,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_UV,
    ORIENTATION,
    PACKETS,
    REFS,
    SCALE,
    TRIANGLES,
    find_mesh,
    mesh_contains,
    mesh_crossings,
)
from pcsg.meshfile import Mesh as Polygons
from pcsg.meshfile import read_mesh
from pcsg.meshfile.closing import close, different_numbers
from pcsg.meshfile.mesh import FARTHEST, make_mesh, offsets_of
from pcsg.simd import WIDTH
from pcsg.vec import Ray, Vec3

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class MeshModel(Constant, Model):
    """A mesh: the constant argument of its leaf, and the model of it, too.

    Parameters
    ----------
    polygons
        Vertices and polygons.
    name
        The file as the grammar names it; None for arrays.
    sheet
        Whether it is known to bound no volume.

    Attributes
    ----------
    closed
        Whether the mesh bounds a volume: every edge is passed as often in one direction as in the
        other, if need be once facets are turned and corners joined; see `pcsg.meshfile.closing`.
    triangles : int64 (T, 3)
        Vertices of the triangles as they are met.
    triangle_corners : int64 (T, 3)
        Their corners in the file's polygons.
    open_edges : float64 (E, 2, 3)
        Ends of the edges where the mesh is open.
    notes
        What of a file is left out or mended.
    """

    def __init__(self, polygons: Polygons, name: str | None = None, *, sheet: bool = False) -> None:
        self.polygons = polygons
        self.name = name
        self.triangles: Integers = polygons.triangles
        self.triangle_corners: Integers = polygons.triangle_corners
        self.closed = False
        self.open_edges: Floats = np.zeros((0, 2, 3))
        self.notes = polygons.notes
        if not len(self.triangles):
            raise UsageError("all polygons of the mesh are degenerate")
        if polygons.crossing_polygons:
            crossing = "cut as they come: polygons that cross themselves"
            self.notes += (f"{crossing} ({polygons.crossing_polygons:,})",)
        if not sheet:
            self._close()
        used = polygons.vertices[different_numbers(self.triangles)]
        self._cells = _Cells(used)
        self.bounds = Box(tuple(used.min(axis=0).tolist()), tuple(used.max(axis=0).tolist()))

    def _close(self) -> None:
        """Make it a solid if it can be."""
        vertices = self.polygons.vertices
        found = close(vertices, self.triangles)
        self.closed = found.closed
        self.open_edges = vertices[found.open_edges]
        self.notes += found.notes
        if found.dropped.any() or found.notes:
            turned = found.turned[:, None]
            corners = np.where(turned, self.triangle_corners[:, ::-1], self.triangle_corners)
            self.triangle_corners = corners[~found.dropped]
            self.triangles = found.twin[self.polygons.corners[self.triangle_corners]]

    @property
    def why_sheet(self) -> str | None:
        if self.closed or not len(self.open_edges):
            return None
        count = len(self.open_edges)
        a, b = (", ".join(f"{x:g}" for x in end) for end in self.open_edges[0])
        edges = f"{count:,} of its edges are" if count > 1 else "one of its edges is"
        first = "the first" if count > 1 else "it"
        return f"the mesh is not closed: {edges} open, {first} from ({a}) to ({b})"

    @property
    def signature(self) -> object:
        return self.name if self.name is not None else id(self)

    @cached_property
    def digest(self) -> str:
        hashed = hashlib.sha256()
        mesh = self.polygons
        said = (mesh.corner_uv, mesh.corner_normals, mesh.corner_colors)
        for numbers in (mesh.vertices, mesh.corners, mesh.offsets, *said):
            hashed.update(b"" if numbers is None else np.ascontiguousarray(numbers).tobytes())
        return hashed.hexdigest()

    @property
    def text(self) -> str | None:
        return None if self.name is None else f'"{self.name}"'

    def support(self, direction: Vec3) -> float:
        return self._cells.support(np.array(direction))

    @cached_property
    def data(self) -> Data:
        """The head, the hierarchy, corners, and what the file says of them; see `triangles`."""
        mesh = self.polygons
        points = mesh.vertices[self.triangles]
        lower, upper = points.min(axis=1), points.max(axis=1)
        reach = float(max(np.abs(lower).max(), np.abs(upper).max()))
        # Boxes are in single precision, in a frame where the mesh is about the origin and 1 long.
        center = 0.5 * (np.array(self.bounds.lower) + np.array(self.bounds.upper))
        size = max(b - a for a, b in zip(self.bounds.lower, self.bounds.upper, strict=True))
        scale = 2.0 ** -float(np.clip(math.frexp(size)[1], -400, 400))
        # Rays are rounded before they meet the boxes.
        room = 1e-14 * reach
        boxes = np.concatenate([lower - room - center, upper + room - center], axis=1) * scale
        made = build_hierarchy(boxes, LANES)
        del boxes, lower, upper
        points = points[made.order]
        corners = self.triangle_corners[made.order]
        uv = _of_corners(mesh.corner_uv, corners, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        normals = None
        if mesh.corner_normals is not None:
            flat = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
            normals = _of_corners(mesh.corner_normals, corners, np.repeat(flat[:, None], 3, axis=1))
        head = np.zeros(REFS, np.int32)
        packets = len(made.begins) - 1
        head[TRIANGLES], head[PACKETS], head[BLOCKS] = len(points), packets, len(made.refs) // WIDTH
        head[CLOSED] = self.closed
        volume = np.einsum("ij,ij->", points[:, 0], np.cross(points[:, 1], points[:, 2]))
        head[ORIENTATION] = -1 if self.closed and volume < 0.0 else 1
        head[HAS_UV], head[HAS_NORMALS] = uv is not None, normals is not None
        colors = _of_corners(mesh.corner_colors, corners, np.full((1, 3, 3), -1.0))
        head[HAS_COLORS] = colors is not None
        about = np.zeros(CORNERS)
        about[: SCALE + 1] = reach, *self.bounds.lower, *self.bounds.upper, *center, scale
        numbers = [about, pack_triangles(points, made.begins)]
        numbers += [a.ravel() for a in (uv, normals, colors) if a is not None]
        return Data(
            np.concatenate(numbers),
            made.boxes,
            np.concatenate([head, made.refs, made.begins[:-1]]),
        )


class _Cells:
    """Points by the cells of a grid, so that the farthest one in a direction is found quickly.

    Parameters
    ----------
    points : float64 (n, 3)
    """

    def __init__(self, points: Floats) -> None:
        lower, upper = points.min(axis=0), points.max(axis=0)
        size = np.where(upper > lower, upper - lower, 1.0)
        # As many cells as would hold 64 points each, if these filled the box.
        side = max(1, round((len(points) / 64.0) ** (1.0 / 3.0)))
        cell = np.minimum((points - lower) / size * side, side - 1.0).astype(np.int64)
        keys = (cell[:, 0] * side + cell[:, 1]) * side + cell[:, 2]
        order = np.argsort(keys, kind="stable")
        self.points = points[order]
        begins = np.flatnonzero(np.diff(keys[order], prepend=-1))
        self.begins = [*begins.tolist(), len(points)]
        self.lower = np.minimum.reduceat(self.points, begins)
        self.upper = np.maximum.reduceat(self.points, begins)

    def support(self, direction: Floats) -> float:
        """Return the largest ``p . direction``."""
        most = np.where(direction > 0.0, self.upper, self.lower) @ direction
        best = -math.inf
        for k in np.argsort(-most, kind="stable"):
            if most[k] <= best:
                break
            inside = self.points[self.begins[k] : self.begins[k + 1]]
            best = max(best, float((inside @ direction).max()))
        return best


def _of_corners(values: Floats | None, corners: Integers, instead: ArrayLike) -> Floats | None:
    """Return values of the corners of triangles; where the file gives none for one, others."""
    if values is None:
        return None
    found = values[corners]
    missing = np.isnan(found).any(axis=(1, 2))
    found[missing] = np.broadcast_to(np.asarray(instead, np.float64), found.shape)[missing]
    return found


def mesh_of_arrays(vertices: ArrayLike, faces: Any) -> MeshModel:
    """Return the mesh of vertices (V, 3) and faces: an array (F, 3) or (F, 4), or lists.

    Raises
    ------
    UsageError
        Shapes do not fit, numbers are not finite, or a vertex is not there.
    """
    points = array_of(vertices, "mesh: vertices").copy()
    if points.ndim != 2 or points.shape[1] != 3 or not (np.abs(points) <= FARTHEST).all():
        raise UsageError(f"mesh: vertices are numbers of shape (n, 3), at most {FARTHEST:g}")
    try:
        polygons = [np.asarray(face) for face in faces]
    except (TypeError, ValueError):
        polygons = []
    if not polygons or any(p.ndim != 1 or len(p) < 3 or p.dtype.kind not in "iu" for p in polygons):
        raise UsageError("mesh: every face is a row of 3 or more numbers of vertices")
    corners = np.concatenate(polygons).astype(np.int64)
    if corners.min() < 0 or corners.max() >= len(points):
        wrong = corners.min() if corners.min() < 0 else corners.max()
        raise UsageError(f"mesh: there is no vertex {wrong}: {len(points)} are given")
    return MeshModel(make_mesh(points, corners, offsets_of([len(p) for p in polygons])))


_READ: WeakValueDictionary[tuple[object, ...], MeshModel] = WeakValueDictionary()


@leaf
class Mesh(Solid):
    """Polygons from a file: OBJ, PLY, STL or GLB.

    The name is relative to the grammar's file; coordinates are taken as they are. A closed mesh is
    a solid: the points that its surface winds about. To close it, corners that differ by rounding
    (by a millionth of the longest side of its box) are joined and facets that are inside out are
    turned. What cannot be closed is a sheet, and so is a mesh whose faces all stand both ways:
    ``pcsg stats`` tells where it is open.

    What of a file is damaged but not its shape, such as colours that are no numbers, is left out
    with a warning (``Scene.warnings``); other damage is an error that names the line or the byte.

    In Python, ``mesh("rock.obj")`` or ``mesh(vertices, faces)``.

    Surface coordinates: those of the file, or else the barycentric ones of the second and the
    third corner of each triangle. Normals are those of the faces, or the file's, if it has any.
    Colours of vertices or faces, where the file has them, come before those that the grammar sets.
    """

    constants = (LeafConstant("file", "the name of a mesh file in quotes"),)
    apart = True

    @classmethod
    def read_constant(cls, text: str, folder: Path) -> MeshModel:
        path = folder / text
        key: tuple[object, ...] = (path,)
        with suppress(OSError, ValueError):  # the reader tells what is wrong
            about = path.stat()
            key = cls.name, path.resolve(), about.st_mtime_ns, about.st_size, text
        found = _READ.get(key)
        if found is None:
            found = _READ[key] = cls.read_model(path, text)
        return found

    @classmethod
    def read_model(cls, path: Path, name: str) -> MeshModel:
        """Return the mesh of a file that the grammar calls `name`; errors as `read_constant`."""
        return MeshModel(read_mesh(path), name)

    @classmethod
    def take_arguments(cls, args: Sequence[Any]) -> tuple[tuple[Constant, ...], Sequence[Any]]:
        if len(args) == 2 and not isinstance(args[0], (str, Path)):
            return (mesh_of_arrays(*args),), ()
        return super().take_arguments(args)

    @classmethod
    def sheet_of(cls, constants: Sequence[Constant]) -> bool:
        return not _model(constants).closed

    @classmethod
    def primitives_of(cls, constants: Sequence[Constant]) -> int:
        return len(_model(constants).triangles)

    @classmethod
    def make_model(cls, constants: Sequence[Constant], args: Sequence[float]) -> MeshModel:
        return _model(constants)

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        return mesh_crossings(ray, want, args, at, pool, t, n)

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        mesh = find_mesh(args, at, pool)
        return normal_at(pool, mesh, locate(pool, mesh, p, NO_PART))

    @staticmethod
    def part_normal(p: Vec3, part: float, args: Array, at: int, pool: Pool) -> Vec3:
        mesh = find_mesh(args, at, pool)
        if is_part(pool, mesh, part) and pool[2][mesh.head + HAS_NORMALS] == 0:
            return face_normal(pool, mesh, corners_of_part(mesh, part))
        return normal_at(pool, mesh, locate(pool, mesh, p, part))

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        return mesh_contains(p, args, at, pool)

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        mesh = find_mesh(args, at, pool)
        place = locate(pool, mesh, p, NO_PART)
        if pool[2][mesh.head + HAS_UV] == 0:
            return place.b, place.c
        u = interpolate(pool[0], mesh.uvs, 2, 0, place)
        return u, interpolate(pool[0], mesh.uvs, 2, 1, place)

    @staticmethod
    def attributes(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float, float, float]:
        mesh = find_mesh(args, at, pool)
        if pool[2][mesh.head + HAS_COLORS] == 0:
            return -1.0, -1.0, -1.0, -1.0
        place = locate(pool, mesh, p, NO_PART)
        red = interpolate(pool[0], mesh.colors, 3, 0, place)
        green = interpolate(pool[0], mesh.colors, 3, 1, place)
        blue = interpolate(pool[0], mesh.colors, 3, 2, place)
        return red, green, blue, -1.0


def _model(constants: Sequence[Constant]) -> MeshModel:
    (model,) = constants
    assert isinstance(model, MeshModel)
    return model
