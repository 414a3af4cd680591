"""Growing trees: counts beside the paper's, time and size of a tree at an instant."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage, spatial

from benchmarks.report import Effort, Row, Subject, best_times
from pcsg.growth.model import GrowthModel
from pcsg.growth.state import State

# The paper's last picture: 181,692 primitives and 22,220 operation nodes.
PAPER = (181_692, 22_220)


def state_bytes(state: State) -> int:
    """Return the memory of all arrays of a tree at an instant."""
    tables: list[Any] = [getattr(state, f.name) for f in fields(state)]
    arrays = [a for t in tables if hasattr(t, "__dict__") for a in vars(t).values()]
    return sum(getattr(a, "nbytes", 0) for a in arrays)


def instants(effort: Effort) -> Iterator[Row]:
    model = GrowthModel.load("populus")
    for year in (1, 5) if effort.tiny else (1, 5, 10, 15, 20, 27):
        t = year - 0.4
        model.at(t)
        taken = best_times({"at": lambda: model.at(t)}, effort.repeats, time.process_time)["at"]  # noqa: B023
        c = model.counts(year)
        values = (c.operators, c.primitives, state_bytes(model.at(t)) / 1e6, taken)
        yield Row(f"populus, t = {t:g}", values, taken, 2.0, at_most=True)
    last = model.counts(model.species.ymax)
    for what, found, paper in (
        ("primitives", last.primitives, PAPER[0]),
        ("operators", last.operators, PAPER[1]),
    ):
        off = abs(found / paper - 1.0)
        yield Row(f"{what} beside the paper's {paper:,}", (None,) * 4, off, 0.03, at_most=True)


def shapes(effort: Effort) -> Iterator[Row]:
    """Silhouettes of bare wood, the mean of some seeds; solidity with leaves, of one."""
    seeds = range(1, 2) if effort.tiny else range(1, 6)
    models = [GrowthModel.load("populus", seed) for seed in seeds]
    # Width over height in the specification, and how far off it may be.
    for year, expected in ((2, 0.33), (4, 0.30), (7, 0.34), (11, 0.38), (15, 0.45), (19, 0.54),
                           (23, 0.63), (27, 0.72))[: 2 if effort.tiny else None]:  # fmt: skip
        found = np.array([_shape(model.at(float(year))) for model in models]).mean(axis=0)
        solid = solidity(models[0].at(year - 0.35))
        height, width, place = map(float, found)
        values = (height, width, width / height, place, solid)
        off = abs(width / height / expected - 1.0)
        yield Row(f"year {year}", values, off, 0.15, at_most=True)


def _shape(state: State) -> tuple[float, float, float]:
    """Return height, greatest width, and the height of what is farthest out, over the height."""
    p = state.nodes.position
    ways = np.linspace(0.0, np.pi, 24)
    width = max(float(np.ptp(p[:, :2] @ (np.cos(a), np.sin(a)))) for a in ways)
    out = np.hypot(p[:, 0], p[:, 1])
    return state.height, width, float(p[np.argmax(out), 2]) / state.height


def solidity(state: State, size: int = 400) -> float:
    """Return the area of the silhouette with leaves, holes filled, over that of its hull."""
    n, leaves = state.nodes, state.leaves
    tips = leaves.position + leaves.size[:, None] * leaves.outward
    points = np.concatenate([n.position, leaves.position, tips])[:, [0, 2]]
    low, scale = points.min(axis=0), (size - 1) / float(np.ptp(points, axis=0).max())
    picture = Image.new("1", (size, size))
    draw = ImageDraw.Draw(picture)
    at = ((points - low) * scale).tolist()
    inner = np.ones(len(n.branch), np.bool_)
    inner[state.branches.first] = False
    for k in np.flatnonzero(inner).tolist():
        thick = max(1, round(2.0 * float(n.radius[k]) * scale))
        draw.line([*at[k - 1], *at[k]], 1, thick)
    for k in range(len(leaves.size)):
        wide = max(1, round(0.6 * float(leaves.size[k]) * scale))
        draw.line([*at[len(n.branch) + k], *at[len(n.branch) + len(leaves.size) + k]], 1, wide)
    filled = ndimage.binary_fill_holes(np.asarray(picture))
    hull = spatial.ConvexHull(np.argwhere(filled)).volume
    return float(filled.sum()) / float(hull)


def areas(effort: Effort) -> Iterator[Row]:
    """Squared radii of laterals, summed, over their bearer's, along each branch."""
    state = GrowthModel.load("populus").at(4.7 if effort.tiny else 26.7)
    b, lat, n = state.branches, state.laterals, state.nodes
    total = np.bincount(b.parent[lat.branch], lat.radius**2, minlength=len(b.order))
    share = total / n.radius[b.first] ** 2
    for order in range(int(b.order.max())):
        bears = (b.order == order) & (total > 0.0)
        yield Row(f"order {order}", (float(np.median(share[bears])), float(share[bears].max())))


SHAPES = Subject(
    "shapes",
    "Shapes of growing trees",
    "Metres; height of the greatest width over the height; area of the silhouette with leaves, "
    "holes filled, over its hull's. The ratio: by how much width over height differs from the "
    "specification's.",
    ("height", "width", "width / height", "greatest width at", "solidity"),
    shapes,
)
AREAS = Subject(
    "areas",
    "Squared radii of laterals over their bearer's",
    "Summed along each branch of year 27, by its order. *BlobTree Trees* assumes at most 1.",
    ("median", "greatest"),
    areas,
)
INSTANTS = Subject(
    "growth",
    "Growing trees",
    "A tree at an instant: what it counts at the end of that year, megabytes of its arrays, "
    "seconds of processor time without the table of years; then relative deviations.",
    ("operators", "primitives", "MB", "s"),
    instants,
)
