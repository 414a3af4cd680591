"""The tables of the benchmarks come out, with tiny sizes and with peers that are missing."""

from __future__ import annotations

import builtins
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks import __main__ as command  # noqa: E402 - not installed with the package
from benchmarks import report  # noqa: E402
from benchmarks.meshes import expand, solids, terrain  # noqa: E402
from benchmarks.report import Row, Subject, lines_of  # noqa: E402
from benchmarks.results import merge  # noqa: E402
from benchmarks.scenes import SCENES  # noqa: E402


@pytest.fixture
def alone(monkeypatch):
    """As if no peer were installed."""
    real = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name.partition(".")[0] in {"embreex", "mitsuba", "drjit"}:
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    monkeypatch.setenv("PATH", "")


@pytest.mark.parametrize("subject", [s.name for s in command.SUBJECTS if s.name != "start"])
def test_every_subject_makes_its_table_without_peers(alone, capsys, subject):
    command.main([subject, "--tiny"])
    told = capsys.readouterr().out
    rows = [line for line in told.splitlines() if line.startswith("| ")]
    heads = [line for line in rows if line.startswith("| what |")]
    assert len(heads) == 1 and len(rows) > 2
    assert len({line.count("|") for line in rows}) == 1


def test_results_are_written_with_the_machine(alone, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(command, "RESULTS", tmp_path / "RESULTS.md")
    command.main(["any", "--tiny", "--write"])
    text = (tmp_path / "RESULTS.md").read_text(encoding="utf-8")
    assert report.processor_name() in text and "Sierpinski 4, random" in text
    table = text[text.index("| what") : text.rindex("|")]
    assert table in capsys.readouterr().out


def test_new_results_take_the_place_of_old_ones_of_the_same_machine():
    head = ["# Results", "", "- this machine", ""]
    first = merge("", head, head[2], {"A": "## A\n\n1\n", "B": "", "C": "## C\n\n3\n"})
    assert first == "# Results\n\n- this machine\n\n## A\n\n1\n\n## C\n\n3\n"
    second = merge(first, head, head[2], {"A": "", "B": "## B\n\n2", "C": "## C\n\n4"})
    assert second == first.replace("## C", "## B\n\n2\n\n## C").replace("3", "4")
    other = ["# Results", "", "- another", ""]
    assert merge(first, other, other[2], {"A": "", "B": "## B\n\n2", "C": ""}) == (
        "# Results\n\n- another\n\n## B\n\n2\n"
    )


def test_an_unknown_subject_is_refused(capsys):
    with pytest.raises(SystemExit):
        command.main(["speed"])
    assert "no subject speed" in capsys.readouterr().err


def test_rows_are_held_against_their_targets():
    rows = [
        Row("fast", (1234.5, None), 1.5, 1.2),
        Row("slow", (0.123456, "x"), 1.1, 1.2),
        Row("small", (1, 2), 1.1, 1.2, at_most=True),
        Row("missing", (1, 2), None, 1.2),
        Row("told", (1, 2)),
    ]
    subject = Subject("s", "S", "Note.", ("a", "b"), lambda effort: iter(rows))
    shown = [line for line in lines_of(subject, report.Effort()) if line.startswith("| ")][2:]
    assert shown == [
        "| fast | 1,234 | - | 1.5 | >= 1.2 | yes |",
        "| slow | 0.123 | x | 1.1 | >= 1.2 | **no** |",
        "| small | 1 | 2 | 1.1 | <= 1.2 | yes |",
        "| missing | 1 | 2 | - | >= 1.2 | - |",
        "| told | 1 | 2 | - |  |  |",
    ]


@pytest.mark.parametrize(("name", "make"), [("Sierpinski 4", solids), ("terrain 3", terrain)])
def test_triangles_are_those_of_the_scene(name, make):
    scene = SCENES[name].load()
    mesh = make(scene)
    assert len(mesh.faces) == {"Sierpinski 4": 4**5, "terrain 3": 2 * 4**3}[name]
    # Rays at the middles of triangles meet them, or what stands before them.
    middles = mesh.corners[mesh.faces].mean(axis=1)
    eye = np.array([3.0, -4.0, 5.0])
    t = scene.intersect(eye, middles - eye).t
    assert (t <= 1 + 1e-9).all()
    assert (np.abs(t - 1) < 1e-9).sum() > 20


def test_every_primitive_is_expanded():
    scene = SCENES["fig 5a limbs"].load()
    assert sum(len(p.matrices) for p in expand(scene.states)) == scene.stats()["primitives"]
