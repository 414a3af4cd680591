"""Files as other programs write them, each with what is right: solid or sheet, area, volume, notes.

Where trimesh reads a file its areas are the same, but for what it does not look at: bridges to
holes, concave polygons, hidden corners, instances.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from pcsg.errors import UsageError
from pcsg.leaf.mesh import MeshModel
from pcsg.meshfile import read_mesh

CASES = Path(__file__).parent / "cases"
TETRAHEDRON = 1.5 + 0.75**0.5


class Right(NamedTuple):
    """What is right of a file; colours are linear."""

    closed: bool
    area: float
    volume: float = 0.0
    note: str = ""
    color: tuple[float, float, float] | None = None


SOLID = Right(True, TETRAHEDRON, 1.0 / 6.0)
RED = SOLID._replace(color=(1.0, 0.0, 0.0))
RIGHT = {
    "nearzero.stl": SOLID._replace(note="joined: corners that differ by rounding (1 of 5)"),
    "ulp.stl": SOLID._replace(note="joined: corners that differ by rounding (1 of 5)"),
    "flip1.stl": SOLID._replace(note="turned round: facets (1 of 4)"),
    "ascii_upper.stl": SOLID,
    "ascii_oneline.stl": SOLID,
    "ascii_two.stl": SOLID,
    "solidhead.stl": SOLID,
    "bom.obj": SOLID,
    "utf16.obj": SOLID,
    "hole_bridge.obj": Right(False, 12.0),
    "bow.obj": Right(False, 4.0, note="cut as they come: polygons that cross themselves (1)"),
    "concave.obj": Right(False, 10.0),
    "crlf_cont.obj": Right(False, 1.0),
    "rgb255.obj": Right(False, 0.5, color=(1.0, ((128 / 255 + 0.055) / 1.055) ** 2.4, 0.0)),
    "nancol.obj": Right(False, 0.5, note="left out: colours that are not finite (line 2)"),
    "vt_nan.obj": Right(False, 0.5, note="left out: texture coordinates of corners that are not"),
    "missing_vt.obj": Right(False, 0.5, note="name a `vt` which is not there (3, the first: line"),
    "forward.obj": Right(False, 0.5),
    "dupcorner.obj": Right(False, 4.0),
    "edge_nan.ply": SOLID._replace(note="left out: vertices that are not finite (vertex 4)"),
    "point_face.ply": SOLID._replace(note="left out: faces of fewer than three corners (face 4)"),
    "zero_face.ply": SOLID._replace(note="left out: faces of fewer than three corners (face 4)"),
    "wrapped.ply": SOLID,
    "be.ply": SOLID,
    "dark.ply": SOLID._replace(color=(1 / 255 / 12.92, 0.0, 0.0)),
    "ushortcol.ply": RED,
    "diffuse.ply": RED,
    "facecolor.ply": RED,
    "tristrips.ply": Right(False, 1.0),
    "matreq.glb": SOLID,
    "webp.glb": SOLID,
    "datauri.glb": SOLID,
    "u8.glb": SOLID,
    "nest.glb": Right(True, 4.0 * TETRAHEDRON, 8.0 / 6.0),
    "sparse.glb": Right(True, 1.5 * 11**0.5 + 0.75**0.5, 4.0 / 6.0),
    "morphsparse.glb": SOLID,
    "nopos.glb": SOLID._replace(note="left out: primitives without positions (mesh 0, primitive 1"),
    "gpuinst.glb": Right(True, 4.0 * TETRAHEDRON, 4.0 / 6.0),
}
REFUSED = {
    "draco.glb": "needs the extension KHR_draco_mesh_compression, which is not supported",
    "zero.glb": "no polygons",
}


def measures(model: MeshModel) -> tuple[float, float]:
    """Return area and volume."""
    a, b, c = (model.polygons.vertices[model.triangles[:, k]] for k in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)
    return area, float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def test_every_file_is_told_of() -> None:
    assert {p.name for p in CASES.iterdir()} == {*RIGHT, *REFUSED}


@pytest.mark.parametrize("name", RIGHT)
def test_files_of_others(name: str) -> None:
    model = MeshModel(read_mesh(CASES / name))
    right = RIGHT[name]
    assert model.closed == right.closed
    area, volume = measures(model)
    assert area == pytest.approx(right.area, rel=1e-6)
    if right.closed:
        assert volume == pytest.approx(right.volume, rel=1e-6)
    assert right.note in "; ".join(model.notes)
    assert bool(right.note) == bool(model.notes)
    if right.color is not None:
        colors = model.polygons.corner_colors
        assert colors is not None
        assert np.allclose(colors[-1 if name == "rgb255.obj" else slice(None)], right.color)


@pytest.mark.parametrize("name", REFUSED)
def test_files_that_cannot_be_read(name: str) -> None:
    with pytest.raises(UsageError, match=REFUSED[name]):
        read_mesh(CASES / name)


@pytest.mark.parametrize("name", ["hole_bridge.obj", "concave.obj", "tristrips.ply", "flip1.stl"])
def test_triangles_cover_their_polygons_once(name: str) -> None:
    """What looks at a sheet from above meets it once, and a hole not at all."""
    model = MeshModel(read_mesh(CASES / name))
    corners = model.polygons.vertices[model.triangles][:, :, :2]
    for x, y in np.random.default_rng(3).uniform(0.0, 4.0, (200, 2)):
        a, b, c = (corners[:, k] - (x, y) for k in range(3))
        sides = [u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] for u, v in ((a, b), (b, c), (c, a))]
        over = (np.sign(sides[0]) == np.sign(sides[1])) & (np.sign(sides[1]) == np.sign(sides[2]))
        met = int(over.sum())
        if name == "flip1.stl":
            assert met == (2 if x + y < 1.0 else 0)
        elif name == "tristrips.ply":
            assert met == (x < 1.0 and y < 1.0)
        elif name == "hole_bridge.obj":
            assert met == (not (1.0 < x < 3.0 and 1.0 < y < 3.0))
        else:
            assert met == (y < 1.0 + 1.5 * abs(x - 2.0))
