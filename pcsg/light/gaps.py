"""Gaps: where canopies let straight light through, and what follows for their leaf area."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array, whole
from pcsg.errors import UsageError
from pcsg.light.sources import direction
from pcsg.light.stage import Stage, batches, chance
from pcsg.trace.measures import Measured

if TYPE_CHECKING:
    from pcsg.scene import Scene

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class GapFraction:
    """Gap fractions by zenith angle.

    Attributes
    ----------
    zenith : float64 (K,)
        Degrees.
    P, se : float64 (K,)
        Share of the sky that is seen, and its standard error.
    """

    zenith: Floats
    P: Floats
    se: Floats


def gap_fraction(
    scene: Scene,
    zenith: ArrayLike,
    *,
    azimuth: float | None = None,
    periodic: ArrayLike | None = None,
    plot: ArrayLike | None = None,
    soil: float | None = None,
    rays: int = 100_000,
    seed: int = 0,
) -> GapFraction:
    """Return which share of the sky is seen from the soil.

    Parameters
    ----------
    zenith : array_like (K,)
        Degrees, below 90.
    azimuth
        Degrees east of north (+y); None: all of them, at random.
    periodic
        A cell (xmin, ymin, xmax, ymax) whose copies fill the plane.
    plot : array_like (4,)
        Without ``periodic``: the rectangle of the soil that is looked from, by default all below
        the scene.
    soil
        Height of the soil, by default the grammar's ``ground``, or else the lowest point.
    rays
        For each zenith angle.
    seed
        Equal seeds give equal bits.

    Returns
    -------
    GapFraction
        ``zenith``, ``P``, ``se``: float64 (K,); the error is binomial.
    """
    angles = np.atleast_1d(array(zenith, "zenith"))
    if ((angles < 0.0) | (angles >= 90.0)).any():
        raise UsageError("zenith angles are from 0 to below 90 degrees")
    stage = Stage(scene, periodic, soil)
    whole(rays, "rays", 1)
    low, high = stage.low[:2], stage.high[:2]
    if stage.cell is not None:
        low, high = stage.cell.corner, stage.cell.corner + stage.cell.sides
    elif plot is not None:
        rectangle = array(plot, "plot")
        if rectangle.shape != (4,):
            raise UsageError("`plot` is (xmin, ymin, xmax, ymax)")
        low, high = rectangle[:2], rectangle[2:]
    found = np.zeros(len(angles))
    for k, angle in enumerate(angles.tolist()):
        free = 0
        for count, rng in batches(rays, seed):
            u = rng.random((count, 3))
            turn = 360.0 * u[:, 2] if azimuth is None else np.full(count, azimuth)
            places = np.column_stack(
                [low + u[:, :2] * (high - low), np.full(count, stage.soil + stage.step)]
            )
            free += int(stage.is_free(places, direction(np.full(count, angle), turn)).sum())
        found[k] = free / rays
    return GapFraction(angles, found, np.sqrt(found * (1.0 - found) / rays))


def lai(P: ArrayLike, zenith: ArrayLike, method: Literal["miller", "hinge"] = "miller") -> float:
    """Return the leaf area index, one-sided m2 of leaves for each m2 of soil, of gap fractions.

    Parameters
    ----------
    P : array_like (K,)
        Gap fractions.
    zenith : array_like (K,)
        Degrees, rising.
    method
        ``miller``: 2 times the integral of -ln P cos sin over the zenith angle (Miller 1967), the
        contact number between angles interpolated and held from the last one to 90 degrees;
        ``hinge``: from 57.5 degrees, where all leaf angles project alike (Wilson 1963), with P
        interpolated.
    """
    p, angles = np.atleast_1d(array(P, "P")), np.atleast_1d(array(zenith, "zenith"))
    if p.shape != angles.shape or ((p < 0.0) | (p > 1.0)).any():
        raise UsageError("gap fractions are from 0 to 1, one for each zenith angle")
    if (np.diff(angles) <= 0.0).any():
        raise UsageError("zenith angles rise")
    with np.errstate(divide="ignore"):
        contact = -np.log(p) * np.cos(np.radians(angles))
    if method == "hinge":
        return float(np.interp(57.5, angles, contact)) / 0.5
    if method != "miller":
        raise UsageError(f"unknown method {method!r}; one of miller, hinge")
    steps = np.linspace(0.0, 90.0, 9_001)
    middles = 0.5 * (steps[1:] + steps[:-1])
    values = np.interp(middles, angles, contact) * np.sin(np.radians(middles))
    return float(2.0 * values.sum() * math.radians(0.01))


def projection(
    scene: Scene,
    zenith: ArrayLike,
    *,
    azimuth: float | None = None,
    label: int | None = None,
    n: int = 1_000_000,
    seed: int = 0,
) -> list[Measured]:
    """Return G: the mean projection of unit leaf area onto planes across directions.

    Parameters
    ----------
    zenith : array_like (K,)
        Degrees.
    azimuth
        Degrees east of north; None: the mean over all.
    label
        Of these surfaces only.
    n
        Points that normals are drawn at.
    """
    drawn = scene.sample(n, seed=seed)
    normals = drawn.normals if label is None else drawn.normals[drawn.label == label]
    if not len(normals):
        raise UsageError(f"the scene has no surface of label {label}")
    rng = chance(seed, 1)
    turn = 360.0 * rng.random(len(normals)) if azimuth is None else np.full(len(normals), azimuth)
    found = []
    for angle in np.atleast_1d(array(zenith, "zenith")).tolist():
        values = np.abs(np.einsum("ij,ij->i", normals, direction(np.full(len(turn), angle), turn)))
        found.append(Measured(float(values.mean()), float(values.std()) / math.sqrt(len(values))))
    return found


def leaf_angles(
    scene: Scene, bins: int = 18, *, label: int | None = None, n: int = 1_000_000, seed: int = 0
) -> tuple[Floats, Floats]:
    """Return the distribution of inclinations of surfaces, by area.

    Parameters
    ----------
    bins
        Equal steps from 0 (level) to 90 degrees.
    label
        Of these surfaces only.

    Returns
    -------
    edges : float64 (bins + 1,)
        Degrees.
    share : float64 (bins,)
        Of the area; they add up to 1.
    """
    drawn = scene.sample(n, seed=seed)
    normals = drawn.normals if label is None else drawn.normals[drawn.label == label]
    angles = np.degrees(np.arccos(np.minimum(1.0, np.abs(normals[:, 2]))))
    counts, edges = np.histogram(angles, whole(bins, "bins", 1), (0.0, 90.0))
    return edges, counts / max(1, len(angles))


@dataclass(frozen=True)
class Hemisphere:
    """A hemispherical picture.

    Attributes
    ----------
    sky : bool (size, size)
        Where the sky is seen. Equidistant: the distance from the middle is the zenith angle, 90
        degrees at the border. Up is north (+y), and, as it is seen from below, left is east.
    zenith : float64 (rings,)
        Middles of the rings, degrees.
    P, se : float64 (rings,)
        Gap fraction of each ring, and its standard error as if pixels were independent.
    """

    sky: NDArray[np.bool_]
    zenith: Floats
    P: Floats
    se: Floats


def hemispherical(
    scene: Scene,
    eye: ArrayLike,
    size: int = 512,
    *,
    rings: int = 9,
    periodic: ArrayLike | None = None,
) -> Hemisphere:
    """Look up from a place with an equidistant fisheye.

    Parameters
    ----------
    eye : array_like (3,)
        World coordinates.
    size
        Pixels across.
    rings
        Of equal steps of the zenith angle.
    periodic
        A cell whose copies fill the plane.
    """
    whole(size, "size", 2, 16_384)
    whole(rings, "rings", 1)
    place = array(eye, "eye")
    if place.shape != (3,):
        raise UsageError("`eye` is (x, y, z)")
    stage = Stage(scene, periodic)
    across = (2.0 * (np.arange(size) + 0.5) / size) - 1.0
    x, y = np.meshgrid(across, -across)
    zenith = 90.0 * np.hypot(x, y)
    seen = np.flatnonzero(zenith.ravel() < 90.0)
    azimuth = np.degrees(np.arctan2(-x, y)).ravel()[seen]
    towards = direction(zenith.ravel()[seen], azimuth)
    sky = np.zeros(size * size, np.bool_)
    sky[seen] = stage.is_free(np.tile(place, (len(seen), 1)), towards)
    ring = np.minimum((zenith.ravel()[seen] / 90.0 * rings).astype(np.int64), rings - 1)
    # Equal areas of the picture are no equal angles: weights are those of the sphere.
    angles = np.radians(np.maximum(zenith.ravel()[seen], 1e-9))
    weights = np.sin(angles) / angles
    total = np.bincount(ring, weights, rings)
    p = np.bincount(ring, weights * sky[seen], rings) / total
    pixels = np.maximum(1, np.bincount(ring, minlength=rings))
    middles = 90.0 * (np.arange(rings) + 0.5) / rings
    return Hemisphere(sky.reshape(size, size), middles, p, np.sqrt(p * (1.0 - p) / pixels))
