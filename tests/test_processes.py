"""What several processes make: faults come through, what is there is kept, names are any."""

import contextlib
import os
import signal
import subprocess
import sys

import pytest
from PIL import Image

from pcsg.commands.animate import Shot, make_shot
from pcsg.render.animation import texts_of

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="processes are told otherwise")

FAULT = "{} uscale(1/(TIME-0.25)) sphere\n"


@pytest.fixture
def start(tmp_path):
    (tmp_path / "t.pcsg").write_text("{n = 0} uscale(n + 1) sphere\n")
    (tmp_path / "fault.pcsg").write_text(FAULT)
    started = []

    def call(*arguments):
        process = subprocess.Popen(
            [sys.executable, "-m", "pcsg", *arguments],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        started.append(process)
        return process

    yield call
    for process in started:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def test_a_fault_in_one_frame_is_told(start, tmp_path):
    small = ["--size", "16x12", "--samples", "1", "--jobs", "2"]
    animate = start("animate", "fault.pcsg", *small, "--frames", "0..4", "--fps", "8")
    _, told = animate.communicate(timeout=300)
    assert animate.returncode == 2
    assert "fault.pcsg:1:11" in told and "not-finite" in told
    assert "mistake in pcsg" not in told and "Traceback" not in told
    frames = tmp_path / "fault.webp.frames"
    assert not frames.exists() or any(frames.iterdir())


def test_an_animation_that_cannot_begin_leaves_no_folder(start, tmp_path):
    (tmp_path / "bad.pcsg").write_text("{} uscale(1/TIME) sphere\n")
    animate = start("animate", "bad.pcsg", "--size", "16x12", "--samples", "1", "--frames", "0..2")
    _, told = animate.communicate(timeout=300)
    assert animate.returncode == 2, told
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.pcsg", "fault.pcsg", "t.pcsg"]


def test_a_damaged_frame_is_made_again(tmp_path):
    grammar = tmp_path / "a.pcsg"
    grammar.write_text("sphere")
    frame = tmp_path / "frames" / "a.png"
    shot = Shot(grammar, frame, {}, (), "auto", (8, 6), 1, 1, 1, None, {}, resume=True)
    make_shot(shot)
    whole = frame.read_bytes()
    with Image.open(frame) as picture:
        assert texts_of(frame) == picture.text != {}
    for damaged in (whole[:-40], whole[: len(whole) // 2], b"", b"\x89PNG"):
        frame.write_bytes(damaged)
        assert texts_of(frame) is None
        make_shot(shot)
        assert frame.read_bytes() == whole
    inode = frame.stat().st_ino
    make_shot(shot)
    assert frame.stat().st_ino == inode


@pytest.mark.skipif(sys.platform == "darwin", reason="names of files are UTF-8 there")
def test_names_that_are_no_text(start, tmp_path):
    name = os.fsdecode(b"\xff\x1b.png")
    options = ["--size", "8x6", "--samples", "1"]
    render = start("render", "t.pcsg", "-o", name, *options, "-D", "n=0")
    _, told = render.communicate(timeout=300)
    assert render.returncode == 0, told
    with Image.open(tmp_path / name) as picture:
        assert picture.size == (8, 6)
        assert "\ufffd␛.png" in picture.text["pcsg:command"]
    assert "\x1b" not in told
