"""No root is missed and none is made up: rays, half of them grazing, against dense sampling."""

from __future__ import annotations

import numpy as np
import pytest
from blob_models import kinds_to_cover, random_model, random_rays, tangent_scale
from field_oracle import T, find_roots, value

from pcsg.blobtree.model import Model
from pcsg.blobtree.nodes import Field
from pcsg.errors import UsageError

RAYS = 5
"""Rays of each model; more of them with another number here."""


def some_model(kinds: tuple[str, ...], seed: int) -> tuple[Field, Model]:
    """A model that exists: random bends may be too much for what is bent."""
    for attempt in range(100):
        try:
            root = random_model(np.random.default_rng([seed, attempt]), kinds)
            model = Model(root)
        except UsageError:
            continue
        if model.primitives:
            return root, model
    raise AssertionError(kinds)


def without_short(roots: np.ndarray, shortest: float) -> np.ndarray:
    """Drop pairs of roots closer than this: chords too short to count."""
    kept: list[float] = []
    for root in roots:
        if kept and root - kept[-1] < shortest:
            kept.pop()
        else:
            kept.append(float(root))
    return np.array(kept)


def count_wrong(root: Field, model: Model, rng: np.random.Generator, rays: int) -> int:
    """Return how many rays meet other roots than the formulas have."""
    origins, directions = random_rays(rng, model, rays)
    counts, t = model.shoot(origins, directions)
    size = tangent_scale(model)
    middle = model.support.mean(axis=0)
    wrong = 0
    for o, d, found in zip(origins, directions, np.split(t, np.cumsum(counts)[:-1]), strict=True):
        speed = float(np.linalg.norm(d))
        near, reach = float((middle - o) @ d) / speed**2, size / speed

        def g(s: np.ndarray, o: np.ndarray = o, d: np.ndarray = d) -> np.ndarray:
            return value(root, o + s[:, None] * d) - T

        expected = without_short(find_roots(g, near - reach, near + reach), 2e-7 * reach)
        found = without_short(found, 2e-7 * reach)
        if len(expected) != len(found) or np.any(np.abs(expected - found) > 1e-6 * reach):
            wrong += 1
    return wrong


@pytest.mark.parametrize("kinds", kinds_to_cover(), ids="-".join)
def test_fields_and_roots_are_those_of_the_formulas(kinds: tuple[str, ...]) -> None:
    root, model = some_model(kinds, 1)
    rng = np.random.default_rng(2)
    low, high = model.support
    points = rng.uniform(low - 0.1, high + 0.1, (500, 3))
    np.testing.assert_allclose(model.field(points), value(root, points), rtol=0.0, atol=1e-12)
    assert count_wrong(root, model, rng, RAYS) == 0


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
