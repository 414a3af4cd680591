"""Pictures that are put aside: checkpoints to go on from, and tiles to put together.

Both are NumPy archives with the texts that describe the picture; only what belongs to the same
picture is taken up.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import EnvironmentFault, UsageError
from pcsg.outputs import write_whole
from pcsg.render.image import Image
from pcsg.render.job import Job

_LAYERS = ("rgb", "depth", "normal", "albedo", "label", "leaf", "finished")


def checkpoint_path(output: Path) -> Path:
    """Return where the checkpoint of a picture is kept."""
    return output.with_name(output.name + ".checkpoint")


def write_checkpoint(job: Job, path: Path) -> None:
    """Write all that is needed to go on with a picture. Nothing may run meanwhile."""
    _write(path, job.description, job.state())


def resume(job: Job, path: Path) -> bool:
    """Let a job go on from a checkpoint; return whether there is one.

    Raises
    ------
    UsageError
        It is of another picture, or damaged.
    """
    if not path.exists():
        return False
    description, arrays = _read(path)
    if description != job.description:
        differing = _difference(description, job.description)
        raise UsageError(
            f"{path} is the checkpoint of another picture: {differing}; without --resume it is"
            " overwritten"
        )
    job.restore(arrays)
    return True


def tile_path(output: Path, tile: tuple[int, int]) -> Path:
    """Return where a tile of a picture is kept."""
    return output.with_name(f"{output.name}.tile-{tile[0]}-of-{tile[1]}")


def write_tile(job: Job, output: Path) -> Path:
    """Write the tile that a job has made; return where."""
    assert job.options.tile is not None
    path = tile_path(output, job.options.tile)
    image = job.image()
    _write(path, job.description, {name: getattr(image, name) for name in _LAYERS})
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
    for path in paths:
        description, arrays = _read(path)
        if description != job.description:
            raise UsageError(
                f"{path} is a tile of another picture: {_difference(description, job.description)}"
            )
        tiles.append(arrays)
    layers = {name: np.concatenate([tile[name] for tile in tiles]) for name in _LAYERS}
    return Image(**layers, metadata=job.metadata, view=job.stage.view), paths


def _difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return what first differs between two descriptions."""
    for name in {**there, **here}:
        if there.get(name) != here.get(name):
            what = name.removeprefix("pcsg:")
            return f"its {what} is {there.get(name, 'not set')}, not {here.get(name, 'not set')}"
    return "nothing differs"


def _write(
    path: Path, description: Mapping[str, str], arrays: Mapping[str, NDArray[np.generic]]
) -> None:
    text = np.frombuffer(json.dumps(dict(description)).encode(), dtype=np.uint8)

    def write(file: IO[bytes]) -> None:
        np.savez(file, **{"description": text, **arrays})  # type: ignore[arg-type]  # stubs say bool

    write_whole(path, write)


def _read(path: Path) -> tuple[dict[str, str], dict[str, NDArray[Any]]]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = dict(archive)
        description = json.loads(arrays.pop("description").tobytes())
    except OSError as error:
        raise EnvironmentFault(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, KeyError, zipfile.BadZipFile):
        raise UsageError(f"{path} is damaged; delete it to begin anew") from None
    return description, arrays
