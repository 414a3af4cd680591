"""Meshes with normals and (u, v), which rays ask of the solid itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.scene import Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

INWARDS = 1e-4
"""Part of the way to a triangle's middle at which its corners are asked: on a seam or an edge the
answers of its two sides differ."""

NEAR = 0.2
"""Part of a solid's size within which rays look for the surface that a triangle stands for."""


COLORED = 60
"""Triangles of a surface without edges whose colours are asked."""


class Shape(NamedTuple):
    """A mesh; corners whose normals or (u, v) differ are vertices of their own.

    Attributes
    ----------
    name
        For people.
    vertices, normals : float64 (V, 3)
    uv : float64 (V, 2)
    triangles : int64 (T, 3)
        Counterclockwise as seen from outside.
    sheet
        Whether it is a surface without volume.
    color
        The mean of the colours that it has by itself, None if it has none.
    """

    name: str
    vertices: Floats
    normals: Floats
    uv: Floats
    triangles: Ints
    sheet: bool = False
    color: tuple[float, float, float] | None = None


def dress(
    name: str, scene: Scene, vertices: Floats, faces: Ints, sheet: bool = False
) -> list[tuple[Shape, int]]:
    """Return triangles as shapes with the scene's normals and (u, v), one for each label.

    Parameters
    ----------
    scene
        The solid that the triangles are about.
    vertices, faces
        (V, 3) and (T, 3).
    """
    points = vertices[faces]
    normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    length = np.linalg.norm(normal, axis=1)
    real = length > 0.0
    if not real.any():
        return []
    faces, points, normal = faces[real], points[real], normal[real] / length[real, None]
    middle = points.mean(axis=1, keepdims=True)
    asked = (points + INWARDS * (middle - points)).reshape(-1, 3)
    size = float(np.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0)))
    found = _Surface(scene, asked, np.repeat(normal, 3, axis=0), size)
    labels = _Surface(scene, middle[:, 0], normal, size).label
    shapes = []
    for label in np.unique(labels).tolist():
        here = labels == label
        corners = np.repeat(here, 3)
        shape = weld(name, vertices, faces[here], found.normal[corners], found.uv[corners])
        color = found.color[corners]
        own = color[(color >= 0.0).all(axis=1)]
        if len(own):
            red, green, blue = own.mean(axis=0).tolist()
            shape = shape._replace(color=(red, green, blue))
        shapes.append((shape._replace(sheet=sheet), label))
    return shapes


def smooth(name: str, scene: Scene, vertices: Floats, faces: Ints, uv: Floats | None) -> Shape:
    """Return triangles of a surface without edges as a shape.

    Rays that meet fields of thousands of limbs take too long to be asked at every corner: normals
    are those of the triangles about a vertex, and the colour is that of a few.

    Parameters
    ----------
    uv
        (3 T, 2) of the corners; None for none.
    """
    points = vertices[faces]
    flat = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], flat)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    corners = faces.ravel()
    if uv is None:
        uv = np.zeros((len(corners), 2))
    shape = weld(name, vertices, faces, normals[corners], uv)
    some = faces[:: max(1, len(faces) // COLORED)]
    asked = dress(name, scene, vertices, some)
    return shape._replace(color=asked[0][0].color) if asked else shape


class _Surface:
    """What the surface is like that is nearest to points along their normals.

    Attributes
    ----------
    normal, color : float64 (N, 3)
    uv : float64 (N, 2)
    label : int64 (N,)
    """

    def __init__(self, scene: Scene, points: Floats, normals: Floats, size: float) -> None:
        reach = NEAR * size
        # A point may lie on either side, by as much as a chord lies below its arc.
        above = scene.intersect(points + 1e-6 * size * normals, -normals, 0.0, reach)
        below = scene.intersect(points - 1e-6 * size * normals, normals, 0.0, reach)
        nearer = above.t <= below.t
        hit = (above.mask | below.mask)[:, None]
        chosen = nearer[:, None]
        normal = np.where(chosen, above.normal, below.normal)
        # Behind a hole the surface may face the other way: that is not the one that was meant.
        towards = np.einsum("ij,ij->i", normal, normals)[:, None]
        self.normal: Floats = np.where(hit & (towards > 0.2), normal, normals)
        self.uv: Floats = np.where(hit, np.where(chosen, above.uv, below.uv), 0.0)
        self.color: Floats = np.where(hit, np.where(chosen, above.color, below.color), -1.0)
        self.label: Ints = np.where(
            hit[:, 0], np.where(nearer, above.label, below.label), -1
        ).astype(np.int64)


def weld(name: str, vertices: Floats, faces: Ints, normals: Floats, uv: Floats) -> Shape:
    """Return triangles as a shape, with corners that are alike joined.

    Parameters
    ----------
    normals, uv
        (3 T, 3) and (3 T, 2) of the corners.
    """
    at = faces.ravel()
    wide = np.abs(uv).max(initial=1.0)
    key = np.column_stack([at, np.rint(50.0 * normals), np.rint(500.0 / wide * uv)])
    _, first, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(-1)
    count = np.bincount(number)[:, None]
    mean = np.zeros((len(first), 5))
    np.add.at(mean, number, np.column_stack([normals, uv]))
    mean /= count
    length = np.linalg.norm(mean[:, :3], axis=1, keepdims=True)
    straight = np.where(length > 0.0, mean[:, :3] / np.maximum(length, 1e-300), normals[first])
    return Shape(name, vertices[at[first]], straight, mean[:, 3:], number.reshape(-1, 3))
