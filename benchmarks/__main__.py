"""Print rays per second and memory of both engines, one thread, all in one run.

``python -m benchmarks [--write]``; ``--write`` also puts the table into RESULTS.md.
Rates are millions of rays per second of the thread's own processor time, the best of three, with
normal and leaf; *coherent* rays make a picture, *random* ones come from all around the scene.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import pcsg
from pcsg.scene import Scene

HERE = Path(__file__).parent
GRAMMARS = HERE.parent / "grammars"
SCENES = (
    ("Sierpinski 6", "sierpinski", {"c": 6.0}),
    ("Sierpinski 10", "sierpinski", {"c": 10.0}),
    ("Sierpinski 40", "sierpinski", {"c": 40.0}),
    ("fig 5a", "fig5a", {}),
    ("tree", "tree", {}),
    ("Menger 3", "menger", {}),
    ("terrain 4", "terrain", {"cnt": 4.0}),
)
COUNT = {"states": 200_000, "cyclic": 4_000}


def make_rays(scene: Scene, n: int, coherent: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return n rays towards the scene's box."""
    rng = np.random.default_rng(1)
    lower, upper = scene.bounds
    centre, radius = (lower + upper) / 2, float(np.linalg.norm(upper - lower)) / 2
    if coherent:
        eye = centre + 2.5 * radius * np.array([0.6, -0.7, 0.4])
        side = int(n**0.5)
        s = np.linspace(-0.4, 0.4, side)
        x, y = np.meshgrid(s, s)
        forward = (centre - eye) / np.linalg.norm(centre - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        up = np.cross(right, forward)
        directions = forward + x.reshape(-1, 1) * right + y.reshape(-1, 1) * up
        return np.broadcast_to(eye, directions.shape).copy(), directions
    origins = rng.normal(size=(n, 3))
    origins = centre + 1.3 * radius * origins / np.linalg.norm(origins, axis=1)[:, None]
    return origins, lower + rng.random((n, 3)) * (upper - lower) - origins


def measure_rate(scene: Scene, method: str, rays: tuple[np.ndarray, np.ndarray]) -> float:
    """Return millions of rays per second of processor time."""
    trace = getattr(scene, method)
    trace(rays[0][:16], rays[1][:16])
    times = []
    for _ in range(3):
        start = time.thread_time()
        trace(*rays)
        times.append(time.thread_time() - start)
    return len(rays[0]) / min(times) / 1e6


def rows() -> Iterator[str]:
    yield "| scene | engine | coherent | random | any, random | KB |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for name, file, parameters in SCENES:
        for engine in ("states", "cyclic"):
            scene = pcsg.load(
                GRAMMARS / f"{file}.pcsg", parameters=parameters, engine=engine, threads=1
            )
            coherent, scattered = (make_rays(scene, COUNT[engine], c) for c in (True, False))
            rates = (
                measure_rate(scene, "intersect", coherent),
                measure_rate(scene, "intersect", scattered),
                measure_rate(scene, "occluded", scattered),
            )
            kilobytes = sum(scene.tracer.nbytes.values()) / 1000
            shown = " | ".join(f"{rate:.3g}" for rate in rates)
            yield f"| {name} | {engine} | {shown} | {kilobytes:.0f} |"


def main() -> None:
    machine = f"{platform.machine()}, {os.cpu_count()} processors, Python {sys.version.split()[0]}"
    lines = ["# Results", "", f"`python -m benchmarks` on {machine}; see `__main__.py`.", ""]
    for row in rows():
        lines.append(row)
        print(row, flush=True)
    if "--write" in sys.argv[1:]:
        (HERE / "RESULTS.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
