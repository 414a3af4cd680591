"""Numbers in files of skeletons that nobody has thought of."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pcsg import blobtree as b
from pcsg.cli import app
from pcsg.errors import UsageError
from pcsg.skeletonfile import parse_rows
from pcsg.treemesh import Skeleton, SurfaceOptions, tree_surface
from pcsg.treemesh.estimate import BYTES, check_memory, count_quads

HUGE = "1" + "0" * 400


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (f"1 {HUGE} 0 0 0 1 -1\n2 0 0 0 1 1 1\n", "line 1: the type 10000.* is too large"),
        (f"{HUGE} 0 0 0 0 1 -1\n{HUGE} 0 0 0 1 1 1\n", "line 2: the id 10000.* is there already"),
        (f"1 0 0 0 0 1 -1\n2 0 0 0 1 1 {HUGE}\n", "line 2: there is no node 10000"),
        (f"{'9' * 5000} 0 0 0 0 1 -1\n", "line 1: expected the 7 numbers"),
        (f"1 0 {HUGE} 0 0 1 -1\n", "line 1: inf is no place"),
        ("1 0 nan 0 0 1 -1\n", "line 1: nan is no place"),
        ("1 0 0 1e31 0 1 -1\n", "line 1: 1e\\+31 is no place"),
        ("1 0 0 0 0 1e-40 -1\n", "line 1: the radius 1e-40 is too small"),
    ],
)
def test_numbers_of_swc_files(text: str, told: str) -> None:
    with pytest.raises(UsageError, match=told) as caught:
        parse_rows(text, "t.swc")
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"root": 0.5}, "pairs of whole numbers"),
        ({"root": [0]}, "pairs of whole numbers"),
        ({"edges": [[0, 10**30]]}, "pairs of whole numbers"),
        ({"nodes": [[0, 0, 0, 1], [0, 0, 10**400, 1]]}, "lists \\[x, y, z, r\\]"),
        ({"nodes": [[0, 0, 0, 1], [0, 0, 1e40, 1]]}, "node 1: 1e\\+40 is no place"),
        ({"tags": {"label": [1, 2]}}, "the tag `label` has one number for each edge"),
        ({"tags": {"label": [10**30]}}, "pairs of whole numbers"),
    ],
)
def test_numbers_of_json_files(changes: dict[str, object], told: str) -> None:
    data = {"nodes": [[0, 0, 0, 1], [0, 0, 5, 1]], "edges": [[0, 1]], **changes}
    with pytest.raises(UsageError, match=told):
        parse_rows(json.dumps(data), "t.json")
    with pytest.raises(UsageError, match="not JSON"):
        parse_rows("[" * 100_000, "t.json")


def test_what_is_no_ordinary_file_is_told() -> None:
    with pytest.raises(UsageError, match="not an ordinary file"):
        b.read_skeleton("/dev/zero")


def skeleton(far: float) -> Skeleton:
    return Skeleton.make([[0, 0, 0], [0, 0, far], [3, 0, far]], [0.5, 0.5, 0.2], [[0, 1], [1, 2]])


def test_the_number_of_quads_is_known_before() -> None:
    for options in (SurfaceOptions(), SurfaceOptions(levels=1, max_aspect=2.0)):
        made = len(tree_surface(skeleton(40.0), options).quads)
        assert 0.8 * made <= count_quads(skeleton(40.0), options) <= 1.3 * made


def test_a_surface_without_end_is_refused_before_it_is_made(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--max-memory allows; a step less of --levels"):
        check_memory(skeleton(2.0**31), None, 2**40)
    quads = count_quads(skeleton(40.0))
    check_memory(skeleton(40.0), None, int(quads * BYTES) + 1)
    with pytest.raises(UsageError, match=r"some [\d,]+ quads about 2 segments"):
        check_memory(skeleton(40.0), None, int(quads * BYTES) - 1)
    swc = tmp_path / "far.swc"
    swc.write_text("1 0 0 0 0 0.5 -1\n2 0 0 0 2147483648 0.5 1\n")
    arguments = ["mesh", str(swc), "-o", str(tmp_path / "x.obj")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2 and "--max-memory" in done.output
    arguments = ["mesh", "populus", "-D", "t=3", "--max-memory", "1M", *arguments[2:]]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2 and "-D t=3" in done.output
    assert not (tmp_path / "x.obj").exists()


def test_statistics_leave_numbers_of_files_bounded(tmp_path: Path) -> None:
    path = tmp_path / "many.pcsg"
    path.write_text("{} sphere", encoding="utf-8")
    before = sys.get_int_max_str_digits()
    assert CliRunner().invoke(app, ["stats", str(path)]).exit_code == 0
    assert sys.get_int_max_str_digits() == before > 0
