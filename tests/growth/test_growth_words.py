"""Growing trees in grammars, in Python and on the command line."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import pcsg
from pcsg.cli import app
from pcsg.commands.grow import Film, _script
from pcsg.errors import GrammarError, UsageError
from pcsg.growth.model import GrowthModel
from pcsg.growth.species import Species


def look_at(scene: pcsg.Scene, n: int = 40) -> pcsg.Hits:
    lower, upper = scene.bounds
    x = np.linspace(lower[0], upper[0], n)
    z = np.linspace(0.05, upper[2], n)
    origins = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
    origins = np.column_stack([origins[:, 0], np.full(len(origins), lower[1] - 1.0), origins[:, 1]])
    return scene.intersect(origins, np.tile([0.0, 1.0, 0.0], (len(origins), 1)))


def test_a_tree_is_its_wood_and_its_leaves() -> None:
    whole = pcsg.loads('tree("populus", 3.66)')
    parts = pcsg.loads('tree_wood("populus", 3.66) | tree_leaves("populus", 3.66)')
    a, b = look_at(whole), look_at(parts)
    assert a.mask.sum() > 20
    assert (a.t == b.t).all() and (a.color == b.color).all()
    python = look_at(pcsg.Scene(pcsg.tree("populus", 3.66)))
    assert (python.t == a.t).all()


def test_a_grammar_passes_the_time() -> None:
    text = """{t = 2} G
G if(t < 6, 1, 2)
1: G -> tree("populus", t) | {t = t+2} move(3,0,0) G
2: G -> empty
"""
    scene = pcsg.loads(text)
    assert scene.bounds[1, 0] > 3.0
    assert look_at(scene).mask.any()
    again = pcsg.loads(scene.to_pcsg())
    assert (look_at(again).t == look_at(scene).t).all()


def test_seeds_make_other_trees() -> None:
    one, two = (pcsg.loads(f'tree_wood("populus", 5, {s})') for s in (1, 2))
    assert not np.array_equal(look_at(one).t, look_at(two).t)
    own = pcsg.loads('tree_wood("populus", 5)')
    assert np.array_equal(look_at(own).t, look_at(one).t)


def test_a_day_stands_for_the_part_of_the_year() -> None:
    day, part = (pcsg.loads(f'tree("populus", {a})') for a in ("5, 0, 219", "5.6"))
    assert np.array_equal(look_at(day).t, look_at(part).t)
    late = pcsg.loads('tree("populus", 5.9, 0, 219)')
    assert np.array_equal(look_at(late).t, look_at(part).t)
    with pytest.raises(GrammarError, match="day"):
        pcsg.loads('tree("populus", 5, 0, 366)')


def test_trees_without_leaves_are_told(tmp_path: Path) -> None:
    told = pcsg.loads('tree("populus", 3)').stats()["notes"]
    assert len(told) == 1
    assert told[0].startswith("populus: no leaves at t = 3: whole years are midwinter")
    when = told[0].split("t = ")[2].split(",")[0]
    assert len(GrowthModel.load("populus").at(float(when)).leaves.size) > 20
    assert "it is winter" in pcsg.loads('tree("populus", 3.1)').stats()["notes"][0]
    # At the end of its life the last summer is told, which can be asked for.
    assert "t = 26.7" in pcsg.loads('tree_leaves("populus", 27)').stats()["notes"][0]
    for leafy in ('tree("populus", 3.6)', 'tree_wood("populus", 3)', 'tree("spruce", 3)'):
        assert "notes" not in pcsg.loads(leafy).stats()
    done = CliRunner().invoke(
        app,
        [
            "grow",
            "frame",
            "populus",
            "--t",
            "1",
            "--size",
            "8x8",
            "--samples",
            "1",
            "-o",
            str(tmp_path / "x.png"),
        ],
    )
    assert done.exit_code == 0 and "no leaves at t = 1: whole years are midwinter" in done.output


def test_a_file_beside_the_grammar(tmp_path: Path) -> None:
    (tmp_path / "mine.json").write_text(Species(ymax=5, seed=4).to_json())
    (tmp_path / "a.pcsg").write_text('tree("mine.json", 4.7)')
    assert look_at(pcsg.load(tmp_path / "a.pcsg")).mask.any()
    (tmp_path / "mine.json").write_text('{"ymax": "five", "species": 3}')
    with pytest.raises(GrammarError, match="this cannot be `ymax`, and 1 more") as caught:
        pcsg.load(tmp_path / "a.pcsg")
    assert len(caught.value.diagnostics) == 1  # one line about the other file, not its excerpts
    assert "\n" not in caught.value.diagnostics[0].message


def test_a_species_is_shown_as_a_grammar_and_its_mistakes_in_itself(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_text(Species(ymax=4).to_json())
    assert look_at(pcsg.load(file, t=3.7)).mask.any()
    file.write_text('{"species": "x",\n "ymax": 0, "zeta": 1}')
    with pytest.raises(GrammarError) as caught:
        pcsg.load(file)
    places = [str(d.span) for d in caught.value.diagnostics]
    assert places == [f"{file}:2:10", f"{file}:2:13"]


def test_mistakes_are_told() -> None:
    with pytest.raises(GrammarError, match="did you mean `populus`"):
        pcsg.loads('tree("populs", 3)')
    with pytest.raises(GrammarError, match="takes"):
        pcsg.loads('tree("populus")')
    with pytest.raises((GrammarError, UsageError), match="27"):
        look_at(pcsg.loads('tree("populus", 30)'))


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str, status: int = 0):
        result = CliRunner().invoke(app, list(arguments))
        assert result.exit_code == status, result.output
        return result

    return call


def test_counts(run) -> None:
    told = run("grow", "counts", "populus").stdout
    assert "181,864" in told and "22,120" in told
    (row,) = json.loads(run("grow", "counts", "populus", "--year", "12", "--json").stdout)
    assert row["primitives"] == 14_209
    run("grow", "counts", "populus", "--year", "99", status=2)


def test_plots_and_views(run, tmp_path: Path) -> None:
    from PIL import Image

    run("grow", "plot", "spruce", "-o", "a.png")
    run("grow", "view", "birch", "--once", "-o", "b.png")
    with Image.open(tmp_path / "a.png") as a, Image.open(tmp_path / "b.png") as b:
        assert a.size[1] == b.size[1] and b.size[0] > a.size[0]
    run("grow", "plot", "populus", "-o", "a.jpg", status=2)


def test_exports(run, tmp_path: Path) -> None:
    run("grow", "export", "populus", "--t", "3", "-o", "tree.swc")
    run("mesh", "tree.swc", "-o", "tree.obj")
    run("mesh", "populus", "-D", "t=3", "-o", "same.obj")
    assert (tmp_path / "same.obj").stat().st_size > 10_000
    run("grow", "export", "populus", "-o", "mine.json")
    run("skeleton", "mine.json", "-D", "t=2.5", "-o", "skel.json")
    run("mesh", "populus", "-D", "age=3", "-o", "x.obj", status=2)


def test_frames_and_films(run, tmp_path: Path) -> None:
    from PIL import Image

    run(
        "grow", "frame", "populus", "--t", "2.6", "-o", "f.png", "--size", "60x72", "--samples", "1"
    )
    with Image.open(tmp_path / "f.png") as picture:
        assert picture.size == (60, 72)
    film = ("--size", "40x48", "--samples", "1", "--from", "1", "--to", "2", "-q")
    run("grow", "animate", "populus", "--frames-per-year", "3", "-o", "f.gif", *film)
    with Image.open(tmp_path / "f.gif") as moving:
        assert moving.n_frames == 3  # type: ignore[attr-defined]
    run("grow", "animate", "shoot", "-o", "s#.png", "--from", "0.4", "--to", "0.6",
        "--frames-per-year", "10", *film[:4])  # fmt: skip
    assert (tmp_path / "s0.png").exists() and (tmp_path / "s1.png").exists()
    run("grow", "frame", "populus", "--t", "40", status=2)
    for size in ("0x5", "5x0", "5"):
        assert (
            "--size" in run("grow", "frame", "populus", "--t", "2", "--size", size, status=2).output
        )
        run("grow", "animate", "shoot", "--size", size, status=2)
    run("grow", "frame", "populus", "--t", "2", "--seed", "-3", status=2)


def test_films_fit_the_tree_at_their_end() -> None:
    model = GrowthModel.load("populus")
    whole, young = (
        _script("populus", model, Film(None, last, None, 24.0, 0.0, None, False), 1.0)[0]
        for last in (None, 6.0)
    )
    distance = [float(np.hypot(*camera.eye[:2])) for camera in (whole, young)]
    assert distance[1] < 0.4 * distance[0]


def test_a_stopped_frame_goes_on_as_its_message_says(run, monkeypatch: pytest.MonkeyPatch) -> None:
    given = []
    monkeypatch.setattr("pcsg.commands.render.run", given.append)
    run("grow", "frame", "populus", "--t", "2.5", "-o", "a.png", "--resume", "--denoise")
    (arguments,) = given
    assert arguments.resume and arguments.denoise
    assert arguments.assignments == ["t=2.5"]


def test_successive_frames_differ_little(run, tmp_path: Path) -> None:
    from PIL import Image

    run("grow", "animate", "populus", "--from", "8.4", "--to", "8.7", "--frames-per-year", "24",
        "--size", "48x60", "--samples", "2", "-o", "f#.png", "-q")  # fmt: skip
    frames = []
    for path in sorted(tmp_path.glob("f*.png")):
        with Image.open(path) as picture:
            frames.append(np.asarray(picture.convert("RGB"), np.float64) / 255.0)
    change = [float(np.abs(a - b).mean()) for a, b in itertools.pairwise(frames)]
    assert len(change) == 6
    assert 0.0 < max(change) <= 0.03
    assert max(change) <= 4.0 * float(np.median(change)) + 0.002
