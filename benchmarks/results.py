"""The page of results: a section for each subject; the last measurement of each stands."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence


def merge(old: str, head: Sequence[str], machine: str, sections: Mapping[str, str]) -> str:
    """Return the page with new sections.

    Parameters
    ----------
    old
        The page so far; empty if there is none.
    head
        Lines above the sections.
    machine
        A line of the head. Sections of a page without it were measured elsewhere, and are dropped:
        figures of two machines in one page would be compared.
    sections
        By title, new text or "" for one that was not measured; in this order they come.
    """
    kept = dict(_sections(old)) if machine in old.splitlines() else {}
    texts = [text or kept.get(title, "") for title, text in sections.items()]
    return "\n\n".join(["\n".join(head).strip(), *(t.strip() for t in texts if t)]) + "\n"


def _sections(page: str) -> list[tuple[str, str]]:
    parts = re.split(r"^(?=## )", page, flags=re.MULTILINE)[1:]
    return [(part.split("\n", 1)[0].removeprefix("## ").strip(), part) for part in parts]
