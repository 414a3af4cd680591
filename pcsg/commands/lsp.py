"""``pcsg lsp``: the language server, which speaks over standard input and output."""

from __future__ import annotations

import os
import sys


def run() -> None:
    """Serve until the editor ends it."""
    from pcsg.editors.server import make_server

    # The server closes what it is given; whatever else is said must not come between its messages.
    own = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    sys.stdout = sys.stderr
    make_server().start_io(sys.stdin.buffer, own)
