from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tree_shapes import species, wild_skeleton

from pcsg.errors import UsageError
from pcsg.treemesh.pruning import branch_orders, extend_foot, thin_out
from pcsg.treemesh.resampling import resample
from pcsg.treemesh.skeleton import FLARE, Skeleton

Y = Skeleton.make(
    [[0, 0, 0], [0, 0, 1], [0, 0, 2], [0.5, 0, 3], [-0.5, 0, 3]],
    [0.2, 0.18, 0.15, 0.05, 0.1],
    [[0, 1], [1, 2], [2, 3], [2, 4]],
    tags={"label": [1, 1, 2, 3]},
)


def test_limbs_joints_and_tips() -> None:
    assert Y.joints.tolist() == [2]
    assert sorted(Y.tips.tolist()) == [0, 3, 4]
    assert Y.loops == 0
    limbs = Y.limbs
    chains = [limbs.nodes[a:b].tolist() for a, b in zip(limbs.ptr, limbs.ptr[1:], strict=False)]
    assert sorted(chains) == [[0, 1, 2], [2, 3], [2, 4]]
    # A twig does not swell to its bearer.
    assert limbs.radius[limbs.ptr[chains.index([2, 3])]] == pytest.approx(FLARE * 0.05)
    assert limbs.radius[limbs.ptr[chains.index([2, 4])]] == pytest.approx(0.15)


@given(st.integers(0, 10**6), st.integers(3, 60))
def test_limbs_partition_the_edges(seed: int, segments: int) -> None:
    skel = wild_skeleton(np.random.default_rng(seed), segments)
    limbs = skel.limbs
    used = limbs.edges[limbs.edges >= 0]
    assert sorted(used.tolist()) == list(range(skel.n_edges))
    for k in range(len(limbs)):
        chain = limbs.nodes[limbs.ptr[k] : limbs.ptr[k + 1]]
        assert (skel.degree[chain[1:-1]] == 2).all()
        assert (skel.degree[chain[[0, -1]]] != 2).all()
        depth = [len(_path(skel, int(a))) for a in chain]
        if skel.root not in chain[1:-1]:
            assert depth == sorted(depth)  # away from the root


def _path(skel: Skeleton, node: int) -> list[int]:
    parent = skel.parents[0]
    path = []
    while node >= 0:
        path.append(node)
        node = int(parent[node])
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": [1, 1, 0]}, "radius 0; it must be positive"),
        ({"radius": [1, 1]}, "has 2 radii"),
        ({"edges": [[0, 1], [1, 5]]}, "does not exist"),
        ({"edges": [[0, 1], [1, 1]]}, "to itself"),
        ({"edges": [[0, 1], [1, 0]]}, "the same nodes"),
        ({"edges": [[0, 1]]}, "not connected: 2 of 3"),
        ({"pos": [[0, 0, 0], [0, 0, 0], [0, 0, 1]]}, "has no length"),
        ({"pos": [[0, 0, 0], [0, 0, np.nan], [0, 0, 1]]}, "node 1 is not finite"),
        ({"pos": [[0, 0], [1, 1]]}, "wrong form"),
        ({"root": 7}, "the root is node 7"),
    ],
)
def test_what_is_refused(change: dict[str, object], message: str) -> None:
    given = {
        "pos": [[0, 0, 0], [0, 0, 1], [0, 0, 2]],
        "radius": [1, 1, 1],
        "edges": [[0, 1], [1, 2]],
    }
    with pytest.raises(UsageError, match=message):
        Skeleton.make(**{**given, **change})  # type: ignore[arg-type]


def test_resampling_keeps_bends_and_ends() -> None:
    x = np.linspace(0.0, 4.0, 41)
    corner = np.concatenate([np.stack([x, 0 * x, 0 * x], 1), [[4.0, 1.0, 0.0], [4.0, 4.0, 0.0]]])
    edges = np.stack([np.arange(42), np.arange(1, 43)], axis=1)
    skel = Skeleton.make(corner, np.full(43, 0.1), edges)
    thin = resample(skel, 8.0, 1.5)
    assert thin.pos.tolist() == [[0, 0, 0], [4, 0, 0], [4, 4, 0]]
    assert resample(skel, 0.0, 0.0).n_nodes == 43


@pytest.mark.parametrize("name", ["quercus", "ulmus"])
def test_resampling_stays_near(name: str) -> None:
    skel = species(name)
    skel = skel.replaced(mapping=tuple(np.array([k]) for k in range(skel.n_nodes)))
    thin = resample(skel, 12.0, 3.0)
    assert 1 < thin.n_edges < skel.n_edges
    assert (len(thin.joints), len(thin.tips)) == (len(skel.joints), len(skel.tips))
    a, b = thin.pos[thin.edges[:, 0]], thin.pos[thin.edges[:, 1]]
    for p, r in zip(skel.pos, skel.radius, strict=True):
        t = np.clip(((p - a) * (b - a)).sum(1) / ((b - a) ** 2).sum(1), 0, 1)
        distance = np.linalg.norm(p - a - t[:, None] * (b - a), axis=1).min()
        assert distance <= 0.2501 * r
    assert thin.mapping is not None
    assert sorted(np.concatenate(thin.mapping).tolist()) == list(range(skel.n_nodes))


def test_orders_and_thinning() -> None:
    assert branch_orders(Y).tolist() == [0, 0, 1, 0]
    left, gone = thin_out(Y, max_order=0)
    assert gone == 1
    assert left.tags["label"].tolist() == [1, 1, 3]
    left, gone = thin_out(Y, min_radius=0.12)
    assert (gone, left.n_edges) == (2, 2)
    with pytest.raises(UsageError, match="nothing is left"):
        thin_out(Y, min_radius=0.19)


def test_the_foot_goes_down_by_one_radius() -> None:
    assert extend_foot(Y).pos[0].tolist() == pytest.approx([0.0, 0.0, -0.2])
