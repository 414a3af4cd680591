"""Leaf area density of a box, from the echoes in it and the ways of beams through it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array
from pcsg.errors import UsageError
from pcsg.lidar.cloud import Cloud
from pcsg.trace.measures import Measured

Floats = NDArray[np.float64]


class Density(NamedTuple):
    """What beams say of a box.

    Attributes
    ----------
    area : Measured
        One-sided leaf area in a volume, m2/m3.
    G : Measured
        Mean projection of a unit of leaf area, from the normals of echoes.
    contacts : Measured
        Contacts in a metre of way: ``G * area``.
    """

    area: Measured
    G: Measured
    contacts: Measured


def density(cloud: Cloud, box: ArrayLike, label: int | None = None) -> Density:
    """Return the leaf area density of a box.

    Contacts over ways, each weighted by its share of a beam, is the estimate of greatest
    likelihood for leaves at random (Pimont et al. 2018, "Estimators and confidence intervals for
    plant area density at voxel scale with T-LiDAR"); G is the harmonic mean of the cosines at
    contacts, as these are met in proportion to them.

    Parameters
    ----------
    cloud
        With misses, and all echoes: ``returns="multi"``.
    box : array_like (2, 3)
        Its corners.
    label
        Of these surfaces only; others only stop beams.

    Raises
    ------
    UsageError
        The cloud has no beams, or none of them passes the box.
    """
    corners = array(box, "box")
    if corners.shape != (2, 3) or not (corners[0] < corners[1]).all():
        raise UsageError("a box is two corners, the smaller one first")
    if not len(cloud.beam_legs):
        raise UsageError("densities need the beams: scan with misses=True")
    near, far = _cross(cloud.beam_origins, cloud.beam_directions, corners)
    within = np.maximum(0.0, far - near)
    left = 1.0 - np.bincount(cloud.beam, cloud.share, len(within))
    ways = np.clip(cloud.range - near[cloud.beam], 0.0, within[cloud.beam]) * cloud.share
    total = float((left * within).sum() + ways.sum())
    if not total > 0.0:
        raise UsageError("no beam passes the box")
    inside = (cloud.range >= near[cloud.beam]) & (cloud.range <= far[cloud.beam])
    if label is not None:
        inside &= cloud.label == label
    shares = cloud.share[inside]
    contacts = Measured(float(shares.sum()) / total, math.sqrt(float((shares**2).sum())) / total)
    if not inside.any():
        return Density(Measured(0.0, 0.0), Measured(math.nan, math.nan), contacts)
    cosines = np.maximum(np.cos(np.radians(cloud.incidence[inside])), 1e-3)
    mean = float((shares / cosines).sum() / shares.sum())
    spread = float((shares * (1.0 / cosines - mean) ** 2).sum() / shares.sum())
    error = math.sqrt(spread / len(cosines))
    g = Measured(1.0 / mean, error / mean**2)
    relative = math.hypot(contacts.se / contacts.value, g.se / g.value)
    area = contacts.value / g.value
    return Density(Measured(area, area * relative), g, contacts)


def _cross(origins: Floats, directions: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Return where lines enter and leave a box, ahead of their origins."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (corners[0] - origins) / directions
        b = (corners[1] - origins) / directions
    a, b = np.nan_to_num(a, nan=-math.inf), np.nan_to_num(b, nan=math.inf)
    near = np.maximum(0.0, np.minimum(a, b).max(axis=1))
    far = np.maximum(a, b).min(axis=1)
    met = far > near
    return np.where(met, near, 0.0), np.where(met, far, 0.0)
