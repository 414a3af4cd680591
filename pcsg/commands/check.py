"""``pcsg check``: every mistake in a grammar, all at once."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import typer

from pcsg.commands.files import check_there
from pcsg.commands.guard import show


def run(file: Path, include: Sequence[Path], as_json: bool) -> None:
    """Print the diagnostics of a file; exit status 2 if one is an error."""
    check_there(file)
    from pcsg.grammar import check_file

    _, diagnostics = check_file(file, include=include)
    for diagnostic in diagnostics:
        text = json.dumps(diagnostic.to_json()) if as_json else diagnostic.render() + "\n"
        show(text)
    errors = sum(d.severity == "error" for d in diagnostics)
    if not as_json:
        found = f"{errors} error{'s' if errors != 1 else ''}" if errors else "no errors"
        show(f"{file}: {found}")
    if errors:
        raise typer.Exit(2)
