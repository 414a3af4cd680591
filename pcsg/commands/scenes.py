"""A scene from a file and the options that every verb shares."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

from pcsg.arguments import whole
from pcsg.collector import kept_for_good
from pcsg.commands.files import check_there
from pcsg.commands.guard import say
from pcsg.commands.options import parse_assignments, parse_memory, parse_number
from pcsg.commands.progress import show_preparation

if TYPE_CHECKING:
    from pcsg.scene import Scene
    from pcsg.trace.tracer import Engine


def open_scene(
    file: Path,
    assignments: Sequence[str],
    seed: int | None,
    time: float | None,
    include: Sequence[Path],
    max_memory: str | None,
    block_memory: str | None = None,
    engine: str = "auto",
    quiet: bool = False,
) -> Scene:
    """Return the scene of a grammar with the options' values."""
    check_there(file)
    values = parse_assignments(assignments)
    if seed is not None:
        values.setdefault("SEED", float(whole(seed, "--seed", -(2**63), 2**64 - 1)))
    if time is not None:
        values.setdefault("TIME", parse_number(str(time), "--time"))
    limit = parse_memory(max_memory)
    blocks = parse_memory(block_memory, "--block-memory")
    from pcsg.scene import load

    with show_preparation(file.name, quiet), kept_for_good():
        scene = load(
            file,
            include=include,
            max_memory=limit,
            block_memory=blocks,
            engine=cast("Engine", engine),  # Scene checks it
            parameters=values,
        )
    tell_warnings(scene)
    return scene


def tell_warnings(scene: Scene) -> None:
    """Say what is odd about a scene's grammar and its files."""
    for warning in scene.warnings:
        say(warning.render())
