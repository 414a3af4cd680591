"""Height fields: files and arrays as closed solids, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import pcsg
from pcsg.errors import GrammarError, PcsgError, UsageError
from pcsg.grammar import check_text
from pcsg.leaf.heightfield import heightfield_mesh, read_heights

HEIGHTS = np.random.default_rng(0).random((5, 7))


def volume_below(heights: Any) -> float:
    """The volume down to the floor: over each half of a cell the mean of three corners."""
    floor = heights.min() - 0.1 * np.ptp(heights)
    a, b, c, d = heights[:-1, :-1], heights[1:, :-1], heights[1:, 1:], heights[:-1, 1:]
    cell = 4.0 / (heights.shape[0] - 1) / (heights.shape[1] - 1)
    return float(((a + b + c) / 6.0 + (a + c + d) / 6.0 - floor).sum() * cell)


def test_it_is_closed_and_has_the_volume_below_its_heights() -> None:
    mesh = heightfield_mesh(HEIGHTS)
    assert mesh.closed and mesh.notes == ()
    a, b, c = np.moveaxis(mesh.polygons.vertices[mesh.triangles], 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(volume_below(HEIGHTS))


def test_rays_from_above_meet_the_heights() -> None:
    scene = pcsg.Scene(pcsg.heightfield(HEIGHTS))
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 7)[1:-1], np.linspace(1.0, -1.0, 5)[1:-1])
    origins = np.stack([x.ravel(), y.ravel(), np.full(x.size, 9.0)], axis=1)
    hits = scene.intersect(origins, np.tile([0.0, 0.0, -1.0], (x.size, 1)))
    np.testing.assert_allclose(9.0 - hits.t, HEIGHTS[1:-1, 1:-1].ravel(), atol=1e-14)
    np.testing.assert_allclose(hits.uv, 0.5 + 0.5 * origins[:, :2], atol=1e-13)
    assert (hits.normal[:, 2] > 0.0).all()
    assert scene.contains(origins * (1, 1, 0)).all()
    assert scene.contains([[0.0, 0.0, HEIGHTS.min() - 0.2]]).sum() == 0


def test_pictures_and_arrays_say_the_same(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", HEIGHTS)
    deep = np.round(HEIGHTS * 65535.0)
    Image.fromarray(deep.astype(np.uint16)).save(tmp_path / "deep.png")
    Image.fromarray(deep.astype(np.uint16)).save(tmp_path / "deep.tif")
    Image.fromarray(HEIGHTS.astype(np.float32)).save(tmp_path / "real.tif")
    grey = Image.fromarray(np.round(HEIGHTS * 255.0).astype(np.uint8))
    grey.save(tmp_path / "grey.png")
    grey.convert("RGB").save(tmp_path / "colour.png")
    Image.fromarray(HEIGHTS > 0.5).save(tmp_path / "bits.png")
    np.testing.assert_array_equal(read_heights(tmp_path / "a.npy"), HEIGHTS)
    for name, step in (("deep.png", 1e-5), ("deep.tif", 1e-5), ("real.tif", 1e-7)):
        np.testing.assert_allclose(read_heights(tmp_path / name), HEIGHTS, atol=step)
    for name in ("grey.png", "colour.png"):
        np.testing.assert_allclose(read_heights(tmp_path / name), HEIGHTS, atol=0.002)
    np.testing.assert_array_equal(read_heights(tmp_path / "bits.png"), HEIGHTS > 0.5)


def test_engines_agree_and_the_text_comes_back(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", HEIGHTS)
    file = tmp_path / "land.pcsg"
    file.write_text('{} (rotx(20) heightfield("a.npy") \\ move(0.5, 0, 0.5) uscale(0.6) sphere)\n')
    states, walked = pcsg.load(file, engine="states"), pcsg.load(file, engine="cyclic")
    assert 'heightfield("a.npy")' in states.to_pcsg()
    rng = np.random.default_rng(3)
    origins = rng.uniform(-2.0, 2.0, (300, 3))
    directions = rng.uniform(-1.0, 1.0, (300, 3)) - origins
    a, b = (s.spans(origins, directions) for s in (states, walked))
    np.testing.assert_array_equal(a.offsets, b.offsets)
    np.testing.assert_allclose(a.t_in, b.t_in, atol=1e-13)
    assert len(a.t_in) > 60


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (np.zeros((1, 5)), "at least 2 x 2"),
        (np.zeros((2000, 2000)), "make it smaller"),
        (np.zeros(5), "rows and columns"),
        (np.array([[0.0, 1.0], [np.nan, 0.0]]), "row 2, column 1"),
        ([["a", "b"], ["c", "d"]], "heightfield"),
    ],
)
def test_what_are_no_heights_is_told(heights: Any, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        pcsg.heightfield(heights)


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.npy"])
def test_spoilt_files_are_told(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name.endswith("npy"):
        np.save(path, HEIGHTS)
    else:
        Image.fromarray(np.zeros((9, 9), np.uint16)).save(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(7)
    refused = 0
    for _ in range(150):
        data = bytearray(whole[: int(rng.integers(1, len(whole) + 1))])
        for _ in range(int(rng.integers(0, 4))):
            data[int(rng.integers(len(data)))] = int(rng.integers(256))
        path.write_bytes(bytes(data))
        try:
            read_heights(path)
        except PcsgError:
            refused += 1
    assert refused > 20


def test_files_of_other_kinds_and_missing_ones_are_told_at_their_place() -> None:
    with pytest.raises(GrammarError, match=r"\.png, \.tif and \.npy"):
        pcsg.loads('heightfield("land.pcsg")')
    assert [p.code for p in check_text('box | heightfield("no.png")')[1]] == ["bad-file"]
    (problem,) = check_text("box | heightfield")[1]
    assert problem.code == "wrong-arguments"


@pytest.mark.parametrize(
    "text",
    [
        "{heightfield = 2} uscale(heightfield) sphere",
        "heightfield | box\nheightfield = sphere",
        "w: heightfield(2)\np: heightfield(n) -> uscale(n) sphere",
    ],
)
def test_its_name_stays_free(text: str) -> None:
    assert check_text(text)[1] == []
