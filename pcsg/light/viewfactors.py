"""View factors: which share of what a surface sends out reaches which others."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from pcsg.arguments import whole
from pcsg.errors import UsageError
from pcsg.light.scattering import scatter_about
from pcsg.light.stage import Stage, batches
from pcsg.trace.measures import Measured

if TYPE_CHECKING:
    from pcsg.scene import Scene

NOTHING = "nothing"
"""Key of what reaches no surface."""


def exchange(
    scene: Scene,
    source_label: int,
    *,
    side: Literal["front", "back", "both"] = "front",
    periodic: ArrayLike | None = None,
    rays: int = 1_000_000,
    seed: int = 0,
) -> dict[int | str, Measured]:
    """Return view factors from the surfaces of a label to those of all labels.

    Parameters
    ----------
    source_label
        Whose surfaces send out light, by Lambert's law.
    side
        Of sheets: ``front``, where the normal points, ``back``, or ``both``. Solids have a front
        only.
    periodic
        A cell whose copies fill the plane.
    rays
        Number of rays.
    seed
        Equal seeds give equal bits.

    Returns
    -------
    dict
        By label, and ``"nothing"`` for what leaves the scene: `Measured`, dimensionless. They add
        up to 1.
    """
    if side not in ("front", "back", "both"):
        raise UsageError(f"`side` is front, back or both, not {side!r}")
    stage = Stage(scene, periodic, soil=-math.inf)
    whole(rays, "rays", 1)
    counts: dict[int | str, int] = {}
    sent = 0
    for size, rng in batches(rays, seed):
        drawn = scene.sample(size, seed=int(rng.integers(1 << 62)))
        own = np.flatnonzero(drawn.label == source_label)
        points, normals = drawn.points[own], drawn.normals[own]
        u = rng.random((len(own), 3))
        if side == "back":
            normals = -normals
        elif side == "both":
            normals = np.where(u[:, 2:] < 0.5, normals, -normals)
        directions = scatter_about(normals, u[:, :2])
        cell = None if stage.cell is None else np.array(stage.cell)
        if not len(own):
            continue
        hits = scene.intersect(points, directions, stage.step, periodic=cell)
        met = np.isfinite(hits.t)
        for label, count in zip(*np.unique(hits.label[met], return_counts=True), strict=True):
            counts[int(label)] = counts.get(int(label), 0) + int(count)
        counts[NOTHING] = counts.get(NOTHING, 0) + int((~met).sum())
        sent += len(own)
    if not sent:
        raise UsageError(f"no surface of label {source_label} was found")
    shares = {key: count / sent for key, count in counts.items()}
    return {key: Measured(p, math.sqrt(p * (1.0 - p) / sent)) for key, p in shares.items()}
