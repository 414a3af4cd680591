"""Files that users and grammars name: ordinary files of a bounded size, and nothing else.

A name may stand for a pipe that nobody fills, a device without an end, or a file larger than the
memory. None of them is waited for or read.
"""

from __future__ import annotations

import errno
import io
import json
import os
import re
import stat
from itertools import accumulate
from pathlib import Path
from typing import Any, BinaryIO

from pcsg.errors import EnvironmentFault, UsageError

LIMIT = 512 * 2**20
"""Bytes of the largest file that is read unless its reader says otherwise."""

# Not to wait for who fills a pipe; not to become the owner of a terminal; bytes as they are.
_FLAGS = os.O_RDONLY | sum(
    getattr(os, name, 0) for name in ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY")
)

MOST_NESTED = 500
"""Brackets within brackets of a JSON text: those who read it further may recurse."""

_STRING = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_BRACKET = re.compile(r"[\[\]{}]")

_USERS_MISTAKES = (errno.ENOENT, errno.ENOTDIR, errno.ELOOP, errno.ENAMETOOLONG)


class TooLargeError(UsageError):
    """A file is larger than what is read of its kind."""


def open_bytes(path: str | Path, what: str, limit: int = LIMIT) -> BinaryIO:
    """Open an ordinary file to read it piece by piece; parameters and errors as `read_bytes`.

    The size is looked at once: who reads without bound from a file that grows gets all of it.
    """
    try:
        # A device may do something when it is opened, so its kind is asked for before and after.
        _require_ordinary(Path(path).stat(), path, what)
        descriptor = os.open(path, _FLAGS)
        try:
            status = os.fstat(descriptor)
            _require_ordinary(status, path, what)
            if status.st_size > limit:
                raise _too_large(path, what, limit)
            return io.FileIO(descriptor, closefd=True)
        except BaseException:
            os.close(descriptor)
            raise
    except OSError as error:
        raise _unreadable(path, what, error) from None
    except ValueError as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"cannot read the {what} {str(path)!r}: {error}") from None


def read_bytes(path: str | Path, what: str, limit: int = LIMIT) -> bytes:
    """Read a file whole.

    Parameters
    ----------
    path
        Its name.
    what
        What it is for, in a word or two: ``mesh``, ``texture``.
    limit
        Bytes of the largest file that is read.

    Raises
    ------
    UsageError
        There is no such file, or it is a folder, a pipe, a device, or too large.
    EnvironmentFault
        The system refuses.
    """
    with open_bytes(path, what, limit) as file:
        # Files of the system have contents and no size, others grow while they are read.
        parts, left = [], limit + 1
        step = os.fstat(file.fileno()).st_size + 1
        try:
            while left > 0 and (part := file.read(min(step, left))):
                parts.append(part)
                left -= len(part)
                step = 2**16
        except OSError as error:
            raise _unreadable(path, what, error) from None
    if left <= 0:
        raise _too_large(path, what, limit)
    return b"".join(parts)


def read_text(path: str | Path, what: str, limit: int = LIMIT) -> str:
    r"""Read a text in UTF-8, without its byte order mark, lines ended by ``\n``.

    Parameters and errors as `read_bytes`; bytes that are not UTF-8 are a `UsageError`, too.
    """
    data = read_bytes(path, what, limit)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        bad = f"byte {data[error.start]:#04x} at offset {error.start}"
        raise UsageError(
            f"cannot read the {what} `{path}`: it is not UTF-8 ({bad}); save it as UTF-8"
        ) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_json(text: str) -> Any:
    """Return the value of a JSON text.

    Raises
    ------
    ValueError
        It is no JSON, or has brackets within brackets more than `MOST_NESTED` deep.
    """
    if text.count("[") + text.count("{") > MOST_NESTED:
        brackets = _BRACKET.findall(_STRING.sub("", text))
        if max(accumulate(1 if b in "[{" else -1 for b in brackets), default=0) > MOST_NESTED:
            raise ValueError(f"brackets within brackets, more than {MOST_NESTED} deep")
    return json.loads(text)


def _require_ordinary(status: os.stat_result, path: str | Path, what: str) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise UsageError(f"cannot read the {what} `{path}`: it is a folder")
    if not stat.S_ISREG(status.st_mode):
        raise UsageError(f"cannot read the {what} `{path}`: it is not an ordinary file")


def _too_large(path: str | Path, what: str, limit: int) -> TooLargeError:
    size = f"{limit / 2**20:g} MB" if limit >= 2**20 else f"{limit} bytes"
    return TooLargeError(f"cannot read the {what} `{path}`: it is larger than {size}")


def _unreadable(path: str | Path, what: str, error: OSError) -> UsageError | EnvironmentFault:
    if error.errno == errno.ENOENT:
        return UsageError(f"cannot read the {what} `{path}`: there is no such file")
    sentence = f"cannot read the {what} `{path}`: {error.strerror or error}"
    return UsageError(sentence) if error.errno in _USERS_MISTAKES else EnvironmentFault(sentence)
