"""One kill of each command that works for long; ``python -m tests.fuzz.kills`` tries more."""

from __future__ import annotations

from pathlib import Path

import pytest
from kills import COMMANDS, Command, withstand_kills


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="processes cannot be counted")
@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c.name)
def test_a_kill_leaves_nothing_running_and_changes_nothing(command: Command) -> None:
    withstand_kills(command, 1)
