"""Stands whose answers are known: discs at random, crowns, plates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import pcsg

LEAF = 1
"""Label of leaves."""

Floats = np.ndarray


def normals_of(kind: str, n: int, rng: np.random.Generator) -> Floats:
    """Return normals of leaves, float64 (n, 3), azimuths alike.

    The classical densities of the inclination a (de Wit 1965): planophile 2/pi (1 + cos 2a),
    erectophile 2/pi (1 - cos 2a), plagiophile 2/pi (1 - cos 4a), spherical sin a, horizontal.
    """
    if kind == "horizontal":
        a = np.zeros(n)
    elif kind == "spherical":
        a = np.arccos(rng.random(n))
    else:
        sign, times = {"planophile": (1, 2), "erectophile": (-1, 2), "plagiophile": (-1, 4)}[kind]
        grid = np.linspace(0.0, 0.5 * math.pi, 20_001)
        share = 2.0 / math.pi * (grid + sign * np.sin(times * grid) / times)
        a = np.interp(rng.random(n), share, grid)
    turn = 2.0 * math.pi * rng.random(n)
    return np.stack([np.sin(a) * np.cos(turn), np.sin(a) * np.sin(turn), np.cos(a)], axis=-1)


def discs(points: Floats, normals: Floats, radius: float | Floats) -> Any:
    """Return discs as a node."""
    table = dict(zip(("x", "y", "z", "nx", "ny", "nz"), [*points.T, *normals.T], strict=True))
    table["scale"] = np.broadcast_to(np.asarray(radius, float), len(points)).copy()
    return pcsg.scatter(pcsg.label(LEAF) * pcsg.disc(), table)


def slab(
    kind: str, lai: float, n: int = 40_000, radius: float = 0.01, seed: int = 1, height: float = 0
) -> tuple[pcsg.Scene, tuple[float, float, float, float]]:
    """Return discs at random in a periodic slab, and its cell."""
    rng = np.random.default_rng(seed)
    side = math.sqrt(n * math.pi * radius**2 / lai)
    # So thin that foliage is dilute: a hundredth of a leaf in a cube of a leaf's size.
    height = height or n * (2 * radius) ** 3 / (0.1 * side * side)
    points = rng.random((n, 3)) * (side, side, height)
    scene = pcsg.Scene(discs(points, normals_of(kind, n, rng), radius))
    return scene, (0.0, 0.0, side, side)


def ball(tau: float, n: int = 100_000, radius: float = 1.0, seed: int = 1) -> pcsg.Scene:
    """Return a spherical crown of spherical leaves with an optical diameter."""
    rng = np.random.default_rng(seed)
    points = radius * rng.random((n, 1)) ** (1 / 3) * normals_on_ball(n, rng)
    # Optical diameter: G u d with G = 1/2, u leaf area in a volume.
    density = tau / (0.5 * 2.0 * radius)
    leaf = math.sqrt(density * 4.0 / 3.0 * math.pi * radius**3 / (n * math.pi))
    return pcsg.Scene(discs(points, normals_of("spherical", n, rng), leaf))


def normals_on_ball(n: int, rng: np.random.Generator) -> Floats:
    """Return directions alike over the ball."""
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def forest_of_balls(
    seed: int = 4,
) -> tuple[pcsg.Scene, tuple[float, float, float, float]]:
    """Return fifteen spherical crowns in a periodic cell, and the cell.

    Radius 5 m, centres 7 to 11 m high, 50,000 discs of radius 0.05 m each, cover 0.3; none overlap.
    """
    rng = np.random.default_rng(seed)
    crowns, n, radius = 15, 50_000, 5.0
    side = math.sqrt(crowns * math.pi * radius**2 / 0.3)
    places: list[Floats] = []
    while len(places) < crowns:
        p = rng.random(3) * (side, side, 4.0) + (0.0, 0.0, 7.0)
        apart = [p - q for q in places]
        for d in apart:
            d[:2] -= side * np.round(d[:2] / side)
        if all(np.linalg.norm(d) >= 2.0 * radius for d in apart):
            places.append(p)
    points = (radius - 0.05) * rng.random((n, 1)) ** (1 / 3) * normals_on_ball(n, rng)
    crown = pcsg.S("CROWN", 1).rule(1, discs(points, normals_of("spherical", n, rng), 0.05))
    x, y, z = np.array(places).T
    stand = pcsg.scatter(crown, {"x": x, "y": y, "z": z}, name="STAND")
    return pcsg.Scene(stand | pcsg.uscale(1e-6) * pcsg.disc()), (0.0, 0.0, side, side)


def trillion(leaves: int) -> tuple[pcsg.Scene, tuple[float, float, float, float], float]:
    """Return a stand of about so many discs, a plot in its middle, and its leaf area index.

    One cell of 20,000 discs is doubled in x and y in turn: its states are as many as the doublings.
    """
    n, radius, lai = 20_000, 0.02, 2.0
    rng = np.random.default_rng(2)
    side = math.sqrt(n * math.pi * radius**2 / lai)
    points = rng.random((n, 3)) * (side, side, 4.0)
    cell = pcsg.S("CELL", 1).rule(1, discs(points, normals_of("spherical", n, rng), radius))
    doublings = max(2, round(math.log2(leaves / n)))
    node: Any = cell
    sides = [side, side]
    for k in range(doublings):
        shift = [0.0, 0.0]
        shift[k % 2] = sides[k % 2]
        sides[k % 2] *= 2.0
        # A module each: what it holds is known once.
        node = pcsg.S(f"DOUBLE{k}", 1).rule(1, node | pcsg.move(*shift, 0.0) * node)
    middle = side * math.floor(0.5 * sides[0] / side), side * math.floor(0.5 * sides[1] / side)
    plot = (middle[0], middle[1], middle[0] + side, middle[1] + side)
    return pcsg.Scene(node), plot, lai
