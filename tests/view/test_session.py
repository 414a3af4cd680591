"""A window and its process, the process made up: it says what tests tell it to say."""

import asyncio
import json
from pathlib import Path

import numpy as np
import pytest
from made import Made

from pcsg.errors import EnvironmentFault
from pcsg.view import session as module
from pcsg.view.document import Document
from pcsg.view.opening import Limits
from pcsg.view.process import Ended
from pcsg.view.session import Session
from pcsg.view.worker import Picture

WANT = {"type": "want", "size": [32, 24]}


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def window(tmp_path, clock):
    async def make():
        made = []

        def start(*arguments):
            made.append(Made(*arguments))
            return made[-1]

        file = tmp_path / "a.pcsg"
        file.write_text("sphere\n")
        session = Session(Document(file), Limits(max_memory=1000), start)
        session.made, session.file = made, file
        session.arrive()
        return session

    return asyncio.run(make())


def told(session):
    said = [json.loads(text) for text in session.outgoing._words]
    session.outgoing._words.clear()
    return said


def test_a_window_is_told_the_text_and_gets_a_process(window):
    assert [m["type"] for m in told(window)] == ["text", "preparing"]
    window.hear(WANT)
    (process,) = window.made
    assert process.words() == ["want"]


def test_a_process_that_ends_is_replaced_when_something_is_wanted(window):
    window.hear(WANT)
    window.made[0].receive(Ended(-9))
    assert "want of memory" in told(window)[-1]["errors"][0]["text"]
    assert len(window.made) == 1
    window.hear(WANT)
    assert window.made[1].words() == ["want"]


def test_a_process_that_takes_too_much_memory_is_ended(window):
    window.made[0].memory = 1001
    window.tick()
    assert window.made[0].ended
    (error,) = told(window)[-1]["errors"]
    assert "more than 1 KB of memory" in error["text"]


def test_a_busy_process_gives_way_to_a_saved_file(window, clock):
    window.hear(WANT)
    window.made[0].receive({"type": "taken"})
    window.file.write_text("box\n")
    window.tick()
    clock[0] += 0.4
    window.tick()
    assert not window.made[0].ended
    clock[0] += 0.2
    window.tick()
    assert window.made[0].ended
    assert window.made[1].words() == ["want"]


def test_a_process_that_starts_or_compiles_is_waited_for(window, clock):
    window.hear(WANT)
    clock[0] += 60.0
    window.tick()
    assert not window.made[0].ended
    window.made[0].receive({"type": "taken"})
    window.made[0].receive({"type": "preparing", "share": None, "compiling": True})
    window.hear(WANT)
    clock[0] += 60.0
    window.tick()
    assert not window.made[0].ended


def test_a_wish_that_waits_for_long_ends_what_is_done(window, clock):
    window.hear(WANT)
    window.made[0].receive({"type": "taken"})
    window.hear(WANT)
    clock[0] += 2.0
    window.tick()
    assert not window.made[0].ended
    clock[0] += 2.0
    window.tick()
    assert window.made[0].ended


def test_stop_ends_the_process_and_the_next_wish_starts_another(window):
    window.hear({"type": "stop"})
    assert window.made[0].ended
    assert "stopped" in told(window)[-1]["errors"][0]["text"]
    window.hear(WANT)
    assert len(window.made) == 2


def test_a_window_that_comes_back_finds_its_process(window, clock):
    window.hear(WANT)
    window.leave()
    assert window.is_gone
    assert not window.is_forgotten
    clock[0] += 60.0
    window.arrive()
    assert window.made[0].words() == ["want", "rest", "again"]
    window.leave()
    clock[0] += 601.0
    assert window.is_forgotten
    window.end()
    assert window.made[0].ended


def test_of_pictures_the_newest_is_kept_and_words_are_all(window):
    told(window)
    depth = np.zeros((2, 2), np.float32)
    for k in range(3):
        window.made[0].receive(Picture({"type": "frame", "number": k}, depth, b"data"))
        window.made[0].receive({"type": "preparing", "share": k / 3})
    assert [m["share"] for m in told(window)] == [0.0, 1 / 3, 2 / 3]
    (picture,) = window.outgoing._pictures.values()
    assert b'"number": 2' in picture
    assert picture.endswith(b"data")


def test_saving_reloads_and_a_refusal_keeps_the_text(window, monkeypatch):
    window.hear(WANT)
    window.hear({"type": "save", "text": "box\n", "base": "sphere\n"})
    assert window.file.read_text() == "box\n"
    assert told(window)[-1] == {"type": "saved", "text": "box\n"}
    assert window.made[0].words() == ["want", "reload", "want"]
    window.tick()
    assert window.made[0].words() == ["want", "reload", "want"]

    def refuse(path, write):
        raise EnvironmentFault(f"cannot write {path}: No space left on device")

    monkeypatch.setattr("pcsg.view.document.write_whole", refuse)
    window.hear({"type": "save", "text": "cone\n", "base": "box\n"})
    said = told(window)[-1]
    assert said["type"] == "unsaved"
    assert "No space left" in said["errors"][0]["text"]


def test_a_removed_file_is_told_and_comes_back(window):
    told(window)
    window.file.unlink()
    window.tick()
    said = told(window)[0]
    assert said["text"] is None
    assert "no such file" in said["trouble"]
    window.file.write_text("box\n")
    window.tick()
    assert told(window)[0]["text"] == "box\n"


def test_a_draft_of_a_species_is_kept_beside_and_goes_with_the_window(tmp_path):
    async def make():
        return Session(Document(tmp_path / "a.json"), Limits(), Made)

    session = asyncio.run(make())
    session.hear(WANT)
    session.hear({"type": "draft", "text": "{}"})
    process = session._process
    path = Path(process.heard[-1].content)
    assert process.words()[-1] == "draft"
    assert path.name == "a.json"
    assert path.read_text() == "{}"
    session.end()
    assert not path.exists()


@pytest.mark.parametrize(
    "message",
    [
        {},
        {"type": 3},
        {"type": "want"},
        {"type": "save"},
        {"type": "ask"},
        {"type": "save", "text": 1},
    ],
)
def test_messages_without_sense_do_no_harm(window, message):
    window.hear(message)
    assert all(m["type"] in ("text", "preparing", "trouble") for m in told(window))
