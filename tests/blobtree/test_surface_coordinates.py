"""u and v of branches: one line without a twist along an axis, lengths from its beginning."""

from __future__ import annotations

import numpy as np
import pytest

import pcsg
from pcsg import Scene, blob
from pcsg import blobtree as b
from pcsg.blobtree.frames import carry, frames_of
from pcsg.blobtree.lsystemfile import read_lsystem
from pcsg.blobtree.meeting import frame_of
from pcsg.blobtree.turtle import Skeleton, draw
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


FORK = "axiom: !(0.3) F(2) !(0.26) [ &(40) F(1.6) ] [ &(34) /(180) ^(70) F(1.6) ]"


@pytest.mark.parametrize("mode", ["smooth", "contact", "aged"])
def test_pictures_pass_over_where_branches_meet_without_a_seam(mode: str) -> None:
    skeleton = draw(read_lsystem(FORK).derive(0)).skeleton
    scene = Scene(blob(b.grow(skeleton, b.Junctions(mode=mode))))
    # Ways up the fork from many sides, as rays from outside see them.
    z = np.linspace(1.2, 3.2, 6001)
    jumps, alone, shares = [], [], []
    for side in np.linspace(0.0, 2.0 * np.pi, 7)[:-1] + 0.3:
        way = np.array([np.cos(side), np.sin(side), 0.0])
        o = np.stack([3 * way[0] + 0 * z, 3 * way[1] + 0 * z, z], axis=1)
        hits = scene.intersect(o, np.tile(-way, (len(z), 1)))
        near = hits.mask[1:] & hits.mask[:-1]
        near &= np.linalg.norm(np.diff(hits.position, axis=0), axis=1) < 3e-3
        v, others, share = hits.uv[:, 1], hits.other_uv[:, :, 1], hits.other_uv[:, :, 2]
        mixed = (1.0 - share.sum(axis=1)) * v + (share * others).sum(axis=1)
        jumps.append(np.abs(np.diff(mixed))[near].max())
        alone.append(np.abs(np.diff(v))[near].max())
        shares.append(share[hits.mask])
    # What lies at v alone would jump from branch to branch.
    assert max(alone) > 0.3
    assert max(jumps) < 0.03
    share = np.concatenate(shares)
    assert (share[:, 0] >= share[:, 1]).all() and (1.0 - share.sum(axis=1) >= share[:, 0]).all()
    assert share[:, 0].max() > 0.4 and share[:, 1].max() > 0.05


def test_both_engines_know_the_second_coordinates() -> None:
    text = """{} blob { cone(2,0.4,0.3) + move(0,0,2) pcm { L , rotz(180) L } }
    L = roty(30) segment(2,0.3)
    """
    o = np.random.default_rng(3).uniform([-0.6, -4, 1.5], [0.6, -4, 3], (300, 3))
    d = np.tile([0.0, 1.0, 0.0], (300, 1))
    found = [pcsg.loads(text, engine=engine).intersect(o, d) for engine in ("cyclic", "states")]
    np.testing.assert_allclose(found[0].other_uv, found[1].other_uv, atol=1e-9)
    assert (found[0].other_uv[:, 0, 2] > 0.1).sum() > 20


def test_u_goes_on_behind_a_bent_lateral() -> None:
    text = "axiom: !(0.3) F(3) [ /(50) &(60) !(0.12) F(1.5) F(1.5) ] F(2)"
    skeleton = draw(read_lsystem(text).derive(0)).skeleton
    model = b.Model(b.grow(skeleton, b.Junctions(mode="smooth", bend=30.0, buds=False, tip=1.0)))
    lateral = 1
    axis = (skeleton.end - skeleton.start)[lateral] / 1.5
    sides = [side[0] for side in frames_of(axis[None])]
    # In the middle of the arc, and on the straight internode that goes on.
    for s in (0.75, 2.25):
        middle = base = skeleton.start[lateral] + s * axis
        for side in sides:
            # A chord's middle tells how far to the side the centre is.
            ends = [model.intersect([base + k * side], [-k * side])[0] for k in (1.0, -1.0)]
            middle = middle + 0.5 * (ends[1] - ends[0]) * side
        for turn in np.linspace(0.0, 1.0, 9)[:-1]:
            a = 2 * np.pi * turn
            side = np.cos(a) * sides[0] + np.sin(a) * sides[1]
            t = model.intersect([middle + 0.25 * side], [-side])[0]
            u = model.attributes([middle + (0.25 - t) * side])["uv"][0][0]
            assert abs((u - turn + 0.5) % 1.0 - 0.5) < 0.02, (turn, s)
