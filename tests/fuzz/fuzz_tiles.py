"""Tiles of pictures, spoilt, and put together."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from archives import spoil_archive
from driver import Subject

import pcsg
from pcsg.render.checkpoint import join_tiles, tile_path, write_tile
from pcsg.render.job import Job
from pcsg.render.options import Options

OPTIONS = Options((9, 7), 1, threads=1, detail=0.0)


@cache
def make_job(part: int) -> Job:
    scene = pcsg.loads("{} label(3) sphere\nground { z = -1 }", threads=1)
    job = Job(scene, replace(OPTIONS, tile=(part, 2)))
    job.run()
    return job


def seeds() -> Sequence[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return [write_tile(make_job(k), Path(folder, "a.png")).read_bytes() for k in (1, 2)]


def run(data: bytes, folder: Path) -> None:
    output = folder / "a.png"
    write_tile(make_job(2), output)
    tile_path(output, (1, 2)).write_bytes(data)
    image, _ = join_tiles(make_job(2), output)
    assert image is not None
    image.save(output, ["depth", "label"])


SUBJECT = Subject("tiles", seeds, spoil_archive, run)
