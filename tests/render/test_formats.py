"""Files against libraries that were not used to write them."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image as Pillow

import pcsg
from pcsg.errors import UsageError
from pcsg.render.formats import write_png
from pcsg.render.pictures import read_linear, read_values


@pytest.mark.parametrize("channels", [3, 4])
def test_png_of_8_bits_is_what_pillow_reads(channels):
    pixels = np.random.default_rng(1).integers(0, 256, (13, 7, channels)).astype(np.uint8)
    file = io.BytesIO()
    write_png(file, pixels, {"Title": "plain", "Author": "Bärbel"})
    with Pillow.open(io.BytesIO(file.getvalue())) as found:
        assert np.array_equal(np.asarray(found), pixels)
        assert found.text == {"Title": "plain", "Author": "Bärbel"}


def test_png_of_16_bits_keeps_them():
    pixels = np.random.default_rng(2).integers(0, 65536, (6, 5, 3)).astype(np.uint16)
    file = io.BytesIO()
    write_png(file, pixels, {})
    data = file.getvalue()
    assert data[24] == 16
    # Pillow reads the upper bytes only; the rest is undone here as the format defines it.
    with Pillow.open(io.BytesIO(data)) as found:
        assert np.array_equal(np.asarray(found), (pixels >> 8).astype(np.uint8))
    rows = np.frombuffer(zlib.decompress(chunk(data, b"IDAT")), np.uint8).reshape(6, 31)
    assert len(set(rows[:, 0])) > 1
    undone = np.zeros((6, 30), int)
    for y, x in np.ndindex(6, 30):
        a = undone[y, x - 6] if x >= 6 else 0
        b = undone[y - 1, x] if y else 0
        c = undone[y - 1, x - 6] if y and x >= 6 else 0
        near = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
        told = (0, a, b, (a + b) // 2, near)[rows[y, 0]]
        undone[y, x] = (int(rows[y, x + 1]) + told) % 256
    assert np.array_equal(undone.astype(np.uint8).view(">u2").reshape(6, 5, 3), pixels)


def chunk(data, wanted):
    at = 8
    while True:
        length, name = struct.unpack(">I4s", data[at : at + 8])
        if name == wanted:
            return data[at + 8 : at + 8 + length]
        at += length + 12


def image():
    scene = pcsg.loads("label(7) move(0,0,1) sphere  ground { z = 0 }")
    return pcsg.render(scene, size=(24, 18), samples=4)


def test_bits_of_a_picture(tmp_path):
    made = image()
    made.save(tmp_path / "a.png", bits=16)
    with Pillow.open(tmp_path / "a.png") as found:
        assert np.abs(np.asarray(found).astype(int) - made.to_bytes()).max() <= 1
    with pytest.raises(UsageError, match="bits"):
        made.save(tmp_path / "b.png", bits=12)


def test_exr_holds_linear_light_and_layers(tmp_path):
    library = pytest.importorskip("OpenEXR", reason="the extra exr is not installed")
    made = image()
    assert made.save(tmp_path / "a.exr", ["depth", "normal", "label", "leaf", "albedo"]) == [
        tmp_path / "a.exr"
    ]
    with library.File(str(tmp_path / "a.exr")) as file:
        channels = file.channels()
        assert file.header()["pcsg:size"] == "24x18"
        assert np.array_equal(channels["RGB"].pixels, made.rgb)
        assert np.array_equal(channels["Z"].pixels, made.depth)
        assert np.array_equal(channels["label"].pixels, made.label)
        assert np.array_equal(channels["leaf"].pixels, made.leaf)
        names = set(channels)
        assert {"normal", "albedo"} <= {n.split(".")[0] for n in names}
    np.testing.assert_array_equal(read_linear(tmp_path / "a.exr"), made.rgb)


def radiance_file(pixels, runs):
    """Return a picture in Ward's format, written as he describes it."""
    height, width = pixels.shape[:2]
    exponent = np.ceil(np.log2(pixels.max(axis=2))).astype(int)
    mantissa = np.floor(pixels * 2.0 ** (8 - exponent)[..., None]).clip(0, 255).astype(np.uint8)
    quads = np.concatenate([mantissa, (exponent + 128).astype(np.uint8)[..., None]], axis=2)
    body = b""
    for row in quads:
        if not runs:
            body += row.tobytes()
            continue
        body += bytes([2, 2, width >> 8, width & 255])
        for channel in range(4):
            values = row[:, channel]
            body += bytes([128 + 3, values[0]]) if (values[:3] == values[0]).all() else b""
            start = 3 if (values[:3] == values[0]).all() else 0
            for x in range(start, width, 100):
                part = values[x : x + 100].tobytes()
                body += bytes([len(part)]) + part
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + f"-Y {height} +X {width}\n".encode()
    return head + body


@pytest.mark.parametrize("runs", [False, True])
def test_radiance_pictures(tmp_path, runs):
    pixels = np.random.default_rng(4).uniform(0.02, 30, (5, 140, 3))
    pixels[:, :5] = 2.5
    (tmp_path / "a.hdr").write_bytes(radiance_file(pixels, runs))
    found = read_linear(tmp_path / "a.hdr")
    assert np.abs(found - pixels).max() <= pixels.max() / 128
    np.testing.assert_allclose(found.max(axis=2), pixels.max(axis=2), rtol=1 / 120)
    (tmp_path / "b.hdr").write_bytes(radiance_file(pixels, runs)[:-50])
    with pytest.raises(UsageError, match="too early"):
        read_linear(tmp_path / "b.hdr")


def test_ordinary_pictures_are_made_linear(tmp_path):
    Pillow.fromarray(np.full((2, 2), 128, np.uint8)).save(tmp_path / "grey.png")
    assert read_values(tmp_path / "grey.png") == pytest.approx(128 / 255)
    assert read_linear(tmp_path / "grey.png") == pytest.approx(0.2158605, rel=1e-5)
    (tmp_path / "no.png").write_bytes(b"nothing")
    with pytest.raises(UsageError, match="not a picture"):
        read_linear(tmp_path / "no.png")
