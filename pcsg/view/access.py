"""Who may speak to the server: hosts, origins, and the token.

Everybody on this machine can reach a port of it, and a page of a stranger can send a browser here.
"""

from __future__ import annotations

import ipaddress
import secrets
from dataclasses import dataclass, field
from urllib.parse import urlsplit

TOKEN_BYTES = 16

SECONDS_FOR_TOKEN = 2.0
"""Until who has opened a socket must have told the token."""

POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' blob:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
"""What the page may load: nothing from elsewhere."""

HEADERS = (
    ("Content-Security-Policy", POLICY),
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "no-referrer"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Cache-Control", "no-store"),
)
"""Of every answer."""


def make_token() -> str:
    """Return a text that nobody can guess."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def is_loopback(host: str) -> bool:
    """Return whether a name or an address is this machine's for itself."""
    if host == "localhost" or host.endswith(".localhost"):
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class Guard:
    """What a server lets in.

    Attributes
    ----------
    host
        The address that it listens at.
    token
        What a page has to tell.
    """

    host: str
    token: str = field(default_factory=make_token, repr=False)

    def refuses(self, host: str | None, origin: str | None) -> str | None:
        """Return why a request is refused, None if it is not.

        Parameters
        ----------
        host, origin
            Values of the headers; None where they are missing. Any port is good, so that the
            server can be reached through a tunnel.
        """
        name = _name_of(f"//{host}") if host else None
        if name is None or not (is_loopback(name) or self._is_ours(name)):
            return "this server answers to its own name only"
        if origin is not None and urlsplit(origin).netloc != host:
            return "pages from elsewhere are not answered"
        return None

    def _is_ours(self, name: str) -> bool:
        """Return whether a name is that of an address that is not only this machine's."""
        if is_loopback(self.host):
            return False
        return self.host in ("0.0.0.0", "::", name)

    def knows(self, token: object) -> bool:
        """Return whether a token is the right one, in a time that does not tell how wrong it is."""
        if not isinstance(token, str):
            return False
        return secrets.compare_digest(token.encode(errors="replace"), self.token.encode())


def _name_of(address: str) -> str | None:
    try:
        return urlsplit(address).hostname
    except ValueError:
        return None
