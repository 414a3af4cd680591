"""``pcsg stats``: counts of a grammar."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pcsg.commands.guard import show
from pcsg.commands.progress import show_preparation
from pcsg.commands.scenes import open_scene


def run(
    file: Path,
    assignments: Sequence[str],
    seed: int | None,
    time: float | None,
    include: Sequence[Path],
    max_memory: str | None,
    block_memory: str | None,
    engine: str,
    as_json: bool,
) -> None:
    """Print what a scene consists of."""
    scene = open_scene(file, assignments, seed, time, include, max_memory, block_memory, engine)
    with show_preparation(file.name, as_json):
        counts = scene.stats()
    # Python refuses to write integers of more than 4300 digits; order 8000 of a fractal has them.
    most = sys.get_int_max_str_digits()
    sys.set_int_max_str_digits(0)
    try:
        _show_counts(counts, as_json)
    finally:
        sys.set_int_max_str_digits(most)


def _show_counts(counts: dict[str, Any], as_json: bool) -> None:
    if as_json:
        show(json.dumps(_plain(counts), allow_nan=False))
        return
    width = max(len(name) for name in counts)
    for name, value in counts.items():
        lines = map(_mesh, value) if name == "meshes" else [_shown(value)]
        show(f"{name.replace('_', ' '):{width}}  " + f"\n{'':{width}}  ".join(lines))


def _mesh(mesh: dict[str, Any]) -> str:
    """Return what is told of a mesh in a line."""
    parts = [f"{mesh['triangles']:,} triangles", "closed" if mesh["closed"] else "a sheet"]
    if mesh["open_edges"]:
        a, b = (f"({_shown(end)})" for end in mesh["open_at"][0])
        parts.append(f"{mesh['open_edges']:,} open edges, one from {a} to {b}")
    return "; ".join([f"{mesh['name'] or 'arrays'}: {', '.join(parts)}", *mesh["notes"]])


def _plain(value: Any) -> Any:
    """Return a value with null for infinite numbers, which JSON lacks."""
    if isinstance(value, dict):
        return {name: _plain(v) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _shown(value: Any) -> str:
    if value is None:
        return "not finite"
    if isinstance(value, dict):
        parts = ", ".join(f"{name} {_shown(v)}" for name, v in value.items() if name != "total")
        return f"{_shown(value['total'])} ({parts})" if "total" in value else parts
    if isinstance(value, list | tuple):
        return ", ".join(_shown(v) for v in value) or "none"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, bool) or not isinstance(value, int):
        return str(value)
    return f"{value:,}"
