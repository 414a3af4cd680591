"""One window: what it wants, the process that makes its pictures, and what is told to it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pcsg.errors import EnvironmentFault, PcsgError
from pcsg.memory import half_of_memory, show_bytes
from pcsg.view.document import Document, Watch
from pcsg.view.inbox import Message
from pcsg.view.opening import Limits, describe_error
from pcsg.view.outgoing import Outgoing
from pcsg.view.process import Ended, Process, tell_end, tell_memory
from pcsg.view.wants import Want, read_draft, read_question, read_sheet, read_want
from pcsg.view.worker import Picture

PATIENCE = 3.0
"""Seconds that a process may be busy while something newer waits."""

PATIENCE_AFTER_SAVE = 0.5
"""Likewise where the file has changed."""

PATIENCE_COMPILING = 120.0
"""Likewise while kernels are compiled, which are kept for all later times."""

FORGOTTEN = 600.0
"""Seconds after which the process of a window that is gone ends: lids are closed for longer."""


class Session:
    """A window, whether it is there at the moment or not.

    Parameters
    ----------
    document
        The file.
    limits
        What its scene may take.
    start
        Starts a process: `Process`, or a test's.
    """

    def __init__(
        self,
        document: Document,
        limits: Limits,
        start: Callable[..., Any] = Process,
    ) -> None:
        self._document, self._limits, self._start = document, limits, start
        self.outgoing = Outgoing()
        self._watch = Watch([document.path])
        self._process: Process | None = None
        self._want: Want | None = None
        self._is_ready = self._is_compiling = False
        self._waiting_since: float | None = None
        self._patience = PATIENCE
        self._gone_since: float | None = None
        self._text: str | None = None
        self._drafts: TemporaryDirectory[str] | None = None
        self._memory_limit = limits.max_memory or half_of_memory()

    # The window.

    def arrive(self) -> None:
        """The window is there, perhaps again: it is told everything."""
        self._gone_since = None
        self._tell_text()
        if self._process is None:
            self._begin()
        else:
            self._send(Message("again"))

    def leave(self) -> None:
        """The window is gone, perhaps for a moment."""
        self._gone_since = time.monotonic()
        self.outgoing.clear()
        if self._want is not None and self._process is not None:
            # Nobody looks: what is in the making is in vain.
            self._send(Message("rest"))

    @property
    def is_gone(self) -> bool:
        """Whether the window is not there at the moment."""
        return self._gone_since is not None

    @property
    def is_forgotten(self) -> bool:
        """Whether the window has been gone for so long that it will not come again."""
        return self._gone_since is not None and time.monotonic() - self._gone_since > FORGOTTEN

    def end(self) -> None:
        """End the process, and forget drafts."""
        self._end_process()
        if self._drafts is not None:
            self._drafts.cleanup()
            self._drafts = None

    def hear(self, message: Mapping[str, Any]) -> None:
        """Do what the window says."""
        word = message.get("type")
        try:
            if word == "want":
                self._wish(read_want(message))
            elif word == "save":
                self._save(message)
            elif word == "ask":
                self._send(Message("ask", read_question(message)))
            elif word == "sheet":
                self._send(Message("sheet", read_sheet(message)))
            elif word == "draft":
                self._show_draft(read_draft(message))
            elif word == "file":
                self._send(Message("file"))
            elif word == "stop":
                self._give_up("the picture was stopped; it starts again when something changes")
        except PcsgError as error:
            self.outgoing.say({"type": "trouble", "errors": describe_error(error)})

    def _wish(self, want: Want) -> None:
        self._want = want
        if self._process is None:
            self._begin()
        else:
            self._send(Message("want", want))

    def _save(self, message: Mapping[str, Any]) -> None:
        text, base = message.get("text"), message.get("base")
        if not isinstance(text, str) or not isinstance(base, str):
            return
        try:
            self._document.write(text, base)
        except PcsgError as error:
            self.outgoing.say({"type": "unsaved", "errors": describe_error(error)})
            return
        self._text = text
        self.outgoing.say({"type": "saved", "text": text})
        self._watch.changed()
        self._reload()

    def _show_draft(self, text: str) -> None:
        """Show a text that is not saved: of a species, which names no other files."""
        if self._document.path.suffix.lower() != ".json":
            return
        if self._drafts is None:
            self._drafts = TemporaryDirectory(prefix="pcsg-view-")
        draft = Path(self._drafts.name) / self._document.path.name
        try:
            draft.write_text(text, encoding="utf-8")
        except OSError as error:
            raise EnvironmentFault(f"cannot keep the draft: {error.strerror or error}") from None
        self._send(Message("draft", str(draft)))

    def _tell_text(self) -> None:
        name = self._document.path.name
        try:
            self._text = self._document.read().text
        except PcsgError as error:
            self._text = None
            self.outgoing.say({"type": "text", "name": name, "text": None, "trouble": str(error)})
            return
        shipped = self._document.shipped
        self.outgoing.say({"type": "text", "name": name, "text": self._text, "shipped": shipped})

    # The process.

    def _begin(self) -> None:
        """Start a process, which gets the newest wish."""
        self._is_ready = self._is_compiling = False
        self._waiting_since = None
        self.outgoing.say({"type": "preparing", "share": None})
        self._process = self._start(self._document.path, self._limits, self._receive)
        if self._want is not None:
            self._send(Message("want", self._want))

    def _end_process(self) -> None:
        if self._process is not None:
            self._process.end()
            self._process = None

    def _send(self, message: Message) -> None:
        if self._process is None:
            return
        self._process.send(message)
        if self._waiting_since is None:
            self._waiting_since = time.monotonic()
            self._patience = PATIENCE
        if message.word == "reload":
            self._patience = PATIENCE_AFTER_SAVE

    def _reload(self) -> None:
        """The file has changed."""
        if self._process is None:
            self._begin()
            return
        self._send(Message("reload"))
        if self._want is not None:
            self._send(Message("want", self._want))

    def _give_up(self, why: str) -> None:
        """End the process and say why; what the window wants next starts another."""
        self._end_process()
        self._tell_trouble(why)

    def _tell_trouble(self, why: str) -> None:
        entry = {"severity": "error", "message": why, "line": None, "text": why}
        self.outgoing.say({"type": "errors", "errors": [entry]})

    def _receive(self, said: Any) -> None:
        """Take what the process says."""
        if isinstance(said, Picture):
            if self._gone_since is None:
                self.outgoing.show(said.head, said.depth.tobytes(), said.data, said.place)
            return
        if isinstance(said, Ended):
            self._process = None
            self._tell_trouble(tell_end(said))
            return
        word = said["type"]
        if word == "ready":
            return
        if word == "taken":
            self._waiting_since, self._is_ready = None, True
            return
        if word in ("scene", "errors") and "files" in said:
            self._watch.follow([self._document.path, *said["files"]])
        self._is_compiling = said.get("compiling", False)
        if word == "counts" and self._process is not None:
            said = {**said, "memory": show_bytes(self._process.memory)}
        if self._gone_since is None:
            self.outgoing.say(said)

    def tick(self) -> None:
        """Look at the file and at the process; to be called several times in a second."""
        if self._watch.changed():
            if self._gone_since is None:
                self._tell_text_if_other(self._text)
            self._reload()
        if self._process is None:
            return
        if self._process.memory > self._memory_limit:
            self._give_up(tell_memory(self._memory_limit))
            return
        waited = 0.0
        if self._waiting_since is not None and self._is_ready:
            waited = time.monotonic() - self._waiting_since
        if waited > (PATIENCE_COMPILING if self._is_compiling else self._patience):
            self._end_process()
            self._begin()

    def _tell_text_if_other(self, before: str | None) -> None:
        try:
            now = self._document.read().text
        except PcsgError:
            now = None
        if now is None or now != before:
            self._tell_text()
