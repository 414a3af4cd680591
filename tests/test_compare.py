"""Two versions are compared rightly: the arithmetic, what is missing, and what is measured."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks import __main__ as command  # noqa: E402 - not installed with the package
from benchmarks import compare, tasks  # noqa: E402
from benchmarks.compare import (  # noqa: E402
    Compared,
    Side,
    find_faults,
    geometric_mean,
    pair,
    shortest,
    table,
)


def test_of_several_rounds_the_shortest_counts_and_one_failure_is_a_failure():
    rounds = [
        {"a": 3.0, "b": 1.0, "c": 1.0, "d": "broken"},
        {"a": 2.0, "b": 1.5, "c": "broken", "d": 1.0},
        {"a": 4.0, "b": 1.2, "c": 0.5, "d": 1.0},
    ]
    assert shortest(rounds) == {"a": 2.0, "b": 1.0, "c": "broken", "d": "broken"}


def test_the_mean_is_geometric_and_leaves_out_what_one_version_lacks():
    rows = pair({"a": 1.0, "b": 1.0, "c": "lacks it"}, {"a": 2.0, "b": 0.5, "c": 9.0})
    assert [row.ratio for row in rows] == [2.0, 0.5, None]
    assert geometric_mean(rows) == pytest.approx(1.0)
    assert geometric_mean([Compared("a", 1.0, 1.0), Compared("b", 1.0, 4.0)]) == pytest.approx(2.0)
    assert geometric_mean([Compared("a", "lacks it", 1.0)]) is None


@pytest.mark.parametrize(
    ("old", "new", "faults"),
    [
        ({"a": 1.0, "b": 1.0}, {"a": 1.02, "b": 1.03}, []),
        ({"a": 1.0, "b": 1.0}, {"a": 1.05, "b": 1.04}, ["the mean: +4.5 % time"]),
        ({"a": 1.0, "b": 1.0}, {"a": 1.12, "b": 0.5}, ["a: +12.0 % time"]),
        ({"a": 1.0, "b": "lacks it"}, {"a": 1.0, "b": 50.0}, []),
        ({"a": 1.0, "b": 1.0}, {"a": 1.0, "b": "KeyError: x"}, ["b: KeyError: x"]),
        ({"a": 1.0, "b": 1.0}, {"a": 1.0}, ["b: was not measured"]),
        ({"a": "lacks it"}, {"a": 1.0}, ["no task was done by both versions"]),
    ],
)
def test_a_slow_mean_a_slow_task_and_what_the_new_version_cannot_do_are_faults(old, new, faults):
    found = find_faults(pair(old, new))
    assert [told.partition(",")[0] for told in found] == faults


def test_limits_can_be_given():
    rows = pair({"a": 1.0}, {"a": 1.2})
    assert find_faults(rows, mean_limit=25.0, row_limit=25.0) == []
    assert len(find_faults(rows, mean_limit=15.0, row_limit=15.0)) == 2


def test_the_table_tells_milliseconds_and_ratios():
    assert list(table(pair({"a": 0.001, "b": "lacks it"}, {"a": 0.002, "b": 1.0})))[2:] == [
        "| a | 1 | 2 | 2.000 |",
        "| b | - | 1,000 | - |",
        "| geometric mean | | | 2.000 |",
    ]


@pytest.mark.parametrize(("slower", "status"), [(1.0, 0), (1.5, 1)])
def test_both_versions_take_turns_after_a_round_that_does_not_count(
    monkeypatch, capsys, slower, status
):
    asked = []

    def measure(side: Side, code: Path, names):
        asked.append(side.name)
        assert (code / "benchmarks" / "tasks.py").exists()
        first = len(asked) <= 2
        return dict.fromkeys(names, 100.0 if first else slower if side.name == "new" else 1.0)

    monkeypatch.setattr(Side, "measure", measure)
    with pytest.raises(SystemExit) as ended:
        command.main(["compare", str(ROOT), str(ROOT), "--rounds", "2", "--tasks", "start"])
    assert ended.value.code == status
    assert asked == ["old", "new", "old", "new", "new", "old"]
    assert "| start, pcsg --help | 1,000 |" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["no-such-revision", str(ROOT)], "`no-such-revision` is neither"),
        ([str(ROOT), str(ROOT), "--tasks", "unheard of"], "no task has such a name"),
        ([str(ROOT), str(ROOT), "--rounds", "0"], "--rounds"),
    ],
)
def test_what_cannot_be_compared_is_told(words, told, capsys):
    with pytest.raises(SystemExit) as ended:
        compare.main(words)
    assert ended.value.code == 2 and told in capsys.readouterr().err


def test_each_version_is_measured_with_the_code_of_the_new_one(tmp_path, capsys):
    """The old version here lacks what a task needs, and the measuring code too."""
    old = tmp_path / "before"
    shutil.copytree(ROOT / "pcsg", old / "pcsg", ignore=shutil.ignore_patterns("__pycache__"))
    (old / "pcsg" / "treemesh" / "__init__.py").unlink()
    (old / "pcsg" / "treemesh").rename(old / "pcsg" / "gone")
    arguments = [str(old), str(ROOT), "--rounds", "1", "--tasks", "start", "--row", "1000"]
    compare.main([*arguments, "--mean", "1000"])
    assert "| start, pcsg --help | " in capsys.readouterr().out
    folder = tmp_path / "sides"
    folder.mkdir()
    told = Side("old", str(old), folder).measure(ROOT, ["mesh of a tree"])
    assert "No module named 'pcsg.treemesh'" in told["mesh of a tree"]


def test_tasks_are_timed_without_their_preparation():
    clock = iter(range(100))
    task = tasks.Task(lambda: lambda: None, lambda: float(next(clock)))
    assert tasks.seconds(task, 1e-9) == 1.0
    assert tasks.seconds(tasks.Task(lambda: lambda: 0.25, None), 1e-9) == 0.25
