"""Low-discrepancy numbers for every pixel, sample and purpose, from a seed.

A Z-ordered Sobol' sampler (Ahmed & Wonka 2020, *Screen-space blue-noise diffusion of Monte Carlo
sampling error via hierarchical ordering of pixels*): all pixels share one scrambled (0,2)-sequence
along the Morton curve, so neighbouring pixels and the first 4, 16, 64... samples of each pixel are
well distributed, and what noise is left is spread evenly. Every number is a pure function of its
arguments: who computes it, and when, makes no difference.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from pcsg.render.tracer import Floats, Ints

Words = NDArray[np.uint64]

MAX_SAMPLES = 1 << 14

_DIGITS = np.array(list(itertools.permutations(range(4))), dtype=np.uint64)
_WEYL = 0x9E3779B97F4A7C15


def _word(value: int) -> np.uint64:
    return np.uint64(value & 0xFFFFFFFFFFFFFFFF)


def _mix(v: Words) -> Words:
    """Return well mixed bits of 64-bit words (Steele et al. 2014, variant 13 of splitmix64)."""
    v = (v ^ (v >> _word(30))) * _word(0xBF58476D1CE4E5B9)
    v = (v ^ (v >> _word(27))) * _word(0x94D049BB133111EB)
    return v ^ (v >> _word(31))


def _separate(v: Words) -> Words:
    """Put a zero bit between the bits of 32-bit numbers."""
    for shift, mask in (
        (16, 0x0000FFFF0000FFFF),
        (8, 0x00FF00FF00FF00FF),
        (4, 0x0F0F0F0F0F0F0F0F),
        (2, 0x3333333333333333),
        (1, 0x5555555555555555),
    ):
        v = (v | (v << _word(shift))) & _word(mask)
    return v


def _superset_xor(v: Words) -> Words:
    """Multiply by Pascal's triangle modulo 2, the second Sobol' matrix.

    Entry (i, j) is binomial(j, i) mod 2, which is 1 where the bits of i are among those of j
    (Lucas), so the product is a butterfly over the six bits of the position.
    """
    for shift, mask in (
        (1, 0x5555555555555555),
        (2, 0x3333333333333333),
        (4, 0x0F0F0F0F0F0F0F0F),
        (8, 0x00FF00FF00FF00FF),
        (16, 0x0000FFFF0000FFFF),
        (32, 0x00000000FFFFFFFF),
    ):
        v = v ^ ((v >> _word(shift)) & _word(mask))
    return v


def _scrambled(v: Words, seed: np.uint32) -> Floats:
    """Owen-scramble radical inverses that are given low bit first; return them in [0, 1).

    Laine & Karras 2011 with the constants of Vegdahl 2021: bits depend on lower bits only.
    """
    x = v.astype(np.uint32)
    x ^= x * np.uint32(0x3D20ADEA)
    x += seed
    x *= (seed >> np.uint32(16)) | np.uint32(1)
    x ^= x * np.uint32(0x05526C56)
    x ^= x * np.uint32(0x53A22864)
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)):
        m = np.uint32(mask)
        s = np.uint32(shift)
        x = ((x >> s) & m) | ((x & m) << s)
    x = (x >> np.uint32(16)) | (x << np.uint32(16))
    return np.asarray(x * 2.0**-32)


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
        curve = _separate(x.astype(np.uint64)) | (_separate(y.astype(np.uint64)) << _word(1))
        curve = (curve << _word(2 * self.sample_digits)) | sample.astype(np.uint64)
        start = self.seed * 256 + purpose + 1
        keys = _mix(np.array([_word(_WEYL * start), _word(_WEYL * start + 1)]))
        index = np.zeros_like(curve)
        for k in reversed(range(self.digits)):
            digit = (curve >> _word(2 * k)) & _word(3)
            above = curve >> _word(2 * k + 2)
            which = (_mix(above ^ keys[0]) >> _word(24)) % _word(24)
            index |= _DIGITS.ravel()[which * _word(4) + digit] << _word(2 * k)
        result = np.empty((len(index), 2))
        first, second = keys.astype(np.uint32)
        result[:, 0] = _scrambled(index, first)
        result[:, 1] = _scrambled(_superset_xor(index), second)
        return result


def disc_cone(pairs: Floats, axis: Floats, cos_angle: float) -> Floats:
    """Return (N, 3) unit vectors uniform in the cone of a half angle about a unit axis."""
    z = 1.0 - pairs[:, 0] * (1.0 - cos_angle)
    return _around(np.broadcast_to(axis, (len(pairs), 3)), z, pairs[:, 1])


def cosine_hemisphere(pairs: Floats, normals: Floats) -> Floats:
    """Return (N, 3) unit vectors about unit normals with density cos / pi."""
    return _around(normals, np.sqrt(1.0 - pairs[:, 0]), pairs[:, 1])


def sphere(pairs: Floats) -> Floats:
    """Return (N, 3) unit vectors in uniform directions."""
    axis = np.array([[0.0, 0.0, 1.0]])
    return _around(np.broadcast_to(axis, (len(pairs), 3)), 1.0 - 2.0 * pairs[:, 0], pairs[:, 1])


def _around(axes: Floats, z: Floats, turn: Floats) -> Floats:
    """Return unit vectors of given cosines and angles (in turns) about unit axes."""
    # The frame of Duff et al. 2017 has no singular direction.
    sign = np.copysign(1.0, axes[:, 2])
    a = -1.0 / (sign + axes[:, 2])
    b = axes[:, 0] * axes[:, 1] * a
    radius = np.sqrt(np.maximum(0.0, 1.0 - z * z))
    u = radius * np.cos(2 * np.pi * turn)
    v = radius * np.sin(2 * np.pi * turn)
    result = z[:, None] * axes
    result[:, 0] += u * (1.0 + sign * axes[:, 0] ** 2 * a) + v * b
    result[:, 1] += u * sign * b + v * (sign + axes[:, 1] ** 2 * a)
    result[:, 2] += -u * sign * axes[:, 0] - v * axes[:, 1]
    return np.asarray(result)
