"""Pictures that are put aside: checkpoints to go on from, and tiles to put together.

Both are NumPy archives with the texts that describe the picture; only what belongs to the same
picture is taken up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from pcsg.errors import UsageError
from pcsg.render.archive import Layout, open_archive, write_archive
from pcsg.render.image import Image
from pcsg.render.job import Job, check_light

_LAYERS = {
    "rgb": ((3,), np.float32),
    "depth": ((), np.float32),
    "normal": ((3,), np.float32),
    "albedo": ((3,), np.float32),
    "label": ((), np.int64),
    "leaf": ((), np.int32),
    "finished": ((), np.bool_),
}
"""What a tile holds for each pixel."""


def checkpoint_path(output: Path) -> Path:
    """Return where the checkpoint of a picture is kept."""
    return output.with_name(output.name + ".checkpoint")


def write_checkpoint(job: Job, path: Path) -> None:
    """Write all that is needed to go on with a picture. Nothing may run meanwhile."""
    write_archive(path, job.description, job.state())


def resume(job: Job, path: Path) -> bool:
    """Let a job go on from a checkpoint; return whether there is one.

    Raises
    ------
    UsageError
        It is of another picture, or damaged.
    """
    if not path.exists():
        return False
    with open_archive(path, "checkpoint") as archive:
        if archive.description != job.description:
            differing = _difference(archive.description, job.description)
            raise UsageError(
                f"{path} is the checkpoint of another picture: {differing}; without --resume it is"
                " overwritten"
            )
        job.restore(archive.read(job.layout()))
    return True


def tile_path(output: Path, tile: tuple[int, int]) -> Path:
    """Return where a tile of a picture is kept."""
    return output.with_name(f"{output.name}.tile-{tile[0]}-of-{tile[1]}")


def write_tile(job: Job, output: Path) -> Path:
    """Write the tile that a job has made; return where."""
    assert job.options.tile is not None
    path = tile_path(output, job.options.tile)
    image = job.image()
    write_archive(path, job.description, {name: getattr(image, name) for name in _LAYERS})
    return path


def join_tiles(job: Job, output: Path) -> tuple[Image | None, list[Path]]:
    """Return the picture of all tiles, None if one is missing, and the tiles' files.

    Raises
    ------
    UsageError
        A tile is of another picture.
    """
    assert job.options.tile is not None
    parts = job.options.tile[1]
    paths = [tile_path(output, (k, parts)) for k in range(1, parts + 1)]
    if not all(path.exists() for path in paths):
        return None, paths
    tiles = []
    for k, path in enumerate(paths, 1):
        first, last = replace(job.options, tile=(k, parts)).rows
        shape = (last - first, job.options.size[0])
        with open_archive(path, "tile") as archive:
            if archive.description != job.description:
                differing = _difference(archive.description, job.description)
                raise UsageError(f"{path} is a tile of another picture: {differing}")
            tiles.append(archive.read(_layouts(shape)))
            check_light(tiles[-1])
    layers = {name: np.concatenate([tile[name] for tile in tiles]) for name in _LAYERS}
    return Image(**layers, metadata=job.metadata, view=job.stage.view), paths


def _layouts(shape: tuple[int, int]) -> dict[str, Layout]:
    """Return what the arrays of a tile must be."""
    return {
        name: Layout((*shape, *more), np.dtype(dtype)) for name, (more, dtype) in _LAYERS.items()
    }


def _difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return what first differs between two descriptions."""
    for name in {**there, **here}:
        if there.get(name) != here.get(name):
            what = name.removeprefix("pcsg:")
            return f"its {what} is {there.get(name, 'not set')}, not {here.get(name, 'not set')}"
    return "nothing differs"
