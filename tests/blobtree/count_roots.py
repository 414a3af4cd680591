"""Roots of many rays, half of them grazing, against the formulas.

``python tests/blobtree/count_roots.py [RAYS [SEED [PROCESSES]]]``: 10,000 rays by default, over
random models that together use every primitive, operator and warp. One line for every wrong ray,
and a total.
"""

from __future__ import annotations

import math
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np
from blob_models import kinds_to_cover, random_model, random_rays, tangent_scale
from field_oracle import T, find_roots, value

from pcsg.blobtree.model import Model
from pcsg.blobtree.nodes import Field
from pcsg.errors import UsageError

OF_A_MODEL = 20
"""Rays of a model: many models tell more than many rays of few."""

SHORTEST = 2e-7
"""Chords up to this, over half the diagonal of a model, need not be found."""

FAINT = 1e-9
"""A field that passes T by no more than this has rounding for an answer."""


class Wrong(NamedTuple):
    """A ray that meets other roots than the formulas have."""

    kinds: tuple[str, ...]
    seed: int
    ray: int
    expected: list[float]
    found: list[float]


def some_model(kinds: tuple[str, ...], seed: int) -> tuple[Field, Model]:
    """A model that exists: random bends may be too much for what is bent."""
    for attempt in range(100):
        try:
            root = random_model(np.random.default_rng([seed, attempt]), kinds)
            model = Model(root)
        except UsageError:
            continue
        if model.primitives:
            return root, model
    raise AssertionError(kinds)


def without_short(roots: np.ndarray, shortest: float) -> np.ndarray:
    """Drop pairs of roots closer than this: chords too short to count."""
    kept: list[float] = []
    for root in roots:
        if kept and root - kept[-1] < shortest:
            kept.pop()
        else:
            kept.append(float(root))
    return np.array(kept)


def find_wrong(
    root: Field, model: Model, rng: np.random.Generator, rays: int
) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Return the rays that meet other roots than the formulas have, with both."""
    origins, directions = random_rays(rng, model, rays)
    counts, t = model.shoot(origins, directions)
    size = tangent_scale(model)
    middle = model.support.mean(axis=0)
    speed = np.linalg.norm(directions, axis=1)
    near = ((middle - origins) * directions).sum(axis=1) / speed**2
    reach = size / speed

    def g(line: np.ndarray, s: np.ndarray) -> np.ndarray:
        return value(root, origins[line] + s[:, None] * directions[line]) - T

    ranges = [(a - r, a + r) for a, r in zip(near.tolist(), reach.tolist(), strict=True)]
    wrong = []
    every = find_roots(g, ranges)
    for k, found in enumerate(np.split(t, np.cumsum(counts)[:-1])):
        shortest = SHORTEST * reach[k]
        expected, found = without_short(every[k], shortest), without_short(found, shortest)
        if _agree(expected, found, reach[k]):
            continue

        def along(_line: object, s: np.ndarray, k: int = k) -> np.ndarray:
            return g(np.full(len(s), k), s)

        # Sampled more finely, before anyone is blamed.
        expected = without_short(find_roots(along, [ranges[k]], 200_000)[0], shortest)
        if not _agree(expected, found, reach[k]) and not _faint(along, expected, found, reach[k]):
            wrong.append((k, (expected - near[k]) / reach[k], (found - near[k]) / reach[k]))
    return wrong


def _agree(expected: np.ndarray, found: np.ndarray, reach: float) -> bool:
    same = len(expected) == len(found)
    return same and not np.any(np.abs(expected - found) > 1e-6 * reach)


def _faint(g: object, expected: np.ndarray, found: np.ndarray, reach: float) -> bool:
    """Return whether all that differs are chords on which the field is T but for rounding."""
    assert callable(g)
    lone = [
        x
        for mine, other in ((expected, found), (found, expected))
        for x in mine
        if not len(other) or np.abs(other - x).min() > 1e-6 * reach
    ]
    if len(lone) % 2:
        return False
    lone.sort()
    for a, b in zip(lone[::2], lone[1::2], strict=True):
        if np.abs(g(0, np.linspace(a, b, 2_001))).max() > FAINT:
            return False
    return True


def run_model(task: tuple[int, int, int]) -> list[Wrong]:
    """Return what is wrong with the rays of one model."""
    number, seed, rays = task
    covered = kinds_to_cover()
    kinds = covered[number % len(covered)]
    root, model = some_model(kinds, 1_000_000 * seed + number)
    found = find_wrong(root, model, np.random.default_rng([seed, number]), rays)
    return [Wrong(kinds, number, k, e.tolist(), f.tolist()) for k, e, f in found]


def main(arguments: list[str]) -> int:
    numbers = [int(a) for a in arguments]
    rays, seed, processes = (*numbers, *(10_000, 1, 1)[len(numbers) :])
    tasks = [(k, seed, OF_A_MODEL) for k in range(math.ceil(rays / OF_A_MODEL))]
    started, bad = time.perf_counter(), 0
    with ProcessPoolExecutor(processes) as pool:
        for done, wrong in enumerate(pool.map(run_model, tasks, chunksize=4), 1):
            for w in wrong:
                print(w, flush=True)
            bad += len(wrong)
            if done % 20 == 0:
                seconds = time.perf_counter() - started
                print(f"{done * OF_A_MODEL:,} rays, {bad} wrong, {seconds:.0f} s", flush=True)
    print(f"{len(tasks) * OF_A_MODEL:,} rays over {len(tasks):,} models, seed {seed}: {bad} wrong")
    return min(bad, 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
