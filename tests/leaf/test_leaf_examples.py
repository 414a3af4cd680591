"""Crossings of single rays whose answers are known: faces, edges, corners, touches, apexes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from pcsg.leaf.dispatch import leaf_crossings, leaf_inside, leaf_normal, leaf_uv
from pcsg.leaf.registry import ALL, LEAVES
from pcsg.trace.pool import ModelPool
from pcsg.vec import Ray, Vec3

POOL = ModelPool(list(LEAVES.values())).pool
INF = math.inf
DIAGONAL = math.sqrt(0.5)

CASES: list[tuple[str, Any, Any, Any, list[float]]] = [
    ("sphere", (), (-3, 0, 0), (1, 0, 0), [2, 4]),
    ("sphere", (), (-3, 1, 0), (1, 0, 0), []),
    ("sphere", (), (0, 0, 0), (0, 0, 2), [-0.5, 0.5]),
    ("cylinder", (), (-3, 0, 0.5), (2, 0, 0), [1, 2]),
    ("cylinder", (), (-3, 0, 0), (1, 0, 0), [2, 4]),
    ("cylinder", (), (-3, 0, 1), (1, 0, 0), [2, 4]),
    ("cylinder", (), (-3, 0, 1.0000001), (1, 0, 0), []),
    ("cylinder", (), (1, 0, -1), (0, 0, 1), [1, 2]),
    ("cylinder", (), (-3, 1, 0.5), (1, 0, 0), []),
    ("cylinder", (), (0, 0, 5), (0, 0, -1), [4, 5]),
    ("cylinder", (), (0, 0, -1), (1, 0, 1), []),
    ("cone", (0.0,), (0, 0, -1), (0, 0, 1), [1, 2]),
    ("cone", (0.0,), (-3, 0, 0.5), (1, 0, 0), [2.5, 3.5]),
    ("cone", (0.0,), (-3, 0, 1), (1, 0, 0), []),
    ("cone", (0.0,), (0.5, 0, -1), (0, 0, 1), [1, 1.5]),
    ("cone", (0.0,), (0, 0, -1), (-1, 0, 1), []),
    ("cone", (0.0,), (0.5, 0, -1), (-1, 0, 1), [1, 1.25]),
    ("cone", (0.0,), (0, 0, 3), (0, 0, -1), [2, 3]),
    ("cone", (0.0,), (0, 0, 0), (0, 0, 0.23161755), [0, 1 / 0.23161755]),
    ("cone", (0.0,), (0, 9.84925464e-7, 0), (0, 0, 1), [0, 1 - 9.84925464e-7]),
    ("cone", (1.0,), (1, 0, -1), (0, 0, 1), [1, 2]),
    ("cone", (1.0,), (-3, 0, 0.5), (1, 0, 0), [2, 4]),
    ("cone", (2.0,), (-3, 0, 0.5), (1, 0, 0), [1.5, 4.5]),
    ("cone", (2.0,), (1.5, 0, -1), (0, 0, 1), [1.5, 2]),
    ("cone", (2.0,), (-3, 0, 1), (1, 0, 0), [1, 5]),
    ("cone", (0.5,), (-3, 0, 0.5), (1, 0, 0), [2.25, 3.75]),
    ("box", (), (-3, 0, 0), (1, 0, 0), [2, 4]),
    ("box", (), (-3, 1, 0), (1, 0, 0), [2, 4]),
    ("box", (), (-3, 1, 1), (1, 0, 0), [2, 4]),
    ("box", (), (-3, 1.0000001, 0), (1, 0, 0), []),
    ("box", (), (-2, 0, 0), (1, -1, 0), []),
    ("box", (), (-3, -3, -3), (1, 1, 1), [2, 4]),
    ("box", (), (0, 0, 0), (0, -4, 0), [-0.25, 0.25]),
    ("tetrahedron", (), (0, 0, -3), (0, 0, 1), [2, 4]),
    ("tetrahedron", (), (2, 2, 2), (-1, -1, -1), [1, 2 + 1 / 3]),
    ("tetrahedron", (), (-3, -3, 1), (1, 1, 0), [2, 4]),
    ("tetrahedron", (), (0, 0, 1), (1, -1, 0), []),
    ("tetrahedron", (), (0.5, 0.5, 0), (0, 0, 1), [0, 1]),
    ("torus", (0.5,), (-3, 0, 0), (1, 0, 0), [1.5, 2.5, 3.5, 4.5]),
    ("torus", (0.5,), (0, 0, -3), (0, 0, 1), []),
    ("torus", (0.5,), (1, 0, -3), (0, 0, 1), [2.5, 3.5]),
    ("torus", (0.5,), (-3, 0, 0.5), (1, 0, 0), []),
    ("torus", (0.5,), (0.5, -3, 0), (0, 1, 0), [3 - math.sqrt(2), 3 + math.sqrt(2)]),
    ("torus", (1.0,), (0, 0, -3), (0, 0, 1), []),
    ("torus", (1.0,), (1, 0, 0), (0, 0, 2), [-0.5, 0.5]),
    ("torus", (1e-6,), (-3, 0, 0), (1, 0, 0), [1.999999, 2.000001, 3.999999, 4.000001]),
    ("halfspace", (), (0, 0, 3), (0, 0, 1), [-INF, -3]),
    ("halfspace", (), (0, 0, 3), (0, 0, -1), [3, INF]),
    ("halfspace", (), (0, 0, 0), (1, 0, 0), [-INF, INF]),
    ("halfspace", (), (0, 0, -1), (1, 0, 0), [-INF, INF]),
    ("halfspace", (), (0, 0, 1), (1, 0, -0.0), []),
    ("halfspace", (), (0, 0, -1e9), (1, 0, 1e-305), [-INF, INF]),
    ("halfspace", (), (0, 0, 1e9), (1, 0, 1e-305), []),
    ("empty", (), (0, 0, 0), (1, 0, 0), []),
    ("tri1", (), (0.25, 0.25, 1), (0, 0, -2), [0.5, 0.5]),
    ("tri1", (), (0, 0, 1), (0, 0, -1), [1, 1]),
    ("tri1", (), (0.5, 0.5, -1), (0, 0, 1), [1, 1]),
    ("tri1", (), (0.51, 0.5, -1), (0, 0, 1), []),
    ("tri1", (), (-0.01, 0.5, -1), (0, 0, 1), []),
    ("tri1", (), (0.5, -0.01, -1), (0, 0, 1), []),
    ("tri1", (), (-1, 0.5, 0), (1, 0, 0), []),
    ("tri2", (), (-0.25, -0.25, 1), (0, 0, -2), [0.5, 0.5]),
    ("tri2", (), (0.01, -0.25, 1), (0, 0, -2), []),
    ("tri2", (), (-0.51, -0.5, 1), (0, 0, -2), []),
    ("disc", (), (0.6, 0.8, 1), (0, 0, -2), [0.5, 0.5]),
    ("disc", (), (0.6, 0.81, 1), (0, 0, -2), []),
    ("disc", (), (0, 0, -3), (0.1, 0, 1), [3, 3]),
    ("disc", (), (-3, 0, 0), (1, 0, 0), []),
    ("rectangle", (), (1, -1, 1), (0, 0, -1), [1, 1]),
    ("rectangle", (), (1.01, 0, 1), (0, 0, -1), []),
    ("rectangle", (), (0, -1.01, -1), (0, 0, 1), []),
    ("rectangle", (), (-3, 0, 0), (1, 0, 0), []),
    ("capsule", (1.0,), (0, 0, -3), (0, 0, 1), [2, 5]),
    ("capsule", (1.0,), (-3, 0, 0.5), (1, 0, 0), [2, 4]),
    ("capsule", (0.0,), (0, 0, -3), (0, 0, 1), [2, 4]),
    ("capsule", (2.0,), (-3, 0, 1), (1, 0, 0), [1, 5]),
    ("capsule", (5.0,), (0, 0, -9), (0, 0, 1), [5, 15]),
    ("capsule", (0.5,), (-3, 0, 1.6), (1, 0, 0), []),
    ("superellipsoid", (1.0, 1.0), (-3, 0.6, 0), (1, 0, 0), [2.2, 3.8]),
    ("superellipsoid", (2.0, 2.0), (-3, 0.25, 0.25), (1, 0, 0), [2.5, 3.5]),
    ("superellipsoid", (2.0, 2.0), (-3, 0.75, 0.5), (1, 0, 0), []),
    ("superellipsoid", (1e-6, 1e-6), (-3, 0.75, 0.5), (1, 0, 0), [2, 4]),
    ("superellipsoid", (0.5, 2.0), (0, 0, 4), (0, 0, -2), [1.5, 2.5]),
    ("infcylinder", (), (0, 0, 3), (0, 0, 1), [-INF, INF]),
    ("infcylinder", (), (1.5, 0, 3), (0, 0, 1), []),
    ("infcylinder", (), (-3, 0, 70), (1, 0, 1), [2, 4]),
    ("infcone", (0.0,), (0, 0, 3), (0, 0, -1), [2, INF]),
    ("infcone", (0.0,), (-9, 0, -2), (1, 0, 0), [6, 12]),
    ("infcone", (0.0,), (-9, 0, 2), (1, 0, 0), []),
    ("infcone", (1.0,), (0, 0, 3), (0, 0, -1), [-INF, INF]),
    ("infcone", (3.0,), (-9, 0, 1), (1, 0, 0), [6, 12]),
]


def cross(name: str, args: Any, o: Any, d: Any) -> list[float]:
    t = np.zeros(8)
    ray = Ray(*map(float, (*o, *d)), 0.0, INF)
    m = leaf_crossings(LEAVES[name].kind, ray, ALL, np.array(args), 0, POOL, t, 0)
    return t[:m].tolist()


@pytest.mark.parametrize(("name", "args", "o", "d", "expected"), CASES)
def test_known_crossings(name: str, args: Any, o: Any, d: Any, expected: list[float]) -> None:
    assert cross(name, args, o, d) == pytest.approx(expected, rel=1e-14, abs=1e-14)


NORMALS: list[tuple[str, Any, Any, Any]] = [
    ("sphere", (), (0, -1, 0), (0, -1, 0)),
    ("cylinder", (), (1, 0, 0.5), (1, 0, 0)),
    ("cylinder", (), (0.5, 0, 0), (0, 0, -1)),
    ("cylinder", (), (0.5, 0, 1), (0, 0, 1)),
    ("cone", (0.0,), (0, 0.5, 0.5), (0, DIAGONAL, DIAGONAL)),
    ("cone", (0.0,), (0, 0, 1), (0, 0, 1)),
    ("cone", (2.0,), (1.5, 0, 0.5), (DIAGONAL, 0, -DIAGONAL)),
    ("cone", (2.0,), (1.5, 0, 1), (0, 0, 1)),
    ("cone", (2.0,), (0, 0, 1), (0, 0, 1)),
    ("cone", (2.0,), (0, 0, 0), (0, 0, -1)),
    ("cylinder", (), (0, 0, 1), (0, 0, 1)),
    ("box", (), (-1, 0.3, 0.5), (-1, 0, 0)),
    ("box", (), (0.3, 1, 0.5), (0, 1, 0)),
    ("box", (), (0.3, 0.5, -1), (0, 0, -1)),
    ("torus", (0.5,), (1.5, 0, 0), (1, 0, 0)),
    ("torus", (0.5,), (0, 0.5, 0), (0, -1, 0)),
    ("torus", (0.5,), (0, 1, -0.5), (0, 0, -1)),
    ("torus", (1.0,), (0, 0, 0), (0, 0, 1)),
    ("halfspace", (), (4, 5, 0), (0, 0, 1)),
    ("tri1", (), (0.1, 0.1, 0), (0, 0, 1)),
    ("tri2", (), (-0.1, -0.1, 0), (0, 0, 1)),
    ("disc", (), (0.1, -0.5, 0), (0, 0, 1)),
    ("rectangle", (), (0.1, -0.5, 0), (0, 0, 1)),
    ("capsule", (1.0,), (0, 1, 0.5), (0, 1, 0)),
    ("capsule", (0.5,), (0, 0, 1.5), (0, 0, 1)),
    ("capsule", (0.0,), (0, 0, -1), (0, 0, -1)),
    ("superellipsoid", (2.0, 2.0), (0.5, 0.25, -0.25), (3**-0.5, 3**-0.5, -(3**-0.5))),
    ("superellipsoid", (0.1, 0.1), (0.01, 0.02, 1), (0, 0, 1)),
    ("infcylinder", (), (0, -1, 80), (0, -1, 0)),
    ("infcone", (0.0,), (3, 0, -2), (DIAGONAL, 0, DIAGONAL)),
    ("infcone", (2.0,), (0, 0, -1), (0, 0, -1)),
]


@pytest.mark.parametrize(("name", "args", "p", "expected"), NORMALS)
def test_known_normals(name: str, args: Any, p: Any, expected: Any) -> None:
    n = leaf_normal(LEAVES[name].kind, Vec3(*map(float, p)), np.array(args), 0, POOL)
    assert np.array(n) / np.linalg.norm(n) == pytest.approx(np.array(expected), abs=1e-15)


COORDINATES: list[tuple[str, Any, Any, tuple[float, float]]] = [
    ("sphere", (), (0, 1, 0), (0.25, 0.5)),
    ("sphere", (), (0, 0, 1), (0, 1)),
    ("sphere", (), (0, -1, 0), (0.75, 0.5)),
    ("cylinder", (), (0, -1, 0.25), (0.75, 0.25)),
    ("cylinder", (), (0.5, 0.2, 1), (0.75, 0.6)),
    ("cylinder", (), (0.5, 0.2, 0), (0.25, 0.6)),
    ("cone", (2.0,), (1, 0.2, 1), (0.75, 0.55)),
    ("cone", (0.0,), (0, 0.5, 0.5), (0.25, 0.5)),
    ("box", (), (1, 0.5, 0.2), (0.75, 0.6)),
    ("box", (), (-1, 0.5, 0.2), (0.25, 0.6)),
    ("box", (), (0.5, 1, 0.2), (0.25, 0.6)),
    ("box", (), (0.5, -1, 0.2), (0.75, 0.6)),
    ("box", (), (0.5, 0.2, 1), (0.75, 0.6)),
    ("box", (), (0.5, 0.2, -1), (0.25, 0.6)),
    ("tetrahedron", (), (-1, -1, 1), (1, 0)),
    ("tetrahedron", (), (-1 / 3, -1 / 3, -1 / 3), (1 / 3, 1 / 3)),
    ("tetrahedron", (), (1 / 3, 1 / 3, -1 / 3), (1 / 3, 1 / 3)),
    ("torus", (0.5,), (0, 1, 0.5), (0.25, 0.25)),
    ("torus", (0.5,), (0, -0.5, 0), (0.75, 0.5)),
    ("halfspace", (), (4, 5, 0), (4, 5)),
    ("tri1", (), (0.1, 0.2, 0), (0.1, 0.2)),
    ("tri2", (), (-0.1, -0.2, 0), (0.1, 0.2)),
    ("disc", (), (0.5, -0.5, 0), (0.75, 0.25)),
    ("rectangle", (), (-1, 1, 0), (0, 1)),
    ("capsule", (1.0,), (0, 1, 0.5), (0.25, 0.5)),
    ("infcylinder", (), (0, -1, 8), (0.75, 8)),
    ("infcone", (0.0,), (3, 0, -2), (0, -2)),
]


@pytest.mark.parametrize(("name", "args", "p", "expected"), COORDINATES)
def test_known_surface_coordinates(name: str, args: Any, p: Any, expected: Any) -> None:
    uv = leaf_uv(LEAVES[name].kind, Vec3(*map(float, p)), np.array(args), 0, POOL)
    assert uv == pytest.approx(expected, abs=1e-15)


CLOSED: list[tuple[str, Any, Any]] = [
    ("sphere", (), (1, 0, 0)),
    ("cylinder", (), (0, 1, 1)),
    ("cylinder", (), (1, 0, 0)),
    ("cone", (0.0,), (0, 0, 1)),
    ("cone", (2.0,), (2, 0, 1)),
    ("box", (), (1, -1, 1)),
    ("tetrahedron", (), (1, -1, -1)),
    ("torus", (0.5,), (1.5, 0, 0)),
    ("torus", (1.0,), (0, 0, 0)),
    ("halfspace", (), (7, 7, 0)),
]


@pytest.mark.parametrize(("name", "args", "p"), CLOSED)
def test_solids_are_closed(name: str, args: Any, p: Any) -> None:
    kind = LEAVES[name].kind
    assert leaf_inside(kind, Vec3(*map(float, p)), np.array(args), 0, POOL)
    beyond = [1.0000001 * c if c else 0.0 for c in p]
    beyond[2] += 1e-7 if name in {"halfspace", "torus"} else 0.0
    assert not leaf_inside(kind, Vec3(*beyond), np.array(args), 0, POOL)


@pytest.mark.parametrize("name", [name for name, cls in LEAVES.items() if cls.sheet])
def test_sheets_contain_nothing(name: str) -> None:
    assert not leaf_inside(LEAVES[name].kind, Vec3(0.0, 0.0, 0.0), np.zeros(1), 0, POOL)


@pytest.mark.parametrize("name", [name for name, cls in LEAVES.items() if not cls.constants])
def test_no_direction_no_disorder(name: str) -> None:
    t = np.zeros(8)
    ray = Ray(0.5, 0.0, 0.25, 1e-310, 0.0, 0.0, 0.0, INF)
    m = leaf_crossings(LEAVES[name].kind, ray, ALL, np.array([0.5]), 0, POOL, t, 0)
    assert m % 2 == 0
    assert not np.isnan(t[:m]).any()
    assert (np.diff(t[:m]) >= 0.0).all()


@pytest.mark.parametrize("name", ["cone", "infcone"])
def test_lines_beside_a_cone_and_parallel_to_its_side_miss_it(name: str) -> None:
    rng = np.random.default_rng(4)
    for _ in range(300):
        angle, along = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.001, 1.0)
        across = np.array([-math.sin(angle), math.cos(angle), 0.0]) * rng.uniform(0.1, 1.0)
        origin = across + np.array([0.0, 0.0, 1.0])
        direction = along * np.array([math.cos(angle), math.sin(angle), rng.choice([-1.0, 1.0])])
        # Farther than a million radii the line and the cone are one.
        assert all(abs(t) * along > 1e6 for t in cross(name, (0.0,), origin, direction))
