"""Files that are written whole or not at all.

They are written beside their place under another name. Who writes one holds a lock on it, so that
what a killed process has left is told from what is being written, and swept away.
"""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # pragma: no cover -- Windows
    fcntl = None  # type: ignore[assignment]  # the one way to say so

from pcsg.errors import EnvironmentFault, UsageError

_PREFIX = ".pcsg-"
_NAME = re.compile(re.escape(_PREFIX) + r"[a-z0-9_]{8}(\.\w+)?")


def check_output(path: Path, endings: tuple[str, ...]) -> None:
    """Raise an error now if a file could not be written later.

    Parameters
    ----------
    endings
        Legal ends of the name, lower case, with the dot.

    Raises
    ------
    UsageError
        The path is a folder, lies in no folder, or ends in none of the endings.
    EnvironmentFault
        The folder takes no files.
    """
    if path.is_dir():
        raise UsageError(f"cannot write {path}: it is a folder")
    if path.suffix.lower() not in endings:
        known = ", ".join(endings)
        raise UsageError(f"cannot write {path}: its name must end in {known}")
    folder = path.parent
    if not folder.exists():
        raise UsageError(f"cannot write {path}: there is no folder {folder}")
    if not folder.is_dir():
        raise UsageError(f"cannot write {path}: {folder} is not a folder")
    if path.exists() and not path.is_file():
        raise UsageError(f"cannot write {path}: it is not an ordinary file")
    try:
        with _beside(path):
            pass
    except OSError as error:
        raise EnvironmentFault(f"cannot write {path}: {error.strerror or error}") from error
    sweep(folder)


def write_whole(
    path: Path, write: Callable[[IO[bytes]], object], *, rights: int | None = None
) -> None:
    """Write a file beside its place, then rename it: readers see all of it or nothing.

    Parameters
    ----------
    rights
        Permissions of the file, by default those of any new one.

    Raises
    ------
    EnvironmentFault
        The system refuses: no space, no permission.
    """

    def write_open(place: Path) -> None:
        with place.open("wb") as file:
            write(file)

    write_by_name(path, write_open, rights=rights)


def write_by_name(
    path: Path, write: Callable[[Path], object], *, rights: int | None = None
) -> None:
    """Let a function write a file beside its place by its name, then rename it.

    Parameters
    ----------
    rights
        Permissions of the file, by default those of any new one.

    Raises
    ------
    EnvironmentFault
        The system refuses: no space, no permission.
    """
    try:
        with _beside(path) as temporary:
            write(temporary)
            # A full disk may tell so late.
            with temporary.open("r+b") as file:
                os.fsync(file.fileno())
            # mkstemp lets only the owner read; a picture gets the rights of any new file.
            mask = os.umask(0)
            os.umask(mask)
            temporary.chmod(0o666 & ~mask if rights is None else rights)
            temporary.replace(path)
    except OSError as error:
        raise EnvironmentFault(f"cannot write {path}: {error.strerror or error}") from error


@contextlib.contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """Make an empty file beside a place, and remove it in the end if it is still there."""
    held: int | None = None
    temporary: Path | None = None
    try:
        while temporary is None or not temporary.exists():
            if held is not None:
                os.close(held)
            handle, name = tempfile.mkstemp(prefix=_PREFIX, suffix=path.suffix, dir=path.parent)
            # Between the two, who sweeps may have taken it for one that is left.
            temporary, held = Path(name), handle
            _lock(handle)
        if fcntl is None:
            # Windows replaces no open files.
            os.close(held)
            held = None
        yield temporary
    finally:
        if held is not None:
            os.close(held)
        if temporary is not None:
            with contextlib.suppress(OSError):
                temporary.unlink()


def sweep(folder: Path) -> None:
    """Remove from a folder what processes that were killed have left half written."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(folder)):
            if _NAME.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                with contextlib.suppress(OSError):
                    _remove_left(Path(entry.path))


def _remove_left(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        if _lock(handle):
            path.unlink()
    finally:
        os.close(handle)


def _lock(handle: int) -> bool:
    """Lock a file until it is closed; return whether that was possible."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
