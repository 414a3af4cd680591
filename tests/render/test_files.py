import os

import pytest

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
