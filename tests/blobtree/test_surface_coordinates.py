"""u and v of branches: one line without a twist along an axis, lengths from its beginning."""

from __future__ import annotations

import numpy as np
import pytest

from pcsg import blobtree as b
from pcsg.blobtree.evaluate import frame_of
from pcsg.blobtree.frames import carry, frames_of
from pcsg.blobtree.turtle import Skeleton
from pcsg.jit import plain
from pcsg.vec import Vec3


def chain(points: np.ndarray, radius: float) -> Skeleton:
    n = len(points) - 1
    return Skeleton(
        points[:-1],
        points[1:],
        np.full(n, radius),
        np.full(n, radius),
        np.arange(-1, n - 1),
        np.arange(n) == 0,
        np.zeros(n, np.int64),
    )


def units(n: int, seed: int = 1) -> np.ndarray:
    v = np.random.default_rng(seed).normal(size=(n, 3))
    found: np.ndarray = v / np.linalg.norm(v, axis=1)[:, None]
    return found


def test_frames_are_those_of_the_kernel() -> None:
    axes = units(50)
    for axis, u, w in zip(axes, *frames_of(axes), strict=True):
        x, y = plain(frame_of)(Vec3(*(float(a) for a in axis)))
        np.testing.assert_allclose([u, w], [x, y], atol=1e-15)


def test_carried_directions_stay_across_and_are_turned_least() -> None:
    a, c = units(100, 2), units(100, 3)
    d = carry(a, c, frames_of(a)[0])
    np.testing.assert_allclose((d * c).sum(axis=1), 0.0, atol=1e-12)
    # The component along the axis of the turn stays.
    normal = np.cross(a, c)
    before = (frames_of(a)[0] * normal).sum(axis=1)
    np.testing.assert_allclose((d * normal).sum(axis=1), before, atol=1e-9)
    same = carry(a, a, frames_of(a)[0])
    np.testing.assert_allclose(same, frames_of(a)[0], atol=1e-12)


def test_u_and_v_go_on_from_internode_to_internode() -> None:
    # A helix: frames of the pieces alone would jump.
    s = np.linspace(0.0, 2.5, 26)
    points = np.stack([2 * np.cos(s), 2 * np.sin(s), 1.4 * s], axis=1)
    radius = 0.03
    model = b.Model(b.grow(chain(points, radius), b.Junctions(mode="smooth", buds=False, tip=1.0)))
    axis = np.diff(points, axis=0)
    length = np.linalg.norm(axis, axis=1)
    axis /= length[:, None]
    zero = frames_of(axis[:1])[0]
    along = 0.0
    for k in range(len(axis)):
        if k:
            zero = carry(axis[k - 1 : k], axis[k : k + 1], zero)
        other = np.cross(axis[k], zero[0])
        for turn in (0.0, 0.2, 0.7):
            a = 2 * np.pi * turn
            p = points[k] + 0.5 * axis[k] * length[k]
            p = p + radius * (np.cos(a) * zero[0] + np.sin(a) * other)
            u, v = model.attributes([p])["uv"][0]
            assert abs((u - turn + 0.5) % 1.0 - 0.5) < 1e-3, k
            assert v == pytest.approx(along + 0.5 * length[k], abs=1e-3)
        along += length[k]


@pytest.mark.parametrize("scale", [1.0, -1.0])
def test_a_placed_branch_has_its_own_direction(scale: float) -> None:
    # Slim rows and full ones, behind a shear, count turns from the same side.
    q, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    q[:, 0] *= scale
    shear = q @ np.array([[1, 1e-9, 0], [0, 1, 0], [0, 0, 1.0]])
    for matrix in (q, shear):
        placed = b.place(np.concatenate([matrix, np.zeros((3, 1))], axis=1), b.cone(2, 0.3, 0.2))
        model = b.Model(placed)
        for turn in (0.0, 0.15, 0.6):
            a = 2 * np.pi * turn
            p = matrix @ np.array([0.25 * np.cos(a), 0.25 * np.sin(a), 1.0])
            assert model.field([p])[0] == pytest.approx(0.5, abs=0.05)
            u, v = model.attributes([p])["uv"][0]
            assert abs((u - turn + 0.5) % 1.0 - 0.5) < 1e-6
            assert v == pytest.approx(1.0)
