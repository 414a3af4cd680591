"""Writes ``docs/errors.md`` from the catalogue and the golden files."""

from __future__ import annotations

from pathlib import Path

from pcsg.catalogue import CATALOGUE, Stage

HEAD = """# Errors

Every diagnostic has the same form: file, line and column, the kind of mistake with its code in
brackets, the line with carets under what is meant, what was expected, and where it helps the likely
repair. `pcsg check FILE --json` gives the same as one object per line. All mistakes of a file and
of what it includes are told in one go; after a syntax error reading goes on at the next item. A
mistake in a grammar ends a command with exit status 2.

This page is made from the table of diagnostics; `pytest tests/grammar --update` writes it anew.
"""
LINES = 12


def write_page(golden: Path) -> str:
    """Return the page as text."""
    parts = [HEAD]
    for stage in Stage:
        parts.append(f"## {stage.value}\n")
        for mistake in CATALOGUE.values():
            if mistake.stage is stage:
                note = " A warning only." if mistake.severity == "warning" else ""
                parts.append(f"### `{mistake.code}`\n\n{mistake.explanation}{note}\n")
                parts.append(_example(golden, mistake.code))
    return "\n".join(part for part in parts if part)


def _example(golden: Path, code: str) -> str:
    """Return a short example with its diagnostic, nothing where there is none."""
    source, message = golden / f"{code}.pcsg", golden / f"{code}.txt"
    if not message.exists():
        return ""
    text = source.read_bytes().decode(errors="replace").rstrip()
    told = _first(message.read_text(encoding="utf-8"), code)
    if text.count("\n") >= LINES or max(map(len, text.splitlines())) > 100:
        return f"```text\n{told}\n```\n"
    return f"```\n{text}\n```\n\n```text\n{told}\n```\n"


def _first(told: str, code: str) -> str:
    """Return the first diagnostic with a code, with its lines."""
    lines = told.splitlines()
    start = next(k for k, line in enumerate(lines) if f"[{code}]" in line)
    end = start + 1
    while end < len(lines) and lines[end].startswith("  "):
        end += 1
    return "\n".join(lines[start:end])
