"""Tables of all primitives: a row each, with its place, label and path."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import IO

from pcsg.graph.leaves import Leaves
from pcsg.outputs import write_whole
from pcsg.scene import Scene

COLUMNS = (
    "solid",
    "arguments",
    *(f"m{row}{column}" for row in range(3) for column in range(4)),
    "label",
    "carved",
    "path",
)
"""Columns of a table: ``m`` is world_from_leaf, row by row."""


def write_table(path: Path, scene: Scene) -> int:
    """Write the primitives of a scene as .csv; return how many there are.

    Memory is that of the table of states, whatever the number of primitives.
    """
    count = 0

    def write(file: IO[bytes]) -> None:
        nonlocal count
        file.write((",".join(COLUMNS) + "\n").encode())
        for leaves in scene.leaves():
            rows = list(_rows(leaves))
            file.write("".join(rows).encode())
            count += len(rows)

    write_whole(path, write)
    return count


def _rows(leaves: Leaves) -> Iterator[str]:
    places = leaves.matrix.reshape(-1, 12).tolist()
    labels, carved = leaves.label.tolist(), leaves.carved.tolist()
    for k, name in enumerate(leaves.name):
        if name == "empty":
            continue
        numbers = " ".join(map(repr, leaves.arguments[k]))
        place = ",".join(map(repr, places[k]))
        way = "/".join(f"{module}:{rule}" for module, rule in leaves.path[k])
        yield f"{name},{numbers},{place},{labels[k]},{int(carved[k])},{way}\n"
