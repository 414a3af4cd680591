"""Bidirectional reflectance factors: backward Monte Carlo from the views."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array, whole
from pcsg.errors import UsageError
from pcsg.light.absorption import interception
from pcsg.light.optics import Bands, Optics, read_optics
from pcsg.light.scattering import roulette, scatter_about, scatter_at_leaves
from pcsg.light.sources import Sun, direction
from pcsg.light.stage import Stage, batches
from pcsg.trace.measures import Measured

if TYPE_CHECKING:
    from pcsg.scene import Scene

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Reflectance:
    """What a canopy reflects under a sun.

    Attributes
    ----------
    views : float64 (V, 2)
        Zenith and azimuth, degrees.
    bands : tuple of str
        B names.
    brf, se : float64 (V, B)
        pi times the radiance towards a view, over what falls on a horizontal surface; and its
        standard error.
    albedo, absorption : dict of str to Measured
        Shares of the incident light that leave upwards, and that leaves and wood absorb.
    """

    views: Floats
    bands: tuple[str, ...]
    brf: Floats
    se: Floats
    albedo: dict[str, Measured]
    absorption: dict[str, Measured]

    def table(self) -> list[dict[str, Any]]:
        """Return a row for each view and band."""
        return [
            {"zenith": zenith, "azimuth": azimuth, "band": name, "brf": value, "se": se}
            for (zenith, azimuth), values, errors in zip(
                self.views.tolist(), self.brf.tolist(), self.se.tolist(), strict=True
            )
            for name, value, se in zip(self.bands, values, errors, strict=True)
        ]


def brf(
    scene: Scene,
    sun: Sun,
    views: Sequence[tuple[float, float]],
    bands: Bands | str,
    *,
    target: ArrayLike | None = None,
    periodic: ArrayLike | None = None,
    soil: float | None = None,
    rays: int = 100_000,
    seed: int = 0,
) -> Reflectance:
    """Return bidirectional reflectance factors, by rays from the views back to the sun.

    Parameters
    ----------
    sun
        What `sun` returns.
    views
        Pairs of zenith and azimuth, degrees, azimuth east of north.
    bands
        As for `interception`.
    target : array_like (5,)
        The rectangle (xmin, ymin, xmax, ymax, z) that views look at; by default the cell, or the
        scene's box, at its top.
    periodic
        A cell whose copies fill the plane.
    soil
        Height of the soil.
    rays
        For each view, and for `albedo` and `absorption` together.
    seed
        Equal seeds give equal bits.
    """
    if not isinstance(sun, Sun):
        raise UsageError("`brf` looks at what one sun lights: `light.sun(zenith, azimuth)`")
    places = np.asarray(views, float).reshape(-1, 2)
    if ((places[:, 0] < 0.0) | (places[:, 0] >= 90.0)).any():
        raise UsageError("views have zenith angles from 0 to below 90 degrees")
    optics = read_optics(scene, bands)
    stage = Stage(scene, periodic, soil)
    whole(rays, "rays", 1)
    means = np.zeros((len(places), len(optics.names)))
    errors = np.zeros_like(means)
    rectangle = _target(stage, target)
    for v, (zenith, azimuth) in enumerate(places.tolist()):
        towards = direction(zenith, azimuth)
        total, squares = np.zeros(means.shape[1]), np.zeros(means.shape[1])
        for count, rng in batches(rays, seed):
            values = _look(stage, optics, sun, towards, rectangle, count, rng)
            total += values.sum(axis=0)
            squares += (values * values).sum(axis=0)
        means[v] = total / rays
        errors[v] = np.sqrt(np.maximum(0.0, squares / rays - means[v] ** 2) / rays)
    lit = interception(scene, sun, bands, periodic=periodic, soil=soil, rays=rays, seed=seed + 1)
    albedo = {k: Measured(*(x / r.incident for x in r.reflected)) for k, r in lit.items()}
    absorbed = {
        name: Measured(
            sum(r.absorbed.values()) / r.incident,
            math.sqrt(sum(se * se for se in r.se.values())) / r.incident,
        )
        for name, r in lit.items()
    }
    return Reflectance(places, optics.names, means, errors, albedo, absorbed)


def _target(stage: Stage, target: ArrayLike | None) -> Floats:
    if target is None:
        if stage.cell is not None:
            return np.array([*stage.cell, stage.top])
        return np.array([*stage.low[:2], *stage.high[:2], stage.top])
    rectangle = array(target, "target")
    if rectangle.shape != (5,):
        raise UsageError("`target` is (xmin, ymin, xmax, ymax, z)")
    return rectangle


def _look(
    stage: Stage,
    optics: Optics,
    sun: Sun,
    towards: Floats,
    target: Floats,
    count: int,
    rng: np.random.Generator,
) -> Floats:
    """Return what rays of a view see, as reflectance factors, float64 (N, B)."""
    n_bands = len(optics.names)
    to_sun = direction(sun.zenith, sun.azimuth)
    up = to_sun[2]
    u = rng.random((count, 2))
    origins = np.column_stack(
        [target[:2] + u * (target[2:4] - target[:2]), np.full(count, target[4])]
    )
    height = max(0.0, stage.top + 4.0 * stage.step - float(target[4])) / towards[2]
    origins = stage.fold(origins + height * towards)
    directions = np.tile(-towards, (count, 1))
    weights = np.ones((count, n_bands))
    seen = np.zeros((count, n_bands))
    ray = np.arange(count)
    while len(ray):
        hits, on_soil, limit = stage.cast(origins, directions)
        rows, ground = np.flatnonzero(np.isfinite(hits.t)), np.flatnonzero(on_soil)
        some = hits.take(rows)
        rho, tau = optics.of_hits(some, stage.is_sheet(some))
        points = origins[ground] + limit[ground, None] * directions[ground]
        points[:, 2] = stage.soil
        positions = stage.fold(np.concatenate([some.position, points]))
        # Light that comes straight from the sun, by the side that it falls on.
        lit, looked = some.normal @ to_sun, np.einsum("ij,ij->i", some.normal, directions[rows])
        same = (lit > 0.0) == (looked < 0.0)
        direct = np.where(same[:, None], rho, tau) * (np.abs(lit) / up)[:, None]
        direct = np.concatenate([direct, np.tile(optics.soil, (len(ground), 1))])
        kept = np.concatenate([rows, ground])
        asked = np.flatnonzero(direct.max(axis=1) > 0.0)
        free = stage.is_free(positions[asked], np.tile(to_sun, (len(asked), 1)))
        shining = asked[free]
        np.add.at(seen, ray[kept[shining]], weights[kept[shining]] * direct[shining])
        u = rng.random((len(ray), 4))
        away, left = scatter_at_leaves(
            directions[rows], some.normal, weights[rows], rho, tau, u[rows, :3]
        )
        plane = np.tile([0.0, 0.0, 1.0], (len(ground), 1))
        directions = np.concatenate([away, scatter_about(plane, u[ground, :2])])
        weights = np.concatenate([left, weights[ground] * optics.soil])
        weights = roulette(weights, np.ones(len(kept)), u[kept, 3])
        lives = np.flatnonzero(weights.max(axis=1) > 0.0)
        origins, directions, weights = positions[lives], directions[lives], weights[lives]
        ray = ray[kept[lives]]
    return seen
