"""Meshes of fields: marching cubes where the surface can be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.fields import T
from pcsg.blobtree.model import Model
from pcsg.blobtree.nodes import Field
from pcsg.errors import EnvironmentFault, UsageError

BLOCK = 16
"""Cells of a block along an axis."""


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
        On the surface, to the second order of the cells' size.
    faces : int64 (F, 3)
        Counterclockwise as seen from outside.

    Raises
    ------
    EnvironmentFault
        scikit-image is not installed, or there is not enough memory.
    """
    if resolution < 2:
        raise UsageError(f"contour: the resolution must be 2 or more, is {resolution}")
    try:
        from skimage.measure import marching_cubes
    except ImportError:
        raise EnvironmentFault(
            "contouring needs scikit-image: `pip install 'pcsg[mesh]'`"
        ) from None
    model = solid if isinstance(solid, Model) else Model(solid)
    low, high = model.support
    cell = float((high - low).max()) / resolution
    # One cell of nothing all around, so that the mesh is closed.
    low = low - 1.5 * cell
    shape = np.ceil((high - low) / cell).astype(np.int64) + 3
    try:
        values = sample(model, low, cell, shape)
        if values.max() < T:
            return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
        found: Any = marching_cubes(values, T, spacing=(cell,) * 3, gradient_direction="ascent")
    except MemoryError:
        raise EnvironmentFault(f"not enough memory for {math.prod(shape):,} cells") from None
    vertices, faces = found[0].astype(np.float64) + low, found[1].astype(np.int64)
    return vertices, faces


def sample(
    model: Model, low: NDArray[np.float64], cell: float, shape: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Return the field on a grid; blocks that no primitive reaches are left at zero."""
    values = np.zeros(tuple(shape), np.float32)
    axes = [low[k] + cell * np.arange(shape[k]) for k in range(3)]
    for i in range(0, int(shape[0]), BLOCK):
        for j in range(0, int(shape[1]), BLOCK):
            column = [axes[0][i : i + BLOCK], axes[1][j : j + BLOCK], axes[2]]
            grid = np.stack(np.meshgrid(*column, indexing="ij"), axis=-1)
            block = model.field(grid.reshape(-1, 3)).reshape(grid.shape[:3])
            values[i : i + BLOCK, j : j + BLOCK] = block
    return values
