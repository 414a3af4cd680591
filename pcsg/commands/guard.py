"""The one place where errors become messages and exit statuses.

0 done; 1 the surroundings failed; 2 the user's mistake; 130 interrupted.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from io import TextIOWrapper
from pathlib import Path
from typing import ParamSpec

import typer

from pcsg.errors import EvaluationFault, GrammarError, PcsgError, missing_extra, printable

P = ParamSpec("P")

INTERRUPTED = 130

TRACEBACK = "PCSG_TRACEBACK"
"""Environment variable that lets errors through with their traceback, for developers."""


EXTRAS = {
    "scipy": ("SciPy", "mesh"),
    "skimage": ("scikit-image", "mesh"),
    "OpenEXR": ("OpenEXR", "exr"),
    "lsprotocol": ("pygls", "lsp"),
    "pygls": ("pygls", "lsp"),
    "websockets": ("websockets", "view"),
}
"""Packages that only some verbs need: what they are called, and the extra that brings them."""


def guard(verb: Callable[P, None]) -> Callable[P, None]:
    """Let a verb end with a message and an exit status whatever happens."""

    @functools.wraps(verb)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            verb(*args, **kwargs)
            sys.stdout.flush()
        except typer.Exit:
            raise
        except BaseException as error:
            if os.environ.get(TRACEBACK):
                raise
            raise typer.Exit(_tell(error)) from None

    return guarded


def _tell(error: BaseException) -> int:
    """Say what went wrong; return the exit status."""
    if isinstance(error, PcsgError):
        rendered = isinstance(error, (GrammarError, EvaluationFault))
        say(str(error) if rendered else f"error: {error}")
        return error.exit_status
    if isinstance(error, KeyboardInterrupt):
        say("interrupted")
        return INTERRUPTED
    if isinstance(error, BrokenPipeError):
        # Who read our output has gone. Nothing may be written at exit either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    if isinstance(error, MemoryError):
        say("error: out of memory; a smaller picture, fewer threads or a larger machine helps")
        return 1
    if isinstance(error, RuntimeError) and "start new thread" in str(error):
        say("error: the system allows no more threads; fewer --threads or --jobs help")
        return 1
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        say(f"error: {place}{error.strerror or error}")
        return 1
    if isinstance(error, ModuleNotFoundError) and (error.name or "").split(".")[0] in EXTRAS:
        package, extra = EXTRAS[(error.name or "").split(".")[0]]
        say("error: " + missing_extra("this needs", package, extra))
        return 1
    if isinstance(error, RecursionError):
        say("error: the input is nested too deeply")
        return 2
    say(
        f"error: this is a mistake in pcsg itself ({type(error).__name__}: {error});"
        f" {TRACEBACK}=1 shows where"
    )
    return 1


def prepare_standard_files() -> None:
    """Let standard input, output and errors take whatever is said.

    What is closed is opened, and leads nowhere: else the first file that is opened would take its
    number, and get what is meant for the user. Signs that the output cannot show are spelled out.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is not None:
            continue
        try:
            os.fstat(number)
        except OSError:
            # It gets the lowest number that is free: this one. Other processes have it, too.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
        opened = Path(os.devnull).open("w" if number else "r", encoding="utf-8")  # noqa: SIM115 -- it stays open
        setattr(sys, name, opened)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def show(text: str) -> None:
    """Write a result to standard output; what it quotes is no command for the terminal."""
    typer.echo(printable(text))


def say(text: str) -> None:
    """Write a line to standard error; what it quotes is no command for the terminal."""
    print(printable(text), file=sys.stderr, flush=True)
