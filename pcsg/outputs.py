"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO

from pcsg.errors import EnvironmentFault, UsageError


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
        handle, name = tempfile.mkstemp(prefix=".pcsg-", dir=folder)
        os.close(handle)
        Path(name).unlink()
    except OSError as error:
        raise EnvironmentFault(f"cannot write {path}: {error.strerror or error}") from error


def write_whole(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file beside its place, then rename it: readers see all of it or nothing.

    Raises
    ------
    EnvironmentFault
        The system refuses: no space, no permission.
    """

    def write_open(place: Path) -> None:
        with place.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())

    write_by_name(path, write_open)


def write_by_name(path: Path, write: Callable[[Path], object]) -> None:
    """Let a function write a file beside its place by its name, then rename it.

    Raises
    ------
    EnvironmentFault
        The system refuses: no space, no permission.
    """
    temporary: Path | None = None
    try:
        handle, name = tempfile.mkstemp(prefix=".pcsg-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        write(temporary)
        # mkstemp lets only the owner read; a picture gets the rights of any new file.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except OSError as error:
        raise EnvironmentFault(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                temporary.unlink()
