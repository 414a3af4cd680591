"""Light that is absorbed, followed from sun and sky: forward Monte Carlo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import whole
from pcsg.errors import UsageError
from pcsg.light.optics import Bands, Optics, read_optics
from pcsg.light.scattering import roulette, scatter_about, scatter_at_leaves
from pcsg.light.sources import Sky, Sun, as_sources
from pcsg.light.stage import Stage, batches
from pcsg.trace.measures import Measured

if TYPE_CHECKING:
    from pcsg.scene import Scene

Floats = NDArray[np.float64]

SOIL, SKY = "soil", "sky"


@dataclass(frozen=True)
class Band:
    """What became of the light of one band.

    Attributes
    ----------
    incident : float
        W that reach the scene: of a cell, its area times the flux on a horizontal surface.
    absorbed : dict of int to float
        W that surfaces absorb, by key (the label, or the leaf's node).
    se : dict of int to float
        Their standard errors, W.
    flux : dict of int to float
        W/m2 of one-sided surface; nan where the area is not known.
    soil, reflected : Measured
        W that the soil absorbs, and that leave upwards.
    balance : Measured
        (absorbed + soil + reflected) / incident: 1 within its standard error.
    """

    incident: float
    absorbed: Mapping[Any, float]
    se: Mapping[Any, float]
    flux: Mapping[Any, float]
    soil: Measured
    reflected: Measured
    balance: Measured


class Interception(dict[str, Band]):
    """Results by band; `table` gives rows, and its text shows the balance."""

    def table(self) -> list[dict[str, Any]]:
        """Return a row for each band and key, for `pandas.DataFrame`: W, W/m2, standard errors."""
        rows = []
        for name, band in self.items():
            for key, value in band.absorbed.items():
                row = {"band": name, "key": key, "absorbed": value, "se": band.se[key]}
                rows.append({**row, "flux": band.flux[key]})
            for key, found in ((SOIL, band.soil), (SKY, band.reflected)):
                row = {"band": name, "key": key, "absorbed": found.value, "se": found.se}
                rows.append({**row, "flux": math.nan})
        return rows

    def __str__(self) -> str:
        lines = []
        for name, band in self.items():
            total = sum(band.absorbed.values()) / band.incident
            lines.append(
                f"{name}: leaves {total:.5f} + soil {band.soil.value / band.incident:.5f} +"
                f" reflected {band.reflected.value / band.incident:.5f} ="
                f" {band.balance.value:.5f} +- {band.balance.se:.5f}"
            )
        return "\n".join(lines)


def interception(
    scene: Scene,
    sources: Sun | Sky | Sequence[Sun | Sky],
    bands: Bands | str,
    *,
    by: str = "label",
    periodic: ArrayLike | None = None,
    soil: float | None = None,
    rays: int = 1_000_000,
    seed: int = 0,
) -> Interception:
    """Follow light from sun and sky, and add up what every surface absorbs.

    Leaves are bi-Lambertian, the soil is Lambertian (Ross and Marshak 1988). A ray carries a weight
    for every band; Russian roulette ends faint ones without bias.

    Parameters
    ----------
    sources
        What `sun` and `sky` return.
    bands
        Names of the grammar's bands, or a dict: see `read_optics`.
    by
        ``label`` or ``leaf``: what keys of results are.
    periodic
        A cell (xmin, ymin, xmax, ymax) whose copies fill the plane; None: the scene stands alone
        on its soil, and light that passes beside it counts as incident, too.
    soil
        Height of the soil, by default the grammar's ``ground``, or else the lowest point.
    rays
        Number of rays.
    seed
        Equal seeds give equal bits.

    Returns
    -------
    Interception
        By the band's name: W, W/m2 and standard errors.
    """
    if by not in ("label", "leaf"):
        raise UsageError(f"`by` is label or leaf, not {by!r}")
    lights = as_sources(sources)
    optics = read_optics(scene, bands)
    stage = Stage(scene, periodic, soil)
    whole(rays, "rays", 1)
    whole(seed, "seed", 0)
    totals: list[dict[Any, Floats]] = []
    sizes: list[int] = []
    for count, rng in batches(rays, seed):
        totals.append(_follow(stage, lights, optics, by, count, rng))
        sizes.append(count)
    return _collect(stage, lights, optics, by, totals, np.array(sizes, float))


def _follow(
    stage: Stage,
    lights: Sequence[Sun | Sky],
    optics: Optics,
    by: str,
    count: int,
    rng: np.random.Generator,
) -> dict[Any, Floats]:
    """Return W by key and band that one batch of rays leaves, as if it were all light."""
    origins, directions, power = _emit(stage, lights, count, rng)
    n_bands = len(optics.names)
    weights = np.tile((power / count)[:, None], (1, n_bands))
    start = power / count
    found: dict[Any, Floats] = {SOIL: np.zeros(n_bands), SKY: np.zeros(n_bands)}
    found["incident"] = weights.sum(axis=0)
    while len(origins):
        hits, on_soil, limit = stage.cast(origins, directions)
        met = np.isfinite(hits.t)
        found[SKY] += weights[~met & ~on_soil].sum(axis=0)
        rows = np.flatnonzero(met)
        some = hits.take(rows)
        sheet = stage.is_sheet(some)
        rho, tau = optics.of_hits(some, sheet)
        lost = weights[rows] * (1.0 - rho - tau)
        keys = some.label if by == "label" else some.leaf
        for key in np.unique(keys).tolist():
            here = lost[keys == key].sum(axis=0)
            found[key] = found.get(key, 0.0) + here
        u = rng.random((len(origins), 4))
        away, left = scatter_at_leaves(
            directions[rows], some.normal, weights[rows], rho, tau, u[rows, :3]
        )
        ground = np.flatnonzero(on_soil)
        found[SOIL] += (weights[ground] * (1.0 - optics.soil)).sum(axis=0)
        up = np.tile([0.0, 0.0, 1.0], (len(ground), 1))
        places = origins[ground] + limit[ground, None] * directions[ground]
        places[:, 2] = stage.soil
        positions = np.concatenate([some.position, places])
        directions = np.concatenate([away, scatter_about(up, u[ground, :2])])
        kept = np.concatenate([rows, ground])
        weights = np.concatenate([left, weights[ground] * optics.soil])
        weights = roulette(weights, start[kept], u[kept, 3])
        lives = np.flatnonzero(weights.max(axis=1) > 0.0)
        origins = stage.fold(positions[lives])
        directions, weights, start = directions[lives], weights[lives], start[kept[lives]]
    return found


def _emit(
    stage: Stage, lights: Sequence[Sun | Sky], count: int, rng: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """Return rays from the sources, and what they carry: W, as if each were all light."""
    flux = np.array([light.horizontal for light in lights])
    if not flux.sum() > 0.0:
        raise UsageError("the sources give no light")
    u = rng.random((count, 5))
    which = np.searchsorted(np.cumsum(flux) / flux.sum(), u[:, 0], side="right")
    which = np.minimum(which, len(lights) - 1)
    towards, share = np.zeros((count, 3)), np.zeros(count)
    for k, light in enumerate(lights):
        here = np.flatnonzero(which == k)
        towards[here], share[here] = light.draw(u[here, 1:3])
    origins, areas = stage.launch(towards, u[:, 3:])
    return origins, -towards, flux.sum() * share * areas


def _collect(
    stage: Stage,
    lights: Sequence[Sun | Sky],
    optics: Optics,
    by: str,
    totals: Sequence[Mapping[Any, Floats]],
    sizes: Floats,
) -> Interception:
    """Return means over batches and their standard errors."""
    keys = sorted({key for total in totals for key in total if isinstance(key, int)})
    areas: Mapping[Any, Measured] = {}
    with suppress(UsageError):  # carved, or not known: flux is nan
        areas = stage.scene.measure("area", by)  # type: ignore[call-overload]
    if by == "label":
        optics.warn_of_black(keys, stage.scene)
    none = np.zeros(len(optics.names))
    result = Interception()
    for k, name in enumerate(optics.names):
        values = {
            key: np.array([total.get(key, none)[k] for total in totals])
            for key in [*keys, SOIL, SKY, "incident"]
        }
        means = {key: _mean(column, sizes) for key, column in values.items()}
        incident = means["incident"].value
        if stage.cell is not None:
            incident = stage.cell.area * sum(light.horizontal for light in lights)
        # What comes in varies where the sky is not uniform: of the share that is cancelled.
        sums = sum(values[key] for key in [*keys, SOIL, SKY]) / incident
        result[name] = Band(
            incident=incident,
            absorbed={key: means[key].value for key in keys},
            se={key: means[key].se for key in keys},
            flux={
                key: means[key].value / areas[key].value if key in areas else math.nan
                for key in keys
            },
            soil=means[SOIL],
            reflected=means[SKY],
            balance=_mean(np.asarray(sums), sizes),
        )
    return result


def _mean(values: Floats, sizes: Floats) -> Measured:
    """Return the mean of batches, weighted by their sizes, and its standard error."""
    total = sizes.sum()
    mean = float((values * sizes).sum() / total)
    if len(values) < 2:
        return Measured(mean, math.nan)
    spread = float((sizes * (values - mean) ** 2).sum()) / total
    return Measured(mean, math.sqrt(spread / (len(values) - 1)))
