"""What the subjects of mesh files share: files to begin with, and what is done with each."""

from __future__ import annotations

import random
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from driver import Data, Subject

from pcsg.leaf.mesh import Mesh
from pcsg.scene import Scene

TESTS = Path(__file__).resolve().parents[1]
CASES = TESTS / "meshfile" / "cases"
sys.path.append(str(CASES.parent))

CUBE = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = [t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))]

LARGE = 2e-4
"""How often an input is one that takes long if something goes wrong."""

TRACED = 16
"""One of so many meshes is met by rays, too, which takes longer than all the rest."""


def cases_of(end: str) -> Sequence[bytes]:
    """Return the files of a kind that others have written."""
    return [p.read_bytes() for p in sorted(CASES.glob(f"*.{end}"))]


def subject_of(
    end: str, seeds: Callable[[], Sequence[Data]], mutate: Callable[[random.Random, Data], Data]
) -> Subject:
    """Return the subject of files with names that end so."""

    def run(data: Data, folder: Path) -> None:
        path = folder / f"spoilt.{end}"
        path.write_bytes(data if isinstance(data, bytes) else data.encode("utf-8", "replace"))
        use(path, len(data))

    def prepare() -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "warm.obj")
            path.write_bytes((CASES / "concave.obj").read_bytes())
            use(path, 0)
            path.with_suffix(".stl").write_bytes((CASES / "ulp.stl").read_bytes())
            use(path.with_suffix(".stl"), 0)

    return Subject(end, seeds, mutate, run, prepare)


def use(path: Path, number: int) -> None:
    """Read a mesh and do with it what a scene does."""
    model = Mesh.read_constant(path.name, path.parent)
    lower, upper = np.array(model.bounds.lower), np.array(model.bounds.upper)
    assert np.isfinite(lower).all() and (lower <= upper).all()
    points = model.polygons.vertices
    assert model.triangles.min() >= 0 and model.triangles.max() < len(points)
    assert np.isfinite(model.data.doubles[:7]).all()
    # What a packet of triangles has no triangle for is NaN; no corner is.
    assert np.isfinite(points[model.triangles]).all()
    assert model.why_sheet is None or not model.closed
    assert all(isinstance(note, str) for note in model.notes)
    if number % TRACED:
        return
    from pcsg import mesh

    scene = Scene(mesh(path))
    center, size = 0.5 * (lower + upper), float((upper - lower).max()) or 1.0
    directions = np.random.default_rng(number).normal(size=(8, 3))
    hits = scene.intersect(center - 3.0 * size * directions, size * directions)
    assert not np.isnan(hits.t).any()
    assert np.isfinite(hits.normal[np.isfinite(hits.t)]).all()
    assert np.isfinite(hits.uv[np.isfinite(hits.t)]).all()
    assert scene.contains([center.tolist()]).dtype == bool
