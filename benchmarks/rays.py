"""Rays per second: first hits beside Embree and Mitsuba, and any hits beside first ones."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.peers import Peer, make_peers
from benchmarks.report import Effort, Row, Subject, best_times, ratio
from benchmarks.scenes import SCENES, triangles_of
from benchmarks.views import Floats, look_at, picture_rays, random_rays
from pcsg.scene import Scene

# Scene, and what should be reached against Embree: coherent and random rays.
TARGETS: tuple[tuple[str, float | None, float | None], ...] = (
    ("Sierpinski 6", 0.8, 0.8),
    ("Sierpinski 8", 1.0, 2.0),
    ("Sierpinski 10", 1.8, 3.0),
    ("Sierpinski 40", None, None),
    ("fig 5a limbs", 1.5, 1.5),
    ("fig 5a", None, None),
    ("tree", None, None),
    ("Menger 3", None, None),
    ("terrain 8", 0.4, 0.3),
    ("terrain 10", 0.4, 0.3),
)
TINY: tuple[tuple[str, float | None, float | None], ...] = (
    ("Sierpinski 4", 0.8, 0.8),
    ("terrain 3", 0.4, None),
)

WALKED = 4_096
"""Rays where the graph itself is walked, which is slow."""


def make_rays(scene: Scene, effort: Effort) -> dict[str, tuple[Floats, Floats]]:
    """Return rays of both kinds for a scene."""
    n = effort.rays if scene.engine != "cyclic" else min(effort.rays, WALKED)
    view = look_at(scene.bounds)
    return {
        "coherent": picture_rays(view, int(n**0.5)),
        "random": random_rays(scene.bounds, n),
    }


def measure_first(
    scene: Scene, peers: list[Peer], rays: tuple[Floats, Floats], repeats: int
) -> dict[str, float]:
    """Return millions of rays per second of ours and of every peer, in turns."""
    n = len(rays[0])
    scene.intersect(rays[0][:64], rays[1][:64])
    times = {"ours": float("inf")}
    prepared = {peer.name: peer.prepare(rays) for peer in peers}
    for _ in range(repeats):
        once = best_times({"ours": partial(scene.intersect, *rays)}, 1)
        for peer in peers:
            run = partial(peer.closest, prepared[peer.name])
            once |= best_times({peer.name: run}, 1, peer.clock)
        times = {name: min(t, times.get(name, float("inf"))) for name, t in once.items()}
    return {name: n / t / 1e6 for name, t in times.items()}


def agreement(scene: Scene, peer: Peer, rays: tuple[Floats, Floats]) -> float:
    """Return the share of rays for which ours and a peer's distance agree to a thousandth."""
    ours = scene.intersect(*rays).t
    theirs = peer.distances(peer.closest(peer.prepare(rays)))
    with np.errstate(invalid="ignore"):
        near = np.abs(ours - theirs) <= 1e-3 * ours
    return float(np.mean(near | (np.isinf(ours) & np.isinf(theirs))))


def first_hits(effort: Effort) -> Iterator[Row]:
    for name, coherent, scattered in TINY if effort.tiny else TARGETS:
        scene = SCENES[name].load()
        peers = make_peers(triangles_of(name))
        targets = {"coherent": coherent, "random": scattered}
        for kind, rays in make_rays(scene, effort).items():
            rates = measure_first(scene, peers, rays, effort.repeats)
            ours, embree = rates["ours"], rates.get("embreex")
            alike = f"{100 * agreement(scene, peers[0], rays):.1f} %" if peers else None
            values = (scene.engine, ours, embree, rates.get("Mitsuba"), alike)
            yield Row(f"{name}, {kind}", values, ratio(ours, embree), targets[kind])


def any_hits(effort: Effort) -> Iterator[Row]:
    for name, *_ in TINY if effort.tiny else TARGETS:
        scene = SCENES[name].load()
        for kind, rays in make_rays(scene, effort).items():
            scene.occluded(rays[0][:64], rays[1][:64])
            runs = {
                "first": partial(scene.intersect, *rays),
                "any": partial(scene.occluded, *rays),
            }
            times = best_times(runs, effort.repeats)
            first, occluded = (len(rays[0]) / times[k] / 1e6 for k in ("first", "any"))
            target = 1.2 if scene.engine != "cyclic" else None
            yield Row(f"{name}, {kind}", (first, occluded), occluded / first, target)


def two_threads(effort: Effort) -> Iterator[Row]:
    for name in ("Sierpinski 4",) if effort.tiny else ("Sierpinski 8", "fig 5a"):
        scenes = {n: SCENES[name].load(threads=n) for n in (1, 2)}
        rays = make_rays(scenes[1], effort)["coherent"]
        runs = {str(n): partial(scene.intersect, *rays) for n, scene in scenes.items()}
        for run in runs.values():
            run()
        times = best_times(runs, 2 * effort.repeats, time.perf_counter)
        one, two = (len(rays[0]) / times[n] / 1e6 for n in ("1", "2"))
        yield Row(f"{name}, coherent", (one, two), two / one, 1.8)


FIRST = Subject(
    "rays",
    "First hits",
    "Millions of rays per second of processor time, one thread; with distance, normal and leaf"
    " (ours: double precision, and position, surface coordinates, attributes). The ratio is ours"
    " over embreex. *alike*: rays on which both find the same distance to a thousandth.",
    ("engine", "ours", "embreex", "Mitsuba", "alike"),
    first_hits,
)
ANY = Subject(
    "any",
    "Any hit",
    "Millions of rays per second of processor time, one thread. The ratio is any over first.",
    ("first", "any"),
    any_hits,
)
THREADS = Subject(
    "threads",
    "Two threads",
    "Millions of rays per second of the clock on the wall. The ratio is two threads over one.",
    ("one", "two"),
    two_threads,
)
