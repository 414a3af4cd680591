"""Options that several verbs take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

File = Annotated[
    Path, typer.Argument(metavar="FILE", help="A grammar (.pcsg).", show_default=False)
]
Include = Annotated[
    list[Path],
    typer.Option(
        "--include", metavar="DIR", help="Further folder whose files the grammar may name."
    ),
]
Assignments = Annotated[
    list[str],
    typer.Option("-D", "--set", metavar="NAME=VALUE", help="Value of a parameter of the axiom."),
]
Seed = Annotated[int | None, typer.Option("--seed", help="Of sampling, and the grammar's SEED.")]
Time = Annotated[float | None, typer.Option("--time", help="The grammar's TIME.")]
MaxMemory = Annotated[
    str | None,
    typer.Option("--max-memory", metavar="SIZE", help="Such as 4G; default half of the machine."),
]
BlockMemory = Annotated[
    str | None,
    typer.Option("--block-memory", metavar="SIZE", help="For states made beforehand; 16M."),
]
EngineName = Annotated[
    str, typer.Option("--engine", metavar="NAME", help="auto, cyclic or states.")
]
Json = Annotated[bool, typer.Option("--json", help="Say it in JSON on standard output.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Say nothing but errors.")]
