"""Pictures that are stopped, put aside, parted and joined come out the same, to the last byte."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from spheres import Spheres

from pcsg.errors import UsageError
from pcsg.render.checkpoint import (
    checkpoint_path,
    join_tiles,
    resume,
    tile_path,
    write_checkpoint,
    write_tile,
)
from pcsg.render.job import Job
from pcsg.render.options import Options


def make(**options):
    scene = Spheres(ground=[{"z": None, "material": None}])
    values = {"size": (150, 110), "samples": 16, "threads": 2, **options}
    return Job(scene, Options(**values))


RARE = {"mode": "path", "exposure": 5.0}
"""So bright that samples count as far as their neighbours have some as bright."""


def same(a, b):
    return all(
        np.array_equal(x, y) if isinstance(x, np.ndarray) else True
        for x, y in zip(vars(a).values(), vars(b).values(), strict=True)
    )


@pytest.mark.parametrize(("mode", "batches"), [("preview", 1), ("preview", 3), ("path", 2)])
def test_a_stopped_picture_goes_on_to_the_same_bits(tmp_path, mode, batches):
    film = {"film": {"mode": mode}}
    whole = make(overrides=film)
    whole.run()
    stopped = make(overrides=film)
    seen = []

    def interrupt(progress):
        seen.append(progress.samples)
        if len(seen) == batches:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped.run(interrupt)
    path = tmp_path / "a.checkpoint"
    write_checkpoint(stopped, path)
    again = make(overrides=film, threads=1)
    assert resume(again, path)
    assert again.progress.samples > 0
    again.run()
    assert same(whole.image(), again.image())
    assert whole.film.count.sum() == again.progress.samples


def test_pauses_change_nothing_and_what_they_keep_is_consistent(tmp_path):
    whole = make()
    whole.run()
    paused = make()
    states = []
    paused.run(
        pause=lambda: states.append({k: v.copy() for k, v in paused.state().items()}), every=0.0
    )
    assert same(whole.image(), paused.image())
    assert len(states) >= 2
    again = make()
    again.restore(states[len(states) // 2])
    again.run()
    assert same(whole.image(), again.image())


def test_a_checkpoint_of_another_picture_is_refused(tmp_path):
    job = make()
    job.run()
    path = checkpoint_path(tmp_path / "a.png")
    assert path.name == "a.png.checkpoint"
    write_checkpoint(job, path)
    with pytest.raises(UsageError, match="seed is 1, not 2"):
        resume(make(seed=2), path)
    path.write_bytes(b"not an archive")
    with pytest.raises(UsageError, match="damaged"):
        resume(make(), path)
    assert not resume(make(), tmp_path / "none.checkpoint")


@pytest.mark.parametrize(("parts", "film"), [(2, {}), (5, {}), (5, RARE)])
def test_tiles_join_to_the_same_bits(tmp_path, parts, film):
    made = {"size": (90, 133), "overrides": {"film": film}} if film else {"size": (90, 133)}
    whole = make(**made)
    whole.run()
    if film:
        assert whole.film._cascade.excess().max() > 0
    for part in range(1, parts + 1):
        job = make(**made, tile=(part, parts))
        job.run()
        assert join_tiles(job, tmp_path / "a.png")[0] is None
        assert write_tile(job, tmp_path / "a.png") == tile_path(tmp_path / "a.png", (part, parts))
    image, paths = join_tiles(job, tmp_path / "a.png")
    assert len(paths) == parts
    assert image is not None
    assert same(whole.image(), image)


@pytest.mark.parametrize("tile", [(0, 4), (5, 4), (1, 111)])
def test_impossible_tiles_are_refused(tile):
    with pytest.raises(UsageError, match="tile"):
        make(tile=tile)


@pytest.mark.skipif(os.name == "nt", reason="signals differ there")
def test_a_killed_picture_goes_on_to_the_same_bytes(tmp_path):
    (tmp_path / "balls.pcsg").write_text(
        "{n=5} B\nB if(n > 0, 2, 1)\n1: B -> sphere\n"
        "2: B -> sphere | {n=n-1} (move(1.2,0,1) uscale(0.6) B | move(-1.2,0,1) uscale(0.6) B)\n"
        "film { mode = path }"
    )
    command = [sys.executable, "-m", "pcsg", "render", "balls.pcsg", "--size", "200x160", "-q"]
    command += ["--samples", "16", "-o", "a.png", "--show-every", "0.2"]
    process = subprocess.Popen(command, cwd=tmp_path)
    kept = tmp_path / "a.png.checkpoint"
    while not kept.exists():
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert kept.exists()
    subprocess.run([*command, "--resume"], cwd=tmp_path, check=True)
    resumed = (tmp_path / "a.png").read_bytes()
    assert not kept.exists()
    subprocess.run(command, cwd=tmp_path, check=True)
    assert (tmp_path / "a.png").read_bytes() == resumed
