"""Checkpoints of pictures, spoilt, and gone on from."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from archives import spoil_archive
from driver import Subject

import pcsg
from pcsg.render.checkpoint import resume, write_checkpoint
from pcsg.render.job import Job
from pcsg.render.options import Options

# With a camera: to look for one takes ten times as long as all the rest.
SCENE = pcsg.loads(
    "{} color(1, 0.3, 0.1) sphere\nground { z = -1 }\ncamera { eye = (3, -5, 2) }", threads=1
)


def make_job(mode: str) -> Job:
    film = {"film": {"mode": mode}}
    return Job(SCENE, Options((9, 7), 4, threads=1, overrides=film, detail=0.0))


def seeds() -> Sequence[bytes]:
    made = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.checkpoint")
        for mode in ("preview", "path"):
            for passes in (1, 2, 3):
                job = make_job(mode)

                def stop(progress: object, job: Job = job, passes: int = passes) -> None:
                    if job.progress.pass_number == passes:
                        raise KeyboardInterrupt

                with suppress(KeyboardInterrupt):
                    job.run(stop)
                write_checkpoint(job, path)
                made.append(path.read_bytes())
    return made


def run(data: bytes, folder: Path) -> None:
    path = folder / "a.checkpoint"
    path.write_bytes(data)
    job = make_job("path" if b"layers.npy" in data else "preview")
    resume(job, path)
    job.run()
    job.image().to_bytes()


SUBJECT = Subject("checkpoints", seeds, spoil_archive, run)
