import numpy as np
import pytest
from made import Made

from pcsg.view import standby as module
from pcsg.view.opening import Limits
from pcsg.view.process import Ended
from pcsg.view.standby import Standby
from pcsg.view.worker import Picture


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def waiting(tmp_path, clock):
    made = []

    def launch(*arguments):
        made.append(Made(*arguments))
        return made[-1]

    path = tmp_path / "a.pcsg"
    path.write_text("sphere\n")
    found = Standby(path, Limits(max_memory=1000), {"n": 3.0}, launch)
    found.made, found.path = made, path
    return found


def done():
    return Picture({"type": "frame", "done": True}, np.zeros((1, 1), np.float32), b"")


def take(waiting):
    heard = []
    return waiting.start(waiting.path, Limits(), heard.append), heard


def test_the_first_window_gets_the_process_that_has_the_scene(waiting):
    first = waiting.made[0]
    assert first.words() == ["want"]
    first.receive({"type": "ready"})
    first.receive(done())
    process, heard = take(waiting)
    assert process is first
    assert first.words() == ["want", "again"]
    first.receive("something")
    assert heard == ["something"]


def test_one_that_is_not_ready_is_not_waited_for(waiting):
    waiting.made[0].receive({"type": "ready"})
    process, _ = take(waiting)
    assert waiting.made[0].ended
    assert process is waiting.made[1]
    assert process.words() == []


def test_the_next_one_reads_no_grammar_and_is_told_what_has_changed(waiting, clock):
    waiting.made[0].receive(done())
    take(waiting)
    waiting.tick()
    assert len(waiting.made) == 1
    clock[0] += 3.0
    waiting.tick()
    second = waiting.made[1]
    assert second.words() == []
    second.receive({"type": "ready"})
    waiting.path.write_text("a box, now\n")
    assert take(waiting)[0] is second
    assert second.words() == ["reload", "again"]


def test_one_that_has_ended_is_replaced(waiting, clock):
    waiting.made[0].receive(Ended(-9))
    assert take(waiting)[0] is waiting.made[1]


@pytest.mark.parametrize("memory", [0, 2000])
def test_an_endless_or_greedy_grammar_does_not_go_on_behind_everybodys_back(waiting, clock, memory):
    waiting.made[0].memory = memory
    clock[0] += 130.0
    waiting.tick()
    assert waiting.made[0].ended
    clock[0] += 10.0
    waiting.tick()
    assert len(waiting.made) == 1
