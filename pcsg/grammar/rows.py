"""Tables that a grammar names, each read once."""

from __future__ import annotations

from pathlib import Path

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, UsageError
from pcsg.grammar import syntax
from pcsg.grammar.names import Names
from pcsg.graph.columns import Table
from pcsg.graph.scattering import PLACING, make_table
from pcsg.tablefile import read_table


def read_rows(part: syntax.Scatter, names: Names) -> tuple[Table | None, list[Diagnostic]]:
    """Return the table of a `scatter`, and what is wrong with it."""
    file = part.file
    target = Path(file.span.folder) / file.text
    if names.reach.find(target) is None:
        return None, [names.reach.refuse(target, file.span)]
    words = {name.text: text.text for name, text in part.words}
    key = file.span.folder, file.text, tuple(words.items())
    found = names.tables.get(key)
    if found is None:
        try:
            columns = read_table(target, PLACING)
            found = make_table(columns.numbers, columns.words, words, file.text)
        except UsageError as error:
            found = error
        names.tables[key] = found
    if isinstance(found, UsageError):
        return None, [diagnose("bad-file", str(found), file.span)]
    return found, []
