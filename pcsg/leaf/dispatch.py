"""Dispatch over the kinds of leaves: one generated ladder for each kernel of the contract."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import pcsg.leaf  # noqa: F401 -- registers every leaf before the ladders are built
from pcsg.jit import build_ladder, njit
from pcsg.leaf.apart import (
    apart_attributes,
    apart_crossings,
    apart_inside,
    apart_normal,
    apart_other_uv,
    apart_part_normal,
    apart_uv,
)
from pcsg.leaf.registry import LEAVES, kernels

_APART = " or ".join(f"kind == {solid.kind}" for solid in LEAVES.values() if solid.apart)


def _ladder(
    method: str,
    arguments: str,
    default: str,
    inline: bool = False,
    apart: Callable[..., Any] | None = None,
    known: Mapping[str, Callable[..., Any]] = MappingProxyType({}),
) -> Callable[..., Any]:
    """Build the ladder of a kernel; `apart` is called for the leaves that are compiled apart."""
    cases = [
        plain
        and not (apart and solid.apart)
        and njit(contract=True, inline=inline and solid.inlined)(plain)
        for solid, plain in zip(LEAVES.values(), kernels(method), strict=True)
    ]
    name = f"leaf_{method}"
    words = arguments.split()
    if apart:
        known = {**known, "apart": apart}
        default = f"apart(kind, {', '.join(words)}) if {_APART} else {default}"
    return build_ladder(
        name,
        "kind",
        words,
        [case or None for case in cases],
        default,
        known=known,
        contract=True,
        inline=inline,
    )


# Within operations leaves are asked so often that the call itself would cost a fifth of the time.
leaf_crossings = _ladder(
    "crossings", "ray want args at pool t n", "n", inline=True, apart=apart_crossings
)
"""``(kind, ray, want, args, at, pool, t, n) -> n``"""

leaf_normal = _ladder("normal", "p args at pool", "p", apart=apart_normal)
"""``(kind, p, args, at, pool) -> Vec3``: outward, of any length"""

leaf_part_normal = _ladder(
    "part_normal",
    "p part args at pool",
    "leaf_normal(kind, p, args, at, pool)",
    apart=apart_part_normal,
    known={"leaf_normal": leaf_normal},
)
"""``(kind, p, part, args, at, pool) -> Vec3``: the same, where the part may be known"""

leaf_inside = _ladder("inside", "p args at pool", "False", apart=apart_inside)
"""``(kind, p, args, at, pool) -> bool``"""

leaf_uv = _ladder("uv", "p args at pool", "(0.0, 0.0)", apart=apart_uv)
"""``(kind, p, args, at, pool) -> (u, v)``"""

leaf_other_uv = _ladder(
    "other_uv", "p args at pool", "(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)", apart=apart_other_uv
)
"""``(kind, p, args, at, pool) -> (u, v, share, u, v, share)``"""

leaf_attributes = _ladder(
    "attributes", "p args at pool", "(-1.0, -1.0, -1.0, -1.0)", apart=apart_attributes
)
"""``(kind, p, args, at, pool) -> (red, green, blue, label)``: -1 where the leaf has none"""

# What boxes are made of has no pool, and so no addresses.
leaf_support = _ladder("support", "d args at", "0.0")
"""``(kind, d, args, at) -> float``: the largest ``p . d`` over a leaf that tells it itself"""
