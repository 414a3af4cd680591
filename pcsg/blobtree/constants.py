"""Constants of L-systems that have a meaning, and what other programs call them."""

from __future__ import annotations

CONSTANTS = ("steps", "angle", "width", "thinning", "elasticity")
"""What is defined by ``#define``, and has a meaning."""

_CALLED = {
    **dict.fromkeys(("n", "depth", "step", "iteration", "iterations", "iters"), "steps"),
    **dict.fromkeys(("generation", "generations", "recursion", "recursions"), "steps"),
    **dict.fromkeys(("delta", "theta", "degrees"), "angle"),
    "linewidth": "width",
}


def constant_called(name: str) -> str | None:
    """Return the constant of a name, also of those that other programs give it."""
    return name if name in CONSTANTS else _CALLED.get(name.lower())
