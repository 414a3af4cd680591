"""The process that makes pictures, without being one: what it says to wishes and messages."""

import pytest

from pcsg.view.inbox import Message
from pcsg.view.opening import Limits
from pcsg.view.wants import SheetWant, Want
from pcsg.view.worker import Picture, Worker, show_count

SMALL = Want(size=(16, 12), samples=1)
TREE = '{"species": "small", "ymax": 3, "trunk_scale": 2.0, "curves": {}}'


class Box:
    superseded = False

    def begin_glance(self):
        pass

    end_glance = begin_glance


@pytest.fixture
def make(tmp_path):
    def worker(text, name="a.pcsg"):
        (tmp_path / name).write_text(text)
        said = []
        made = Worker(said.append, tmp_path / name, Limits())
        made.inbox, made.said, made.file = Box(), said, tmp_path / name
        return made

    return worker


def kinds(worker):
    found = [m.head["type"] if isinstance(m, Picture) else m["type"] for m in worker.said]
    worker.said.clear()
    return found


def test_a_wish_is_shown_once(make):
    worker = make("sphere\n")
    worker.show(SMALL)
    said = kinds(worker)
    assert said[-2:] == ["frame", "counts"]
    assert "scene" in said
    worker.show(SMALL)
    assert kinds(worker) == []


def test_a_wrong_text_keeps_the_picture_and_is_told_once(make):
    worker = make("sphere\n")
    worker.show(SMALL)
    kinds(worker)
    worker.file.write_text("sphera\n")
    worker.answer([Message("reload")])
    worker.show(SMALL)
    assert kinds(worker) == ["preparing", "errors"]
    worker.show(Want(size=(16, 12), samples=1, camera={"eye": (5, 0, 0), "target": (0, 0, 0)}))
    assert set(kinds(worker)) == {"frame"}


def test_wrong_values_keep_the_picture_too(make):
    worker = make("{n = 1} uscale(n) sphere\n")
    worker.show(SMALL)
    kinds(worker)
    worker.show(Want(size=(16, 12), samples=1, values={"n": 0.0}))
    assert "errors" in kinds(worker)
    worker.show(Want(size=(16, 12), samples=1, values={"m": 1.0}))
    assert "errors" in kinds(worker)
    worker.show(Want(size=(16, 12), samples=1, values={"n": 2.0}))
    assert "scene" in kinds(worker)


def test_a_sheet_has_a_picture_or_a_word_for_every_value(make):
    worker = make("{n = 1} uscale(n) sphere\n")
    worker.show(SMALL)
    worker.said.clear()
    worker.answer([Message("sheet", SheetWant(SMALL, "n", (1.0, 0.0, 2.0)))])
    first, second, third = worker.said
    assert (first.place, third.place) == ("tile 0", "tile 2")
    assert "no inverse" in second["error"]


def test_a_draft_of_a_species_is_shown_and_not_watched(make):
    worker = make(TREE, "small.json")
    want = Want(size=(16, 12), samples=1, values={"t": 1.6})
    worker.show(want)
    worker.said.clear()
    draft = worker.file.with_name("draft.json")
    draft.write_text(TREE.replace('"ymax": 3', '"ymax": 5'))
    worker.answer([Message("draft", str(draft))])
    worker.show(want)
    (scene,) = [m for m in worker.said if not isinstance(m, Picture) and m["type"] == "scene"]
    assert scene["controls"]["t"]["high"] == 5
    assert scene["files"] == [str(worker.file)]
    worker.answer([Message("reload")])
    worker.show(want)
    scenes = [m for m in worker.said if not isinstance(m, Picture) and m["type"] == "scene"]
    assert scenes[-1]["controls"]["t"]["high"] == 3


def test_large_numbers_are_short():
    assert show_count(1_234_567) == "1,234,567"
    assert show_count(4**40) == "1.21e+24"
