"""Cross-sections at junctions: the papers assume that branches are together no thicker than what
bears them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.turtle import Skeleton


class Areas(NamedTuple):
    """Squared radii at every junction, in the order of the bearers.

    Attributes
    ----------
    bearer : int64 (J,)
        Numbers of the internodes at whose tops two or more others begin.
    below, above : float64 (J,)
        r_A^2, the bearer's top, and sum r_i^2, the bases of what it bears.
    """

    bearer: NDArray[np.int64]
    below: NDArray[np.float64]
    above: NDArray[np.float64]

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Sum r_i^2 / r_A^2; above 1 the branches are thicker than their bearer."""
        return self.above / self.below


def junction_areas(s: Skeleton) -> Areas:
    """Return the areas at the junctions of a skeleton."""
    n = len(s.base)
    borne = s.parent >= 0
    count = np.bincount(s.parent[borne], minlength=n)
    above = np.zeros(n)
    np.add.at(above, s.parent[borne], s.base[borne] ** 2)
    bearer = np.flatnonzero(count > 1)
    return Areas(bearer, np.minimum(s.top, s.base)[bearer] ** 2, above[bearer])
