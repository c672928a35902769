"""Random numbers without a generator."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from crowdsim.crowd.random import Purpose, normal, uniform

MASK = 2**64 - 1
GOLDEN = 0x9E3779B97F4A7C15


def naive_mix(bits: int) -> int:
    bits = ((bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    bits = ((bits ^ (bits >> 27)) * 0x94D049BB133111EB) & MASK
    return bits ^ (bits >> 31)


def naive_uniform(seed: int, purpose: int, avatar: int, draw: int) -> float:
    start = naive_mix((naive_mix((seed + GOLDEN) & MASK) + purpose * GOLDEN) & MASK)
    bits = naive_mix((start + (avatar + 1) * GOLDEN) & MASK)
    return (naive_mix((bits + (draw + 1) * GOLDEN) & MASK) >> 11) * 2.0**-53


@given(st.integers(0, MASK), st.sampled_from(Purpose), st.integers(0, 2**31), st.integers(0, 2**40))
def test_numpy_draws_as_written_in_integers(seed, purpose, avatar, draw):
    assert float(uniform(seed, purpose, avatar, draw)) == naive_uniform(seed, purpose, avatar, draw)


def test_draws_are_evenly_spread_along_each_argument():
    many = np.arange(200_000)
    for numbers in (
        uniform(1, 1, many),
        uniform(1, 1, 0, many),
        np.array([uniform(seed, 1, 0) for seed in range(5000)]),
    ):
        counts = np.histogram(numbers, bins=50, range=(0, 1))[0]
        expected = len(numbers) / 50
        assert ((counts - expected) ** 2 / expected).sum() < 90  # chi-squared with 49 degrees, p = 0.0003
        assert abs(np.corrcoef(numbers[:-1], numbers[1:])[0, 1]) < 4 / np.sqrt(len(numbers))


def test_seeds_purposes_avatars_and_draws_do_not_repeat_each_other():
    few = [uniform(seed, purpose, np.arange(64)[:, None], np.arange(64)) for seed in range(4) for purpose in Purpose]
    assert len(np.unique(np.concatenate([numbers.ravel() for numbers in few]))) == 4 * len(Purpose) * 64 * 64


def test_normal_draws_have_mean_nought_and_deviation_one():
    numbers = normal(5, Purpose.SCALE, np.arange(100_000))
    assert abs(numbers.mean()) < 0.015
    assert abs(numbers.std() - 1) < 0.01
    assert np.isfinite(numbers).all()
