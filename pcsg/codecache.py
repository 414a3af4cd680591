"""Where compiled kernels are kept: a folder of the user's own, and files that are proved whole.

What is loaded from there is run. So the folder and its files must belong to the user, nobody else
may be able to write them, none may be a link; and every byte of a file, and its name, is under a
digest. What is not so is not there: it is compiled again, and replaced.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import re
import shutil
import stat
import sys
import tempfile
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import platformdirs

from pcsg.objectcode import Code

CACHE = "PCSG_CACHE"
"""Environment variable that names another folder for what is kept."""

_MAGIC = b"pcsg kernel 3\n"
_DIGEST = 32
_MOST = 1 << 28
"""Most bytes of a file, and of all together."""

_DAY = 24 * 3600.0
_UNUSED = 30 * _DAY
_ABANDONED = 3600.0
"""Seconds after which a file that was not finished has lost its writer."""

_FORMER = re.compile("kernels-[0-9a-f]{16}")
"""Names of the folders of versions that had one for each state of their sources."""

_READ = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
_READ_FILE = _READ | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_CREATE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


def pack(name: str, code: Code) -> bytes:
    """Return the content of the file of a kernel."""
    about = code._asdict()
    del about["content"]
    head = json.dumps(about).encode()
    body = len(head).to_bytes(4, "big") + head + code.content
    return _MAGIC + _digest(name, body) + body


def unpack(name: str, data: bytes) -> Code | None:
    """Return the kernel in the content of a file, None if any byte of it is not what was kept."""
    start = len(_MAGIC) + _DIGEST
    magic, digest, body = data[: len(_MAGIC)], data[len(_MAGIC) : start], data[start:]
    if magic != _MAGIC or digest != _digest(name, body):
        return None
    end = 4 + int.from_bytes(body[:4], "big")
    return Code(**json.loads(body[4:end]), content=body[end:])


def _digest(name: str, body: bytes) -> bytes:
    digest = hashlib.sha256(_MAGIC + name.encode() + b"\n")
    digest.update(body)
    return digest.digest()


def _is_ours(about: os.stat_result) -> bool:
    """Return whether something belongs to us and nobody else can write it."""
    return sys.platform == "win32" or (
        about.st_uid == os.geteuid() and not about.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    )


class Folder:
    """A folder of compiled kernels.

    Parameters
    ----------
    path
        Its place; it is there.

    Raises
    ------
    OSError
        It cannot be opened, is a link, or others could have put files there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._handle: int | None = None
        self._is_clean = False
        if sys.platform == "win32":
            # A profile of Windows is its user's own; folders cannot be opened there.
            return
        handle = os.open(path, _READ | os.O_DIRECTORY)
        about = os.fstat(handle)
        if not _is_ours(about):
            os.close(handle)
            is_mine = about.st_uid == os.geteuid()
            raise PermissionError("others can write it" if is_mine else "it is another user's")
        self._handle = handle
        weakref.finalize(self, os.close, handle)
        if about.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            with suppress(OSError):
                os.fchmod(handle, about.st_mode & stat.S_IRWXU)

    def _place(self, name: str) -> str:
        return name if self._handle is not None else str(self.path / name)

    @property
    def is_writable(self) -> bool:
        """Whether files can be put there, as far as is known beforehand."""
        return os.access(self.path, os.W_OK | os.X_OK)

    def names(self) -> list[str]:
        """Return the names of all files."""
        try:
            # By its handle where there is one.
            with os.scandir(self.path if self._handle is None else self._handle) as entries:
                return [entry.name for entry in entries]
        except OSError:
            return []

    def read(self, name: str) -> Code | None:
        """Return what is kept under a name, None if there is none or it is not what was kept."""
        try:
            handle = os.open(self._place(name), _READ_FILE, dir_fd=self._handle)
        except OSError:
            return None
        try:
            about = os.fstat(handle)
            if not stat.S_ISREG(about.st_mode) or not _is_ours(about) or about.st_size > _MOST:
                return None
            with os.fdopen(handle, "rb", closefd=False) as file:
                code = unpack(name, file.read(_MOST))
            if code is not None and time.time() - about.st_mtime > _DAY:
                # It is in use; what is not goes one day.
                with suppress(OSError):
                    os.utime(handle if os.utime in os.supports_fd else self.path / name)
            return code
        except OSError:
            return None
        finally:
            os.close(handle)

    def write(self, name: str, code: Code) -> None:
        """Keep a kernel: all of it or nothing.

        Raises
        ------
        OSError
            It cannot be kept.
        """
        part = f".{os.urandom(8).hex()}.part"
        handle = os.open(self._place(part), _CREATE, 0o600, dir_fd=self._handle)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(pack(name, code))
            os.replace(
                self._place(part),
                self._place(name),
                src_dir_fd=self._handle,
                dst_dir_fd=self._handle,
            )
        except BaseException:
            with suppress(OSError):
                os.unlink(self._place(part), dir_fd=self._handle)
            raise
        if not self._is_clean:
            self._is_clean = True
            self.clean()

    def clean(self) -> None:
        """Remove what is not used any more: other versions' kernels, unfinished files."""
        now = time.time()
        kept: list[tuple[float, int, str]] = []
        for name in self.names():
            try:
                about = os.stat(self._place(name), dir_fd=self._handle, follow_symlinks=False)
            except OSError:
                continue
            age = now - about.st_mtime
            if name.endswith(".code") and age < _UNUSED:
                kept.append((about.st_mtime, about.st_size, name))
            elif name.endswith(".code") or (name.endswith(".part") and age > _ABANDONED):
                self._remove(name)
        total = sum(size for _time, size, _name in kept)
        for _time, size, name in sorted(kept):
            if total <= _MOST:
                break
            self._remove(name)
            total -= size

    def _remove(self, name: str) -> None:
        with suppress(OSError):
            os.unlink(self._place(name), dir_fd=self._handle)

    @contextmanager
    def hold(self, name: str) -> Iterator[None]:
        """Let one process at a time compile what is to be kept under a name."""
        try:
            import fcntl

            handle = os.open("lock", os.O_RDWR | os.O_CREAT | _READ, 0o600, dir_fd=self._handle)
        except (ImportError, OSError):
            # Several may compile it: that costs time, no more.
            yield
            return
        try:
            at = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big") >> 1
            with suppress(OSError):
                fcntl.lockf(handle, fcntl.LOCK_EX, 1, at)
            yield
        finally:
            os.close(handle)


class Cache:
    """What a process reads compiled kernels from, and where it keeps them.

    Attributes
    ----------
    obstacle
        Why what is compiled now cannot be kept for later processes; empty if it can.
    failure
        Why something could not be kept though nothing stood against it; empty if all was.
    """

    def __init__(self) -> None:
        self.obstacle = self.failure = ""
        self._private: Folder | None = None
        self._folder: Folder | None = None
        self._is_clean = False
        path = _place()
        if not path.is_absolute():
            self.obstacle = "no home folder is known"
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileExistsError):
                path.mkdir(mode=0o700)
            self._folder = Folder(path)
        except OSError as error:
            self.obstacle = f"{path}: {error.strerror or error}"
            return
        if not self._folder.is_writable:
            self.obstacle = f"{path} cannot be written"

    def read(self, name: str) -> Code | None:
        """Return what is kept under a name, None if there is none."""
        folder = self._folder or self._private
        return None if folder is None else folder.read(name)

    def write(self, name: str, code: Code) -> None:
        """Keep a kernel, if not for later processes then, where there is room, for this one."""
        try:
            if self._folder is None:
                self._private = self._private or _private_folder()
                self._private.write(name, code)
            elif self._folder.is_writable:
                self._folder.write(name, code)
                if not self._is_clean:
                    self._is_clean = True
                    _remove_former(self._folder.path.parent)
        except OSError as error:
            if not self.obstacle:
                self.failure = f"{_place()}: {error.strerror or error}"

    @contextmanager
    def hold(self, name: str) -> Iterator[None]:
        """Let one process at a time compile what is to be kept under a name."""
        if self._folder is None or self.obstacle:
            yield
            return
        with self._folder.hold(name):
            yield

    def has(self, prefix: str) -> bool:
        """Return whether something is kept for later processes under a name that begins so."""
        names = self._folder.names() if self._folder is not None else []
        return any(name.startswith(prefix) for name in names)


@cache
def opened() -> Cache:
    """Return the cache of this process."""
    return Cache()


def _place() -> Path:
    """Return the folder where kernels are kept for later processes."""
    named = os.environ.get(CACHE)
    return (Path(named).absolute() if named else Path(platformdirs.user_cache_dir("pcsg"))) / (
        "kernels"
    )


def _remove_former(cache: Path) -> None:
    """Remove the folders in which former versions kept kernels, once they are out of use."""
    for path in cache.glob("kernels-*"):
        with suppress(OSError):
            about = path.lstat()
            is_old = time.time() - about.st_mtime > _UNUSED
            if _FORMER.fullmatch(path.name) and is_old and _is_ours(about):
                shutil.rmtree(path)  # which follows no link


def _private_folder() -> Folder:
    """Return a folder for this process, which is removed when it ends."""
    path = Path(tempfile.mkdtemp(prefix="pcsg-kernels-"))
    owner = os.getpid()

    def remove() -> None:
        # A process that was forked off is not the one whose it is.
        if os.getpid() == owner:
            shutil.rmtree(path, ignore_errors=True)

    atexit.register(remove)
    return Folder(path)
