"""All operators of the BlobTree, and the kernel that dispatches over them.

A new operator stands in a file of its subject; the file is named here, which registers what it has.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pcsg.blobtree import algebra, bounded, contact, pairs, rfunctions
from pcsg.blobtree.blend import BLENDS, Array, Blend
from pcsg.jit import build_ladder, njit

__all__ = ["BLENDS", "FILES", "Array", "Blend", "blend_ladder"]

FILES = (algebra, bounded, contact, pairs, rfunctions)
"""Where operators are."""


def blend_ladder() -> Callable[..., Any]:
    """Return the kernel that dispatches over the kinds of operators."""
    cases = [njit(contract=True)(cls.hull) for cls in BLENDS.values()]
    return build_ladder(
        "blend_hull",
        "kind",
        ["values", "slots", "base", "n", "args", "at", "out"],
        cases,
        "0",
        contract=True,
    )
