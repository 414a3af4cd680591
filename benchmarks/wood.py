"""Growing trees: from an instant to a field, its first hits, and what grids of it lose."""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Effort, Row, Subject, measure_command
from pcsg.blobtree.meshing import contour
from pcsg.blobtree.model import Model
from pcsg.growth.foliage import foliage_mesh
from pcsg.growth.model import GrowthModel
from pcsg.growth.pictures import frame_tree
from pcsg.growth.state import State
from pcsg.growth.wood import Pieces, find_pieces, wood_field
from pcsg.leaf.mesh import MeshModel

SEASON = 0.68
"""All leaves are there, and no branch is shed yet."""

MODEL_LIMIT = 10.0
"""Seconds for the first hits of the oldest tree."""


def camera_rays(state: State, size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return one ray for each pixel of a picture of the whole tree."""
    camera = frame_tree(state, 1.0)
    eye, target = np.array(camera.eye), np.array(camera.target)
    w = (target - eye) / np.linalg.norm(target - eye)
    u = np.cross(w, [0.0, 0.0, 1.0])
    u /= np.linalg.norm(u)
    v = np.cross(u, w)
    half = math.tan(math.radians(0.5 * camera.fov))
    s = half * ((np.arange(size) + 0.5) / size * 2.0 - 1.0)
    x, y = np.meshgrid(s, -s)
    d = w + x[..., None] * u + y[..., None] * v
    return np.broadcast_to(eye, (size * size, 3)), d.reshape(-1, 3)


def evaluations(effort: Effort) -> Iterator[Row]:
    """Measure every step from the species to the first hits of its wood."""
    size = 32 if effort.tiny else 768
    species = GrowthModel.load("populus")
    Model(wood_field(species.at(1.0 + SEASON))).intersect([[0, 0, 9]], [[0, 0, -1]])
    MeshModel(foliage_mesh(species.at(1.0 + SEASON)), "populus")
    for year in (1, 5) if effort.tiny else (1, 5, 10, 15, 20, 27):
        marks = [time.process_time()]
        state = species.at(year - 1.0 + SEASON)
        marks.append(time.process_time())
        model = Model(wood_field(state))
        marks.append(time.process_time())
        MeshModel(foliage_mesh(state), "populus")
        marks.append(time.process_time())
        model.intersect(*camera_rays(state, size))
        marks.append(time.process_time())
        steps = np.diff(marks).tolist()
        yield Row(
            f"year {year}, {len(state.branches.length):,} branches, {model.primitives:,} cones"
            f" and bounds, {len(state.leaves.size):,} leaves",
            (*steps, model.nbytes / 1e6),
            steps[3] if year == 27 else None,
            MODEL_LIMIT if year == 27 else None,
            at_most=True,
        )


def lost_branches(p: Pieces, low: NDArray[np.float64], cell: float) -> float:
    """Return the share of branches in which no point of a grid lies: marching cubes miss them."""
    found = np.zeros(int(p.branch.max()) + 1, np.bool_)
    # Corners of the cells that the axis passes, in steps of half a cell.
    steps = np.ceil(p.length / (0.5 * cell)).astype(np.int64) + 1
    row = np.repeat(np.arange(len(p)), steps)
    number = np.arange(len(row)) - np.repeat(np.cumsum(steps) - steps, steps)
    axis = p.end - p.start
    at = p.start[row] + (number / (steps[row] - 1))[:, None] * axis[row]
    corner = np.floor((at - low) / cell)
    for k in range(8):
        point = low + cell * (corner + np.array([k & 1, k >> 1 & 1, k >> 2]))
        away = point - p.start[row]
        square = np.maximum(np.einsum("ij,ij->i", axis, axis), 1e-30)[row]
        share = np.clip(np.einsum("ij,ij->i", away, axis[row]) / square, 0.0, 1.0)
        radius = p.base[row] + share * (p.top - p.base)[row]
        distance = np.linalg.norm(away - share[:, None] * axis[row], axis=1)
        found[p.branch[row[distance <= radius]]] = True
    return 1.0 - float(found[np.unique(p.branch)].mean())


def grids(effort: Effort) -> Iterator[Row]:
    """Make triangles on grids, and count what falls between their points."""
    year = 5 if effort.tiny else 27
    state = GrowthModel.load("populus").at(year - 1.0 + SEASON)
    pieces, model = find_pieces(state), Model(wood_field(state))
    low, high = model.support
    contour(model, 8)  # what it needs is loaded
    for n in (16,) if effort.tiny else (128, 256, 512, 1024):
        cell = float((high - low).max()) / n
        taken: float | None = None
        if n <= 512:
            start = time.process_time()
            contour(model, n)
            taken = time.process_time() - start
        lost = 100.0 * lost_branches(pieces, low, cell)
        yield Row(f"year {year}, {n} cells, {1e3 * cell:.0f} mm each", (taken, lost))


def frames(effort: Effort) -> Iterator[Row]:
    """Measure whole pictures with leaves, ground and sky, as a command."""
    size = 32 if effort.tiny else 768
    for year in (1,) if effort.tiny else (1, 5, 10, 15, 20, 27):
        with tempfile.TemporaryDirectory() as folder:
            clock, processor, peak = measure_command(
                [
                    *(sys.executable, "-m", "pcsg", "grow", "frame", "populus", "-q"),
                    *("--t", str(year - 1.0 + SEASON), "--size", f"{size}x{size}"),
                    *("-o", str(Path(folder) / "out.png")),
                ]
            )
        yield Row(
            f"year {year}, {size}x{size}",
            (clock, processor, peak),
            peak if year == 27 else None,
            600.0 if year == 27 else None,
            at_most=True,
        )


WOOD = Subject(
    "wood",
    "Wood and leaves of growing trees",
    "One thread, processor seconds: the tree at a time as arrays; the model of its wood; the mesh"
    " of its leaves; first hits of the wood, a ray for each of 768x768 pixels. What is built before"
    " the first of them, once for a species, is not counted. Paper: 430 s for such a picture of"
    " year 27 on a Pentium 4.",
    ("arrays", "wood", "leaves", "first hits", "MB of wood"),
    evaluations,
)

GRIDS = Subject(
    "grids",
    "Wood as triangles",
    "Processor seconds to make triangles on a grid, one thread; percent of branches that no point"
    " lies in, which a surface from the grid cannot have. Paper: 350 s for 1024 cells along each"
    " side, and fine detail lost.",
    ("seconds", "% lost"),
    grids,
)

FRAMES = Subject(
    "frames",
    "Pictures of growing trees",
    "`pcsg grow frame`, antialiased, all steps from the start of Python. Paper: 2 s to 30 min on a"
    " Pentium 4.",
    ("seconds", "processor seconds", "MB"),
    frames,
)
