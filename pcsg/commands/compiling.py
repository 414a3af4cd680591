"""What is said about kernels that have to be compiled first."""

from __future__ import annotations

from typing import Any

from pcsg.commands.guard import say


def announce_compiling(entry: Any, time: str) -> None:
    """Say that a picture will take longer than it takes, if so, and whether only this once.

    Parameters
    ----------
    entry
        The kernel that takes longest.
    time
        About how long.
    """
    from pcsg.codecache import CACHE, opened
    from pcsg.jit import is_cached

    if is_cached(entry):
        return
    if not entry.fingerprint:
        say(f"compiling kernels, at every run, for a leaf uses what cannot be compared: {time}")
        return
    obstacle = opened().obstacle
    if not obstacle:
        say(f"compiling kernels, which are kept for later runs: {time}")
        return
    say(
        f"compiling kernels, at every run, for they cannot be kept ({obstacle}): {time};"
        f" let {CACHE} name a folder of your own"
    )


def tell_unkept() -> None:
    """Say that kernels could not be kept, if that was not known before."""
    from pcsg.codecache import CACHE, opened

    if failure := opened().failure:
        say(
            f"the compiled kernels could not be kept ({failure}), so the next run compiles them"
            f" again; let {CACHE} name a folder with room"
        )
