"""Arrays that are put aside with the texts that describe them.

An archive is one of NumPy's, unpacked. It may be damaged, or somebody else's: what it holds is
looked at before room is made for it, and only what is asked for is read.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from pcsg.errors import EnvironmentFault, PcsgError, UsageError
from pcsg.inputs import open_bytes
from pcsg.outputs import write_whole

_DESCRIPTION = "description"

_HEADER = 1024
"""Bytes of what stands before an array's numbers, at most."""

_TEXTS = 2**24
"""Bytes of the texts, at most."""


class Layout(NamedTuple):
    """What an array must be.

    Attributes
    ----------
    shape
        Where a side is -1, at most `most` elements.
    optional
        Whether it may be missing.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    most: int = 0
    optional: bool = False

    @classmethod
    def of(cls, array: NDArray[Any]) -> Layout:
        """Return the layout of an array."""
        return cls(array.shape, array.dtype)

    def fits(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> bool:
        """Return whether an array is of this layout."""
        if dtype != self.dtype or len(shape) != len(self.shape):
            return False
        return all(
            a == b if b >= 0 else a <= self.most for a, b in zip(shape, self.shape, strict=True)
        )


class Archive:
    """An open archive.

    Attributes
    ----------
    description
        Its texts.
    """

    def __init__(self, file: zipfile.ZipFile, path: Path) -> None:
        self._file, self._path = file, path
        texts = json.loads(
            self._read(_DESCRIPTION, Layout((-1,), np.dtype(np.uint8), _TEXTS)).tobytes()
        )
        if not isinstance(texts, dict) or not all(isinstance(t, str) for t in texts.values()):
            raise ValueError("its description is none")
        self.description: dict[str, str] = texts

    def read(self, layouts: Mapping[str, Layout]) -> dict[str, NDArray[Any]]:
        """Return arrays by their names; raises an error if one is not as it must be."""
        names = {info.filename for info in self._file.infolist()}
        return {
            name: self._read(name, layout)
            for name, layout in layouts.items()
            if not layout.optional or f"{name}.npy" in names
        }

    def _read(self, name: str, layout: Layout) -> NDArray[Any]:
        info = self._file.getinfo(f"{name}.npy")
        if info.compress_type != zipfile.ZIP_STORED:
            raise ValueError("it is packed")
        with self._file.open(info) as member:
            shape, _, dtype = _READERS[npy.read_magic(member)](member, max_header_size=_HEADER)
            if not layout.fits(shape, dtype):
                raise ValueError(f"{name} is of another kind")
            # All is read, so that the check sum is compared.
            data = member.read()
        return np.frombuffer(bytearray(data), dtype).reshape(shape)


_READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


@contextmanager
def open_archive(path: Path, what: str) -> Iterator[Archive]:
    """Open an archive; whatever is wrong with it while it is used is told.

    Parameters
    ----------
    what
        What it is, for messages.

    Raises
    ------
    UsageError
        It is not there, no archive, or damaged.
    EnvironmentFault
        It cannot be read.
    """
    with open_bytes(path, what, limit=2**62) as opened:
        try:
            with zipfile.ZipFile(opened) as file:
                yield Archive(file, path)
        except (PcsgError, MemoryError):
            raise
        except OSError as error:
            raise EnvironmentFault(f"cannot read {path}: {error.strerror or error}") from error
        except Exception:  # the readers of a damaged archive raise anything
            raise UsageError(f"{path} is damaged; delete it to begin anew") from None


def write_archive(
    path: Path, description: Mapping[str, str], arrays: Mapping[str, NDArray[np.generic]]
) -> None:
    """Write an archive, whole or not at all.

    Raises
    ------
    EnvironmentFault
        The system refuses.
    """
    text = np.frombuffer(json.dumps(dict(description)).encode(), dtype=np.uint8)

    def write(file: IO[bytes]) -> None:
        np.savez(file, **{_DESCRIPTION: text, **arrays})  # type: ignore[arg-type]  # stubs say bool

    write_whole(path, write)
