"""A file that is not there: what may have been meant."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pcsg.errors import UsageError, suggest

ENDINGS = (".pcsg", ".lsys")


def check_there(file: Path, endings: Sequence[str] = ENDINGS) -> None:
    """Refuse a file that does not exist, with what may have been meant.

    Parameters
    ----------
    endings
        Of what the command takes.

    Raises
    ------
    UsageError
        There is no such file.
    """
    try:
        if file.exists() or not file.name:
            return
    except OSError:
        return  # whoever reads it tells why it cannot be read
    from pcsg.commands.gallery import find

    message = f"there is no file {file}"
    try:
        beside = [path.name for path in file.parent.iterdir() if path.suffix in endings]
    except OSError:
        beside = []
    completed = next((file.name + e for e in endings if file.name + e in beside), None)
    if completed:
        raise UsageError(f"{message}; did you mean `{file.with_name(completed)}`?")
    picture = find(file.name)
    if picture:
        copied = file.with_name(Path(picture.grammar).name)
        raise UsageError(
            f"{message}; `pcsg gallery {picture.name} --copy` copies the gallery's {copied.name} to"
            " this folder"
        )
    # Endings make all names alike.
    near = suggest(file.stem, [Path(name).stem for name in beside])
    hint = next(
        (f"did you mean `{n}`?" for n in beside if near and f"`{Path(n).stem}`" in near), ""
    )
    raise UsageError(f"{message}; {hint}" if hint else message)
