"""What is on its way to a page: words in order, and of the pictures the newest only."""

from __future__ import annotations

import asyncio
import json
import math
import struct
from collections import deque
from collections.abc import Mapping
from typing import Any, Protocol


class Socket(Protocol):
    """Where messages go."""

    async def send(self, message: str | bytes) -> None:
        """Send a message; returns when there is room for another one."""
        ...


class Outgoing:
    """Keeps what a page has not got yet. A slow one misses pictures, and gets the newest."""

    def __init__(self) -> None:
        self._words: deque[str] = deque()
        self._pictures: dict[str, bytes] = {}
        self._news = asyncio.Event()

    def say(self, message: Mapping[str, Any]) -> None:
        """Add words."""
        self._words.append(to_json(message))
        self._news.set()

    def show(self, head: Mapping[str, Any], depth: bytes, data: bytes, place: str) -> None:
        """Add a picture, in place of the one before that was for the same place of the page."""
        text = to_json(head).encode()
        packed = struct.pack("<II", len(text), len(depth)) + text + depth + data
        self._pictures[place] = packed
        self._news.set()

    def clear(self) -> None:
        """Forget all: nobody is there, or who comes is told everything anew."""
        self._words.clear()
        self._pictures.clear()

    async def pass_on(self, socket: Socket) -> None:
        """Send all that is there and will come, for ever."""
        while True:
            await self._news.wait()
            self._news.clear()
            while self._words or self._pictures:
                while self._words:
                    await socket.send(self._words.popleft())
                if self._pictures:
                    place = next(iter(self._pictures))
                    await socket.send(self._pictures.pop(place))


def to_json(message: Any) -> str:
    """Return JSON, with null for numbers that it lacks."""
    try:
        return json.dumps(message, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(message), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _finite(v) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
