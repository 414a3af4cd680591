""" "Fix my tree": what generators write becomes one closed surface, or is refused with a reason."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tree_shapes import axis_distances, forked_tree, species, tubes

from pcsg.errors import UsageError
from pcsg.treemesh import Skeleton, extract_skeleton, merge, resample, tree_surface
from pcsg.treemesh.merging import closest_place, split_edge
from pcsg.treemesh.meshes import extract, refine
from pcsg.treemesh.parts import clean
from pcsg.treemesh.tubes import tube_skeleton

CHANGES: dict[str, dict[str, Any]] = {
    "open": {},
    "five sides": {"sides": 5},
    "capped": {"cap": True},
    "a third inside out": {"cap": True, "flip": 0.3},
    "open, a third inside out": {"flip": 0.3},
    "vertices of their own": {"cap": True, "soup": True},
    "all of it": {"sides": 7, "cap": True, "soup": True, "flip": 0.5},
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
@pytest.mark.parametrize("name", ["quercus", "ulmus"])
def test_tubes_become_one_surface(name: str, change: dict[str, Any]) -> None:
    true = species(name)
    found = extract(tubes(true, **change))
    assert found.parts == len(true.limbs)
    skel = found.skeleton
    assert (len(skel.tips), len(skel.joints)) == (len(true.tips), len(true.joints))
    away, radius = axis_distances(true, skel.pos)
    assert (away / radius).max() < 1e-6
    surf = tree_surface(resample(skel))
    r = surf.report(cuts=False)
    assert (r["closed"], r["euler_characteristic"], r["quad_share"]) == (True, 2, 1.0)


def lifted_tubes(true: Skeleton, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Tubes that begin a share of their bearer's radius away from its axis, every other capped."""
    verts, faces, n = [], [], 0
    limbs = true.limbs
    for k in range(len(limbs)):
        at = slice(limbs.ptr[k], limbs.ptr[k + 1])
        places, radii = true.pos[limbs.nodes[at]].copy(), limbs.radius[at]
        if limbs.ends[k, 0] >= 0:
            way = places[1] - places[0]
            lift = share * true.radius[limbs.nodes[at][0]] / np.linalg.norm(way)
            places[0] += min(lift, 0.6) * way
        chain = np.stack([np.arange(len(places) - 1), np.arange(1, len(places))], axis=1)
        v, f = tubes(Skeleton.make(places, radii, chain), sides=6, cap=k % 2 == 0)
        verts.append(v)
        faces.append(f + n)
        n += len(v)
    return np.concatenate(verts), np.concatenate(faces)


@pytest.mark.parametrize("share", [0.5, 0.9, 1.1])
@pytest.mark.parametrize("name", ["acer", "ulmus"])
def test_tubes_that_begin_beside_an_axis_meet_on_it(name: str, share: float) -> None:
    true = species(name)
    found = extract(lifted_tubes(true, share)).skeleton
    assert (len(found.tips), len(found.joints)) == (len(true.tips), len(true.joints))
    joints = true.pos[true.joints]
    for place, radius in zip(found.pos[found.joints], found.radius[found.joints], strict=True):
        assert np.linalg.norm(joints - place, axis=1).min() < 0.6 * radius
    r = tree_surface(resample(found)).report()
    assert (r["closed"], r["euler_characteristic"], r["residual"]["off"]) == (True, 2, 0)
    assert r["folded_share"] <= 0.003
    assert r["self_intersections"]["pairs"] == 0


def test_grafted_twigs_of_a_hundredth() -> None:
    trunk = Skeleton.make([[0, 0, 0], [0, 0, 4], [0, 0, 8]], [1.0, 1.0, 0.9], [[0, 1], [1, 2]])
    twigs = [
        Skeleton.make([[0.5, 0, h], [3, 0, h + 1]], [0.02, 0.01], [[0, 1]]) for h in (2.0, 5.0)
    ]
    through = Skeleton.make([[-2, 0, 6], [2, 0, 6.5]], [0.03, 0.03], [[0, 1]])
    verts, faces, n = [], [], 0
    for part in (trunk, *twigs, through):
        v, f = tubes(part, cap=True)
        verts.append(v)
        faces.append(f + n)
        n += len(v)
    found = extract((np.concatenate(verts), np.concatenate(faces)))
    # Two twigs begin in the trunk, one runs through it: four ends beside the trunk's two.
    assert len(found.skeleton.tips) == 2 + 2 + 2
    surf = tree_surface(found.skeleton)
    r = surf.report(cuts=False)
    assert (r["closed"], r["euler_characteristic"]) == (True, 2)
    assert r["residual"]["off"] <= 0.005 * r["vertices"]


def test_overlapping_branched_surfaces_become_one() -> None:
    a = tree_surface(forked_tree(np.random.default_rng(1), forks=2), levels=1)
    b = tree_surface(forked_tree(np.random.default_rng(2), forks=2), levels=1)
    shift = a.skeleton.pos[3] - b.skeleton.pos[0] + [0.02, 0.0, 0.0]
    verts = np.concatenate([a.verts, 0.9 * b.verts + shift])
    faces = np.concatenate([a.triangles, b.triangles + len(a.verts)])
    found = extract((verts, faces))
    assert found.parts == 2
    assert "2 parts were joined" in found.notes
    r = tree_surface(resample(found.skeleton)).report(cuts=False)
    assert (r["closed"], r["euler_characteristic"]) == (True, 2)
    alone = extract((verts, faces), largest_only=True)
    assert "1 smaller parts were left out" in alone.notes


def test_leaves_are_left_out() -> None:
    verts, faces = tubes(species("quercus"))
    card = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.1]]) + np.full(3, 9.0)
    both = (
        np.concatenate([verts, card]),
        np.concatenate([faces, np.array([[0, 1, 2], [0, 2, 3]]) + len(verts)]),
    )
    found = extract(both)
    assert "1 flat sheets (such as leaves) were left out" in found.notes


def test_what_floats_free_is_refused() -> None:
    verts, faces = tubes(species("quercus"))
    far = verts + np.array([50.0, 0.0, 0.0])
    both = np.concatenate([verts, far]), np.concatenate([faces, faces + len(verts)])
    with pytest.raises(UsageError, match=r"float free: the nearest lies .* --reach"):
        extract(both)
    assert extract(both, reach=100.0).parts == 62
    assert "gaps between parts were bridged" in " ".join(extract(both, reach=100.0).notes)


@pytest.mark.parametrize(
    ("verts", "faces", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), "no faces"),
        (np.zeros((3, 3)), [[0, 1, 2]], "no faces with area"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "flat sheets only"),
        ([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]], "not finite"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 7]], "does not exist"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], "an array of vertices"),
    ],
)
def test_no_mesh_is_refused(verts: Any, faces: Any, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        extract((verts, faces))


def test_a_moebius_strip_is_refused() -> None:
    n = 24
    angle = 2 * np.pi * np.arange(n) / n
    centre = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    half = np.stack(
        [np.cos(angle) * np.cos(angle / 2), np.sin(angle) * np.cos(angle / 2), np.sin(angle / 2)],
        axis=1,
    )
    verts = np.concatenate([centre + 0.3 * half, centre - 0.3 * half])
    faces = []
    for k in range(n):
        a, b = k, (k + 1) % n
        c, d = a + n, b + n
        if k == n - 1:
            b, d = d, b
        faces += [[a, b, d], [a, d, c]]
    with pytest.raises(UsageError, match="Moebius"):
        extract((verts, np.array(faces)))


def test_cleaning_turns_merges_and_caps() -> None:
    verts, faces = tubes(forked_tree(np.random.default_rng(0), forks=0), cap=False)
    faces = faces.copy()
    faces[::3] = faces[::3, ::-1]
    soup = verts[faces.ravel()], np.arange(faces.size).reshape(-1, 3)
    doubled = soup[0], np.concatenate([soup[1], soup[1][:5], [[0, 0, 1]]])
    cleaned = clean(*doubled)
    (part,) = cleaned.parts
    assert len(part.verts) == len(verts) + 2
    notes = " ".join(cleaned.notes)
    for words in ("2 open ends were capped", "were turned", "there twice", "without area"):
        assert words in notes
    edges = set()
    for face in part.faces.tolist():
        for k in range(3):
            edge = face[k], face[(k + 1) % 3]
            assert edge not in edges
            edges.add(edge)
    assert all((b, a) in edges for a, b in edges)


def test_a_fork_is_no_tube() -> None:
    surf = tree_surface(forked_tree(np.random.default_rng(2), forks=1), levels=1)
    (part,) = clean(surf.verts, surf.triangles).parts
    assert tube_skeleton(part) is None


def test_long_faces_are_halved_without_gaps() -> None:
    verts, faces = tubes(Skeleton.make([[0, 0, 0], [0, 0, 9]], [0.2, 0.1], [[0, 1]]), cap=True)
    fine_verts, fine = refine(verts, faces)
    assert len(fine) > 20 * len(faces)
    (part,) = clean(fine_verts, fine).parts  # closed as it is, or it would be capped
    assert not part.loops
    skel = extract_skeleton((fine_verts, fine))
    assert len(skel.tips) == 2


def test_merging_splits_the_closest_edge() -> None:
    trunk = Skeleton.make([[0, 0, 0], [0, 0, 4]], [0.3, 0.2], [[0, 1]], tags={"label": [1]})
    twig = Skeleton.make([[0.5, 0, 1], [2, 0, 2]], [0.05, 0.02], [[0, 1]], tags={"label": [2]})
    place = closest_place(trunk, twig.pos[0])
    assert (place.edge, place.part, place.distance) == (0, pytest.approx(0.25), pytest.approx(0.5))
    both = merge(trunk, twig)
    both.check()
    assert both.pos[2].tolist() == [0, 0, 1]
    assert both.radius[2] == pytest.approx(0.275)
    assert both.n_edges == 4
    assert sorted(both.tags["label"].tolist()) == [1, 1, 2, 2]
    touching = merge(trunk, twig.replaced(pos=twig.pos - [0.5, 0, 0]))
    assert (touching.n_edges, touching.n_nodes) == (3, 4)
    with pytest.raises(UsageError, match="between 0 and 1"):
        split_edge(trunk, 0, 1.0)
