"""What the text of an L-system says, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from pcsg.blobtree.lsystem import LSystem

MOST_REMARKS = 100
"""More are not told."""


class Remark(NamedTuple):
    """What is wrong with a line, or worth a look.

    Attributes
    ----------
    line
        From 1; 0 for the whole text.
    severity
        ``error`` or ``warning``.
    """

    line: int
    message: str
    severity: str = "error"


@dataclass
class LSystemText:
    """What the text of an L-system says.

    Attributes
    ----------
    settings
        Lines ``name: value`` such as ``junctions: contact``, each with its line's number.
    remarks
        Everything that is wrong, and what is worth a look.
    """

    system: LSystem
    settings: dict[str, tuple[str, int]] = field(default_factory=dict)
    remarks: list[Remark] = field(default_factory=list)

    def complain(self, line: int, message: str, severity: str = "error") -> None:
        """Take down a remark."""
        if len(self.remarks) < MOST_REMARKS or (severity == "error" and not self.mistakes()):
            self.remarks.append(Remark(line, message, severity))

    def mistakes(self) -> list[Remark]:
        """Return what makes the text unusable, by lines."""
        return sorted(r for r in self.remarks if r.severity == "error")


def plain_lines(text: str) -> str:
    """Return a text with lines that end in a line feed only."""
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")


def told(remarks: Iterable[Remark], text: str, name: str) -> str:
    """Return remarks as text, with the lines that they are about."""
    lines = plain_lines(text).split("\n")
    return "\n".join(
        f"{name}:{r.line}: {r.message}\n  {r.line} | {lines[r.line - 1].strip()[:120]}"
        if r.line
        else f"{name}: {r.message}"
        for r in remarks
    )
