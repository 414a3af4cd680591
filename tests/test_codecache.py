"""Files of machine code are loaded only where nobody else can have written them."""

from __future__ import annotations

import errno
import gc
import os
import random
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from pcsg import codecache
from pcsg.codecache import Cache, Folder, opened, pack, unpack
from pcsg.objectcode import Code

CODE = Code("symbol", "if", True, False, bytes(range(256)) * 8)
NAME = "kernel.code"

ANOTHER = 12345
"""A user who is not us."""

posix = pytest.mark.skipif(sys.platform == "win32", reason="owners and modes of POSIX")


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    path = tmp_path / "kernels"
    path.mkdir(mode=0o700)
    return Folder(path)


def test_what_was_kept_is_read(folder: Folder) -> None:
    assert folder.read(NAME) is None
    folder.write(NAME, CODE)
    assert folder.read(NAME) == CODE
    assert folder.names() == [NAME]


def test_every_bit_is_under_the_digest() -> None:
    data = pack(NAME, CODE)
    chance = random.Random(1)
    head = len(data) - len(CODE.content)
    for at in [*range(head), *chance.sample(range(head, len(data)), 100)]:
        changed = bytearray(data)
        changed[at] ^= 1 << chance.randrange(8)
        assert unpack(NAME, bytes(changed)) is None
    for end in (0, 1, 20, head - 1, len(data) - 1):
        assert unpack(NAME, data[:end]) is None
    assert unpack(NAME, data + b"\0") is None
    assert unpack(NAME, data) == CODE


def test_a_file_under_another_name_is_not_taken(folder: Folder) -> None:
    folder.write(NAME, CODE)
    (folder.path / NAME).rename(folder.path / "other.code")
    assert folder.read("other.code") is None


@posix
def test_links_are_not_followed(folder: Folder, tmp_path: Path) -> None:
    folder.write(NAME, CODE)
    (folder.path / NAME).rename(tmp_path / NAME)
    (folder.path / NAME).symlink_to(tmp_path / NAME)
    assert folder.read(NAME) is None
    folder.write(NAME, CODE)
    assert not (folder.path / NAME).is_symlink()
    (tmp_path / "link").symlink_to(folder.path)
    with pytest.raises(OSError):
        Folder(tmp_path / "link")


@posix
@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_files_that_others_can_write_are_not_taken(folder: Folder, mode: int) -> None:
    folder.write(NAME, CODE)
    (folder.path / NAME).chmod(mode)
    assert folder.read(NAME) is None
    folder.write(NAME, CODE)
    assert folder.read(NAME) == CODE


@posix
def test_only_ordinary_files_are_read(folder: Folder) -> None:
    os.mkfifo(folder.path / NAME)
    assert folder.read(NAME) is None
    (folder.path / "folder.code").mkdir()
    assert folder.read("folder.code") is None


@posix
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o1777])
def test_a_folder_that_others_can_write_is_not_used(kernel_folder: Path, mode: int) -> None:
    kernel_folder.mkdir(parents=True)
    Folder(kernel_folder).write(NAME, CODE)
    kernel_folder.chmod(mode)
    assert opened().read(NAME) is None
    assert opened().obstacle == f"{kernel_folder}: others can write it"


@posix
def test_what_belongs_to_another_user_is_not_used(
    kernel_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Cache().write(NAME, CODE)
    monkeypatch.setattr(os, "geteuid", lambda: ANOTHER)
    mine = Cache()
    assert mine.read(NAME) is None
    assert mine.obstacle == f"{kernel_folder}: it is another user's"
    monkeypatch.undo()


@posix
def test_a_planted_file_of_another_user_is_not_taken(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.write(NAME, CODE)
    monkeypatch.setattr(os, "geteuid", lambda: ANOTHER)
    assert folder.read(NAME) is None


@posix
def test_folders_are_for_their_user_alone(kernel_folder: Path) -> None:
    opened()
    assert kernel_folder.stat().st_mode & 0o777 == 0o700
    kernel_folder.chmod(0o755)
    assert not Cache().obstacle
    assert kernel_folder.stat().st_mode & 0o777 == 0o700
    kernel_folder.chmod(0o555)
    Cache()
    assert kernel_folder.stat().st_mode & 0o777 == 0o500


def test_where_the_folder_is_not_safe_there_is_a_private_one(
    kernel_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    removals: list[Any] = []
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("atexit.register", removals.append)
    kernel_folder.parent.mkdir()
    kernel_folder.touch()
    cache = opened()
    assert cache.read(NAME) is None
    assert not list(tmp_path.glob("pcsg-kernels-*"))
    cache.write(NAME, CODE)
    cache.write("other.code", CODE)
    assert cache.read(NAME) == CODE
    assert not cache.has("kernel")
    (private,) = tmp_path.glob("pcsg-kernels-*")
    assert private.stat().st_mode & 0o777 == 0o700
    (remove,) = removals
    remove()
    assert not private.exists()


def test_a_folder_that_cannot_be_written_is_read(
    kernel_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened().write(NAME, CODE)
    # For the administrator no mode forbids writing.
    monkeypatch.setattr(Folder, "is_writable", False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
    cache = Cache()
    assert cache.obstacle == f"{kernel_folder} cannot be written"
    assert cache.read(NAME) == CODE
    assert cache.has("kernel")
    with cache.hold("other.code"):
        cache.write("other.code", CODE)
    assert [path.name for path in kernel_folder.iterdir()] == [NAME]


@pytest.mark.parametrize("call", ["replace", "fdopen"])
def test_a_full_disk_leaves_no_part_of_a_file(
    kernel_folder: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    def fail(*args: object, **kwargs: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    cache = opened()
    monkeypatch.setattr(codecache.os, call, fail)
    cache.write(NAME, CODE)
    monkeypatch.undo()
    assert os.strerror(errno.ENOSPC) in cache.failure
    assert not list(kernel_folder.iterdir())


def test_without_a_home_nothing_is_written_where_one_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PCSG_CACHE", raising=False)
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: f"~/.cache/{name}")
    assert "home" in Cache().obstacle
    assert not list(tmp_path.iterdir())


def test_what_is_not_used_any_more_goes(
    kernel_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Cache().write("used.code", CODE)
    Cache().write("unused.code", CODE)
    for name in ("old.part", "new.part"):
        (kernel_folder / name).write_bytes(b"")
    past = time.time() - 40 * 24 * 3600
    for name in ("used.code", "unused.code", "old.part"):
        os.utime(kernel_folder / name, (past, past))
    assert Cache().read("used.code") == CODE
    Cache().write(NAME, CODE)
    names = {path.name for path in kernel_folder.iterdir()}
    assert names == {NAME, "used.code", "new.part"}


def test_folders_of_former_versions_go(kernel_folder: Path, tmp_path: Path) -> None:
    cache = kernel_folder.parent
    old, new, mine, link = (
        cache / f"kernels-{name}" for name in ("0" * 15 + "f", "1" * 16, "mine", "2" * 16)
    )
    for path in (old, new, mine, tmp_path / "elsewhere"):
        path.mkdir(parents=True)
        (path / "a.code").write_bytes(b"")
    link.symlink_to(tmp_path / "elsewhere")
    past = time.time() - 40 * 24 * 3600
    for path in (old, mine, tmp_path / "elsewhere"):
        os.utime(path, (past, past))
    os.utime(link, (past, past), follow_symlinks=False)
    opened().read(NAME)
    assert old.exists()
    opened().write(NAME, CODE)
    assert not old.exists()
    assert all((path / "a.code").exists() for path in (new, mine, link))


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files cannot be counted")
def test_folders_that_are_dropped_are_closed(folder: Folder) -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(20):
        Folder(folder.path).read(NAME)
    gc.collect()
    assert len(list(Path("/proc/self/fd").iterdir())) < before + 20


def test_all_together_have_a_size_and_the_oldest_go(
    kernel_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(codecache, "_MOST", 3 * len(pack(NAME, CODE)))
    for k in range(5):
        Cache().write(f"{k}.code", CODE)
        os.utime(kernel_folder / f"{k}.code", (time.time() - 100 + k,) * 2)
    Folder(kernel_folder).clean()
    assert sorted(path.name for path in kernel_folder.iterdir()) == ["2.code", "3.code", "4.code"]
