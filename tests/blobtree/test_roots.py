"""No root is missed and none is made up: rays, half of them grazing, against dense sampling."""

from __future__ import annotations

import numpy as np
import pytest
from blob_models import kinds_to_cover, random_rays
from count_roots import find_wrong, run_model, some_model
from field_oracle import value

RAYS = 5
"""Rays of each model; `count_roots.py` shoots as many as one likes."""


@pytest.mark.parametrize("kinds", kinds_to_cover(), ids="-".join)
def test_fields_and_roots_are_those_of_the_formulas(kinds: tuple[str, ...]) -> None:
    root, model = some_model(kinds, 1)
    rng = np.random.default_rng(2)
    low, high = model.support
    points = rng.uniform(low - 0.1, high + 0.1, (500, 3))
    np.testing.assert_allclose(model.field(points), value(root, points), rtol=0.0, atol=1e-12)
    assert find_wrong(root, model, rng, RAYS) == []


@pytest.mark.parametrize("kinds", kinds_to_cover()[::3], ids="-".join)
def test_gradients_are_differences(kinds: tuple[str, ...]) -> None:
    _root, model = some_model(kinds, 3)
    rng = np.random.default_rng(4)
    low, high = model.support
    points = rng.uniform(low, high, (300, 3))
    h = 1e-6
    ends = points[:, None, :] + h * np.concatenate([np.eye(3), -np.eye(3)])
    f = model.field(ends.reshape(-1, 3)).reshape(-1, 6)
    numeric = (f[:, :3] - f[:, 3:]) / (2.0 * h)
    error = np.abs(numeric - model.gradient(points)).max(axis=1)
    # On a crease there is none; few points lie within h of one.
    assert (error < 1e-4).mean() > 0.97


def test_first_and_any_are_among_all() -> None:
    _root, model = some_model(("pcm", "bend"), 5)
    o, d = random_rays(np.random.default_rng(6), model, 300)
    counts, t = model.shoot(o, d)
    lists = np.split(t, np.cumsum(counts)[:-1])
    for low, high in ((-np.inf, np.inf), (0.0, np.inf), (0.7, 1.9)):
        first = model.intersect(o, d, low, high)
        inside = [r[(r >= low) & (r <= high)] for r in lists]
        expected = np.array([r[0] if len(r) else np.inf for r in inside])
        np.testing.assert_allclose(first, expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(model.occluded(o, d, low, high), np.isfinite(expected))


def test_an_even_number_of_crossings_and_midpoints_inside() -> None:
    _root, model = some_model(("gbb",), 7)
    o, d = random_rays(np.random.default_rng(8), model, 200)
    counts, t = model.shoot(o, d)
    assert not np.any(counts % 2)
    rays = np.repeat(np.arange(len(o)), counts)[::2]
    middles = 0.5 * (t[::2] + t[1::2])
    long = t[1::2] - t[::2] > 1e-6
    assert np.all(model.contains((o[rays] + middles[:, None] * d[rays])[long]))


@pytest.mark.parametrize("number", range(5))
def test_the_long_run_begins_without_a_wrong_ray(number: int) -> None:
    assert run_model((number, 1, 5)) == []
