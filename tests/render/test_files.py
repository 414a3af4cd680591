import os
import subprocess
import sys

import pytest

from pcsg import outputs
from pcsg.errors import EnvironmentFault, UsageError
from pcsg.outputs import check_output, write_whole


def names(folder):
    return sorted(p.name for p in folder.iterdir())


def test_a_file_is_written_whole(tmp_path):
    path = tmp_path / "a.bin"
    write_whole(path, lambda file: file.write(b"one"))
    write_whole(path, lambda file: file.write(b"two"))
    assert path.read_bytes() == b"two"
    assert names(tmp_path) == ["a.bin"]
    mask = os.umask(0)
    os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask


def test_a_failure_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")

    def fail(file):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(EnvironmentFault, match="No space left"):
        write_whole(path, fail)
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["a.bin"]


def test_other_errors_leave_nothing_either(tmp_path):
    def fail(file):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "a.bin", fail)
    assert names(tmp_path) == []


def test_outputs_are_judged_before(tmp_path):
    check_output(tmp_path / "a.png", (".png",))
    check_output(tmp_path / "a.PNG", (".png",))
    (tmp_path / "d.png").mkdir()
    (tmp_path / "file").write_text("")
    for path, word in (
        (tmp_path / "d.png", "folder"),
        (tmp_path / "a.gif", "must end in .png"),
        (tmp_path / "a", "must end in .png"),
        (tmp_path / "no" / "a.png", "no folder"),
        (tmp_path / "file" / "a.png", "not a folder"),
    ):
        with pytest.raises(UsageError, match=word):
            check_output(path, (".png",))
    assert names(tmp_path) == ["d.png", "file"]


def test_a_folder_that_takes_no_files(tmp_path, monkeypatch):
    def refuse(*args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pcsg.outputs.tempfile.mkstemp", refuse)
    with pytest.raises(EnvironmentFault, match="Permission denied"):
        check_output(tmp_path / "a.png", (".png",))
    with pytest.raises(EnvironmentFault, match="Permission denied"):
        write_whole(tmp_path / "a.png", lambda file: None)


LEFT = ".pcsg-abc_1234.png"


@pytest.mark.skipif(os.name != "posix", reason="files are not locked")
def test_what_killed_processes_left_is_swept_away(tmp_path):
    (tmp_path / LEFT).write_bytes(b"half")
    (tmp_path / ".pcsg-abcd1234").touch()
    for name in (".pcsg-mine", "pcsg-abc_1234.png", ".pcsg-abc_1234.png.bak"):
        (tmp_path / name).touch()
    (tmp_path / ".pcsg-dir_1234").mkdir()
    (tmp_path / ".pcsg-lin_1234").symlink_to(tmp_path / ".pcsg-mine")
    check_output(tmp_path / "a.png", (".png",))
    assert names(tmp_path) == [
        ".pcsg-abc_1234.png.bak",
        ".pcsg-dir_1234",
        ".pcsg-lin_1234",
        ".pcsg-mine",
        "pcsg-abc_1234.png",
    ]


@pytest.mark.skipif(os.name != "posix", reason="files are not locked")
def test_what_is_being_written_is_not_swept_away(tmp_path):
    path = tmp_path / "a.bin"

    def write(file):
        file.write(b"all")
        check_output(tmp_path / "b.png", (".png",))

    write_whole(path, write)
    assert path.read_bytes() == b"all"
    assert names(tmp_path) == ["a.bin"]


def test_a_sweep_between_making_and_locking_is_survived(tmp_path, monkeypatch):
    lock = outputs._lock
    swept = []

    def sweep_first(handle):
        if not swept:
            swept.extend(tmp_path.iterdir())
            for path in swept:
                path.unlink()
        return lock(handle)

    monkeypatch.setattr(outputs, "_lock", sweep_first)
    write_whole(tmp_path / "a.bin", lambda file: file.write(b"all"))
    assert swept
    assert names(tmp_path) == ["a.bin"]


FULL = """
import resource, sys
from pathlib import Path
import numpy as np
from pcsg.errors import EnvironmentFault
from pcsg.render.image import Image
pixels = np.random.default_rng(1).random((200, 300, 3), dtype=np.float32)
plane = pixels[..., 0].copy()
image = Image(pixels, plane, pixels, pixels, plane.astype(np.int64), plane.astype(np.int32),
              np.ones((200, 300), bool))
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
try:
    image.save(Path(sys.argv[1]))
except EnvironmentFault as fault:
    print(fault)
"""


@pytest.mark.skipif(os.name != "posix", reason="the size of files cannot be limited")
@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_a_full_disk_is_told(tmp_path, name):
    if name.endswith("exr"):
        pytest.importorskip("OpenEXR", reason="the extra exr is not installed")
    path = tmp_path / name
    path.write_bytes(b"old")
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path)], capture_output=True, text=True, check=True
    )
    assert f"cannot write {path}: File too large" in done.stdout
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == [name]
