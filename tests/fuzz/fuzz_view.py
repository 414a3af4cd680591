"""Messages of a page of `pcsg view`, spoilt: nothing but words of trouble comes of them."""

from __future__ import annotations

import asyncio
import json
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from driver import Subject
from mutations import NUMBERS, spoil_text

from pcsg.errors import PcsgError
from pcsg.view.access import Guard
from pcsg.view.document import Document
from pcsg.view.opening import Limits
from pcsg.view.server import read_message
from pcsg.view.session import Session
from pcsg.view.wants import Want, read_want

TEXT = "{n = 2} sphere\n"
CAMERA = {"eye": [1, 2, 3], "target": [0, 0, 0.5], "up": [0, 0, 1], "fov": 20, "height": None}
WANT = {
    "type": "want",
    "values": {"n": 3, "SEED": 7},
    "camera": CAMERA,
    "size": [320, 200],
    "moving": True,
    "mode": "path",
    "layer": "depth",
    "samples": 64,
    "number": 5,
}
MESSAGES: tuple[dict[str, Any], ...] = (
    WANT,
    {**WANT, "type": "ask", "x": 0.5, "y": 0.25},
    {**WANT, "type": "sheet", "name": "n", "steps": [1, 2.5, 3]},
    {"type": "save", "text": "box\n", "base": TEXT},
    {"type": "draft", "text": "{}"},
    {"type": "file"},
    {"type": "stop"},
    {"token": "abc", "window": "w"},
)
WORDS = ("{", "}", "[", "]", ",", ":", '"', "null", "true", '"type": ', "9" * 400, *NUMBERS)


class Silent:
    """A process that hears everything and says nothing."""

    memory = 0

    def __init__(self, *_: Any) -> None:
        pass

    def send(self, message: Any) -> None:
        if message.word == "want":
            assert isinstance(message.content, Want)

    def end(self) -> None:
        pass


def seeds() -> Sequence[str]:
    return [json.dumps(message) for message in MESSAGES]


def mutate(rng: random.Random, text: str) -> str:
    return spoil_text(rng, text, WORDS, most=3)


def run(text: str, folder: Path) -> None:
    file = folder / "a.json"
    file.write_text(TEXT, encoding="utf-8")
    message = read_message(text)
    assert not Guard("localhost").knows(message.get("token"))

    async def hear() -> None:
        session = Session(Document(file), Limits(), Silent)
        session.arrive()
        session.hear(message)
        session.end()

    asyncio.run(hear())
    try:
        want = read_want(message)
    except PcsgError:
        return
    assert want == read_want(json.loads(json.dumps(message)))


SUBJECT = Subject("view", seeds, mutate, run)
