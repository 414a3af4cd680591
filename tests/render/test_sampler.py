import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pcsg.render.sampler import Sampler, cosine_hemisphere, disc_cone


def pairs_of(pixel, count, *, samples=64, seed=1, purpose=0):
    sampler = Sampler((100, 80), samples, seed)
    x, y = np.full(count, pixel[0]), np.full(count, pixel[1])
    return sampler.pairs(x, y, np.arange(count), purpose)


@pytest.mark.parametrize("count", [4, 16, 64])
@pytest.mark.parametrize("pixel", [(0, 0), (17, 5), (99, 79)])
def test_the_first_samples_of_a_pixel_are_stratified(count, pixel):
    pairs = pairs_of(pixel, count)
    assert ((pairs >= 0) & (pairs < 1)).all()
    side = round(count**0.5)
    # A (0,2)-sequence: one sample in each cell of every shape of grid.
    for columns, rows in ((count, 1), (side, side), (1, count)):
        cells = np.floor(pairs[:, 0] * columns) * rows + np.floor(pairs[:, 1] * rows)
        assert len(set(cells)) == count


def test_neighbouring_pixels_are_stratified_together():
    sampler = Sampler((64, 64), 1, 3)
    y, x = (v.ravel() for v in np.mgrid[0:8, 0:8])
    pairs = sampler.pairs(x, y, np.zeros(64, dtype=np.int64), 0)
    cells = np.floor(pairs * 8) @ [8, 1]
    assert len(set(cells)) >= 40  # 64 random points fill 41 cells on average with far more scatter
    assert abs(pairs.mean() - 0.5) < 0.03


def test_numbers_are_pure_functions():
    whole = pairs_of((3, 4), 16)
    sampler = Sampler((100, 80), 64, 1)
    single = sampler.pairs(np.array([3]), np.array([4]), np.array([7]), 0)
    assert (single == whole[7]).all()


def test_seed_purpose_and_pixel_change_the_numbers():
    reference = pairs_of((3, 4), 16)
    for other in (
        pairs_of((3, 4), 16, seed=2),
        pairs_of((3, 4), 16, seed=-1),
        pairs_of((3, 4), 16, purpose=1),
        pairs_of((4, 3), 16),
    ):
        assert (np.abs(other - reference) > 1e-6).all()


def test_directions_have_their_distributions():
    pairs = pairs_of((1, 2), 4096, samples=4096)
    axis = np.array([0.6, 0.0, -0.8])
    about = np.broadcast_to(axis, (4096, 3))
    hemisphere = cosine_hemisphere(pairs, about)
    np.testing.assert_allclose(np.linalg.norm(hemisphere, axis=1), 1)
    assert (hemisphere @ axis).min() >= -1e-12
    np.testing.assert_allclose(hemisphere.mean(axis=0), axis * 2 / 3, atol=0.01)
    cone = disc_cone(pairs, axis, 0.9)
    assert (cone @ axis).min() >= 0.9 - 1e-12
    np.testing.assert_allclose((cone @ axis).mean(), 0.95, atol=1e-3)


def naive_pair(x, y, sample, sampler, purpose):
    """The same numbers in whole numbers of Python, digit by digit, as the paper describes them."""
    morton = sum(((x >> k) & 1) << 2 * k | ((y >> k) & 1) << 2 * k + 1 for k in range(20))
    curve = morton << 2 * sampler.sample_digits | sample
    low64, low32 = (1 << 64) - 1, (1 << 32) - 1

    def mix(v):
        v = (v ^ v >> 30) * 0xBF58476D1CE4E5B9 & low64
        v = (v ^ v >> 27) * 0x94D049BB133111EB & low64
        return v ^ v >> 31

    keys = [
        mix(((sampler.seed * 4096 + purpose + 1) * 0x9E3779B97F4A7C15 + k) & low64) for k in (0, 1)
    ]
    orders = list(itertools.permutations(range(4)))
    index = 0
    for place in range(sampler.digits):
        which = (mix(curve >> 2 * place + 2 ^ keys[0]) >> 24) % 24
        index |= orders[which][curve >> 2 * place & 3] << 2 * place
    # The second Sobol' matrix is Pascal's triangle modulo 2.
    second = 0
    for i in range(64):
        odd = [j for j in range(i, 64) if j & i == i and index >> j & 1]
        second |= (len(odd) & 1) << i

    def scramble(v, seed):
        v, seed = v & low32, seed & low32
        v ^= v * 0x3D20ADEA & low32
        v = (v + seed) & low32
        v = v * (seed >> 16 | 1) & low32
        v ^= v * 0x05526C56 & low32
        v ^= v * 0x53A22864 & low32
        return int(f"{v:032b}"[::-1], 2) / 2**32

    return scramble(index, keys[0]), scramble(second, keys[1])


@given(
    st.integers(0, 999),
    st.integers(0, 999),
    st.integers(0, 63),
    st.integers(-5, 10**6),
    st.integers(0, 2000),
)
def test_the_kernel_does_what_the_paper_says(x, y, sample, seed, purpose):
    sampler = Sampler((1000, 1000), 64, seed)
    found = sampler.pairs(np.array([x]), np.array([y]), np.array([sample]), purpose)[0]
    assert tuple(found) == naive_pair(x, y, sample, sampler, purpose)
