"""Convolution of line segments with the Cauchy and the quartic kernel, in closed form.

The field of a segment from A to B = A + L u is the integral of the kernel along it,

    F(p) = int_0^L w(t) k(|A + t u - p|) dt,     w(t) = wa + (wb - wa) t / L,

for the Cauchy kernel ``k(r) = 1 / (1 + s^2 r^2)^2`` (McCormack, Sherstyuk 1998) and the quartic
kernel ``k(r) = (1 - r^2 / R^2)^2`` for r < R, else 0; weights that vary linearly after Jin, Tai
2002. A point is given to the kernels by its axial coordinate ``x = (p - A).u`` and the square of
its distance from the segment's line, h2. With v = t - x, m = (wb - wa) / L and w_x = wa + m x,

    F = w_x I0 + m I1,    I_n = int v^n k dv,
    dF/dh2 = w_x J0 + m J1,    J_n = int v^n dk/dh2 dv,
    dF/dx = wa k(v0) - wb k(v1) + m I0,

and the gradient in space is ``dF/dx u + 2 dF/dh2 h``, h the vector from the line to the point.

Weights that let an infinitely long segment alone have the radius d: Zhu, Jin, You 2015, equations
3 and 4.
"""

from __future__ import annotations

import math
from typing import Any

from pcsg.jit import njit

# Nodes and weights of the Gauss-Legendre rule of six points on [-1, 1].
_N1, _W1 = 0.238619186083196908630501721681, 0.467913934572691047389870343990
_N2, _W2 = 0.661209386466264513661399595020, 0.360761573048138607569833513838
_N3, _W3 = 0.932469514203152027812301554494, 0.171324492379170345040296142173

_SHORT = 0.15
"""Half length over distance below which the rule of six points is exact to rounding."""

_FAR = 1e3
"""Distance in units of 1/s from which on a Cauchy segment is nothing (1e-12 of its peak)."""


@njit
def _cauchy_point(v: float, a2: float, s2: float) -> tuple[float, float]:
    """Return the Cauchy kernel and 1/D^3 at an axial offset."""
    q = 1.0 / (a2 + s2 * v * v)
    return q * q, q * q * q


@njit
def _cauchy_short(v0: float, v1: float, a2: float, s2: float) -> tuple[float, float, float, float]:
    """Return I0, I1, J0, J1 of a segment that is short for its distance, by quadrature."""
    middle, half = 0.5 * (v0 + v1), 0.5 * (v1 - v0)
    i0 = i1 = j0 = j1 = 0.0
    for node, weight in ((_N1, _W1), (_N2, _W2), (_N3, _W3)):
        for side in (-1.0, 1.0):
            v = middle + side * node * half
            k, q = _cauchy_point(v, a2, s2)
            i0 += weight * k
            i1 += weight * k * v
            j0 += weight * q
            j1 += weight * q * v
    return half * i0, half * i1, -2.0 * s2 * half * j0, -2.0 * s2 * half * j1


@njit
def _cauchy_long(v0: float, v1: float, a2: float, s: float) -> tuple[float, float, float, float]:
    """Return I0, I1, J0, J1 by their antiderivatives."""
    s2 = s * s
    a = math.sqrt(a2)
    d0, d1 = a2 + s2 * v0 * v0, a2 + s2 * v1 * v1
    # atan(s v1 / a) - atan(s v0 / a) without cancellation.
    angle = math.atan2(a * s * (v1 - v0), a2 + s2 * v0 * v1)
    i0 = 0.5 / a2 * (v1 / d1 - v0 / d0) + angle / (2.0 * a2 * a * s)
    i1 = 0.5 * (v1 - v0) * (v1 + v0) / (d0 * d1)
    j0 = v1 / (d1 * d1) - v0 / (d0 * d0)
    j0 = -0.5 * s2 / a2 * (j0 + 3.0 * i0)
    j1 = 0.5 * (1.0 / (d1 * d1) - 1.0 / (d0 * d0))
    return i0, i1, j0, j1


@njit
def cauchy_segment(
    x: float, h2: float, length: float, wa: float, wb: float, s: float
) -> tuple[float, float, float]:
    """Return F, dF/dx, dF/dh2 of a segment under the Cauchy kernel.

    Parameters
    ----------
    x, h2
        Axial coordinate of the point from the segment's start, squared distance from its line.
    length
        Of the segment, > 0.
    wa, wb
        Weights at its start and its end.
    s
        Kernel parameter, one over a length.

    Notes
    -----
    Accurate to 1e-10 relative within 100 / s of the segment, and 0 beyond 1000 / s.
    """
    v0, v1 = -x, length - x
    s2 = s * s
    a2 = 1.0 + s2 * h2
    gap = max(v0, -v1, 0.0)
    if s2 * (h2 + gap * gap) > _FAR * _FAR:
        return 0.0, 0.0, 0.0
    half, middle = 0.5 * length, 0.5 * (v0 + v1)
    if s2 * half * half < _SHORT * _SHORT * (a2 + s2 * middle * middle):
        i0, i1, j0, j1 = _cauchy_short(v0, v1, a2, s2)
    else:
        i0, i1, j0, j1 = _cauchy_long(v0, v1, a2, s)
    m = (wb - wa) / length
    wx = wa + m * x
    k0, _ = _cauchy_point(v0, a2, s2)
    k1, _ = _cauchy_point(v1, a2, s2)
    return wx * i0 + m * i1, wa * k0 - wb * k1 + m * i0, wx * j0 + m * j1


@njit
def quartic_segment(
    x: float, h2: float, length: float, wa: float, wb: float, R: float
) -> tuple[float, float, float]:
    """Return F, dF/dx, dF/dh2 of a segment under the quartic kernel of support radius R.

    Parameters as for `cauchy_segment`. All are exactly 0 farther than R from the segment.
    """
    c2 = R * R - h2
    if c2 <= 0.0:
        return 0.0, 0.0, 0.0
    c = math.sqrt(c2)
    if x <= -c or x >= length + c:
        return 0.0, 0.0, 0.0
    v0, v1 = max(-x, -c), min(length - x, c)
    r4 = 1.0 / (R * R * R * R)
    p0, p1 = v0 * v0, v1 * v1
    e0, e1 = max(c2 - p0, 0.0), max(c2 - p1, 0.0)
    i0 = v1 * (c2 * c2 - p1 * (2.0 / 3.0 * c2 - 0.2 * p1))
    i0 -= v0 * (c2 * c2 - p0 * (2.0 / 3.0 * c2 - 0.2 * p0))
    i1 = (e0 * e0 * e0 - e1 * e1 * e1) / 6.0
    j0 = -2.0 * (v1 * (c2 - p1 / 3.0) - v0 * (c2 - p0 / 3.0))
    j1 = 0.5 * (e1 * e1 - e0 * e0)
    # At a clipped end the kernel is 0, and so is e there up to rounding.
    k0 = e0 * e0 if -x > -c else 0.0
    k1 = e1 * e1 if length - x < c else 0.0
    m = (wb - wa) / length
    wx = wa + m * x
    return (
        r4 * (wx * i0 + m * i1),
        r4 * (wa * k0 - wb * k1 + m * i0),
        r4 * (wx * j0 + m * j1),
    )


def cauchy_weight(d: Any, s: Any, T: float = 1.0) -> Any:
    """Return the weight that gives a segment without ends F = T at distance d (equation 3)."""
    return 2.0 * s * T / math.pi * (1.0 + s * s * d * d) ** 1.5


def quartic_weight(d: Any, R: Any, T: float = 1.0) -> Any:
    """Return the weight that gives an infinite segment F = T at distance d < R (equation 4)."""
    return 15.0 * T * R**4 / (16.0 * (R * R - d * d) ** 2.5)
