"""``pcsg fmt``: grammars set in order, in place."""

from __future__ import annotations

import stat
import sys
from collections.abc import Sequence
from pathlib import Path

import typer

from pcsg.commands.files import check_there
from pcsg.commands.guard import say, show
from pcsg.errors import GrammarError, PcsgError, UsageError
from pcsg.grammar.formatting import format_text
from pcsg.grammar.preprocess import ENDING, MAX_BYTES, decode_source, read_source
from pcsg.outputs import check_output, write_whole

STANDARD = "-"
"""What stands for standard input, and output."""


def run(files: Sequence[Path], check: bool) -> None:
    """Set files in order; exit status 2 if one has a mistake or, to be checked, is not in order."""
    bad = 0
    for file in files:
        try:
            if str(file) == STANDARD:
                bad += not _format_input(check)
            else:
                bad += not _format_file(file, check)
        except PcsgError as error:
            if len(files) == 1:
                raise
            # The others are read all the same.
            say(str(error) if isinstance(error, GrammarError) else f"error: {error}")
            bad += 1
    if bad:
        raise typer.Exit(2)


def _format_file(file: Path, check: bool) -> bool:
    """Format a file; return whether all is well."""
    check_there(file, (ENDING,))
    if file.suffix.lower() != ENDING:
        raise UsageError(f"{file} is no grammar: the name of one ends in {ENDING}")
    source, problems = read_source(file)
    if source is None:
        raise GrammarError(problems)
    made = format_text(source)
    # A byte order mark, too, is gone.
    if made.encode() == file.read_bytes():
        return True
    if check:
        show(f"{file}: not formatted")
        return False
    place = file.resolve()
    check_output(place, (place.suffix.lower(),))
    rights = stat.S_IMODE(place.stat().st_mode)
    write_whole(place, lambda out: out.write(made.encode()), rights=rights)
    show(f"{file}: formatted")
    return True


def _format_input(check: bool) -> bool:
    """Format standard input to standard output; return whether all is well."""
    data = sys.stdin.buffer.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise UsageError(f"standard input has more than {MAX_BYTES:,} bytes")
    source, problems = decode_source(data, "<stdin>")
    if source is None:
        raise GrammarError(problems)
    made = format_text(source).encode()
    if check:
        if made != data:
            show("<stdin>: not formatted")
        return made == data
    sys.stdout.flush()
    sys.stdout.buffer.write(made)
    return True
