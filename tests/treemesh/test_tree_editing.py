"""Operations on skeletons, undo, partial rebuilding, composition."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tree_shapes import forked_tree, species

from pcsg.errors import UsageError
from pcsg.treemesh import Skeleton, tree_surface
from pcsg.treemesh.composition import CompositionOptions, collides, compose, segment_distances
from pcsg.treemesh.editing import Editor, detach, rotation, subtree
from pcsg.treemesh.library import Library, longest_path
from pcsg.treemesh.offsets import transfer_offsets
from pcsg.treemesh.surface import QuadMesh


def same_surface(a: QuadMesh, b: QuadMesh) -> None:
    assert np.array_equal(a.quads, b.quads)
    assert np.array_equal(a.verts, b.verts)
    assert np.array_equal(a.normals, b.normals)
    assert np.array_equal(a.residual, b.residual)
    assert np.array_equal(a.nearest, b.nearest)


@settings(max_examples=12)
@given(seed=st.integers(0, 10**6), data=st.data())
def test_partial_rebuilding_is_rebuilding(seed: int, data: st.DataObject) -> None:
    rng = np.random.default_rng(seed)
    editor = Editor(forked_tree(rng, forks=4), levels=1)
    assert editor.surface is editor.surface
    for _ in range(3):
        skel = editor.skeleton
        edge = int(rng.integers(skel.n_edges))
        node = int(rng.integers(1, skel.n_nodes))
        move = 0.05 * rng.normal(size=3)
        what = data.draw(st.sampled_from(["drag", "rotate", "split", "append", "delete"]))
        try:
            if what == "drag":
                editor.translate_node(node, move)
            elif what == "rotate":
                editor.rotate(edge, rng.normal(size=3), 25.0)
            elif what == "split":
                editor.split(edge, 0.4)
            elif what == "append":
                editor.append(node, skel.pos[node] + [0.1, 0.1, 0.2], 0.03)
            else:
                editor.delete(edge)
        except UsageError:
            continue  # such as an edge that bears the whole tree
        same_surface(editor.surface, tree_surface(editor.skeleton, levels=1))
    while editor.undo():
        pass
    same_surface(editor.surface, tree_surface(editor.skeleton, levels=1))


def test_an_edit_projects_few_vertices(monkeypatch: pytest.MonkeyPatch) -> None:
    editor = Editor(species("ulmus"))
    everything = len(editor.surface.verts)
    seen: list[int] = []
    from pcsg.treemesh import surface as module

    def count(verts, owner, found, zone, chosen, *, fair):  # type: ignore[no-untyped-def]
        seen.append(len(chosen))
        return evolve(verts, owner, found, zone, chosen, fair=fair)

    evolve = module.evolve
    monkeypatch.setattr(module, "evolve", count)
    tip = int(editor.skeleton.tips[-1])
    editor.translate_node(tip, [0.01, 0.0, 0.0])
    assert len(editor.surface.verts) == everything
    assert 0 < seen[0] < 0.2 * everything


def test_undo_and_redo() -> None:
    first = forked_tree(np.random.default_rng(0), forks=2)
    editor = Editor(first)
    assert not editor.undo()
    second = editor.split(3)
    third = editor.translate_node(5, [0.1, 0, 0])
    assert editor.undo()
    assert editor.skeleton is second
    assert editor.redo()
    assert editor.skeleton is third
    assert not editor.redo()
    assert editor.history == (first, second)
    editor.undo()
    editor.split(1)
    assert not editor.redo()  # another way was taken
    with pytest.raises(UsageError):
        editor.translate_node(0, [np.nan, 0, 0])
    with pytest.raises(UsageError, match="at one place"):
        editor.translate_node(1, editor.skeleton.pos[0] - editor.skeleton.pos[1])
    assert len(editor.history) == 2  # what failed changed nothing


def test_what_operations_do() -> None:
    pos = [[0, 0, 0], [0, 0, 1], [0, 0, 2], [1, 0, 2]]
    skel = Skeleton.make(pos, [0.3, 0.2, 0.1, 0.1], [[0, 1], [1, 2], [1, 3]])
    editor = Editor(skel)
    turned = editor.rotate(1, [0, 1, 0], 90.0)
    assert turned.pos[2] == pytest.approx([1, 0, 1])
    assert turned.pos[3].tolist() == [1, 0, 2]
    editor.undo()
    assert editor.split(0, 0.25).radius[4] == pytest.approx(0.275)
    assert editor.skeleton.pos[4].tolist() == [0, 0, 0.25]
    moved = editor.translate_subtree(1, [0, 1, 0])
    assert moved.pos[2].tolist() == [0, 1, 2]
    off = editor.detach(1)
    assert (off.n_edges, editor.skeleton.n_edges) == (1, 3)
    assert len(editor.skeleton.joints) == 0  # two edges are left there
    back = editor.merge(off)
    assert len(back.joints) == 1
    grown = editor.append(2, [1, 0, 3], 0.05)
    assert grown.n_nodes == back.n_nodes + 1
    assert editor.delete(grown.n_edges - 1).n_edges == back.n_edges
    nodes, edges = subtree(skel, 0)
    assert nodes.tolist() == [1, 2, 3]
    assert edges.tolist() == [1, 2]


def test_mistakes_in_operations() -> None:
    ring = Skeleton.make([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [0.1] * 3, [[0, 1], [1, 2], [2, 0]])
    with pytest.raises(UsageError, match="loop"):
        subtree(ring, 0)
    line = Skeleton.make([[0, 0, 0], [1, 0, 0]], [0.1, 0.1], [[0, 1]])
    with pytest.raises(UsageError, match="whole skeleton"):
        detach(line, 0)
    with pytest.raises(UsageError, match="no edge 5"):
        subtree(line, 5)
    with pytest.raises(UsageError, match="axis"):
        rotation([0, 0, 0], 5.0)


def test_bark_survives_an_edit() -> None:
    editor = Editor(forked_tree(np.random.default_rng(3), forks=2))
    before = editor.surface
    rough = 0.1 * np.sin(np.arange(len(before.verts)))
    from dataclasses import replace

    barked = replace(before, offsets=rough)
    editor.apply(lambda s: s.replaced(radius=2.0 * s.radius, pos=2.0 * s.pos))
    moved = transfer_offsets(editor.surface, barked)
    assert moved.offsets == pytest.approx(2.0 * rough, rel=1e-6, abs=1e-12)


@cache
def library() -> Library:
    found = Library()
    found.add(species("quercus"), "quercus")
    return found


def test_entries_are_normalised() -> None:
    skel = species("quercus")
    joints = [a for a in skel.joints if skel.parents[0][a] >= 0]
    children = sum(int((skel.parents[0] == a).sum()) for a in joints)
    assert len(library().entries) == children
    for entry in library().entries:
        s = entry.skeleton
        s.check()
        ptr, others, _ = s.incidence
        way = s.pos[others[ptr[s.root]]]
        assert s.pos[s.root].tolist() == pytest.approx([0, 0, 0])
        assert way / np.linalg.norm(way) == pytest.approx([0, 0, 1], abs=1e-9)
        assert longest_path(s) == pytest.approx(1.0)
        assert 0.0 < entry.radius < 0.2


def test_libraries_come_back(tmp_path: Path) -> None:
    back = Library.load(library().save(tmp_path / "lib.json"))
    assert len(back.entries) == len(library().entries)
    for a, b in zip(back.entries, library().entries, strict=True):
        assert (a.order, a.species, a.segments) == (b.order, b.species, b.segments)
        assert np.array_equal(a.skeleton.pos, b.skeleton.pos)
    (tmp_path / "no.json").write_text("{}")
    with pytest.raises(UsageError, match="not a library"):
        Library.load(tmp_path / "no.json")


@pytest.mark.parametrize("seed", range(6))
def test_composed_trees(seed: int) -> None:
    template = species("quercus")
    tree = compose(template, library(), seed)
    assert tree.loops == 0
    assert np.array_equal(tree.pos, compose(template, library(), seed).pos)
    assert not np.array_equal(tree.pos[:60], compose(template, library(), seed + 1).pos[:60])
    # No thicker together than what bears them, where anything was replaced.
    parent, _, _ = tree.parents
    for joint in tree.joints.tolist():
        children = tree.radius[parent == joint]
        assert (children**2.5).sum() <= 1.02 * tree.radius[joint] ** 2.5 + _left(tree, joint)
    surf = tree_surface(tree, levels=1)
    assert surf.report(cuts=False)["euler_characteristic"] == 2


def _left(tree: Skeleton, joint: int) -> float:
    """The template's own children may break the rule; replacements may add a twig to them."""
    own = tree.radius[tree.parents[0] == joint].max()
    return float(own**2.5 + (0.02 * tree.radius[joint]) ** 2.5)


def _chain(n: int) -> list[list[int]]:
    """Return the edges of a path of n nodes."""
    return [[k, k + 1] for k in range(n - 1)]


def test_composition_tells_how_far_it_is() -> None:
    seen: list[tuple[int, int]] = []
    template = species("quercus")
    tree = compose(template, library(), 3, report=lambda done, of: seen.append((done, of)))
    assert [done for done, _ in seen] == list(range(1, len(seen) + 1))
    assert all(done <= of for done, of in seen) and seen[-1][0] == tree.n_nodes
    assert np.array_equal(tree.pos, compose(template, library(), 3).pos)


def test_composition_avoids_collisions() -> None:
    rng = np.random.default_rng(2)
    p, q = rng.normal(size=(2, 6, 3)), rng.normal(size=(2, 7, 3))
    i, j = np.divmod(np.arange(42), 7)
    found = segment_distances(p[0, i], p[1, i], q[0, j], q[1, j]).reshape(6, 7)
    t = np.linspace(0, 1, 201)
    for i in range(6):
        a = p[0, i] + t[:, None] * (p[1, i] - p[0, i])
        for j in range(7):
            b = q[0, j] + t[:, None] * (q[1, j] - q[0, j])
            brute = np.linalg.norm(a[:, None] - b[None], axis=2).min()
            assert found[i, j] == pytest.approx(brute, abs=0.02)
            assert found[i, j] <= brute + 1e-12
    # Limbs whose boxes are apart are not looked at.
    for scale in (0.02, 0.1, 0.3):
        chain = Skeleton.make(
            np.cumsum(scale * rng.normal(size=(30, 3)), axis=0), [0.02] * 30, _chain(30)
        )
        twig = Skeleton.make(
            chain.pos[0] + np.cumsum(scale * rng.normal(size=(9, 3)), axis=0), [0.02] * 9, _chain(9)
        )
        ends, others = chain.pos[chain.edges[1:]], twig.pos[twig.edges]
        k, j = np.divmod(np.arange(28 * 8), 8)
        near = segment_distances(ends[k, 0], ends[k, 1], others[j, 0], others[j, 1]).min()
        assert collides(chain, 0, twig) == (near < 0.04)
    rest = Skeleton.make([[0, 0, 0], [0, 0, 1], [2, 0, 1]], [0.1] * 3, [[0, 1], [1, 2]])
    clear = Skeleton.make([[0, 0, 0], [0, 2, 1]], [0.1, 0.1], [[0, 1]])
    hits = Skeleton.make([[0, 0, 0], [2, 0, 2]], [0.1, 0.1], [[0, 1]])
    assert not collides(rest, 0, clear)
    assert collides(rest, 0, hits)


def test_mistakes_in_composition() -> None:
    template = species("quercus")
    with pytest.raises(UsageError, match="empty"):
        compose(template, Library())
    line = Skeleton.make([[0, 0, 0], [1, 0, 0]], [0.1, 0.1], [[0, 1]])
    with pytest.raises(UsageError, match="no joint"):
        compose(line, library())
    with pytest.raises(UsageError, match="p_replace"):
        compose(template, library(), 0, CompositionOptions(p_replace=2.0))
    same = compose(template, library(), 0, CompositionOptions(p_replace=0.0))
    assert np.array_equal(same.pos, template.pos)
