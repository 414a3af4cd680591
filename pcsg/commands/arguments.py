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
    typer.Option("-D", "--set", metavar="NAME=VALUE", help="Set a parameter of the axiom."),
]
Seed = Annotated[
    int | None,
    typer.Option("--seed", help="Random seed, for sampling and for SEED in the grammar."),
]
Time = Annotated[float | None, typer.Option("--time", help="Set TIME in the grammar, in seconds.")]
MaxMemory = Annotated[
    str | None,
    typer.Option(
        "--max-memory",
        metavar="SIZE",
        help="Limit memory to this size, such as 4G; by default half of the machine's.",
    ),
]
BlockMemory = Annotated[
    str | None,
    typer.Option(
        "--block-memory",
        metavar="SIZE",
        help="Cache geometry of huge scenes in this much memory (16M); more is faster.",
    ),
]
EngineName = Annotated[
    str,
    typer.Option(
        "--engine", metavar="NAME", help="Trace rays by the engine auto, cyclic or states."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")]
