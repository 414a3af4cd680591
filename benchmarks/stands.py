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
