"""Which files a grammar may name: those below its own folder, and below folders that are allowed.

A grammar may be anybody's, and what it names is read with the rights of who draws it. So one rule
holds for all files that a text names: included grammars, models, meshes, species, textures and
skies. What users name themselves, on the command line or in Python, they may read.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, SourceSpan


@dataclass(frozen=True)
class Reach:
    """Where files that a grammar names may lie.

    Attributes
    ----------
    places
        Folders, and files that the user named; without links.
    """

    places: tuple[Path, ...]
    _found: dict[Path, Path | None] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, folder: Path, include: Iterable[str | Path], named: Path | None = None) -> Reach:
        """Return the reach of a grammar in a folder.

        Parameters
        ----------
        include
            Further folders.
        named
            A file that the user named, wherever its link leads.
        """
        paths = [folder, *map(Path, include), *([named] if named else [])]
        return cls(tuple(found for path in paths if (found := _without_links(path))))

    def find(self, target: Path) -> Path | None:
        """Return a file without links on its way; None if it lies outside.

        The file need not be there.
        """
        if target not in self._found:
            found = _without_links(target)
            inside = found and any(found.is_relative_to(place) for place in self.places)
            self._found[target] = found if inside else None
        return self._found[target]

    def refuse(self, target: Path, span: SourceSpan, code: str = "file-outside") -> Diagnostic:
        """Return what is told of a file that lies outside."""
        message = f"`{target}` is outside the folder of the root file"
        return diagnose(code, message, span, hint="allow its folder with --include DIR")


def _without_links(path: Path) -> Path | None:
    """Return where a path leads; None where it leads nowhere, as a link to itself does."""
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError):  # ValueError: a NUL in the name
        return None
