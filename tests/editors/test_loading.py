"""What the language server loads: little at the start, and never the compiler."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pygls", reason="the extra `lsp` is not installed")

ROOT = Path(__file__).parents[2]


def checked_modules(code: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", f"{code}; import sys; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    return {name.split(".")[0] for name in done.stdout.split()} | set(done.stdout.split())


def test_the_server_starts_without_the_language() -> None:
    loaded = checked_modules("from pcsg.editors.server import make_server; make_server()")
    assert not loaded & {"numba", "numpy", "lark", "llvmlite", "pcsg.grammar", "rich"}


def test_checking_loads_no_compiler() -> None:
    code = (
        "from pathlib import Path; from pcsg.editors.server import find_problems, make_server\n"
        "from pcsg.editors.symbols import files_of; from pcsg.errors import Source\n"
        "from pcsg.editors.assistance import explain, propose, colours\n"
        "for p in ['grammars/tree.pcsg', 'grammars/sea.pcsg', 'grammars/dew.pcsg']:\n"
        "    s = Source(p, Path(p).read_text(encoding='utf-8'), 'grammars')\n"
        "    assert find_problems(s)[0] == []\n"
        "    files = files_of(s, {}); propose(files, 400); explain(files, 400, {})\n"
        "    list(colours(files[0]))\n"
        "pass"
    )
    assert "numba" not in checked_modules(code)


def test_the_verb_ends_in_order_and_says_nothing_else() -> None:
    messages = [
        {"id": 1, "method": "initialize", "params": {"processId": None, "capabilities": {}}},
        {"id": 2, "method": "shutdown"},
        {"method": "exit"},
    ]
    sent = b""
    for message in messages:
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        sent += b"Content-Length: %d\r\n\r\n" % len(body) + body
    command = [sys.executable, "-m", "pcsg", "lsp"]
    done = subprocess.run(command, input=sent, capture_output=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stderr == b""
    assert b'"name":"pcsg"' in done.stdout.replace(b" ", b"")
