"""Laser scans: echoes, densities, files, the verb."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import pcsg
from benchmarks.stands import LEAF, discs, normals_of
from pcsg import lidar
from pcsg.cli import app
from pcsg.errors import UsageError
from pcsg.lidar.echoes import RINGS, _offsets, pieces_of

NARROW = lidar.SCANNERS["vz400"].but(
    zenith=(89.95, 90.05), azimuth=(-0.1, 0.1), step=0.004, range_sd=0.0
)


def walls(behind: float) -> pcsg.Scene:
    """A wall at 50 m in the west, and one behind it in the east."""
    wall = pcsg.rotx(90) * pcsg.uscale(5) * pcsg.rectangle()
    return pcsg.Scene(
        pcsg.label(1) * pcsg.move(-5, 50, 0) * wall
        | pcsg.label(2) * pcsg.move(0, 50 + behind, 0) * wall
    )


def test_the_footprint_grows_with_the_divergence() -> None:
    for rays in RINGS:
        offsets = _offsets(rays, 0.15e-3)
        assert len(offsets) == rays
        assert np.allclose(offsets.sum(axis=0), 0.0, atol=1e-12)
        # The mean square radius of a disc is half the square of its own.
        if rays > 1:
            spread = np.sqrt(2.0 * (offsets**2).sum(axis=1).mean())
            assert 50.0 * 2.0 * spread == pytest.approx(0.015, rel=0.1 if rays == 7 else 0.02)


def test_two_walls_within_half_a_pulse_are_one_echo() -> None:
    near = lidar.scan(walls(0.5), NARROW, [(0, 0, 0)])
    assert near.returns.max() == 1
    mixed = (near.range > 50.01) & (near.range < 50.49)
    assert mixed.any()  # ghosts at the edge
    far = lidar.scan(walls(1.0), NARROW, [(0, 0, 0)])
    both = far.returns == 2
    assert both.any()
    assert np.allclose(far.range[both & (far.return_number == 1)], 50.0, atol=1e-3)
    assert np.allclose(far.range[both & (far.return_number == 2)], 51.0, atol=1e-3)
    assert np.allclose(far.share[both].reshape(-1, 2).sum(axis=1), 1.0)
    assert set(far.label[~both].tolist()) == {1, 2}


@pytest.mark.parametrize(("which", "label"), [("first", 1), ("last", 2)])
def test_first_or_last_echoes_only(which: str, label: int) -> None:
    multi = lidar.scan(walls(1.0), NARROW, [(0, 0, 0)])
    found = lidar.scan(walls(1.0), NARROW, [(0, 0, 0)], returns=which)  # type: ignore[arg-type]
    assert found.returns.max() == 1
    assert len(found) == len(np.unique(multi.beam))
    beams = multi.beam[multi.returns == 2]
    assert set(found.label[np.isin(found.beam, beams)].tolist()) == {label}
    strongest = lidar.scan(walls(1.0), NARROW, [(0, 0, 0)], returns="strongest")
    assert (strongest.share >= 9 / 19).all()


def test_ranges_have_the_scanner_s_noise() -> None:
    scene = walls(1.0)
    found = lidar.scan(scene, NARROW.but(range_sd=0.02, azimuth=(-0.1, -0.02)), [(0, 0, 0)], seed=3)
    assert found.range.std() == pytest.approx(0.02, rel=0.1)
    again = lidar.scan(scene, NARROW.but(range_sd=0.02, azimuth=(-0.1, -0.02)), [(0, 0, 0)], seed=3)
    assert np.array_equal(found.points, again.points)


def test_the_density_of_leaves_comes_back() -> None:
    rng = np.random.default_rng(1)
    n = int(2.0 / (math.pi * 0.02**2))
    leaves = discs(rng.random((n, 3)) * 1.2 - 0.1, normals_of("spherical", n, rng), 0.02 * 1.2**1.5)
    device = lidar.SCANNERS["vz400"].but(zenith=(80, 100), azimuth=(-10, 10), step=0.2)
    cloud = lidar.scan(pcsg.Scene(leaves), device, [(0.5, -5, 0.5)])
    found = lidar.density(cloud, [[0, 0, 0], [1, 1, 1]], LEAF)
    assert found.area.value == pytest.approx(2.0, rel=0.12)
    assert found.G.value == pytest.approx(0.5, rel=0.08)
    assert len(cloud.missed) > 100
    with pytest.raises(UsageError, match="no beam"):
        lidar.density(cloud, [[0, -90, 0], [1, -80, 1]])


def test_lines_and_mirrors_look_where_they_should() -> None:
    ground = pcsg.Scene(pcsg.label(2) * pcsg.halfspace())
    vlp = lidar.SCANNERS["vlp16"].but(range_sd=0.0, step=5.0)
    cloud = lidar.scan(ground, vlp, [(0, 0, 2)], rays_per_beam=1)
    assert len(cloud.beam_legs) == 16 * 72
    elevations = np.degrees(np.arcsin(cloud.beam_directions[:16, 2]))
    assert np.allclose(elevations, np.arange(-15, 16, 2))
    flown = lidar.Scanner("mirror", zenith=(0, 20), step=1.0, spacing=5.0, divergence=0.0)
    cloud = lidar.scan(ground, flown, [[(0, 0, 100), (0, 50, 100)]], rays_per_beam=1)
    assert len(cloud) == 41 * 11
    assert np.abs(cloud.points[:, 0]).max() == pytest.approx(100 * math.tan(math.radians(20)), 1e-3)
    assert np.allclose(np.unique(np.round(cloud.points[:, 1])), np.arange(0, 51, 5))


@pytest.mark.parametrize("ending", ["laz", "las", "csv", "xyz", "ply", "npz"])
def test_clouds_are_written(tmp_path: Path, ending: str) -> None:
    cloud = lidar.scan(walls(1.0), NARROW.but(step=0.02), [(0, 0, 0), (0.01, 0, 0)])
    path = tmp_path / f"plot.{ending}"
    if ending in ("laz", "las"):
        laspy = pytest.importorskip("laspy", reason="the extra science is not installed")
        cloud.write(path, classes={2: 6})
        found = laspy.read(path)
        assert str(found.header.version) == "1.4" and found.header.point_format.id == 6
        assert np.abs(found.xyz - cloud.points).max() < 1e-4
        assert np.array_equal(np.asarray(found.label), cloud.label)
        assert np.array_equal(np.asarray(found.classification), np.where(cloud.label == 2, 6, 1))
        assert set(np.asarray(found.point_source_id).tolist()) == {1, 2}
        assert np.allclose(found.range, cloud.range)
        return
    cloud.write(path)
    if ending == "csv":
        rows = np.genfromtxt(path, delimiter=",", names=True)
        assert np.allclose(rows["y"], cloud.points[:, 1], atol=1e-5)
    elif ending == "xyz":
        assert np.allclose(np.loadtxt(path), cloud.points, atol=1e-5)
    elif ending == "npz":
        assert np.array_equal(np.load(path)["points"], cloud.points)
    else:
        assert f"element vertex {len(cloud)}".encode() in path.read_bytes()


def test_the_verb_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pcsg.commands import scan as verb
    from pcsg.lidar import echoes as scanning

    monkeypatch.setattr(scanning, "PIECE", 60)
    file = tmp_path / "wall.pcsg"
    file.write_text("label(3) move(0, 5, 0) rotx(90) uscale(5) rectangle")
    words = ["scan", str(file), "--scanner", "vlp16", "--figure", "step=3", "--at", "0,0,0"]
    words += ["--figure", "azimuth=-40,40", "--seed", "4", "-q"]
    whole = tmp_path / "whole.npz"
    assert CliRunner().invoke(app, [*words, "-o", str(whole)]).exit_code == 0
    saved = verb.save_part
    done: list[Path] = []

    def stop(path: Path, part: lidar.Cloud) -> None:
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(path)
        saved(path, part)

    monkeypatch.setattr(verb, "save_part", stop)
    parts = tmp_path / "parts.npz"
    assert CliRunner().invoke(app, [*words, "-o", str(parts)]).exit_code != 0
    assert not parts.exists() and len(done) == 2
    monkeypatch.setattr(verb, "save_part", saved)
    assert CliRunner().invoke(app, [*words, "-o", str(parts), "--resume"]).exit_code == 0
    a, b = np.load(whole), np.load(parts)
    assert len(a["points"]) > 100
    assert all(np.array_equal(a[name], b[name]) for name in a.files)
    assert not parts.with_name("parts.npz.parts").exists()


def test_parts_of_a_scan_are_small_and_complete() -> None:
    device = lidar.SCANNERS["vz400"].but(step=1.0)
    leg = lidar.Leg(np.zeros(3))
    assert sum(piece.beams for piece in pieces_of(device, [leg, leg])) == 2 * device.count(leg)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--at", "0,0"], "--at takes x,y,z"),
        ([], "a scan has a leg"),
        (["--at", "0,0,0", "--scanner", "vz40"], "vz400"),
        (["--at", "0,0,0", "--figure", "steps=1"], "no steps"),
        (["--at", "0,0,0", "--class", "a=1"], "label=code"),
        (["--at", "0,0,0", "--returns", "all"], "multi"),
        (["--at", "0,0,0", "--rays-per-beam", "5"], "1, 7, 19, 37"),
        (["--at", "0,0,0", "--periodic", "0,0,0,1"], "periodic"),
    ],
)
def test_mistakes_of_the_verb_are_told(tmp_path: Path, words: list[str], says: str) -> None:
    file = tmp_path / "ball.pcsg"
    file.write_text("sphere")
    result = CliRunner().invoke(app, ["scan", str(file), "-o", str(tmp_path / "a.csv"), *words])
    assert result.exit_code == 2
    assert says in result.stderr
