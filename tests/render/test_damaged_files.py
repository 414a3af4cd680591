"""Pictures, checkpoints and tiles that are damaged, or somebody else's: told, never trusted."""

import io
import os
import zipfile

import numpy as np
import pytest
from PIL import Image as Pillow
from spheres import Spheres

import pcsg
from pcsg.errors import EnvironmentFault, PcsgError, UsageError
from pcsg.graph.settings import SETTINGS
from pcsg.render.checkpoint import join_tiles, resume, write_checkpoint, write_tile
from pcsg.render.job import Job
from pcsg.render.options import Options
from pcsg.render.pictures import read_linear, read_values
from pcsg.render.sky import make_sky

RADIANCE = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"


@pytest.mark.parametrize(
    ("rest", "word"),
    [
        (b"-Y 999999999 +X 0\n", "without pixels"),  # took for ever
        (b"-Y 0 +X 5\n", "without pixels"),
        (b"-Y 999999999 +X 999999999\n", "too many"),
        (b"-Y 20000 +X 20000\n", "too many"),
        (b"-Y 4000 +X 4000\n", "too early"),
        (b"-Y -5 +X 5\n", "how large"),
        (b"-Y 1e3 +X 5\n", "how large"),
        (b"-Y " + b"9" * 5000 + b" +X 5\n", "order"),
        (b"", "order"),
        # Runs that end behind the row, or never.
        (b"-Y 1 +X 8\n\2\2\0\x08" + b"\xff\1" * 4, "does not end"),
        (b"-Y 1 +X 8\n\2\2\0\x08" + b"\0\1" * 20, "does not end"),
        (b"-Y 1 +X 8\n\2\2\0\x08" + (b"\x09" + b"1" * 9) * 4, "does not end"),
        (b"-Y 2 +X 8\n" + b"1" * 32 + b"\2\2\0", "too early"),
        (b"-Y 1 +X 8\n\2\2\0\x08" + b"\x88\1" * 3 + b"\x08" + b"1" * 5, "too early"),
    ],
)
def test_radiance_pictures_that_are_none(tmp_path, rest, word):
    path = tmp_path / "a.hdr"
    path.write_bytes(RADIANCE + rest)
    with pytest.raises(UsageError, match=word):
        read_linear(path)


def png(pixels=None, **options):
    file = io.BytesIO()
    pixels = np.full((9, 7, 3), 128, np.uint8) if pixels is None else pixels
    Pillow.fromarray(pixels).save(file, **{"format": "PNG", **options})
    return file.getvalue()


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a"])
@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x89PNG\r\n\x1a\n",
        png()[:50],
        png()[:16] + b"\xff\xff\xff\xff" + png()[20:],
        png().replace(b"IDAT", b"IDAX"),
        png(format="JPEG")[:300],
        png(format="TIFF")[:50],
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n(secret) run\n",
    ],
)
def test_pictures_that_are_none(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    for read in (read_linear, read_values):
        with pytest.raises(UsageError, match=name):
            read(path)


def test_a_picture_much_larger_than_its_file_is_not_unpacked(tmp_path):
    path = tmp_path / "a.png"
    Pillow.new("1", (10_000, 9_000)).save(path)
    with pytest.raises(UsageError, match="10000 x 9000 pixels in"):
        read_values(path)


def test_colours_of_small_pictures_are_as_written(tmp_path):
    grey = np.arange(256, dtype=np.uint8).reshape(16, 16)
    (tmp_path / "a.png").write_bytes(png(grey))
    assert read_values(tmp_path / "a.png")[..., 1] == pytest.approx(grey / 255, abs=1e-7)
    deep = np.arange(0, 65536, 257, dtype=np.uint16).reshape(16, 16)
    (tmp_path / "b.png").write_bytes(png(deep))
    assert read_values(tmp_path / "b.png")[..., 1] == pytest.approx(deep / 65535, abs=1e-7)


def write_exr(path, pixels):
    library = pytest.importorskip("OpenEXR", reason="the extra exr is not installed")
    header = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage}
    library.File(header, {"RGB": np.ascontiguousarray(pixels, np.float32)}).write(str(path))


def test_damaged_exr_bodies_are_refused(tmp_path):
    path = tmp_path / "a.exr"
    write_exr(path, np.linspace(0, 1, 64 * 64 * 3).round(1).reshape(64, 64, 3))
    data = path.read_bytes()
    whole = read_linear(path)
    refused = 0
    for at in range(len(data) - 400, len(data), 3):
        path.write_bytes(data[:at] + bytes([data[at] ^ 16]) + data[at + 1 :])
        try:
            assert np.array_equal(read_linear(path), whole)
        except UsageError:
            refused += 1
    assert refused > 120
    for cut in (0, 10, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:cut])
        with pytest.raises(UsageError, match="damaged"):
            read_linear(path)


def sky_of(path, **values):
    defaults = {key: k.default for key, k in SETTINGS["sky"].keys.items()}
    return make_sky({**defaults, "kind": "image", "file": str(path), **values}, (0.0, 0.0, 1.0))


def test_light_that_is_none_is_mended(tmp_path):
    pixels = np.ones((16, 32, 3))
    pixels[3, 4] = np.nan
    pixels[5, 6] = np.inf
    pixels[7, 8] = -3.0
    pixels[0, 0] = 9.0
    write_exr(tmp_path / "sky.exr", pixels)
    found = read_linear(tmp_path / "sky.exr")
    assert found[3, 4].tolist() == found[7, 8].tolist() == [0, 0, 0]
    assert found[5, 6].tolist() == [9, 9, 9]
    scene = pcsg.loads("sphere ground { z = -1 }")
    sky = {"kind": "image", "file": str(tmp_path / "sky.exr")}
    image = pcsg.render(scene, (12, 10), 4, sky=sky, film={"mode": "path"})
    assert np.isfinite(image.rgb).all() and image.rgb.max() > 0.1


def test_a_sky_brighter_than_any_is_told(tmp_path):
    (tmp_path / "a.png").write_bytes(png())
    with pytest.raises(UsageError, match="brighter than any"):
        sky_of(tmp_path / "a.png", strength=1e300)


def make(**options):
    return Job(Spheres(), Options(**{"size": (40, 30), "samples": 4, "threads": 1, **options}))


@pytest.fixture
def kept(tmp_path):
    """Return the checkpoint of a picture that was stopped in its second pass."""
    job = make()

    def stop(progress):
        if progress.pass_number == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        job.run(stop)
    path = tmp_path / "a.checkpoint"
    write_checkpoint(job, path)
    assert resume(make(), path)
    return path


def changed(path, **arrays):
    """Change arrays of an archive; None leaves one out."""
    with np.load(path) as archive:
        found = {**dict(archive), **arrays}
    with path.open("wb") as file:
        np.savez(file, **{k: v for k, v in found.items() if v is not None})


@pytest.mark.parametrize(
    "arrays",
    [
        {"total": None},
        {"taken": None},
        {"done": None},
        {"pixels": None},
        {"description": None},
        {"taken": np.array(3)},
        {"taken": np.array(-1)},
        {"taken": np.array(4)},
        {"taken": np.array([1])},
        {"taken": np.array(1.0)},
        {"work": np.array([np.nan, 0, 0])},
        {"work": np.array([-1.0, 0, 0])},
        {"work": np.array([1e300, 0, 0])},
        {"total": np.zeros((1, 1, 3), np.float32)},
        {"total": np.zeros((30, 40, 3))},
        {"total": np.full((30, 40, 3), np.nan, np.float32)},
        {"depth": np.full((30, 40), np.nan, np.float32)},
        {"tone": np.full((30, 40), 1e25, np.float32)},
        {"tone2": np.full((30, 40), -1, np.float32)},
        {"count": np.full((30, 40), -1, np.int32)},
        {"count": np.full((30, 40), 5, np.int32)},
        {"pixels": np.array([0, 1200])},
        {"pixels": np.array([-1, 0])},
        {"pixels": np.arange(1201)},
        {"done": np.zeros(7, bool)},
        {"description": np.frombuffer(b"[]", np.uint8)},
        {"description": np.frombuffer(b'{"a": 1}', np.uint8)},
        {"description": np.frombuffer(b"[" * 5_000, np.uint8)},
        {"description": np.array(["a"], object)},
    ],
)
def test_checkpoints_that_are_none(kept, arrays):
    changed(kept, **arrays)
    with pytest.raises(UsageError, match="damaged; delete it"):
        resume(make(), kept)


def test_a_packed_checkpoint_is_not_unpacked(kept):
    with zipfile.ZipFile(kept) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["total.npy"] += bytes(100_000_000)
    with zipfile.ZipFile(kept, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    assert kept.stat().st_size < 1_000_000
    with pytest.raises(UsageError, match="damaged"):
        resume(make(), kept)


def test_a_header_that_asks_for_too_much_gets_none(kept):
    data = kept.read_bytes()
    assert b"(30, 40, 3)" in data
    kept.write_bytes(data.replace(b"(30, 40, 3)", b"(9999999,9)"))
    with pytest.raises(UsageError, match="damaged"):
        resume(make(), kept)


def test_every_bit_of_a_checkpoint_counts(kept):
    data = kept.read_bytes()
    rng = np.random.default_rng(3)
    for at in rng.integers(0, len(data), 200).tolist():
        kept.write_bytes(data[:at] + bytes([data[at] ^ 1 << int(rng.integers(8))]) + data[at + 1 :])
        job = make()
        try:
            resume(job, kept)
        except PcsgError:
            continue
        job.run()
        job.image().to_bytes()


def test_tiles_that_are_none(tmp_path):
    output = tmp_path / "a.png"
    paths = []
    for part in (1, 2):
        job = make(tile=(part, 2))
        job.run()
        paths.append(write_tile(job, output))
    image, _ = join_tiles(job, output)
    assert image.rgb.shape == (30, 40, 3)
    good = paths[0].read_bytes()
    for arrays in (
        {"rgb": None},
        {"rgb": np.zeros((15, 41, 3), np.float32)},
        {"rgb": np.full((15, 40, 3), np.inf, np.float32)},
        {"rgb": np.full((15, 40, 3), 3e38, np.float32)},
        {"finished": np.zeros((15, 40))},
    ):
        changed(paths[0], **arrays)
        with pytest.raises(UsageError, match="damaged"):
            join_tiles(job, output)
        paths[0].write_bytes(good)
    paths[0].write_bytes(good[:1000])
    with pytest.raises(UsageError, match="damaged"):
        join_tiles(job, output)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
def test_pipes_are_not_waited_for(tmp_path):
    for name in ("a.hdr", "a.exr", "a.png", "a.checkpoint"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(UsageError, match="ordinary"):
        resume(make(), tmp_path / "a.checkpoint")
    for name in ("a.hdr", "a.exr", "a.png"):
        with pytest.raises((UsageError, EnvironmentFault), match=r"ordinary|OpenEXR"):
            read_linear(tmp_path / name)
