"""The mesh leaf beside Embree on the same triangles, and what its hierarchy costs."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

import pcsg
from benchmarks.meshes import Triangles
from benchmarks.peers import make_peers
from benchmarks.rays import agreement, make_rays, measure_first
from benchmarks.report import Effort, Row, Subject, ratio
from pcsg.leaf.mesh import mesh_of_arrays

SIZES = ((30, 0.3), (300, 0.3))
"""Rings of a ball, and what should be reached against Embree."""


def rough_ball(n: int) -> Triangles:
    """Return a closed ball with a rough surface, of 4 n (n - 1) triangles."""
    rng = np.random.default_rng(0)
    polar, around = np.pi * np.arange(1, n) / n, np.pi * np.arange(2 * n) / n
    b, a = (x.ravel() for x in np.meshgrid(polar, around, indexing="ij"))
    ring = np.stack([np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b)], axis=1)
    points = np.concatenate([[(0.0, 0.0, 1.0)], ring, [(0.0, 0.0, -1.0)]])
    waves = 0.1 * np.sin(9.0 * points[:, 0]) * np.sin(7.0 * points[:, 1])
    points *= (1.0 + waves + 0.2 / n * rng.normal(size=len(points)))[:, None]
    rows = 1 + 2 * n * np.arange(n - 1)[:, None] + np.arange(2 * n)
    ahead = np.roll(rows, -1, axis=1)
    last = np.full_like(rows[:1], len(points) - 1)
    parts = [
        (np.zeros_like(last), rows[:1], ahead[:1]),
        (rows[:-1], rows[1:], ahead[1:]),
        (rows[:-1], ahead[1:], ahead[:-1]),
        (last, ahead[-1:], rows[-1:]),
    ]
    faces = np.concatenate([np.stack(p, axis=-1).reshape(-1, 3) for p in parts])
    return Triangles(points, faces.astype(np.int32))


def rows(effort: Effort) -> Iterator[Row]:
    for n, target in SIZES[:1] if effort.tiny else SIZES:
        ball = rough_ball(n)
        start = time.thread_time()
        model = mesh_of_arrays(ball.corners, ball.faces)
        nbytes = model.data.nbytes / len(ball.faces)
        building = time.thread_time() - start
        scene = pcsg.Scene(pcsg.mesh(ball.corners, ball.faces), threads=1)
        peers = make_peers(ball)
        for kind, rays in make_rays(scene, effort).items():
            rates = measure_first(scene, peers, rays, effort.repeats)
            ours, embree = rates["ours"], rates.get("embreex")
            alike = f"{100 * agreement(scene, peers[0], rays):.1f} %" if peers else None
            values = (ours, embree, rates.get("Mitsuba"), alike, building, nbytes)
            what = f"{len(ball.faces):,} triangles, {kind}"
            yield Row(what, values, ratio(ours, embree), target)


MESH = Subject(
    "mesh",
    "A mesh as a leaf",
    "First hits, millions of rays per second of processor time, one thread. Ours are in double"
    " precision, watertight, and with position, normal and surface coordinates, for which the"
    " point is looked up in the hierarchy again. Building: seconds from arrays to the hierarchy;"
    " bytes: memory of one triangle with its share of the hierarchy.",
    ("ours", "embreex", "Mitsuba", "alike", "building", "bytes"),
    rows,
)
