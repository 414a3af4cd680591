"""The mesh leaf beside Embree on the same triangles, and what its hierarchy costs."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pcsg
from benchmarks.meshes import Triangles
from benchmarks.peers import make_peers
from benchmarks.rays import agreement, make_rays, measure_first
from benchmarks.report import Effort, Row, Subject, ratio
from benchmarks.scenes import rough_ball
from pcsg.leaf.mesh import mesh_of_arrays

SIZES = (30, 300)
"""Rings of a ball."""

TARGETS = {"coherent": 0.6, "random": 0.5}
"""What should be reached against Embree."""


def rows(effort: Effort) -> Iterator[Row]:
    for n in SIZES[:1] if effort.tiny else SIZES:
        ball = Triangles(*rough_ball(n))
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
            yield Row(what, values, ratio(ours, embree), TARGETS[kind])


MESH = Subject(
    "mesh",
    "A mesh as a leaf",
    "First hits, millions of rays per second of processor time, one thread. Ours are in double"
    " precision, watertight, and with position and normal. Building: seconds from arrays to the"
    " hierarchy; bytes: memory of one triangle with its share of the hierarchy.",
    ("ours", "embreex", "Mitsuba", "alike", "building", "bytes"),
    rows,
)
