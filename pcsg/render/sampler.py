"""Low-discrepancy numbers for every pixel, sample and purpose, from a seed.

A Z-ordered Sobol' sampler (Ahmed & Wonka 2020, *Screen-space blue-noise diffusion of Monte Carlo
sampling error via hierarchical ordering of pixels*): all pixels share one scrambled (0,2)-sequence
along the Morton curve, so neighbouring pixels and the first 4, 16, 64... samples of each pixel are
well distributed, and what noise is left is spread evenly. Every number is a pure function of its
arguments: who computes it, and when, makes no difference.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit, plain
from pcsg.render.tracer import Floats, Ints

Words = NDArray[np.uint64]

MAX_SAMPLES = 1 << 14

_DIGITS = np.array(list(itertools.permutations(range(4))), dtype=np.uint64).ravel()
_WEYL = 0x9E3779B97F4A7C15


@njit
def _mix(v: Any) -> Any:
    """Return well mixed bits of a 64-bit word (Steele et al. 2014, variant 13 of splitmix64)."""
    v = (v ^ (v >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    v = (v ^ (v >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return v ^ (v >> np.uint64(31))


@njit
def _separate(v: Any) -> Any:
    """Put a zero bit between the bits of a 32-bit number."""
    v = (v | (v << np.uint64(16))) & np.uint64(0x0000FFFF0000FFFF)
    v = (v | (v << np.uint64(8))) & np.uint64(0x00FF00FF00FF00FF)
    v = (v | (v << np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    v = (v | (v << np.uint64(2))) & np.uint64(0x3333333333333333)
    return (v | (v << np.uint64(1))) & np.uint64(0x5555555555555555)


@njit
def _superset_xor(v: Any) -> Any:
    """Multiply by Pascal's triangle modulo 2, the second Sobol' matrix.

    Entry (i, j) is binomial(j, i) mod 2, which is 1 where the bits of i are among those of j
    (Lucas), so the product is a butterfly over the six bits of the position.
    """
    v = v ^ ((v >> np.uint64(1)) & np.uint64(0x5555555555555555))
    v = v ^ ((v >> np.uint64(2)) & np.uint64(0x3333333333333333))
    v = v ^ ((v >> np.uint64(4)) & np.uint64(0x0F0F0F0F0F0F0F0F))
    v = v ^ ((v >> np.uint64(8)) & np.uint64(0x00FF00FF00FF00FF))
    v = v ^ ((v >> np.uint64(16)) & np.uint64(0x0000FFFF0000FFFF))
    return v ^ ((v >> np.uint64(32)) & np.uint64(0x00000000FFFFFFFF))


@njit
def _scrambled(v: Any, key: Any) -> float:
    """Owen-scramble a radical inverse that is given low bit first; return it in [0, 1).

    Laine & Karras 2011 with the constants of Vegdahl 2021: bits depend on lower bits only.
    """
    low = np.uint64(0xFFFFFFFF)
    x, seed = v & low, key & low
    x ^= (x * np.uint64(0x3D20ADEA)) & low
    x = (x + seed) & low
    x = (x * ((seed >> np.uint64(16)) | np.uint64(1))) & low
    x ^= (x * np.uint64(0x05526C56)) & low
    x ^= (x * np.uint64(0x53A22864)) & low
    x = ((x >> np.uint64(1)) & np.uint64(0x55555555)) | (
        (x & np.uint64(0x55555555)) << np.uint64(1)
    )
    x = ((x >> np.uint64(2)) & np.uint64(0x33333333)) | (
        (x & np.uint64(0x33333333)) << np.uint64(2)
    )
    x = ((x >> np.uint64(4)) & np.uint64(0x0F0F0F0F)) | (
        (x & np.uint64(0x0F0F0F0F)) << np.uint64(4)
    )
    x = ((x >> np.uint64(8)) & np.uint64(0x00FF00FF)) | (
        (x & np.uint64(0x00FF00FF)) << np.uint64(8)
    )
    x = ((x >> np.uint64(16)) | (x << np.uint64(16))) & low
    return float(np.int64(x)) * 2.0**-32


@njit(entry=True)
def _fill_pairs(
    x: Ints,
    y: Ints,
    sample: Ints,
    sample_digits: int,
    digits: int,
    keys: Words,
    permutations: Words,
    out: Floats,
) -> None:
    """Write the pairs of pixels and samples to out (N, 2)."""
    for k in range(len(x)):
        curve = _separate(np.uint64(x[k])) | (_separate(np.uint64(y[k])) << np.uint64(1))
        curve = (curve << np.uint64(2 * sample_digits)) | np.uint64(sample[k])
        # Every digit in base 4 is permuted by the digits above it: a shuffle that keeps the order.
        index = np.uint64(0)
        for place in range(digits):
            shift = np.uint64(2 * place)
            digit = (curve >> shift) & np.uint64(3)
            above = curve >> (shift + np.uint64(2))
            which = (_mix(above ^ keys[0]) >> np.uint64(24)) % np.uint64(24)
            index |= permutations[np.int64(which * np.uint64(4) + digit)] << shift
        out[k, 0] = _scrambled(index, keys[0])
        out[k, 1] = _scrambled(_superset_xor(index), keys[1])


class Sampler:
    """Pairs of numbers in [0, 1).

    Parameters
    ----------
    size
        Width and height of the picture.
    samples
        Largest number of samples per pixel.
    seed
        Another seed gives other numbers.
    """

    def __init__(self, size: tuple[int, int], samples: int, seed: int) -> None:
        levels = (max(max(size) - 1, 1)).bit_length()
        # At least four numbers per pixel, also where a single sample needs several.
        self.sample_digits = max(((samples - 1).bit_length() + 1) // 2, 1)
        self.digits = levels + self.sample_digits
        self.seed = seed

    def pairs(self, x: Ints, y: Ints, sample: Ints, purpose: int) -> Floats:
        """Return (N, 2) numbers.

        Parameters
        ----------
        x, y
            (N,) pixels.
        sample
            (N,) which sample of the pixel.
        purpose
            What the numbers are for: numbers of different purposes are independent.
        """
        out = np.empty((len(x), 2))
        keys = self.keys(purpose)
        _fill_pairs(x, y, sample, self.sample_digits, self.digits, keys, _DIGITS, out)
        return out

    def keys(self, purpose: int) -> Words:
        """Return the (2,) words that scramble the numbers of a purpose."""
        start = (self.seed * 4096 + purpose + 1) * _WEYL
        low = 0xFFFFFFFFFFFFFFFF
        words = np.array([start & low, (start + 1) & low], dtype=np.uint64)
        mixed: Words = plain(_mix)(words)
        return mixed


def disc_cone(pairs: Floats, axis: Floats, cos_angle: float) -> Floats:
    """Return (N, 3) unit vectors uniform in the cone of a half angle about a unit axis."""
    z = 1.0 - pairs[:, 0] * (1.0 - cos_angle)
    return around(axis[None, :], z, pairs[:, 1])


def cosine_hemisphere(pairs: Floats, normals: Floats) -> Floats:
    """Return (N, 3) unit vectors about unit normals with density cos / pi."""
    return around(normals, np.sqrt(1.0 - pairs[:, 0]), pairs[:, 1])


def sphere(pairs: Floats) -> Floats:
    """Return (N, 3) unit vectors in uniform directions."""
    axis = np.array([[0.0, 0.0, 1.0]])
    return around(axis, 1.0 - 2.0 * pairs[:, 0], pairs[:, 1])


@njit(entry=True)
def _fill_around(axes: Floats, z: Floats, turn: Floats, out: Floats) -> None:
    """Write what `around` returns; there may be a single axis for all."""
    for i in range(len(z)):
        k = i if len(axes) > 1 else 0
        ax, ay, az = axes[k, 0], axes[k, 1], axes[k, 2]
        # The frame of Duff et al. 2017 has no singular direction.
        sign = math.copysign(1.0, az)
        a = -1.0 / (sign + az)
        b = ax * ay * a
        radius = math.sqrt(max(0.0, 1.0 - z[i] * z[i]))
        u = radius * math.cos(2 * math.pi * turn[i])
        v = radius * math.sin(2 * math.pi * turn[i])
        out[i, 0] = z[i] * ax + u * (1.0 + sign * ax * ax * a) + v * b
        out[i, 1] = z[i] * ay + u * sign * b + v * (sign + ay * ay * a)
        out[i, 2] = z[i] * az - u * sign * ax - v * ay


def around(axes: Floats, z: Floats, turn: Floats) -> Floats:
    """Return unit vectors of given cosines and angles (in turns) about unit axes, or one axis."""
    result = np.empty((len(z), 3))
    axes, z, turn = (np.ascontiguousarray(values) for values in (axes, z, turn))
    _fill_around(axes, z, turn, result)
    return result
