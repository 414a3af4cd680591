"""``pcsg stats``: counts of a grammar."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

from pcsg.commands.scenes import open_scene


def run(
    file: Path,
    assignments: Sequence[str],
    seed: int | None,
    time: float | None,
    include: Sequence[Path],
    max_memory: str | None,
    as_json: bool,
) -> None:
    """Print what a scene consists of."""
    scene = open_scene(file, assignments, seed, time, include, max_memory)
    counts = scene.stats()
    if as_json:
        typer.echo(json.dumps(counts))
        return
    width = max(len(name) for name in counts)
    for name, value in counts.items():
        typer.echo(f"{name.replace('_', ' '):{width}}  {_shown(value)}")


def _shown(value: Any) -> str:
    if value is None:
        return "not finite"
    if isinstance(value, bool) or not isinstance(value, int):
        return str(value)
    return f"{value:,}"
