"""Segment integrals against adaptive quadrature, gradients against differences."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pcsg.blobtree.convolution import (
    cauchy_segment,
    cauchy_weight,
    quartic_segment,
    quartic_weight,
)

scipy_integrate = pytest.importorskip("scipy.integrate", reason="needs the extra `mesh`")

Segment = Callable[..., tuple[float, float, float]]


def cauchy(r2: float, s: float) -> float:
    return 1.0 / (1.0 + s * s * r2) ** 2


def quartic(r2: float, R: float) -> float:
    return max(0.0, 1.0 - r2 / (R * R)) ** 2


def quadrature(
    kernel: Any, x: float, h2: float, length: float, wa: float, wb: float, k: float
) -> float:
    """Integrate piece by piece: a kernel is smooth between the foot point and its supports."""
    reach = math.sqrt(max(k * k - h2, 0.0)) if kernel is quartic else 0.0
    inner = [x - reach, x - 1 / k, x, x + 1 / k, x + reach]
    cuts = sorted({0.0, length, *(t for t in inner if 0.0 < t < length)})

    def integrand(t: float) -> float:
        return float((wa + (wb - wa) * t / length) * kernel((t - x) ** 2 + h2, k))

    return math.fsum(
        scipy_integrate.quad(integrand, a, b, epsabs=0.0, epsrel=1e-12, limit=200)[0]
        for a, b in itertools.pairwise(cuts)
        if any(integrand(a + f * (b - a)) != 0.0 for f in (0.1, 0.5, 0.9))
    )


KERNELS = [(cauchy_segment, cauchy), (quartic_segment, quartic)]
lengths = st.floats(0.05, 40.0)
weights = st.floats(0.1, 5.0)


@pytest.mark.parametrize(("segment", "kernel"), KERNELS, ids=["cauchy", "quartic"])
@given(length=lengths, wa=weights, wb=weights, k=st.floats(0.3, 4.0), data=st.data())
def test_segment_is_the_integral(
    segment: Segment, kernel: Any, length: float, wa: float, wb: float, k: float, data: Any
) -> None:
    reach = 20.0 / k if kernel is cauchy else 0.95 * k
    x = data.draw(st.floats(-reach, length + reach))
    h = data.draw(st.floats(0.0, reach))
    expected = quadrature(kernel, x, h * h, length, wa, wb, k)
    found = segment(x, h * h, length, wa, wb, k)[0]
    # A point that sees a sliver of the support only measures the rounding of R^2 - h^2.
    assert found == pytest.approx(expected, rel=1e-10, abs=1e-10 if kernel is quartic else 1e-300)


@pytest.mark.parametrize(("segment", "kernel"), KERNELS, ids=["cauchy", "quartic"])
@given(length=lengths, wa=weights, wb=weights, k=st.floats(0.3, 4.0), data=st.data())
def test_derivatives_are_those_of_the_field(
    segment: Segment, kernel: Any, length: float, wa: float, wb: float, k: float, data: Any
) -> None:
    reach = 10.0 / k if kernel is cauchy else 0.9 * k
    x = data.draw(st.floats(-reach, length + reach))
    h2 = data.draw(st.floats(0.01, reach)) ** 2
    F, dx, dh2 = segment(x, h2, length, wa, wb, k)
    e = 1e-5 * reach
    by_x = (segment(x + e, h2, length, wa, wb, k)[0] - segment(x - e, h2, length, wa, wb, k)[0]) / (
        2 * e
    )
    f = 1e-5 * reach * reach  # the field goes on smoothly to negative h2
    by_h2 = (
        segment(x, h2 + f, length, wa, wb, k)[0] - segment(x, h2 - f, length, wa, wb, k)[0]
    ) / (2 * f)
    scale = max(abs(F), 1e-3) / reach
    assert dx == pytest.approx(by_x, rel=1e-5, abs=1e-5 * scale)
    assert dh2 == pytest.approx(by_h2, rel=1e-4, abs=1e-4 * scale / reach)


@pytest.mark.parametrize("d", [0.01, 0.3, 5.0])
@pytest.mark.parametrize("kappa", [1.0, 2.0, 3.0, 5.0])
def test_long_segment_has_its_radius(d: float, kappa: float) -> None:
    length = 2000 * d
    w = cauchy_weight(d, kappa / d)
    assert cauchy_segment(length / 2, d * d, length, w, w, kappa / d)[0] == pytest.approx(
        1.0, abs=1e-6
    )
    w = quartic_weight(d, 2 * d, T=0.5)
    assert quartic_segment(length / 2, d * d, length, w, w, 2 * d)[0] == pytest.approx(
        0.5, abs=1e-14
    )


def test_far_segments_count_for_nothing_and_near_ones_join() -> None:
    assert cauchy_segment(-2000.0, 0.0, 1.0, 1.0, 1.0, 1.0) == (0.0, 0.0, 0.0)
    assert quartic_segment(0.5, 1.0, 1.0, 1.0, 1.0, 1.0) == (0.0, 0.0, 0.0)
    assert quartic_segment(-1.0, 0.0, 1.0, 1.0, 1.0, 1.0) == (0.0, 0.0, 0.0)
    for segment in (cauchy_segment, quartic_segment):
        parts = segment(0.3, 0.2, 0.6, 1.0, 1.6, 1.5)[0] + segment(-0.3, 0.2, 0.4, 1.6, 2.0, 1.5)[0]
        assert parts == pytest.approx(segment(0.3, 0.2, 1.0, 1.0, 2.0, 1.5)[0], rel=1e-13)


def test_the_quadrature_notices_a_wrong_kernel() -> None:
    right = quadrature(cauchy, 0.4, 0.3, 1.0, 1.0, 2.0, 1.5)
    assert np.isfinite(right)
    assert quadrature(cauchy, 0.4, 0.3, 1.0, 1.0, 2.0, 1.51) != pytest.approx(right, rel=1e-6)
