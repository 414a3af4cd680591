"""``pcsg export``: scenes for other programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from pcsg.commands.guard import say, show
from pcsg.commands.progress import show_preparation
from pcsg.commands.scenes import open_scene


def run(
    file: Path,
    output: Path,
    segments: int,
    resolution: int,
    depth: int | None,
    instances: bool,
    up: str | None,
    assignments: Sequence[str],
    seed: int | None,
    time: float | None,
    include: Sequence[Path],
    max_memory: str | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Write a scene and say what the file has."""
    from pcsg.export import check_export, export

    check_export(output, up, instances)
    scene = open_scene(file, assignments, seed, time, include, max_memory, quiet=quiet)
    with show_preparation(file.name, quiet or as_json):
        made = export(
            scene,
            output,
            segments=segments,
            resolution=resolution,
            depth=depth,
            instances=instances,
            up=up,
        )
    size = output.stat().st_size
    if as_json:
        show(json.dumps({"file": str(output), "bytes": size, **made._asdict()}))
        return
    if quiet:
        return
    counts = {
        "solids": made.solids,
        "prototypes": made.prototypes,
        "shapes": made.shapes,
        "materials": made.materials,
    }
    words = ", ".join(f"{name} {count:,}" for name, count in counts.items() if count)
    say(f"{output}: {words}, bytes {size:,}")
    for note in made.notes:
        say(f"  {note}")
