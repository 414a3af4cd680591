"""Meshes of fields, without a scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.model import Model
from pcsg.blobtree.nodes import Field
from pcsg.errors import UsageError
from pcsg.marching import march

Floats = NDArray[np.float64]


def contour(
    solid: Field | Model, resolution: int = 100
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a closed triangle mesh of a blob.

    Parameters
    ----------
    solid
        A field, or its model.
    resolution
        Cells along the longest side of its box. What is thinner than a cell may be missed.

    Returns
    -------
    vertices : float64 (V, 3)
        On the surface.
    faces : int64 (F, 3)
        Counterclockwise as seen from outside.

    Raises
    ------
    EnvironmentFault
        scikit-image is not installed.
    """
    if resolution < 2:
        raise UsageError(f"contour: the resolution must be 2 or more, is {resolution}")
    model = solid if isinstance(solid, Model) else Model(solid)
    low, high = model.support

    def columns(o: Floats, d: Floats) -> tuple[NDArray[np.int64], Floats, Floats]:
        counts, t = model.shoot(o, d)
        return np.concatenate([[0], np.cumsum(counts // 2)]), t[::2], t[1::2]

    def first(o: Floats, d: Floats) -> Floats:
        return model.intersect(o, d, 0.0, 1.0)

    return march(low, high, resolution, columns, first)
