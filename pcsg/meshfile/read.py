"""From a path to a mesh: the reader by the end of the name, and what holds for every format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pcsg.inputs import read_bytes
from pcsg.meshfile.glb import read_glb
from pcsg.meshfile.mesh import Mesh, MeshFileError
from pcsg.meshfile.obj import read_obj
from pcsg.meshfile.ply import read_ply
from pcsg.meshfile.stl import read_stl

READERS: dict[str, Callable[[str, bytes], Mesh]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".glb": read_glb,
}
"""Readers by the end of the file's name; they take the name for messages, and the bytes."""


def read_mesh(path: str | Path) -> Mesh:
    """Read a mesh.

    Parameters
    ----------
    path
        A file that ends in ``.obj``, ``.ply``, ``.stl`` or ``.glb``. Coordinates are taken as they
        are: axes are not turned and units not changed. In GLB the transformations of the nodes
        are applied.

    Raises
    ------
    MeshFileError
        The file is damaged, holds no polygons, or is of another kind.
    UsageError, EnvironmentFault
        It cannot be read: see `pcsg.inputs`.
    """
    path = Path(path)
    name = str(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(READERS)
        raise MeshFileError(name, None, f"the name of a mesh file ends in one of {known}")
    mesh = reader(name, read_bytes(path, "mesh"))
    if not mesh.polygon_count:
        raise MeshFileError(name, None, "; ".join(("no polygons", *mesh.notes)))
    return mesh
