"""What users and grammars name is read only if it is an ordinary file of a bounded size."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pcsg.errors import EnvironmentFault, UsageError
from pcsg.inputs import MOST_NESTED, TooLargeError, open_bytes, parse_json, read_bytes, read_text

READERS = [
    lambda path, limit: read_bytes(path, "mesh", limit),
    lambda path, limit: read_text(path, "mesh", limit),
    lambda path, limit: open_bytes(path, "mesh", limit).close(),
]
posix = pytest.mark.skipif(sys.platform == "win32", reason="there are no such files")


@pytest.fixture(params=READERS, ids=["bytes", "text", "open"])
def read(request: pytest.FixtureRequest) -> Callable[..., object]:
    reader: Callable[[str | Path, int], object] = request.param
    return lambda path, limit=1000: reader(path, limit)


@pytest.mark.parametrize("content", [b"", b"f 1 2 3", b"x" * 1000, bytes(300)])
def test_a_file_is_read_whole(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.obj"
    path.write_bytes(content)
    assert read_bytes(path, "mesh", 1000) == content
    with open_bytes(str(path), "mesh", 1000) as file:
        assert file.read() == content
        assert file.seek(0) == 0


def test_a_byte_order_mark_and_ends_of_lines_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "a.lsys"
    path.write_bytes("\ufeffä\r\nb\rc\n".encode())
    assert read_text(path, "L-system") == "ä\nb\nc\n"


def test_what_is_not_utf8_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.lsys"
    path.write_bytes(b"caf\xe9")
    with pytest.raises(UsageError, match=r"cannot read the L-system `.*`: it is not UTF-8 .byte 0"):
        read_text(path, "L-system")


def test_no_such_file(tmp_path: Path, read: Callable[..., object]) -> None:
    with pytest.raises(UsageError, match=r"cannot read the mesh `.*`: there is no such file"):
        read(tmp_path / "a.obj")
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="cannot read the mesh"):
        read(tmp_path / "file" / "a.obj")
    with pytest.raises(UsageError, match="cannot read the mesh"):
        read("a" * 5000)
    with pytest.raises(UsageError, match="cannot read the mesh"):
        read("a\0b")


def test_a_folder(tmp_path: Path, read: Callable[..., object]) -> None:
    with pytest.raises(UsageError, match="it is a folder"):
        read(tmp_path)


@posix
def test_a_link_that_leads_to_itself(tmp_path: Path, read: Callable[..., object]) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "a")
    with pytest.raises(UsageError, match="cannot read the mesh"):
        read(tmp_path / "a")


@posix
def test_a_pipe_is_not_waited_for(tmp_path: Path, read: Callable[..., object]) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UsageError, match="it is not an ordinary file"):
        read(tmp_path / "pipe")


@posix
def test_what_becomes_a_pipe_before_it_is_opened_is_not_waited_for(
    tmp_path: Path, read: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").touch()
    ordinary = (tmp_path / "file").stat()
    with monkeypatch.context() as patch:
        patch.setattr(os, "stat", lambda *_args, **_kw: ordinary)
        with pytest.raises(UsageError, match="it is not an ordinary file"):
            read(tmp_path / "pipe")


@posix
def test_a_socket(
    tmp_path: Path, read: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    with socket.socket(socket.AF_UNIX) as it:
        it.bind("socket")
        with pytest.raises(UsageError, match="it is not an ordinary file"):
            read("socket")


@pytest.mark.parametrize("name", ["zero", "full", "tty", "urandom"])
def test_devices(name: str, read: Callable[..., object]) -> None:
    if not Path("/dev", name).exists():
        pytest.skip("there is no such device")
    with pytest.raises(UsageError, match="it is not an ordinary file"):
        read(f"/dev/{name}")


def test_a_large_file_is_refused_unread(tmp_path: Path, read: Callable[..., object]) -> None:
    path = tmp_path / "a.obj"
    with path.open("wb") as file:
        file.truncate(2**40)  # it has no blocks
    with pytest.raises(TooLargeError, match="it is larger than 1000 bytes"):
        read(path)
    with pytest.raises(TooLargeError, match=r"it is larger than 2.5 MB"):
        read(path, 5 * 2**19)


@posix
def test_a_file_without_a_size_is_read_and_bounded() -> None:
    path = Path("/proc/self/status")
    if not path.exists():
        pytest.skip("this system has no such files")
    assert path.stat().st_size == 0
    assert b"Name:" in read_bytes(path, "mesh")
    with pytest.raises(TooLargeError):
        read_bytes(path, "mesh", 10)


@posix
def test_a_file_that_may_not_be_read(
    tmp_path: Path, read: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.obj"
    path.touch()

    def refuse(*_args: object) -> int:
        raise PermissionError(13, "Permission denied")

    # The superuser may read everything.
    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(EnvironmentFault, match=r"cannot read the mesh `.*`: Permission denied"):
        read(path)


def test_json_may_nest_brackets_only_so_deep() -> None:
    assert parse_json('{"a": [1, {"b": "[[[" }]}') == {"a": [1, {"b": "[[["}]}
    deep, strings = MOST_NESTED * "[", '["' + 1_000 * "[" + '"]'
    assert parse_json(deep + MOST_NESTED * "]") is not None
    assert parse_json(strings) == [1_000 * "["]
    for text in ("[" * 100_000, '{"a":' * 100_000, deep + '["]]]"'):
        with pytest.raises(ValueError, match="within brackets"):
            parse_json(text)
