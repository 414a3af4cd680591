"""Mesh files: OBJ, PLY, STL and GLB as arrays of vertices and polygons."""

from pcsg.meshfile.mesh import Mesh, MeshFileError
from pcsg.meshfile.read import read_mesh

__all__ = ["Mesh", "MeshFileError", "read_mesh"]
