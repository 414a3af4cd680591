"""The files of the page, which hold no data and no secrets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources

_KINDS = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}


@dataclass(frozen=True)
class Asset:
    """A file and its kind."""

    content: bytes
    kind: str


@cache
def assets() -> dict[str, Asset]:
    """Return all files by the paths under which they are served; ``/`` is the page."""
    folder = resources.files("pcsg.view") / "page"
    found = {}
    for file in folder.iterdir():
        kind = _KINDS.get(file.name.rpartition(".")[2])
        if kind is not None:
            found[f"/{file.name}"] = Asset(file.read_bytes(), kind)
    found["/"] = found["/index.html"]
    return found
