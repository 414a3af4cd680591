"""STL, binary and as text: triangles without shared vertices.

Format: 3D Systems, "Stereolithography Interface Specification", 1989. Normals of facets are
ignored, as is usual: they follow from the order of the vertices. So are the colours that some
programs hide in the two bytes behind a facet, each in its own way.
"""

from __future__ import annotations

import re
from typing import NoReturn

import numpy as np

from pcsg.meshfile.mesh import Floats, Mesh, MeshFileError, Notes, checked_vertices, make_mesh
from pcsg.meshfile.words import as_utf8, line_of, shown

_HEADER, _FACET = 84, 50
_UNKNOWN_COUNTS = (0, 2**32 - 1)
"""What programs write that do not know the number of facets when they begin."""

_BEGIN_OF_LOOP = re.compile(rb"outer\s+loop\s+vertex\s", re.IGNORECASE)
# No expression begins with spaces: a search would try each of a long run of them.
_NUMBERS = rb"\s+(\S+)\s+(\S+)\s+(\S+)"
_TEXT_FACET = re.compile(
    rb"(?:facet(?:\s+normal\s+\S+\s+\S+\s+\S+)?\s+)?outer\s+loop"
    + 3 * (rb"\s+vertex" + _NUMBERS)
    + rb"\s+endloop(?:\s+endfacet)?(?=\s|$)",
    re.IGNORECASE,
)
# The name of a solid reaches to the end of its line, or to the first facet in it.
_HEAD = re.compile(
    rb"(?:end)?solid(?=\s|$)(?:(?!\s(?:facet\s+normal|endsolid)\s)[^\r\n])*|[#;][^\r\n]*",
    re.IGNORECASE,
)
_SPACE = re.compile(rb"\s*")
_WORD = re.compile(rb"\S+")


def read_stl(name: str, data: bytes) -> Mesh:
    """Read an STL file; `name` is for messages."""
    notes = Notes()
    count = int.from_bytes(data[80:84], "little") if len(data) >= _HEADER else -1
    # Some programs write `solid` into the header of binary files, so the size decides, and then
    # the words.
    if len(data) != _HEADER + _FACET * count:
        text = as_utf8(name, data)
        begins = text.lstrip()[:5].lower() == b"solid"
        if (begins and b"\0" not in text) or _BEGIN_OF_LOOP.search(text):
            return _read_text(name, text, notes)
    return _read_binary(name, data, count, notes)


def _mesh_of(points: Floats, notes: Notes) -> Mesh:
    corners = np.arange(len(points))
    return make_mesh(points, corners, np.arange(0, len(points) + 1, 3), notes=notes)


def _read_binary(name: str, data: bytes, count: int, notes: Notes) -> Mesh:
    if count < 0:
        reason = f"a binary STL file has at least {_HEADER} bytes, this one has {len(data)}"
        raise MeshFileError(name, None, reason)
    held, rest = divmod(len(data) - _HEADER, _FACET)
    if count in _UNKNOWN_COUNTS and held and not rest:
        notes.add(f"the header counts {count:,} facets, {held:,} are there", "byte 80")
        count = held
    elif held > count:
        notes.add(f"left out: what stands behind the {count:,} facets of the header", "byte 80")
    wanted = _HEADER + _FACET * count
    if len(data) < wanted:
        reason = f"the file ends; its {count} facets need {wanted} bytes"
        raise MeshFileError(name, f"byte {len(data)}", reason)
    facet = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("about", "<u2")])
    facets = np.frombuffer(data, facet, count, _HEADER)
    with np.errstate(invalid="ignore"):
        points: Floats = facets["points"].reshape(-1, 3).astype(np.float64)

    def place(k: int) -> str:
        return f"byte {_HEADER + _FACET * (k // 3)}"

    return _mesh_of(checked_vertices(name, points, np.arange(len(points)), place, notes), notes)


def _read_text(name: str, text: bytes, notes: Notes) -> Mesh:
    values: list[float] = []
    begins: list[int] = []
    at = _skip(text, 0)
    while at < len(text):
        found = _TEXT_FACET.match(text, at)
        if found is not None:
            try:
                values += map(float, found.groups())
            except ValueError:
                _explain(name, text, at)
            begins.append(at)
        else:
            found = _HEAD.match(text, at)
            if found is None:
                _explain(name, text, at)
        at = _skip(text, found.end())
    points = np.array(values, np.float64).reshape(-1, 3)

    def place(k: int) -> str:
        facet = _TEXT_FACET.match(text, begins[k // 3])
        return line_of(text, facet.start(1 + 3 * (k % 3)) if facet else 0)

    return _mesh_of(checked_vertices(name, points, np.arange(len(points)), place, notes), notes)


def _skip(text: bytes, at: int) -> int:
    """Return the first place that is no space."""
    space = _SPACE.match(text, at)
    return space.end() if space else at


def _explain(name: str, text: bytes, at: int) -> NoReturn:
    """Say what is wrong with the facet that begins at a place."""

    def fail(where: int, reason: str) -> NoReturn:
        raise MeshFileError(name, line_of(text, where), reason)

    vertices = 0
    numbers = 0
    last = at
    in_loop = False
    for found in _WORD.finditer(text, at):
        word = found.group().lower()
        if numbers:
            try:
                float(word)
            except ValueError:
                fail(last, "a vertex needs three finite numbers")
            numbers -= 1
            continue
        last = found.start()
        if word == b"vertex":
            vertices += 1
            numbers = 3
        elif word == b"loop":
            in_loop = True
        elif word == b"endloop" and vertices == 3:
            fail(at, "expected `facet normal x y z`, `outer loop`, three vertices and `endloop`")
        elif word == b"endloop" or (in_loop and word in (b"facet", b"endfacet", b"outer")):
            fail(last, f"a facet needs three vertices, not {vertices}")
        elif not in_loop and word not in (b"facet", b"outer") and last == at:
            fail(last, f"`{shown(found.group())}` does not belong here; expected a `facet`")
        elif in_loop:
            fail(last, f"`{shown(found.group())}` does not belong into a facet")
    if numbers:
        fail(last, "a vertex needs three finite numbers")
    fail(len(text), "the file ends inside a facet")
