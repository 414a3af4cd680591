"""Noise taken out by a library that may be missing."""

import sys
import types

import numpy as np
import pytest
from spheres import Spheres
from typer.testing import CliRunner

import pcsg
from pcsg.cli import app
from pcsg.errors import EnvironmentFault

GRAMMAR = "{} (sphere | move(0, 0, -1) scale(3, 3, 1) box)"


def picture(samples=4):
    return pcsg.render(Spheres(), size=(64, 48), samples=samples, film={"mode": "path"})


def test_noise_becomes_less():
    pytest.importorskip("pyoidn", reason="the extra denoise is not installed")
    noisy, clear = picture(1), picture(256)
    cleaned = noisy.denoised()
    error = [
        np.square(x.to_bytes().astype(float) - clear.to_bytes()).mean() for x in (noisy, cleaned)
    ]
    assert error[1] < 0.5 * error[0]
    assert "pcsg:denoised" in cleaned.metadata
    np.testing.assert_array_equal(cleaned.rgb, noisy.denoised().rgb)


@pytest.fixture
def library(monkeypatch):
    """Put a library in the place of the real one; what it was asked is in `calls`."""
    fake = types.ModuleType("pyoidn")
    fake.calls = []

    def denoise(color, albedo, normal, *, hdr):
        fake.calls.append((color, albedo, normal, hdr))
        return color / 2

    fake.denoise = denoise
    monkeypatch.setitem(sys.modules, "pyoidn", fake)
    return fake


def test_what_the_library_gets(library):
    image = picture(1)
    cleaned = image.denoised()
    np.testing.assert_array_equal(cleaned.rgb, image.rgb / 2)
    ((color, albedo, normal, hdr),) = library.calls
    assert hdr
    assert color.dtype == albedo.dtype == normal.dtype == np.float32
    np.testing.assert_array_equal(normal, image.normal)
    assert 0 <= albedo.min() <= albedo.max() <= 1


def test_a_part_of_a_picture_is_left_as_it_is(library):
    image = picture(1)
    image.finished[0, 0] = False
    assert image.denoised() is image
    assert not library.calls


def test_what_the_library_says_is_told(library):
    def fail(*arguments, **options):
        raise RuntimeError("no such device")

    library.denoise = fail
    with pytest.raises(EnvironmentFault, match="no such device"):
        picture(1).denoised()


def test_without_the_library_nothing_is_begun(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    (tmp_path / "a.pcsg").write_text(GRAMMAR)
    result = CliRunner().invoke(app, ["render", "a.pcsg", "--size", "24x18", "--denoise"])
    assert result.exit_code == 1
    assert "pip install '.[denoise]'" in result.output
    assert not (tmp_path / "a.png").exists()


def test_the_command_takes_noise_out(tmp_path, monkeypatch, library):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.pcsg").write_text(GRAMMAR)
    result = CliRunner().invoke(
        app, ["render", "a.pcsg", "--size", "24x18", "--samples", "1", "--denoise", "-q"]
    )
    assert result.exit_code == 0, result.output
    assert len(library.calls) == 1
    for part in ("1/2", "2/2"):
        arguments = ["render", "a.pcsg", "--size", "24x18", "--tile", part, "--denoise", "-q"]
        assert CliRunner().invoke(app, [*arguments, "-o", "b.png"]).exit_code == 0
    assert len(library.calls) == 2  # the joined picture only
    assert library.calls[1][0].shape == (18, 24, 3)
