"""Cylinders and cones of grammars become skeletons."""

from __future__ import annotations

import numpy as np
import pytest
from tree_shapes import GRAMMARS

import pcsg
from pcsg.errors import UsageError
from pcsg.graph.leaves import placed_leaves
from pcsg.treemesh import Segments, skeleton_of_segments, tree_surface


def segments(*rows: tuple[float, ...]) -> Segments:
    """Rows of start, end, radius at the start and at the end."""
    table = np.array(rows, dtype=float)
    return Segments(table[:, 0:3], table[:, 3:6], table[:, 6:8], np.arange(len(table)))


def test_ends_that_coincide_are_one_node() -> None:
    skel, notes = skeleton_of_segments(
        segments((0, 0, 0, 0, 0, 1, 0.2, 0.2), (0.001, 0, 1, 0, 0, 2, 0.2, 0.15))
    )
    assert (skel.n_nodes, skel.n_edges) == (3, 2)
    assert skel.radius.tolist() == pytest.approx([0.2, 0.2, 0.15])
    assert not notes


def test_a_branch_on_an_axis_is_a_joint_and_keeps_its_thickness() -> None:
    skel, _ = skeleton_of_segments(
        segments((0, 0, 0, 0, 0, 2, 0.3, 0.3), (0, 0, 1, 2, 0, 1, 0.05, 0.05))
    )
    assert len(skel.joints) == 1
    assert skel.pos[skel.joints[0]].tolist() == [0, 0, 1]
    shoulder = np.flatnonzero(np.abs(skel.pos[:, 0] - 0.3) < 1e-9)
    assert skel.radius[shoulder].tolist() == [0.05]
    assert sorted(set(skel.tags["label"].tolist())) == [0, 1]


def test_a_branch_beside_an_axis_is_joined() -> None:
    skel, notes = skeleton_of_segments(
        segments((0, 0, 0, 0, 0, 2, 0.3, 0.3), (0.2, 0, 1, 2, 0, 1, 0.25, 0.25))
    )
    assert len(skel.joints) == 1
    assert "2 parts were joined" in notes


def test_collinear_doubles_and_loops() -> None:
    trunk = (0, 0, 0, 0, 0, 3, 0.1, 0.1)
    thick = (0, 0, 0, 0, 0, 1, 0.3, 0.3)
    skel, _ = skeleton_of_segments(segments(trunk, thick))
    assert skel.pos[np.argsort(skel.pos[:, 2])].tolist() == [[0, 0, 0], [0, 0, 1], [0, 0, 3]] or (
        skel.n_edges == 3  # with a shoulder where it becomes thin
    )
    assert not len(skel.joints)
    square = [(0, 0, 0, 1, 0, 0), (1, 0, 0, 1, 1, 0), (1, 1, 0, 0, 1, 0), (0, 1, 0, 0, 0, 0)]
    skel, notes = skeleton_of_segments(
        segments(*((*s, 0.1, 0.1 - 0.01 * k) for k, s in enumerate(square)))
    )
    assert skel.loops == 0
    assert "1 cylinders that would close a loop were left out" in notes


def test_mistakes() -> None:
    with pytest.raises(UsageError, match="no cylinder or cone"):
        skeleton_of_segments(Segments(*(np.zeros((0, k)) for k in (3, 3, 2)), np.zeros(0, int)))
    with pytest.raises(UsageError, match="not finite"):
        skeleton_of_segments(segments((0, 0, 0, np.inf, 0, 0, 1, 1)))
    with pytest.raises(UsageError, match="length and a radius"):
        skeleton_of_segments(segments((0, 0, 0, 0, 0, 0, 1, 1)))
    with pytest.raises(UsageError, match="float free"):
        skeleton_of_segments(
            segments((0, 0, 0, 0, 0, 1, 0.1, 0.1), (9, 0, 0, 9, 0, 1, 0.1, 0.1)), reach=0.5
        )


def test_cylinders_of_a_grammar() -> None:
    text = """
        {n = 2; r = 0.2} T
        T if(n > 0, 2, 1)
        1: T -> label(7) scale(r, r, 1) cylinder
        2: T -> label(n) scale(r, r, 1) cone(0.8) | {n = n-1; r = 0.8*r} move(0,0,1)
                (rotx(40) T | rotx(-40) T | sphere)
        """
    found = pcsg.loads(text).limbs()
    skel = found.skeleton
    assert (skel.n_edges, len(skel.joints), len(skel.tips)) == (7, 3, 5)
    assert sorted(skel.tags["label"].tolist()) == [1, 1, 2, 7, 7, 7, 7]
    assert skel.radius[skel.tips].tolist().count(pytest.approx(0.2 * 0.64)) == 4
    assert "3 primitives that are no plain cylinders" in found.notes[-1]
    surf = tree_surface(skel)
    assert set(surf.labels.tolist()) == {1, 2, 7}


def test_what_is_carved_is_no_limb() -> None:
    scene = pcsg.loads(
        r"cylinder | move(0,0,1) (scale(2,2,1) cylinder \ sphere) | (box & cylinder)"
    )
    leaves = list(placed_leaves(scene.states, 100))
    assert [(leaf.name, leaf.carved) for leaf in leaves] == [
        ("cylinder", False),
        ("cylinder", True),
        ("sphere", True),
        ("box", True),
        ("cylinder", True),
    ]
    assert scene.limbs().skeleton.n_edges == 1


def test_deep_recursion_needs_no_stack() -> None:
    chain = pcsg.loads(
        """
        {n = 3000} T
        T if(n > 0, 2, 1)
        1: T -> cylinder
        2: T -> cylinder | {n = n-1} move(0,0,1) T
        """
    )
    assert chain.limbs().skeleton.n_edges == 3001


def test_limits_and_elliptic_sections() -> None:
    scene = pcsg.load(GRAMMARS / "quercus.pcsg")
    with pytest.raises(UsageError, match="more than 50 primitives"):
        scene.limbs(limit=50)
    skel = pcsg.loads("rotx(90) scale(4, 1, 5) cylinder").limbs().skeleton
    assert skel.radius.tolist() == pytest.approx([2.0, 2.0])
    assert skel.pos[1].tolist() == pytest.approx([0.0, -5.0, 0.0])
