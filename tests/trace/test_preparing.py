"""Long preparation: it tells how far it is, asks before it takes memory, and can be interrupted."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import pcsg
from pcsg.cli import app
from pcsg.commands import progress, render, scenes, stats
from pcsg.errors import EnvironmentFault
from pcsg.render.job import Job
from pcsg.trace.expand.partial import PartialExpansion
from pcsg.trace.pool import make_pool
from pcsg.trace.preparing import Preparation, watched

BALLS = """
{a = 0; n = 150000} HALF
HALF if(n > 1, 2, 1)
1: HALF -> move(100*rand(a,1), 100*rand(a,2), 100*rand(a,3)) uscale(0.5) sphere
2: HALF -> {n = floor(n/2)} HALF | {a = a + floor(n/2); n = n - floor(n/2)} HALF
"""


def test_preparation_tells_its_share() -> None:
    told: list[float | None] = []
    with watched(told.append):
        scene = pcsg.loads(BALLS)
        table = len(told)
        scene.occluded([[0.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]])
    shares = [share for share in told if share is not None]
    assert len(told) > 10 and 0 < table < len(told)
    assert shares == sorted(shares) and shares[0] >= 0.0 and shares[-1] <= 1.0
    assert sum(share > 0.4 for share in shares) > 5 and shares[-1] > 0.9


def test_preparation_of_suspended_states_tells_its_share_and_asks_for_memory() -> None:
    told: list[float | None] = []
    grammar = Path(__file__).parents[2] / "grammars" / "terrain.pcsg"
    with watched(told.append):
        scene = pcsg.load(grammar, parameters={"cnt": 12.0}, block_memory=8 << 20)
        table = len(told)
        assert scene.tracer.counts["suspended"] > 1_000  # type: ignore[union-attr]
    shares = [share for share in told if share is not None]
    assert 0 < table < len(told)
    assert shares == sorted(shares) and shares[0] >= 0.0 and shares[-1] > 0.5
    with pytest.raises(EnvironmentFault, match="only"):
        PartialExpansion(
            scene.graph,
            scene.values,
            make_pool(scene.graph),
            64 << 20,
            Preparation(max_bytes=1 << 20),
        )


def test_nobody_else_is_told() -> None:
    told: list[float | None] = []
    with watched(told.append):
        other = threading.Thread(target=lambda: Preparation().tell(0.5))
        other.start()
        other.join()
    Preparation().tell(0.5)
    assert told == []


def test_parts_of_a_preparation_follow_each_other() -> None:
    told: list[float | None] = []
    with watched(told.append):
        Preparation(begin=0.4, end=0.8).tell(0.5)
        Preparation(begin=0.4, end=0.8).tell(7.0)
        Preparation().tell(None)
    assert told == pytest.approx([0.6, 0.8, None])


@pytest.mark.parametrize("memory", [1 << 20, 30 << 20])
def test_memory_is_asked_for_before_it_is_taken(memory: int) -> None:
    """The table does not fit, or what is laid out from it."""
    with pytest.raises(EnvironmentFault, match=r"<text>: its preparation needs .* only .* MB"):
        pcsg.loads(BALLS, max_memory=memory).intersect([[0, 0, -9]], [[0, 0, 1.0]])


def test_less_memory_suffices_on_demand() -> None:
    scene = pcsg.loads(BALLS, max_memory=30 << 20, block_memory=4 << 20)
    assert scene.intersect([[50.0, 50.0, -9.0]], [[0.0, 0.0, 1.0]]).t.shape == (1,)


def test_a_bar_appears_for_what_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    moved: list[tuple[int, int]] = []

    @contextmanager
    def show(text: str, quiet: bool) -> Iterator[Callable[[int, int], None]]:
        assert text == "preparing balls.pcsg" and not quiet
        yield lambda done, total: moved.append((done, total))

    terminal = StringIO()
    terminal.isatty = lambda: True  # type: ignore[method-assign]
    monkeypatch.setattr(progress.sys, "stderr", terminal)
    monkeypatch.setattr(progress, "show_share", show)
    for patience, quiet in ((1e9, False), (0.0, True)):
        monkeypatch.setattr(progress, "PATIENCE", patience)
        with progress.show_preparation("balls.pcsg", quiet):
            Preparation().tell(0.5)
    assert moved == []
    with progress.show_preparation("balls.pcsg", False):
        Preparation().tell(None)
        Preparation().tell(0.5)
        Preparation().tell(1.0)
    assert moved == [(500, 1000), (1000, 1000)]


@pytest.mark.parametrize("verb", ["render", "stats"])
def test_commands_show_the_preparation(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ball.pcsg").write_text("sphere")
    monkeypatch.chdir(tmp_path)
    shown: list[str] = []

    @contextmanager
    def show(name: str, quiet: bool) -> Iterator[None]:
        shown.append(name)
        yield

    for module in (scenes, render, stats):
        monkeypatch.setattr(module, "show_preparation", show)
    options = ["--size", "4x4", "--samples", "1"] if verb == "render" else []
    assert CliRunner().invoke(app, [verb, "ball.pcsg", *options]).exit_code == 0
    assert shown == ["ball.pcsg", "ball.pcsg"]


def test_a_picture_that_lacks_memory_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ball.pcsg").write_text("sphere")
    monkeypatch.chdir(tmp_path)
    passes = []

    def take(job: Job, *rest: Any) -> None:
        if passes:
            raise EnvironmentFault("a ray needs more")
        passes.append(1)
        run_pass(job, *rest)

    run_pass = Job._run_pass
    monkeypatch.setattr(Job, "_run_pass", take)
    ended = CliRunner().invoke(app, ["render", "ball.pcsg", "--size", "16x16"])
    assert ended.exit_code == 1 and "a ray needs more" in ended.output
    assert "--resume" in ended.output and (tmp_path / "ball.png").exists()
    monkeypatch.setattr(Job, "_run_pass", run_pass)
    again = CliRunner().invoke(app, ["render", "ball.pcsg", "--size", "16x16", "--resume"])
    assert again.exit_code == 0 and "going on" in again.output
