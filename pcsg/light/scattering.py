"""What light does at surfaces: bi-Lambertian leaves, Lambertian soil, Russian roulette."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FAINT = 0.1
"""Below this share of what it had, a ray goes on by chance only."""


def frame_about(normals: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors across each of unit normals, float64 (N, 3) each.

    Duff et al. 2017, "Building an orthonormal basis, revisited".
    """
    nx, ny, nz = normals.T
    sign = np.copysign(1.0, nz)
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    first = np.stack([1.0 + sign * nx * nx * a, sign * b, -sign * nx], axis=-1)
    return first, np.stack([b, sign + ny * ny * a, -ny], axis=-1)


def scatter_about(normals: Floats, u: Floats) -> Floats:
    """Return directions about normals with the density cos / pi, float64 (N, 3).

    Parameters
    ----------
    normals : float64 (N, 3)
        Unit.
    u : float64 (N, 2)
        Uniform in [0, 1).
    """
    r, angle = np.sqrt(u[:, 0]), 2.0 * np.pi * u[:, 1]
    x, y, z = r * np.cos(angle), r * np.sin(angle), np.sqrt(1.0 - u[:, 0])
    first, second = frame_about(normals)
    found: Floats = x[:, None] * first + y[:, None] * second + z[:, None] * normals
    return found


def scatter_at_leaves(
    directions: Floats, normals: Floats, weights: Floats, rho: Floats, tau: Floats, u: Floats
) -> tuple[Floats, Floats]:
    """Return directions and weights behind a bi-Lambertian leaf.

    A ray is reflected or passes, in proportion to what of all its bands is; weights keep every
    band's mean.

    Parameters
    ----------
    directions, normals : float64 (N, 3)
        Either side of the leaf.
    weights, rho, tau : float64 (N, B)
    u : float64 (N, 3)
        Uniform in [0, 1).
    """
    facing = np.where(
        (np.einsum("ij,ij->i", directions, normals) < 0.0)[:, None], normals, -normals
    )
    back, through = (weights * rho).sum(axis=1), (weights * tau).sum(axis=1)
    total = back + through
    share = np.divide(back, total, out=np.ones_like(total), where=total > 0.0)
    reflected = u[:, 0] < share
    side = np.where(reflected[:, None], facing, -facing)
    chance = np.where(reflected, share, 1.0 - share)
    factor = np.where(reflected[:, None], rho, tau) / np.maximum(chance, 1e-300)[:, None]
    return scatter_about(side, u[:, 1:]), weights * factor


def roulette(weights: Floats, start: Floats, u: Floats) -> Floats:
    """Return weights of rays, some of which end and others stand for them, without bias.

    Parameters
    ----------
    weights : float64 (N, B)
    start : float64 (N,)
        What the rays had.
    u : float64 (N,)
        Uniform in [0, 1).
    """
    chance = np.minimum(1.0, weights.max(axis=1) / (FAINT * start))
    lives = u < chance
    found: Floats = np.where(lives[:, None], weights / np.maximum(chance, 1e-300)[:, None], 0.0)
    return found
