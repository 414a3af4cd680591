"""Dispatch over the kinds of leaves: one generated ladder for each kernel of the contract."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pcsg.leaf  # noqa: F401 -- registers every leaf before the ladders are built
from pcsg.jit import build_ladder, njit
from pcsg.leaf.registry import kernels


def _cases(method: str) -> list[Callable[..., Any] | None]:
    return [plain and njit(contract=True)(plain) for plain in kernels(method)]


def _ladder(
    name: str,
    arguments: str,
    cases: list[Callable[..., Any] | None],
    default: str,
    inline: bool = False,
) -> Callable[..., Any]:
    split = arguments.split()
    return build_ladder(name, "kind", split, cases, default, contract=True, inline=inline)


_CROSSINGS = "ray want args at pool t n", _cases("crossings"), "n"

leaf_crossings = _ladder("leaf_crossings", *_CROSSINGS)
"""``(kind, ray, want, args, at, pool, t, n) -> n``"""

leaf_crossings_inline = _ladder("leaf_crossings_inline", *_CROSSINGS, inline=True)
"""The same within its caller, for inner loops."""

leaf_normal = _ladder("leaf_normal", "p args at pool", _cases("normal"), "p")
"""``(kind, p, args, at, pool) -> Vec3``: outward, of any length"""

leaf_inside = _ladder("leaf_inside", "p args at pool", _cases("inside"), "False")
"""``(kind, p, args, at, pool) -> bool``"""

leaf_uv = _ladder("leaf_uv", "p args at pool", _cases("uv"), "(0.0, 0.0)")
"""``(kind, p, args, at, pool) -> (u, v)``"""

leaf_attributes = _ladder(
    "leaf_attributes", "p args at pool", _cases("attributes"), "(-1.0, -1.0, -1.0, -1.0)"
)
"""``(kind, p, args, at, pool) -> (red, green, blue, label)``: -1 where the leaf has none"""
