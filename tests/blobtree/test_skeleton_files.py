"""Trees of skeletons in files: internodes, axes, areas at junctions, in grammars and commands."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import pcsg
from pcsg import blobtree as b
from pcsg.blobtree.lines import FLARE, internodes
from pcsg.cli import app
from pcsg.errors import UsageError
from pcsg.skeletonfile import SkeletonRows, parse_rows

SWC = """# id type x y z r parent
1 0 0 0 0 0.50 -1
2 0 0 0 2 0.45 1
3 0 0.5 0 4 0.40 2
4 0 1.8 0 3.2 0.15 2
5 0 2.7 0 4 0.10 4
"""
NODES = [[0, 0, 0, 0.5], [0, 0, 2, 0.45], [0.5, 0, 4, 0.4], [1.8, 0, 3.2, 0.15], [2.7, 0, 4, 0.1]]


def rows(**changes: object) -> SkeletonRows:
    data = {"nodes": NODES, "edges": [[0, 1], [1, 2], [3, 1], [3, 4]], "root": 0, **changes}
    return parse_rows(json.dumps(data), "skel.json")


def test_internodes_go_outwards_and_the_thickest_goes_on() -> None:
    for found in (internodes(parse_rows(SWC, "t.swc")), internodes(rows())):
        assert found.parent.tolist() == [-1, 0, 0, 2]
        assert found.lateral.tolist() == [True, False, True, False]
        # The thin branch does not begin as thick as its bearer, nor the leader.
        np.testing.assert_allclose(found.base, [0.5, 0.45, FLARE * 0.15, 0.15])
        np.testing.assert_allclose(found.top, [0.45, 0.4, 0.15, 0.1])
        np.testing.assert_allclose(found.start[2], [0, 0, 2])


def test_branch_tags_say_which_edge_goes_on() -> None:
    found = internodes(rows(tags={"branch": [7, 8, 7, 7]}))
    assert found.lateral.tolist() == [True, True, False, False]


def test_areas_at_junctions() -> None:
    areas = b.junction_areas(internodes(rows()))
    assert areas.bearer.tolist() == [0]
    np.testing.assert_allclose(areas.ratio, (0.45**2 + (FLARE * 0.15) ** 2) / 0.45**2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"edges": [[0, 1], [1, 2], [3, 1], [3, 4], [4, 2]]}, "no tree"),
        ({"edges": [[0, 1], [1, 2], [0, 2], [3, 4]]}, "does not hang together"),
        ({"edges": [[0, 1], [1, 2], [3, 1], [3, 9]]}, "does not exist"),
        ({"nodes": [*NODES[:4], [2.7, 0, 4, -1]]}, "must be positive"),
        ({"nodes": [*NODES[:4], [1.8, 0, 3.2, 0.1]]}, "no length"),
    ],
)
def test_what_is_no_tree_is_told(changes: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        internodes(rows(**changes))


def test_a_grammar_names_a_skeleton_with_its_junctions(tmp_path: Path) -> None:
    (tmp_path / "t.swc").write_text(SWC)
    skeleton = b.read_skeleton(tmp_path / "t.swc")
    points = np.random.default_rng(1).uniform([-0.7, -0.7, 1.2], [1.4, 0.7, 3.4], (9_000, 3))
    seen = []
    for number, mode in enumerate(("smooth", "contact", "aged")):
        file = tmp_path / f"{mode}.pcsg"
        file.write_text(f'blob("t.swc", {number})')
        scene = pcsg.load(file)
        inside = scene.contains(points)
        model = b.Model(b.grow(skeleton, b.Junctions(mode=mode)))
        np.testing.assert_array_equal(inside, model.contains(points))
        seen.append(tuple(inside.tolist()))
    assert len(set(seen)) == 3


def test_commands_take_skeletons(tmp_path: Path) -> None:
    (tmp_path / "t.swc").write_text(SWC)
    run = CliRunner()
    done = run.invoke(app, ["stats", str(tmp_path / "t.swc"), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)["junctions"]
    assert told["total"] == told["thicker"] == 1
    done = run.invoke(app, ["stats", str(tmp_path / "t.swc"), "-D", "junctions=5"])
    assert done.exit_code != 0
    assert "Traceback" not in done.output
    (tmp_path / "bad.swc").write_text("1 0 0 0 0 1 -1\n2 0 x\n")
    done = run.invoke(app, ["check", str(tmp_path / "bad.swc")])
    assert done.exit_code != 0
    assert "line 2" in done.output


@pytest.mark.parametrize("mode", ["smooth", "contact"])
def test_where_a_tip_tapers_there_is_neither_a_bulge_nor_a_notch(mode: str) -> None:
    # Before: the offset was that of untapered branches, which left a notch of a sixth.
    skeleton = internodes(
        parse_rows("1 0 0 0 0 0.5 -1\n2 0 0 0 4 0.5 1\n3 0 0 0 9 0.2 2\n", "t.swc")
    )
    model = b.Model(b.grow(skeleton, b.Junctions(mode=mode, buds=False)))
    z = np.linspace(1.0, 6.0, 101)
    t = model.intersect(np.stack([0 * z - 3.0, 0 * z, z], 1), np.tile([1.0, 0, 0], (101, 1)))
    tip = 0.3 * 0.5
    expected = np.where(z < 4.0, 0.5, 0.5 - (0.5 - tip) * (z - 4.0) / 5.0)
    assert np.abs(3.0 - t - expected).max() < 0.09 * 0.5
