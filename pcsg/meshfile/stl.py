"""STL, binary and as text: triangles without shared vertices.

Format: 3D Systems, "Stereolithography Interface Specification", 1989. Normals of facets are
ignored, as is usual: they follow from the order of the vertices.
"""

from __future__ import annotations

import numpy as np

from pcsg.meshfile.mesh import Floats, Mesh, MeshFileError, make_mesh

_HEADER, _FACET = 84, 50


def read_stl(name: str, data: bytes) -> Mesh:
    """Read an STL file; `name` is for messages."""
    count = int.from_bytes(data[80:84], "little") if len(data) >= _HEADER else -1
    # Some programs write `solid` into the header of binary files, so the size decides.
    is_binary = len(data) == _HEADER + _FACET * count
    is_text = data.lstrip()[:5].lower() == b"solid" and b"vertex" in data
    if is_text and not is_binary:
        points = _read_text(name, data)
    else:
        points = _read_binary(name, data, count)
    corners = np.arange(len(points))
    return make_mesh(points, corners, np.arange(0, len(points) + 1, 3))


def _read_binary(name: str, data: bytes, count: int) -> Floats:
    if count < 0:
        reason = f"a binary STL file has at least {_HEADER} bytes, this one has {len(data)}"
        raise MeshFileError(name, None, reason)
    wanted = _HEADER + _FACET * count
    if len(data) < wanted:
        reason = f"the file ends; its {count} facets need {wanted} bytes"
        raise MeshFileError(name, f"byte {len(data)}", reason)
    facet = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("about", "<u2")])
    facets = np.frombuffer(data, facet, count, _HEADER)
    with np.errstate(invalid="ignore"):
        points: Floats = facets["points"].reshape(-1, 3).astype(np.float64)
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(wrong):
        at = _HEADER + _FACET * (int(wrong[0]) // 3)
        raise MeshFileError(name, f"byte {at}", "a vertex needs finite numbers")
    return points


def _read_text(name: str, data: bytes) -> Floats:
    points: list[tuple[float, ...]] = []
    in_loop = -1
    for number, line in enumerate(data.splitlines(), 1):
        words = line.lower().split()
        if words[:1] == [b"vertex"]:
            try:
                values = tuple(map(float, words[1:4]))
            except ValueError:
                values = ()
            if len(values) != 3 or not np.isfinite(values).all():
                raise MeshFileError(name, f"line {number}", "a vertex needs three finite numbers")
            points.append(values)
            in_loop += 1
        elif words[:2] == [b"outer", b"loop"]:
            in_loop = 0
        elif words[:1] == [b"endloop"]:
            if in_loop != 3:
                reason = f"a facet needs three vertices, not {max(in_loop, 0)}"
                raise MeshFileError(name, f"line {number}", reason)
            in_loop = -1
    if in_loop >= 0 or len(points) % 3:
        raise MeshFileError(name, f"line {data.count(10) + 1}", "the file ends inside a facet")
    return np.array(points, np.float64).reshape(-1, 3)
