"""``pcsg check``: every mistake in a grammar, all at once."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import typer

from pcsg.collector import kept_for_good
from pcsg.commands.files import check_there
from pcsg.commands.guard import show
from pcsg.errors import GrammarError


def run(file: Path, include: Sequence[Path], as_json: bool) -> None:
    """Print the diagnostics of a file; exit status 2 if one is an error."""
    check_there(file)
    from pcsg.grammar import check_file
    from pcsg.graph.evaluate import axiom_values, check_settings
    from pcsg.graph.graph import GLOBALS

    with kept_for_good():
        graph, diagnostics = check_file(file, include=include)
    if graph is not None:
        # Parameters of the command line could mend these, so that files with them can be read.
        try:
            diagnostics += check_settings(graph, axiom_values(graph, GLOBALS))
        except GrammarError as error:
            diagnostics += error.diagnostics
    for diagnostic in diagnostics:
        text = json.dumps(diagnostic.to_json()) if as_json else diagnostic.render() + "\n"
        show(text)
    errors = sum(d.severity == "error" for d in diagnostics)
    if not as_json:
        found = f"{errors} error{'s' if errors != 1 else ''}" if errors else "no errors"
        show(f"{file}: {found}")
    if errors:
        raise typer.Exit(2)
