"""The server: files of the page by HTTP, everything else over one WebSocket for each window."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from functools import cache, cached_property
from http import HTTPStatus
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from pcsg.errors import EnvironmentFault
from pcsg.grammar.preprocess import MAX_BYTES
from pcsg.grammar.tokens import LOOPS, words
from pcsg.graph.settings import SETTINGS
from pcsg.view.access import HEADERS, SECONDS_FOR_TOKEN, Guard
from pcsg.view.assets import assets
from pcsg.view.document import Document
from pcsg.view.opening import Limits
from pcsg.view.session import Session
from pcsg.view.standby import Standby

MOST_WINDOWS = 8
"""Windows at a time: each has a process of its own."""

TICK = 0.15
"""Seconds between two looks at the files."""

NOT_KNOWN, TOO_MANY, ELSEWHERE = 4401, 4429, 4409
"""Why a socket is closed, in the words of the protocol."""


@dataclass
class Viewer:
    """What is served: a file, to whom, and the windows that look at it.

    Attributes
    ----------
    name
        Of the file, as it was typed.
    values
        Of parameters, at first.
    """

    document: Document
    limits: Limits
    guard: Guard
    name: str
    values: Mapping[str, float] = field(default_factory=dict)
    windows: dict[str, Session] = field(default_factory=dict)
    sockets: dict[str, ServerConnection] = field(default_factory=dict)

    @cached_property
    def standby(self) -> Standby:
        """The process that waits for the next window."""
        return Standby(self.document.path, self.limits, self.values)

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a plain request; None lets a socket be opened."""
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        if len(hosts) > 1 or len(origins) > 1:
            return _respond(HTTPStatus.BAD_REQUEST, "a header stands twice")
        why = self.guard.refuses(next(iter(hosts), None), next(iter(origins), None))
        if why is not None:
            return _respond(HTTPStatus.FORBIDDEN, why)
        path = request.path.partition("?")[0]
        if path == "/ws":
            if request.headers.get("Upgrade", "").lower() != "websocket" or not origins:
                return _respond(HTTPStatus.FORBIDDEN, "this is for the page only")
            return None
        asset = assets().get(path)
        if asset is None:
            return _respond(HTTPStatus.NOT_FOUND, "there is nothing here")
        return _respond(HTTPStatus.OK, asset.content, asset.kind)

    async def attend(self, socket: ServerConnection) -> None:
        """Serve one window as long as its socket is open."""
        window = await self._greet(socket)
        if window is None:
            return
        if window not in self.windows:
            self.windows[window] = Session(self.document, self.limits, self.standby.start)
        session = self.windows[window]
        before = self.sockets.get(window)
        self.sockets[window] = socket
        if before is not None:
            await before.close(ELSEWHERE, "this window was opened again")
        session.outgoing.clear()
        session.outgoing.say(
            {"type": "welcome", "values": self.values, "file": self.name, "words": _words()}
        )
        session.arrive()
        sender = asyncio.create_task(session.outgoing.pass_on(socket))
        try:
            async for message in socket:
                session.hear(read_message(message))
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
                await sender
            if self.sockets.get(window) is socket:
                del self.sockets[window]
                session.leave()

    async def _greet(self, socket: ServerConnection) -> str | None:
        """Hear the first message; return the window's name, None for who has no business here."""
        try:
            first = read_message(await asyncio.wait_for(socket.recv(), SECONDS_FOR_TOKEN))
        except (TimeoutError, ConnectionClosed):
            await socket.close(NOT_KNOWN, "no token")
            return None
        if not self.guard.knows(first.get("token")):
            await socket.close(NOT_KNOWN, "the token is wrong")
            return None
        window = str(first.get("window", ""))[:64]
        if window not in self.windows and len(self.windows) >= MOST_WINDOWS:
            self._forget(lambda session: session.is_gone)
        if window not in self.windows and len(self.windows) >= MOST_WINDOWS:
            await socket.close(TOO_MANY, f"there are {MOST_WINDOWS} windows already")
            return None
        return window

    async def watch(self) -> None:
        """Look after files and processes, for ever."""
        while True:
            await asyncio.sleep(TICK)
            self._forget(lambda session: session.is_forgotten)
            for session in list(self.windows.values()):
                session.tick()
            self.standby.tick()

    def _forget(self, done: Callable[[Session], bool]) -> None:
        for window, session in list(self.windows.items()):
            if done(session):
                session.end()
                del self.windows[window]

    def end(self) -> None:
        """End all processes."""
        self.standby.end()
        for session in self.windows.values():
            session.end()


@cache
def _words() -> list[str]:
    """Return the words of the language, which are coloured in the text."""
    return sorted({*words(), *SETTINGS, *LOOPS})


def _respond(
    status: HTTPStatus, content: str | bytes, kind: str = "text/plain; charset=utf-8"
) -> Response:
    body = content.encode() + b"\n" if isinstance(content, str) else content
    headers = Headers([*HEADERS, ("Content-Type", kind), ("Content-Length", str(len(body)))])
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, body)


def read_message(message: str | bytes) -> dict[str, Any]:
    """Return a message of a page; what is none says nothing."""
    try:
        found = json.loads(message)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


async def run(viewer: Viewer, port: int, ready: Callable[[int], None], ssl: Any = None) -> None:
    """Serve until the task is cancelled.

    Parameters
    ----------
    port
        0 for any that is free.
    ready
        Called with the port once the server listens.
    ssl
        The context of a certificate, if there is one.

    Raises
    ------
    EnvironmentFault
        The port is taken, or the address is not this machine's.
    """
    async with contextlib.AsyncExitStack() as stack:
        try:
            server = await stack.enter_async_context(_listen(viewer, port, ssl))
        except OSError as error:
            raise EnvironmentFault(
                f"cannot listen at {viewer.guard.host}, port {port}: {error.strerror or error}"
            ) from None
        assert viewer.standby is not None  # it starts now
        ready(next(iter(server.sockets)).getsockname()[1])
        try:
            await viewer.watch()
        finally:
            viewer.end()


def _listen(viewer: Viewer, port: int, ssl: Any) -> AbstractAsyncContextManager[Server]:
    return serve(
        viewer.attend,
        viewer.guard.host,
        port,
        ssl=ssl,
        process_request=viewer.answer,
        max_size=2 * MAX_BYTES,
        compression=None,
        ping_interval=20,
        ping_timeout=40,
        server_header=None,
    )
