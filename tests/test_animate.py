"""Moving pictures: ranges, frames, cameras, files; the gallery and the grammar to begin with."""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from pcsg.cli import app
from pcsg.commands import gallery
from pcsg.commands.animate import parse_frames, parse_range, parse_ranges
from pcsg.commands.gallery import PICTURES, folder
from pcsg.errors import UsageError
from pcsg.render.animation import frame_path, turn_camera

GROWING = """
{n = 2; size = 1} T
T if(n > 0, 2, 1)
1: T -> uscale(size) sphere
2: T -> sphere | {n = n-1} move(1.5*sin(90*TIME), 0, 1) uscale(0.7) T
"""
SMALL = ["--size", "24x18", "--samples", "1", "--jobs", "1"]


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.pcsg").write_text(GROWING)

    def call(*arguments):
        result = CliRunner().invoke(app, list(arguments))
        assert result.exception is None or isinstance(result.exception, SystemExit)
        assert "Traceback" not in result.output
        return result

    return call


def test_ranges_go_from_end_to_end():
    whole = parse_range("1..9", "n")
    assert [whole.at(s) for s in (0, 0.3, 1)] == [1, 3, 9]
    smooth = parse_range("1.0..2", "n")
    assert smooth.at(0.25) == 1.25
    assert parse_range("-2..-4", "n").at(0.5) == -3
    assert parse_range("7", "n").at(0.9) == 7
    assert parse_ranges(["a=1..2", " b = 3"])["b"].at(0.5) == 3
    with pytest.raises(UsageError, match="NAME"):
        parse_ranges(["=1..2"])
    with pytest.raises(UsageError, match="number"):
        parse_range("1..x", "n")


def test_frames_have_their_times_and_shares():
    frames = parse_frames("10..14", 4.0)
    assert list(frames.numbers) == [10, 11, 12, 13, 14]
    assert [frames.share(k) for k in (10, 12, 14)] == [0, 0.5, 1]
    assert frames.seconds(14) == 1.0
    assert frames.turned(14) == 0.8
    assert parse_frames("3..3", 4.0).share(3) == 0
    for text in ("5..3", "x..3", "3"):
        with pytest.raises(UsageError, match="--frames"):
            parse_frames(text, 4.0)


def test_the_camera_walks_about_its_target():
    camera = {"eye": (3.0, 1.0, 2.0), "target": (1.0, 1.0, 0.0), "fov": 30.0}
    turned = turn_camera(camera, 90.0)
    np.testing.assert_allclose(turned["eye"], (1, 3, 2), atol=1e-12)
    assert turned["fov"] == 30.0


@pytest.mark.parametrize(("ending", "kind"), [("webp", "WEBP"), ("gif", "GIF"), ("png", "PNG")])
def test_an_animation_in_one_file(run, tmp_path, ending, kind):
    result = run(
        "animate", "t.pcsg", "-D", "n=0..2", "--frames", "0..2", *SMALL, "-o", f"a.{ending}"
    )
    assert result.exit_code == 0, result.output
    with Image.open(tmp_path / f"a.{ending}") as film:
        assert film.format == kind
        assert film.n_frames == 3
        shown = []
        for k in range(3):
            film.seek(k)
            shown.append(np.asarray(film.convert("RGB"), dtype=int))
    assert np.abs(shown[0] - shown[2]).max() > 30
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"a.{ending}", "t.pcsg"]


def test_what_is_odd_about_a_grammar_is_told_once(run, tmp_path):
    (tmp_path / "t.pcsg").write_text("color(255, 0, 0) sphere")
    result = run("animate", "t.pcsg", *SMALL, "--frames", "0..0", "-o", "f_#.png")
    assert result.exit_code == 0
    assert result.stderr.count("warning[colour-range]") == 1


def test_frames_as_files_are_kept_when_they_are_the_same_picture(run, tmp_path):
    arguments = ["animate", "t.pcsg", "--frames", "8..10", *SMALL, "-o", "f_###.png"]
    assert run(*arguments).exit_code == 0
    paths = [tmp_path / f"f_{k:03}.png" for k in (8, 9, 10)]
    before = [p.read_bytes() for p in paths]
    assert before[0] != before[2]  # TIME went on
    times = [p.stat().st_mtime_ns for p in paths]
    paths[1].unlink()
    assert run(*arguments, "--resume").exit_code == 0
    assert [p.read_bytes() for p in paths] == before
    assert [p.stat().st_mtime_ns == t for p, t in zip(paths, times, strict=True)] == [
        True,
        False,
        True,
    ]
    # Another seed is another picture, so none is kept.
    assert run(*arguments, "--resume", "--seed", "5").exit_code == 0
    assert all(p.read_bytes() != b for p, b in zip(paths, before, strict=True))


def test_frames_do_not_depend_on_who_makes_them(run, tmp_path):
    arguments = ["animate", "t.pcsg", "--frames", "0..3", "--orbit", "360", *SMALL[:-2]]
    assert run(*arguments, "--jobs", "1", "-o", "a_#.png").exit_code == 0
    assert run(*arguments, "--jobs", "2", "-o", "b_#.png").exit_code == 0
    for k in range(4):
        assert (tmp_path / f"a_{k}.png").read_bytes() == (tmp_path / f"b_{k}.png").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "status", "word"),
    [
        (["--frames", "4..1"], 2, "--frames"),
        (["--fps", "0"], 2, "--fps"),
        (["-o", "a.avi"], 2, ".webp"),
        (["-o", "a_#_#.png"], 2, "#"),
        (["-o", "a_##.gif"], 2, "#"),
        (["-o", "none/a.gif"], 2, "no folder"),
        (["--jobs", "0"], 2, "--jobs"),
        (["-D", "m=1..2"], 2, "`m`"),
    ],
)
def test_what_cannot_be_animated_is_refused(run, tmp_path, arguments, status, word):
    result = run("animate", "t.pcsg", *arguments)
    assert result.exit_code == status
    assert word in result.output


def test_films_need_ffmpeg(run, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    result = run("animate", "t.pcsg", "-o", "a.mp4")
    assert result.exit_code == 1
    assert "ffmpeg" in result.output


FFMPEG = """#!{python}
import json, sys
data = sys.stdin.buffer.read()
frames = data.split(b"\\x89PNG\\r\\n\\x1a\\n")[1:]
with open({log!r}, "w") as log:
    json.dump({{"arguments": sys.argv[1:], "frames": [len(f) for f in frames]}}, log)
if {status}:
    sys.exit("Unknown encoder 'libx264'")
with open(sys.argv[-1], "wb") as film:
    film.write(b"film of %d frames" % len(frames))
"""


@pytest.fixture
def ffmpeg(tmp_path, monkeypatch):
    """Put a program in the place of ffmpeg; return how to make it fail, and its log."""
    programs = tmp_path / "programs"
    programs.mkdir()
    log = programs / "log.json"

    def install(status=0):
        program = programs / "ffmpeg"
        program.write_text(FFMPEG.format(python=sys.executable, log=str(log), status=status))
        program.chmod(0o755)
        monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
        return log

    return install


def test_a_film_is_made_by_ffmpeg(run, tmp_path, ffmpeg):
    log = ffmpeg()
    arguments = ["animate", "t.pcsg", "--frames", "0..4", "--fps", "12.5", *SMALL, "-o", "a.mp4"]
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    assert (tmp_path / "a.mp4").read_bytes() == b"film of 5 frames"
    told = json.loads(log.read_text())
    assert len(told["frames"]) == 5
    given = told["arguments"]
    # What is said before the input is said of it.
    before, after = given[: given.index("-i")], given[given.index("-i") + 2 :]
    assert given[given.index("-i") + 1] == "-"
    for option, value in (("-f", "image2pipe"), ("-framerate", "12.5"), ("-c:v", "png")):
        assert before[before.index(option) + 1] == value
    for option, value in (("-c:v", "libx264"), ("-pix_fmt", "yuv420p")):
        assert after[after.index(option) + 1] == value
    assert "-y" in before  # the place is there already, empty
    assert after[-1].endswith(".mp4")
    # The frames are gone, the film has its name.
    assert not (tmp_path / "a.mp4.frames").exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mp4", "programs", "t.pcsg"]


def test_when_ffmpeg_fails_the_frames_are_kept(run, tmp_path, ffmpeg):
    ffmpeg(status=1)
    (tmp_path / "a.mp4").write_bytes(b"an older film")
    arguments = ["animate", "t.pcsg", "--frames", "0..2", *SMALL, "-o", "a.mp4"]
    result = run(*arguments)
    assert result.exit_code == 1
    assert "ffmpeg" in result.output
    assert "Unknown encoder" in result.output
    assert (tmp_path / "a.mp4").read_bytes() == b"an older film"
    kept = sorted((tmp_path / "a.mp4.frames").iterdir())
    assert len(kept) == 3
    # With another ffmpeg no frame is made again.
    log = ffmpeg()
    assert run(*arguments, "--resume").exit_code == 0
    assert (tmp_path / "a.mp4").read_bytes() == b"film of 3 frames"
    assert len(json.loads(log.read_text())["frames"]) == 3


def test_an_ffmpeg_that_reads_nothing_is_told_of(run, tmp_path, ffmpeg):
    ffmpeg()
    program = tmp_path / "programs" / "ffmpeg"
    program.write_text("#!/bin/sh\nexec <&-\necho 'no memory' >&2\nexit 69\n")
    result = run("animate", "t.pcsg", "--frames", "0..1", *SMALL, "-o", "a.mp4")
    assert result.exit_code == 1
    assert "no memory" in result.output
    assert not (tmp_path / "a.mp4").exists()


def test_a_real_film(run, tmp_path):
    """With the real program, if it is here: odd sides, as many frames as were made."""
    program = shutil.which("ffmpeg")
    if program is None:
        pytest.skip("ffmpeg is not installed")
    small = ["--size", "25x19", "--samples", "1", "--jobs", "1"]
    result = run("animate", "t.pcsg", "--frames", "0..4", "--fps", "10", *small, "-o", "a.mp4")
    assert result.exit_code == 0, result.output
    command = [program, "-i", "a.mp4", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=True)
    assert len(done.stdout) == 5 * 26 * 20 * 3
    assert b"10 fps" in done.stderr


def test_frames_of_a_file_lie_in_a_folder_beside_it(tmp_path):
    assert frame_path(tmp_path / "a.gif", 7) == tmp_path / "a.gif.frames" / "frame_00007.png"


def test_a_grammar_to_begin_with(run, tmp_path):
    assert run("new", "oak").exit_code == 0
    text = (tmp_path / "oak.pcsg").read_text()
    assert "pcsg render oak.pcsg" in text
    assert run("check", "oak.pcsg").exit_code == 0
    assert run("render", "oak.pcsg", "--size", "24x18", "--samples", "1").exit_code == 0
    again = run("new", "oak.pcsg")
    assert again.exit_code == 2
    assert "already" in again.output
    assert (tmp_path / "oak.pcsg").read_text() == text
    assert run("new", "none/oak").exit_code == 2


def test_the_gallery_lists_every_grammar_and_makes_pictures(run, tmp_path):
    listed = run("gallery")
    assert listed.exit_code == 0
    shipped = {p.stem for p in folder().glob("*.pcsg")} - {"sierpinski-pl"}
    assert {picture.name for picture in PICTURES} >= shipped
    assert all((folder() / picture.grammar).exists() for picture in PICTURES)
    assert all(name in listed.output for name in shipped)
    made = run("gallery", "--render", "sierpinski", "--size", "24x18", "--samples", "1")
    assert made.exit_code == 0, made.output
    with Image.open(tmp_path / "sierpinski.png") as picture:
        assert picture.size == (24, 18)
        assert json.loads(picture.text["pcsg:parameters"])["c"] == 6
    wrong = run("gallery", "siepinski")
    assert wrong.exit_code == 2
    assert "sierpinski" in wrong.output


def test_the_gallery_goes_on_where_it_stopped(run, tmp_path, monkeypatch):
    names = ["sierpinski", "menger", "leaf"]
    quick = ["--size", "16x12", "--samples", "1"]
    made = []
    make = gallery._make

    def stop_at_menger(picture, *rest):
        if picture.name == "menger" and "menger" not in made:
            made.append("menger")
            raise KeyboardInterrupt
        made.append(picture.name)
        return make(picture, *rest)

    monkeypatch.setattr(gallery, "_make", stop_at_menger)
    assert run("gallery", "--render", *names, *quick).exit_code == 130
    assert (tmp_path / gallery.PROGRESS).exists()
    again = run("gallery", "--render", *names, *quick)
    assert again.exit_code == 0, again.output
    assert made == ["sierpinski", "menger", "menger", "leaf"]
    assert "sierpinski.png is made already" in again.output
    assert not (tmp_path / gallery.PROGRESS).exists()
    # Asked for anew, or in another way, all are made.
    made.clear()
    (tmp_path / gallery.PROGRESS).write_text("pictures of 24x18\nsierpinski")
    assert run("gallery", "--render", "sierpinski", *quick).exit_code == 0
    assert made == ["sierpinski"]


def test_a_picture_that_fails_ends_the_gallery(run, tmp_path):
    (tmp_path / "leaf.png").mkdir()
    failed = run("gallery", "--render", "leaf", "--size", "16x12", "--samples", "1")
    assert failed.exit_code == 1
    assert "leaf was not made" in failed.output


def test_large_pictures_are_left_with_few_colours(run, tmp_path, monkeypatch):
    arguments = ["gallery", "--render", "leaf", "--size", "60x45", "--samples", "1"]
    assert run(*arguments).exit_code == 0
    with Image.open(tmp_path / "leaf.png") as picture:
        whole, texts = np.asarray(picture.convert("RGB"), dtype=int), dict(picture.text)
    monkeypatch.setattr(gallery, "LARGEST", 100)
    assert run(*arguments).exit_code == 0
    with Image.open(tmp_path / "leaf.png") as picture:
        assert picture.mode == "P"
        assert dict(picture.text) == texts
        few = np.asarray(picture.convert("RGB"), dtype=int)
    assert np.abs(few - whole).mean() < 4
