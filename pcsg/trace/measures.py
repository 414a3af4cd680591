"""What integrals over all primitives of a scene are told with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Quantity = Literal["area", "volume", "count"]
Key = Literal["label", "leaf"]


class Measured(NamedTuple):
    """A number and its standard error, 0 where it is exact."""

    value: float
    se: float


@dataclass(frozen=True)
class Samples:
    """Points at random on the surfaces of a scene, uniform by area; of sheets one side counts.

    Attributes
    ----------
    points, normals : float64 (N, 3)
        World coordinates; normals are unit and outward.
    label, leaf : int64 (N,)
        As in `Hits`.
    area : Measured
        Of all surfaces, in the square of the scene's unit of length.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    label: NDArray[np.int64]
    leaf: NDArray[np.int64]
    area: Measured
