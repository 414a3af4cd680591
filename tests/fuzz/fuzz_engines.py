"""Grammars that assemble modules by operations: engines agree about rays from everywhere."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path
from zlib import crc32

import numpy as np
from agreement import Judge, make_states
from assemblies import assemble
from consistency import check_engines, rays_through
from driver import Subject

from pcsg.grammar import load_text
from pcsg.trace.walker import Walker

RAYS = 20
"""From outside, from inside and from surfaces."""

JUDGED = 10
"""One in so many grammars is asked of the oracle, too, which is slow."""

SEEDS = (
    "{} ((move(0,1,0) B \\ sphere) | uscale(1.2) sphere)\n1: B -> box | move(0,0,5) sphere\n",
    "{n=3} A\nA if(n > 0, 2, 1)\n1: A -> cylinder\n"
    "2: A -> {} ((rotx(30) box & rotz(45) {n=n-1} A) | (box \\ rotx(30) box))\n",
)


def seeds() -> Sequence[str]:
    return SEEDS


def mutate(rng: random.Random, _text: str) -> str:
    return assemble(rng)


def run(text: str, _folder: Path) -> None:
    graph = load_text(text)
    chance = crc32(text.encode())
    rays = rays_through(graph, np.random.default_rng(chance), RAYS)
    check_engines(graph, rays)
    if chance % JUDGED:
        return
    # Whether a ray that starts on a surface meets it is a matter of rounding.
    few = slice(0, 2 * RAYS, 4)
    walker = Walker(graph)
    for tracer in (walker, make_states(graph, walker=walker)):
        judge = Judge(tracer, graph)
        found = tracer.intersect(rays[0][few], rays[1][few])
        for i, ray in enumerate(zip(rays[0][few].tolist(), rays[1][few].tolist(), strict=True)):
            judge.hit(ray, found, i)


def prepare() -> None:
    """Load or compile the kernels."""
    run(SEEDS[0], Path())


SUBJECT = Subject("engines", seeds, mutate, run, prepare)
