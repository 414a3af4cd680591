"""The one file that a page may read and write, as a text, and whether it has changed."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pcsg.errors import EnvironmentFault, UsageError
from pcsg.grammar.preprocess import MAX_BYTES
from pcsg.inputs import read_bytes
from pcsg.outputs import write_whole

BOM = "\ufeff"


@dataclass(frozen=True)
class Text:
    """A text as an editor shows it, and what is put back when it is saved.

    Attributes
    ----------
    text
        With ends of lines as browsers have them.
    ending
        What ends a line in the file.
    mark
        Whether the file begins with a byte order mark.
    """

    text: str
    ending: str = "\n"
    mark: bool = False

    @classmethod
    def of(cls, data: bytes) -> Text:
        """Return the text of a file; what is not UTF-8 is replaced."""
        text = data.decode("utf-8", errors="replace")
        ending = "\r\n" if "\r\n" in text else "\n"
        plain = text.replace("\r\n", "\n").replace("\r", "\n")
        return cls(plain.removeprefix(BOM), ending, text.startswith(BOM))

    def encode(self, text: str) -> bytes:
        """Return the bytes of another text for the same file."""
        plain = text.replace("\r\n", "\n").replace("\r", "\n")
        return (BOM * self.mark + plain.replace("\n", self.ending)).encode("utf-8", "replace")


class Document:
    """A file.

    Parameters
    ----------
    path
        Where it is.
    shipped
        Whether it came with pcsg, and is not to be changed.
    """

    def __init__(self, path: Path, shipped: bool = False) -> None:
        self.path = path
        self.shipped = shipped

    def read(self) -> Text:
        """Return the file's text.

        Raises
        ------
        UsageError, EnvironmentFault
            It cannot be read.
        """
        return Text.of(read_bytes(self.path, "grammar", MAX_BYTES))

    def write(self, text: str, base: str) -> None:
        """Replace the file's text, whole or not at all.

        Parameters
        ----------
        base
            The text that was changed: another one in the file is not overwritten.

        Raises
        ------
        UsageError
            The file has changed, or is not to be changed.
        EnvironmentFault
            The system refuses: no space, no permission.
        """
        if self.shipped:
            raise UsageError(
                f"{self.path.name} came with pcsg and stays as it is;"
                " save the text under a name of your own"
            )
        # What is linked to is written, not the link.
        path = self.path.resolve()
        try:
            now, mode = self.read(), stat.S_IMODE(path.stat().st_mode)
        except (PermissionError, FileNotFoundError, UsageError):
            if path.exists():
                raise
            now, mode = Text(base), None
        except OSError as error:
            raise EnvironmentFault(f"cannot write {path}: {error.strerror}") from None
        if now.text != base:
            raise UsageError(f"{self.path.name} was changed by somebody else meanwhile")
        if mode is not None and not os.access(path, os.W_OK):
            raise EnvironmentFault(f"cannot write {path}: Permission denied")
        data = now.encode(text)
        if len(data) > MAX_BYTES:
            raise UsageError(f"the text is longer than {MAX_BYTES >> 20} MB")
        write_whole(path, lambda file: file.write(data))
        if mode is not None:
            path.chmod(mode)


Stamp = tuple[int, int, int] | None
"""Time, size and number of a file; None where there is none."""


def stamp_of(path: str | Path) -> Stamp:
    """Return what changes when a file is written, replaced or removed."""
    try:
        status = Path(path).stat()
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


class Watch:
    """Tells when one of some files has changed."""

    def __init__(self, files: Iterable[str | Path]) -> None:
        self._stamps: dict[str, Stamp] = {}
        self.follow(files)

    def follow(self, files: Iterable[str | Path]) -> None:
        """Watch other files; of those that were watched, what is known stays."""
        self._stamps = {
            name: self._stamps[name] if name in self._stamps else stamp_of(name)
            for name in map(str, files)
        }

    def changed(self) -> bool:
        """Return whether any has changed since the last call."""
        now = {name: stamp_of(name) for name in self._stamps}
        different = now != self._stamps
        self._stamps = now
        return different
