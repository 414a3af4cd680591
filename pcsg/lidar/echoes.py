"""From beams to echoes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import whole
from pcsg.errors import UsageError
from pcsg.lidar.cloud import Cloud, join
from pcsg.lidar.scanners import MOST_BEAMS, Leg, Scanner, as_legs, as_scanner
from pcsg.light.scattering import frame_about
from pcsg.light.stage import chance
from pcsg.trace.periodic import as_cell

if TYPE_CHECKING:
    from pcsg.scene import Scene

Floats = NDArray[np.float64]
Returns = Literal["multi", "first", "last", "strongest"]

RINGS = {1: (), 7: (6,), 19: (6, 12), 37: (6, 12, 18)}
"""Sub-rays of a beam, and how many stand on its rings about the middle one."""

PIECE = 1 << 15
"""Beams that are followed together."""


class Piece(NamedTuple):
    """A part of a scan that can be done alone.

    Attributes
    ----------
    leg, first, beams
        Which leg, its first beam, and how many.
    """

    leg: int
    first: int
    beams: int


def pieces_of(scanner: Scanner, legs: list[Leg]) -> list[Piece]:
    """Return the parts of a scan, in order.

    Raises
    ------
    UsageError
        It has more beams than a scan may have.
    """
    beams = sum(scanner.count(leg) for leg in legs)
    if beams > MOST_BEAMS:
        raise UsageError(
            f"the scan has more than {MOST_BEAMS:g} beams; a larger step or spacing makes fewer"
        )
    return [
        Piece(k, first, min(PIECE, scanner.count(leg) - first))
        for k, leg in enumerate(legs)
        for first in range(0, scanner.count(leg), PIECE)
    ]


def scan(
    scene: Scene,
    scanner: str | Scanner,
    legs: Any,
    *,
    returns: Returns = "multi",
    rays_per_beam: int = 19,
    misses: bool = True,
    periodic: ArrayLike | None = None,
    seed: int = 0,
) -> Cloud:
    """Scan a scene with a laser.

    A beam is a cone of sub-rays; what they meet within half a pulse's way of the first is one echo,
    at the mean of their ranges: so there are mixed echoes at edges, as real scanners give them.

    Parameters
    ----------
    scanner
        ``vz400``, ``vz400-fast``, ``vlp16``, or a `Scanner` of figures of your own.
    legs
        Places (x, y, z) of a tripod, or pairs of places for paths; the scene's unit is metres.
    returns
        Which echoes of a beam are kept.
    rays_per_beam
        1, 7, 19 or 37.
    misses
        Whether the beams are kept, for densities and for those without an echo.
    periodic
        A cell whose copies fill the plane.
    seed
        Equal seeds give equal bits.

    Returns
    -------
    Cloud
    """
    device, places = as_scanner(scanner), as_legs(legs)
    check(returns, rays_per_beam, seed)
    parts = list(scan_pieces(scene, device, places, returns, rays_per_beam, misses, periodic, seed))
    return join(parts)


def check(returns: str, rays_per_beam: int, seed: int) -> None:
    """Check what a scan is asked for.

    Raises
    ------
    UsageError
        It makes no sense.
    """
    if returns not in get_args(Returns):
        raise UsageError(f"returns are one of {', '.join(get_args(Returns))}, not {returns!r}")
    if rays_per_beam not in RINGS:
        known = ", ".join(map(str, RINGS))
        raise UsageError(f"a beam has {known} sub-rays, not {rays_per_beam}")
    whole(seed, "seed", 0)


def scan_pieces(
    scene: Scene,
    scanner: Scanner,
    legs: list[Leg],
    returns: Returns,
    rays_per_beam: int,
    misses: bool,
    periodic: ArrayLike | None,
    seed: int,
) -> Iterator[Cloud]:
    """Yield the clouds of the parts of a scan."""
    cell = None if periodic is None else np.array(as_cell(periodic))
    for piece in pieces_of(scanner, legs):
        yield scan_piece(scene, scanner, legs, piece, returns, rays_per_beam, misses, cell, seed)


def scan_piece(
    scene: Scene,
    scanner: Scanner,
    legs: list[Leg],
    piece: Piece,
    returns: Returns,
    rays_per_beam: int,
    misses: bool,
    cell: Floats | None,
    seed: int,
) -> Cloud:
    """Return the cloud of a part of a scan; its chance belongs to the part."""
    rng = chance(seed, piece.leg, piece.first)
    numbers = piece.first + np.arange(piece.beams)
    origins, directions = scanner.beams(legs[piece.leg], numbers)
    if scanner.angle_sd > 0.0:
        bend = rng.normal(0.0, 1e-3 * scanner.angle_sd, (piece.beams, 2))
        directions = _bent(directions, bend)
    offsets = _offsets(rays_per_beam, 0.5e-3 * scanner.divergence)
    turn = 2.0 * math.pi * rng.random(piece.beams)
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    turned = np.stack(
        [cos * offsets[:, 0] - sin * offsets[:, 1], sin * offsets[:, 0] + cos * offsets[:, 1]],
        axis=-1,
    )
    rays = _bent(np.repeat(directions, rays_per_beam, axis=0), turned.reshape(-1, 2))
    hits = scene.intersect(
        np.repeat(origins, rays_per_beam, axis=0),
        rays,
        scanner.min_range,
        scanner.max_range,
        periodic=cell,
    )
    echoes = _find_echoes(hits.t.reshape(-1, rays_per_beam), scanner.resolution)
    shape = (piece.beams, rays_per_beam)
    cosine = np.abs(np.einsum("ij,ij->i", hits.normal, rays)).reshape(shape)
    kept = _choose(echoes, cosine, returns, rng)
    beam, ranges, share, told, intensity = kept
    number = _count_up(beam)
    total = np.bincount(beam, minlength=piece.beams)[beam]
    measured = ranges + rng.normal(0.0, 1.0, len(ranges)) * scanner.range_sd
    sub = beam * rays_per_beam + told
    before = sum(scanner.count(leg) for leg in legs[: piece.leg])
    none = np.zeros((0, 3))
    return Cloud(
        points=origins[beam] + measured[:, None] * directions[beam],
        normals=hits.normal[sub],
        intensity=intensity,
        share=share,
        return_number=number,
        returns=total,
        label=hits.label[sub],
        leg=np.full(len(beam), piece.leg),
        beam=beam if misses else np.zeros(len(beam), np.int64),
        time=(before + numbers[beam]) / scanner.rate,
        range=measured,
        incidence=np.degrees(np.arccos(np.clip(cosine.ravel()[sub], 0.0, 1.0))),
        beam_origins=origins if misses else none,
        beam_directions=directions if misses else none,
        beam_legs=np.full(piece.beams if misses else 0, piece.leg),
    )


def _offsets(rays: int, radius: float) -> Floats:
    """Return the sub-rays of a beam as angles off its middle, each for an equal share of it."""
    rings = RINGS[rays]
    found = [np.zeros((1, 2))]
    inner = 1
    for count in rings:
        # A ring's sub-rays stand where half of its share is inside of them.
        r = radius * math.sqrt((inner + 0.5 * count) / rays)
        angle = 2.0 * math.pi * (np.arange(count) + 0.5 * (inner % 2)) / count
        found.append(r * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
        inner += count
    return np.concatenate(found)


def _bent(directions: Floats, angles: Floats) -> Floats:
    """Return unit directions that are bent by small angles across."""
    first, second = frame_about(directions)
    bent = directions + angles[:, :1] * first + angles[:, 1:] * second
    found: Floats = bent / np.linalg.norm(bent, axis=1)[:, None]
    return found


class _Echoes(NamedTuple):
    """Which echo every sub-ray of every beam belongs to, -1 for none, sorted by range."""

    order: NDArray[np.int64]
    ranges: Floats
    number: NDArray[np.int64]


def _find_echoes(t: Floats, resolution: float) -> _Echoes:
    """Part the ranges of sub-rays (B, R) into echoes: none is longer than the resolution."""
    order = np.argsort(t, axis=1, kind="stable")
    ranges = np.take_along_axis(t, order, axis=1)
    number = np.full(t.shape, -1, np.int64)
    begin = np.full(len(t), -math.inf)
    current = np.full(len(t), -1, np.int64)
    for k in range(t.shape[1]):
        met = np.isfinite(ranges[:, k])
        with np.errstate(invalid="ignore"):
            new = met & ~(ranges[:, k] - begin <= resolution)
        begin = np.where(new, ranges[:, k], begin)
        current = current + new
        number[met, k] = current[met]
    return _Echoes(order, ranges, number)


def _choose(
    echoes: _Echoes, cosine: Floats, returns: Returns, rng: np.random.Generator
) -> tuple[NDArray[np.int64], Floats, Floats, NDArray[np.int64], Floats]:
    """Return beam, range, share, a sub-ray and intensity of the echoes that are kept."""
    rays = echoes.order.shape[1]
    beam, column = np.nonzero(echoes.number >= 0)
    sub = echoes.order[beam, column]
    key = beam * (rays + 1) + echoes.number[beam, column]
    different, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    inverse = inverse.reshape(-1)
    n = len(different)
    power = cosine[beam, sub]
    count = np.bincount(inverse, minlength=n)
    ranges = np.bincount(inverse, echoes.ranges[beam, column], n) / np.maximum(1, count)
    intensity = np.bincount(inverse, power, n) / rays
    # The one whose surface is told, at random: the strongest would favour what faces the scanner.
    told = np.zeros(n, np.int64)
    by_chance = np.argsort(rng.random(len(sub)), kind="stable")
    told[inverse[by_chance]] = sub[by_chance]
    owner = beam[first]
    kept = np.arange(n)
    if returns != "multi" and n:
        ends = np.flatnonzero(np.diff(owner, append=-1))
        starts = np.concatenate([[0], ends[:-1] + 1])
        if returns == "first":
            kept = starts
        elif returns == "last":
            kept = ends
        else:
            ranked = np.lexsort((-intensity, owner))
            kept = ranked[starts]
    return owner[kept], ranges[kept], count[kept] / rays, told[kept], intensity[kept]


def _count_up(beam: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the numbers of echoes within their beams, from 1; beams are sorted."""
    if not len(beam):
        return beam
    new = np.concatenate([[True], beam[1:] != beam[:-1]])
    starts = np.flatnonzero(new)
    found: NDArray[np.int64] = np.arange(len(beam)) - starts[np.cumsum(new) - 1] + 1
    return found
