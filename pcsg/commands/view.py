"""``pcsg view``: a grammar in the browser, live."""

from __future__ import annotations

import asyncio
import os
import sys
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pcsg.commands.files import check_there
from pcsg.commands.gallery import find, folder
from pcsg.commands.grow import species_file
from pcsg.commands.guard import say
from pcsg.commands.options import parse_assignments, parse_memory
from pcsg.errors import EnvironmentFault, UsageError


@dataclass(frozen=True)
class ViewArguments:
    """The options of ``pcsg view`` as they were typed."""

    file: str
    port: int
    host: str
    insecure: bool
    certificate: Path | None
    key: Path | None
    browser: bool
    assignments: Sequence[str]
    seed: int | None
    time: float | None
    threads: int | None
    include: Sequence[Path]
    max_memory: str | None
    block_memory: str | None
    engine: str


def run(arguments: ViewArguments) -> None:
    """Serve the page until Ctrl-C."""
    path, shipped = find_file(arguments.file)
    values = parse_assignments(arguments.assignments)
    if arguments.seed is not None:
        values.setdefault("SEED", float(arguments.seed))
    if arguments.time is not None:
        values.setdefault("TIME", arguments.time)
    if not 0 <= arguments.port < 1 << 16:
        raise UsageError(f"--port takes a number from 0 to 65535, not {arguments.port}")
    from pcsg.view.access import Guard, is_loopback

    context = _certificate(arguments)
    if not is_loopback(arguments.host) and not arguments.insecure and context is None:
        raise UsageError(
            f"--host {arguments.host} lets others on the network see what is sent, the token"
            " included; add --certificate FILE (and --key FILE), or --insecure, or reach this"
            " machine by `ssh -L` instead"
        )
    from pcsg.view.document import Document
    from pcsg.view.opening import Limits
    from pcsg.view.server import Viewer
    from pcsg.view.server import run as serve

    limits = Limits(
        arguments.threads,
        parse_memory(arguments.max_memory),
        parse_memory(arguments.block_memory, "--block-memory"),
        arguments.engine,
        tuple(map(str, arguments.include)),
    )
    viewer = Viewer(Document(path, shipped), limits, Guard(arguments.host), arguments.file, values)

    def ready(port: int) -> None:
        host = "localhost" if is_loopback(arguments.host) else arguments.host
        scheme = "http" if context is None else "https"
        address = f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}/"
        address += f"#token={viewer.guard.token}"
        say(f"{path.name} is shown at {address}")
        say("Ctrl-C ends it")
        if arguments.browser and has_display():
            webbrowser.open(address)

    try:
        asyncio.run(serve(viewer, arguments.port, ready, context))
    except KeyboardInterrupt:
        return  # the way to end it


def find_file(name: str) -> tuple[Path, bool]:
    """Return a file, or that of a species or a picture of the gallery, and whether it is ours.

    Raises
    ------
    UsageError
        There is none.
    """
    path = Path(name)
    if path.exists():
        if not path.is_file():
            raise UsageError(f"cannot show {path}: it is not an ordinary file")
        return path, False
    species = species_file(name)
    if species != path:
        return species, True
    picture = find(name)
    if picture is not None and name == picture.name:
        return folder() / picture.grammar, True
    check_there(path)
    return path, False


def has_display() -> bool:
    """Return whether a browser can be shown here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _certificate(arguments: ViewArguments) -> Any:
    """Return the context of the certificate, None without one."""
    if arguments.certificate is None:
        return None
    import ssl

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(arguments.certificate, arguments.key)
    except (OSError, ssl.SSLError) as error:
        reason = error.strerror or str(error)
        raise EnvironmentFault(
            f"cannot use the certificate {arguments.certificate}: {reason}"
        ) from None
    return context
