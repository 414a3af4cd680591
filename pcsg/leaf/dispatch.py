"""Dispatch over the kinds of leaves: one generated ladder for each kernel of the contract."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import pcsg.leaf  # noqa: F401 -- registers every leaf before the ladders are built
from pcsg.jit import build_ladder, njit
from pcsg.leaf.registry import LEAVES, kernels


def _ladder(
    method: str,
    arguments: str,
    default: str,
    inline: bool = False,
    known: Mapping[str, Callable[..., Any]] = MappingProxyType({}),
) -> Callable[..., Any]:
    cases = [
        plain and njit(contract=True, inline=inline and solid.inlined)(plain)
        for solid, plain in zip(LEAVES.values(), kernels(method), strict=True)
    ]
    name = f"leaf_{method}"
    words = arguments.split()
    return build_ladder(
        name, "kind", words, cases, default, known=known, contract=True, inline=inline
    )


# Within operations leaves are asked so often that the call itself would cost a fifth of the time.
leaf_crossings = _ladder("crossings", "ray want args at pool t n", "n", inline=True)
"""``(kind, ray, want, args, at, pool, t, n) -> n``"""

leaf_normal = _ladder("normal", "p args at pool", "p")
"""``(kind, p, args, at, pool) -> Vec3``: outward, of any length"""

leaf_part_normal = _ladder(
    "part_normal",
    "p part args at pool",
    "leaf_normal(kind, p, args, at, pool)",
    known={"leaf_normal": leaf_normal},
)
"""``(kind, p, part, args, at, pool) -> Vec3``: the same, where the part may be known"""

leaf_inside = _ladder("inside", "p args at pool", "False")
"""``(kind, p, args, at, pool) -> bool``"""

leaf_uv = _ladder("uv", "p args at pool", "(0.0, 0.0)")
"""``(kind, p, args, at, pool) -> (u, v)``"""

leaf_other_uv = _ladder("other_uv", "p args at pool", "(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)")
"""``(kind, p, args, at, pool) -> (u, v, share, u, v, share)``"""

leaf_attributes = _ladder("attributes", "p args at pool", "(-1.0, -1.0, -1.0, -1.0)")
"""``(kind, p, args, at, pool) -> (red, green, blue, label)``: -1 where the leaf has none"""

leaf_support = _ladder("support", "d args at", "0.0")
"""``(kind, d, args, at) -> float``: the largest ``p . d`` over a leaf that tells it itself"""
