"""How large a surface will be, before it is made."""

from __future__ import annotations

import numpy as np

from pcsg.errors import UsageError
from pcsg.treemesh.limits import check_aspect, check_levels
from pcsg.treemesh.skeleton import Skeleton
from pcsg.treemesh.surface import SurfaceOptions

BYTES = 1_300
"""Of a quad, with all that is needed to make it and to write it; measured."""

_LIMB = 6
"""Quads of the cage at the ends of a limb, in the mean."""


def count_quads(skel: Skeleton, options: SurfaceOptions | None = None) -> float:
    """Return about how many quads the surface of a skeleton has; some percent too many."""
    o = options or SurfaceOptions()
    check_levels(o.levels)
    check_aspect(o.max_aspect)
    radius = skel.radius[skel.edges].mean(axis=1)
    squares = np.ones(skel.n_edges)
    if o.max_aspect is not None:
        squares = np.maximum(np.ceil(skel.lengths / (o.max_aspect * radius)), 1.0)
    cage = 4.0 * float(squares.sum()) + _LIMB * len(skel.limbs)
    return float(4.0**o.levels * cage)


def check_memory(skel: Skeleton, options: SurfaceOptions | None, most: int) -> None:
    """Refuse a surface that needs more memory than is allowed.

    Parameters
    ----------
    most
        Bytes.

    Raises
    ------
    UsageError
        How much it needs, and what makes it smaller.
    """
    quads = count_quads(skel, options)
    if quads * BYTES <= most:
        return
    raise UsageError(
        f"the surface would have some {quads:,.0f} quads about {skel.n_edges:,} segments and need "
        f"{quads * BYTES / 1e9:,.1f} GB, more than the {most / 1e9:,.1f} GB that --max-memory "
        "allows; a step less of --levels takes a quarter, --min-radius and --max-order leave out "
        "twigs, and a growing tree is smaller at an earlier time (-D t=3)"
    )
