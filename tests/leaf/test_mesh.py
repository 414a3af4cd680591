"""The mesh leaf beyond the contract: every triangle by brute force, edges and vertices, sheets."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pcsg
from pcsg import Scene, UsageError
from pcsg.graph.nodes import Leaf
from pcsg.graph.text import to_pcsg
from pcsg.leaf.dispatch import leaf_crossings, leaf_inside, leaf_normal, leaf_uv
from pcsg.leaf.mesh import Mesh, MeshModel, mesh_of_arrays
from pcsg.leaf.registry import ALL, ANY, FIRST, OVERFLOW
from pcsg.trace.pool import ModelPool
from pcsg.vec import Ray, Vec3

Floats = Any


def rock(n: int, seed: int, open_at: int = 0) -> MeshModel:
    """Return a rough ball of 4 n (n - 1) triangles; the first ones may be missing."""
    rng = np.random.default_rng(seed)
    polar, around = np.pi * np.arange(1, n) / n, np.pi * np.arange(2 * n) / n
    ring = [
        (np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b)) for b in polar for a in around
    ]
    points = np.array([(0.0, 0.0, 1.0), *ring, (0.0, 0.0, -1.0)])
    points *= rng.uniform(0.6, 1.1, (len(points), 1))
    faces = []
    for j in range(2 * n):
        k = (j + 1) % (2 * n)
        faces += [
            (0, 1 + j, 1 + k),
            (len(points) - 1, 1 + (n - 2) * 2 * n + k, 1 + (n - 2) * 2 * n + j),
        ]
        for i in range(n - 2):
            a, b = 1 + 2 * n * i, 1 + 2 * n * (i + 1)
            faces += [(a + j, b + j, b + k), (a + j, b + k, a + k)]
    return mesh_of_arrays(points, faces[open_at:])


class Probe:
    """A mesh, ready for kernels."""

    def __init__(self, model: MeshModel) -> None:
        models = ModelPool([Mesh])
        self.args = np.array(models.place(model))
        self.pool = models.pool
        self.corners = model.polygons.vertices[model.triangles]

    def cross(
        self, o: Any, d: Any, want: int = ALL, low: float = 0.0, high: float = math.inf
    ) -> Floats:
        t = np.zeros(400)
        ray = Ray(*map(float, o), *map(float, d), low, high)
        n = leaf_crossings(Mesh.kind, ray, want, self.args, 0, self.pool, t, 0)
        return t[:n]

    def brute_force(self, o: Any, d: Any) -> tuple[Floats, Floats]:
        """Return where every triangle is met, and its normal (Möller and Trumbore, 1997)."""
        a, u, v = self.corners[:, 0], *(self.corners[:, k] - self.corners[:, 0] for k in (1, 2))
        n = np.cross(u, v)
        det = -n @ d
        with np.errstate(divide="ignore", invalid="ignore"):
            side = np.cross(o - a, d)
            x, y = np.einsum("ij,ij->i", v, side) / det, -np.einsum("ij,ij->i", u, side) / det
            t = np.einsum("ij,ij->i", n, o - a) / det
            met = (x > 0.0) & (y > 0.0) & (x + y < 1.0)
        order = np.argsort(t[met])
        return t[met][order], n[met][order]


ROCKS = {f"rock-{n}-{seed}": Probe(rock(n, seed)) for n, seed in ((3, 0), (6, 1), (14, 2))}
LARGE = {n: rock(n, n) for n in (2, 3, 14, 40)}
OPEN = Probe(rock(6, 3, open_at=7))
every_rock = pytest.mark.parametrize("probe", ROCKS.values(), ids=ROCKS)

coordinates = st.floats(-1.5, 1.5)
vectors = st.tuples(coordinates, coordinates, coordinates).map(np.array)


@every_rock
@given(o=vectors, target=vectors, far=st.sampled_from([1.0, 10.0, 1e4]))
def test_crossings_are_those_of_every_triangle(
    probe: Probe, o: Any, target: Any, far: float
) -> None:
    d = target + 0.0123 - o
    if np.abs(d).max() < 1e-3:
        return
    o = target - far * d
    t, normals = probe.brute_force(o, d)
    found = probe.cross(o, d)
    assert len(found) == len(t)
    assert np.abs(found - t).max(initial=0.0) <= 1e-12 * far / np.abs(d).max()
    assert (np.sign(normals @ d) == np.resize([-1.0, 1.0], len(t))).all()
    for s, n in zip(t, normals, strict=True):
        p = o + s * d
        got = np.array(leaf_normal(Mesh.kind, Vec3(*p), probe.args, 0, probe.pool))
        near_edge = far > 100.0
        assert near_edge or np.allclose(got / np.linalg.norm(got), n / np.linalg.norm(n), atol=1e-6)


@every_rock
@given(o=vectors, target=vectors, low=st.floats(-1.0, 2.0), length=st.floats(0.0, 3.0))
def test_the_first_crossing_is_the_first_of_all(
    probe: Probe, o: Any, target: Any, low: float, length: float
) -> None:
    d = target + 0.0123 - 2.0 * o
    if np.abs(d).max() < 1e-3:
        return
    o = 2.0 * o
    every = probe.cross(o, d).reshape(-1, 2)
    wanted = every[(every[:, 1] >= low) & (every[:, 0] <= low + length)]
    for want in (FIRST, ANY):
        found = probe.cross(o, d, want, low, low + length).reshape(-1, 2)
        found = found[(found[:, 1] >= low) & (found[:, 0] <= low + length)]
        assert (len(found) > 0) == (len(wanted) > 0)
        if len(found) == 0:
            continue
        if wanted[0, 0] < low:  # it starts inside, and must say so
            assert found[0, 0] < low
            assert want == ANY or found[0, 1] == wanted[0, 1]
        elif want == FIRST:
            assert found[0, 0] == wanted[0, 0]
        else:
            assert low <= found[0, 0] <= low + length


@every_rock
def test_rays_through_vertices_and_edges_enter_as_often_as_they_leave(probe: Probe) -> None:
    """No ray slips through between neighbours, and none meets both."""
    rng = np.random.default_rng(7)
    corners = probe.corners.reshape(-1, 3)
    middles = 0.5 * (probe.corners + np.roll(probe.corners, 1, axis=1)).reshape(-1, 3)
    inner = np.zeros(3)
    for target in np.concatenate([corners[rng.integers(0, len(corners), 150)], middles[:150]]):
        above = target + np.array((0.0, 0.0, 5.0))
        for origin in (inner, rng.normal(size=3) * 4.0, above, (5.0, 0.0, 0.0)):
            d = target - origin
            found = probe.cross(origin, d)
            assert len(found) % 2 == 0
            assert (np.diff(found) > 0.0).all()
            if origin is inner:
                # The middle of a star-shaped rock is inside, whatever the ray passes through.
                assert len(found) == 2
                assert found[0] < 0.0 and found[1] == pytest.approx(1.0)


TETRAHEDRON = mesh_of_arrays(
    [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)], [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)]
)


@pytest.mark.parametrize("probe", [Probe(TETRAHEDRON), Probe(rock(4, 3))], ids=["four", "rock"])
def test_a_ray_past_a_silhouette_edge_meets_nothing_however_it_asks(probe: Probe) -> None:
    rng = np.random.default_rng(11)
    edges = np.concatenate([probe.corners[:, [k, (k + 1) % 3]] for k in range(3)])
    dropped = 0
    for a, b in edges[rng.integers(0, len(edges), 400)]:
        target = a + rng.choice([0.25, 0.5, 0.75]) * (b - a)
        d = rng.integers(-2, 3, 3).astype(float)
        if not d.any():
            continue
        origin = target - 4.0 * d
        every = probe.cross(origin, d)
        dropped += len(every) == 0
        for want in (FIRST, ANY):
            found = probe.cross(origin, d, want)
            assert (len(found) > 0) == (len(every) > 0), (origin, d)
            assert len(found) == 0 or found[0] == every[0] or (want == ANY and found[0] in every)
    assert dropped > 20


@pytest.mark.parametrize("engine", ["states", "cyclic"])
def test_first_hits_of_a_mesh_are_the_beginnings_of_its_spans(engine: Any) -> None:
    corners = [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)]
    mesh = pcsg.mesh(corners, [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
    scene = Scene(mesh, engine=engine)
    o, d = np.array([[1.0, -1.0, 0.0]]), np.array([[-1.0, 1.0, 1.0]])
    assert len(scene.spans(o, d).t_in) == 0
    assert not scene.intersect(o, d).mask[0] and not scene.occluded(o, d)[0]


def test_a_crossing_in_a_vertex_at_the_origin_is_zero_exactly() -> None:
    corners = [(0, 0, 0), (1, 0, 1), (0, 1, 1), (-1, -1, 1)]
    probe = Probe(mesh_of_arrays(corners, [(0, 1, 2), (0, 2, 3), (0, 3, 1), (3, 2, 1)]))
    assert probe.cross((0.0, 0.0, 0.0), (0.0, 0.0, 4.0)).tolist() == [0.0, 0.25]


def test_a_grid_of_rays_along_the_axes_of_a_cube_of_many_squares() -> None:
    """Integer coordinates, where everything coincides."""
    n = 4
    faces, points = [], {}

    def corner(p: tuple[int, ...]) -> int:
        return points.setdefault(p, len(points))  # type: ignore[no-any-return]

    for axis in range(3):
        for side in (0, n):
            for i in range(n):
                for j in range(n):
                    square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    placed = [(*c[:0], *np.roll((side, *c), axis).tolist()) for c in square]
                    face = [corner(tuple(p)) for p in placed]
                    faces.append(face if side else face[::-1])
    model = mesh_of_arrays(list(points), faces)
    assert model.closed
    probe = Probe(model)
    for axis in range(3):
        d = np.eye(3)[axis]
        for i in np.arange(-0.5, n + 1.0, 0.5):
            for j in np.arange(-0.5, n + 1.0, 0.5):
                o = np.roll((-3.0, i, j), axis)
                found = probe.cross(o, d)
                if 0.0 < i < n and 0.0 < j < n:
                    assert found.tolist() == [3.0, 7.0]
                else:
                    # Along a face either answer is right.
                    edge = {i, j} & {0.0, float(n)}
                    assert found.tolist() in ([[], [3.0, 7.0]] if edge else [[]])


@given(p=vectors)
def test_points_are_inside_by_the_solid_angle(p: Any) -> None:
    """Van Oosterom and Strackee, 1983: the triangles cover the whole sphere about the point."""
    probe = ROCKS["rock-6-1"]
    a, b, c = (probe.corners[:, k] - p for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    dot = lambda x, y: np.einsum("ij,ij->i", x, y)  # noqa: E731
    under = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    winding = 2.0 * np.arctan2(top, under).sum() / (4.0 * np.pi)
    got = leaf_inside(Mesh.kind, Vec3(*p), probe.args, 0, probe.pool)
    assert abs(winding - round(winding)) > 1e-6 or got == (round(winding) != 0)


@given(o=vectors, target=vectors)
def test_an_open_mesh_is_a_sheet(o: Any, target: Any) -> None:
    d = target + 0.0123 - o
    if np.abs(d).max() < 1e-3:
        return
    t, _ = OPEN.brute_force(o, d)
    found = OPEN.cross(o, d)
    assert (found[::2] == found[1::2]).all()
    assert len(found[::2]) == len(t) and np.allclose(found[::2], t, rtol=1e-11, atol=1e-12)
    ahead = t[t >= 0.0]
    first = OPEN.cross(o, d, FIRST)
    assert np.allclose(first[::2], ahead[:1], rtol=1e-11, atol=1e-12)
    assert not leaf_inside(Mesh.kind, Vec3(*o), OPEN.args, 0, OPEN.pool)


@given(direction=vectors, count=st.sampled_from([2, 3, 14, 40]))
def test_the_support_is_that_of_the_farthest_vertex(direction: Any, count: int) -> None:
    model = LARGE[count]
    expected = float((model.polygons.vertices @ direction).max())
    assert model.support(Vec3(*direction)) == pytest.approx(expected, rel=1e-14, abs=1e-14)


def test_what_does_not_fit_is_said() -> None:
    probe = ROCKS["rock-3-0"]
    ray = Ray(0.01, 0.02, -5.0, 0.0, 0.0, 1.0, 0.0, math.inf)
    assert (
        leaf_crossings(Mesh.kind, ray, ALL, probe.args, 0, probe.pool, np.zeros(5), 0) == OVERFLOW
    )


OBJ = """v 0 0 0
v 2 0 0
v 2 2 0
v 0 2 0
vt 0 0
vt 1 0
vt 1 0.5
vt 0 0.5
vn 0 0.6 0.8
"""


def test_coordinates_and_normals_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "sheet.obj"
    path.write_text(OBJ + "f 1/1/1 2/2/1 3/3/1 4/4/1\n")
    scene = Scene(pcsg.mesh(path))
    hits = scene.intersect([(0.5, 1.0, 3.0), (1.5, 1.5, 3.0)], [(0.0, 0.0, -1.0)] * 2)
    assert np.allclose(hits.uv, [(0.25, 0.25), (0.75, 0.375)])
    assert np.allclose(hits.normal, (0.0, 0.6, 0.8))
    path.write_text(OBJ + "f 1 2 3 4\n")
    scene = Scene(pcsg.mesh(path))  # the file is read anew
    hits = scene.intersect([(0.5, 0.25, 3.0)], [(0.0, 0.0, -1.0)])
    # Barycentric: of the corners (2,0) and (2,2).
    assert np.allclose(hits.uv, [(0.125, 0.125)])
    assert np.allclose(hits.normal, (0.0, 0.0, 1.0))
    uv = leaf_uv(Mesh.kind, Vec3(0.5, 0.25, 0.0), *_kernel(scene))
    assert np.allclose(uv, (0.125, 0.125))


@pytest.mark.parametrize("engine", ["cyclic", "states"])
def test_colors_of_the_file_come_before_those_of_the_grammar(engine: Any, tmp_path: Path) -> None:
    path = tmp_path / "painted.obj"
    path.write_text(
        "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf 1 2 3\nf 4 5 6\n"
    )
    painted = pcsg.color(0.5, 0.25, 0.125) * pcsg.label(7) * pcsg.mesh(path)
    scene = Scene(painted, engine=engine)
    hits = scene.intersect([(0.25, 0.5, 3.0), (5.25, 0.5, 3.0)], [(0.0, 0.0, -1.0)] * 2)
    # Of the second triangle the file says nothing.
    assert np.allclose(hits.color, [(0.25, 0.25, 0.5), (0.5, 0.25, 0.125)])
    assert hits.label.tolist() == [7, 7]


def _kernel(scene: Scene) -> tuple[Any, int, Any]:
    models = ModelPool([Mesh])
    (leaf,) = (n for n in scene.graph.nodes if isinstance(n, Leaf))
    return np.array(models.place(leaf.model(()))), 0, models.pool


def test_meshes_in_python(tmp_path: Path) -> None:
    triangle = pcsg.mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    assert Scene(triangle).bounds.tolist() == pytest.approx(
        np.array([(0, 0, 0), (1, 1, 0)]), abs=1e-7
    )
    with pytest.raises(UsageError, match="save them to a file and name it"):
        to_pcsg(Scene(triangle).graph)
    assert Scene(triangle).source_hash == Scene(triangle).source_hash
    other = pcsg.mesh([(0, 0, 0), (1, 0, 0), (0, 2, 0)], [(0, 1, 2)])
    assert Scene(triangle).source_hash != Scene(other).source_hash
    for args, told in (
        ((), "takes the name of a mesh file"),
        ((3.0,), "takes the name of a mesh file"),
        ((tmp_path / "none.ply",), "no such file"),
        (([(0, 0)], [(0, 1, 2)]), "shape"),
        (([(0, 0, 0)], [(0, 1, 2)]), "there is no vertex 2: 1 are given"),
        (([(0, 0, 0)], [(0, 1)]), "3 or more"),
        (([(0, 0, 0)], [(0, 0, 0)]), "degenerate"),
        (([(0, 0, math.nan)], [(0, 0, 0)]), "numbers of shape"),
    ):
        with pytest.raises(UsageError, match=told):
            pcsg.mesh(*args)


CORNERS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]


@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e9])
def test_facets_that_are_inside_out_are_turned_with_a_warning(scale: float) -> None:
    corners = (np.array(CORNERS) * scale).tolist()
    scene = Scene(pcsg.mesh(corners, [FACES[0][::-1], *FACES[1:]]) - pcsg.empty())
    (warning,) = scene.warnings
    assert warning.code == "file-mended" and warning.severity == "warning"
    assert warning.message == "mesh(...): turned round: facets (1 of 4)"
    assert scene.contains([(0.2 * scale,) * 3, (0.4 * scale,) * 3]).tolist() == [True, False]
    hits = scene.intersect([(0.2 * scale, 0.2 * scale, -scale)], [(0.0, 0.0, 1.0)])
    assert hits.normal.tolist() == [[0.0, 0.0, -1.0]]


@pytest.mark.parametrize("engine", ["cyclic", "states"])
def test_a_double_faced_mesh_is_a_sheet_that_is_seen(engine: Any) -> None:
    both = [face for f in FACES[1:] for face in (f, f[::-1])]
    scene = Scene(pcsg.mesh(CORNERS, both) | pcsg.empty(), engine=engine)
    assert scene.warnings == ()
    rays = [(0.2, 0.2, -1.0), (0.2, 0.2, 2.0)], [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]
    assert np.allclose(scene.intersect(*rays).t, [1.6, 1.4])
    assert not scene.contains([(0.2, 0.2, 0.2)]).any()
    assert scene.stats()["primitives"] == 3


def test_where_a_mesh_is_open_is_told() -> None:
    opened = pcsg.mesh(CORNERS, FACES[1:])
    (told,) = Scene(opened).stats()["meshes"]
    assert told["closed"] is False and told["open_edges"] == 3 and told["triangles"] == 3
    assert told["open_at"][0] == [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    with pytest.raises(
        pcsg.GrammarError, match="not closed: 3 of its edges are open, the first from"
    ):
        Scene(pcsg.sphere() - opened)


def test_what_a_file_leaves_out_is_told_once(tmp_path: Path) -> None:
    path = tmp_path / "damaged.obj"
    path.write_text("v 0 0 0 nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    leaf = pcsg.mesh(path)
    scene = Scene(leaf | pcsg.move(1, 0, 0) * pcsg.mesh(path))
    assert [w.message.split(": ", 1)[1] for w in scene.warnings] == [
        "left out: colours that are not finite (line 1)"
    ]
