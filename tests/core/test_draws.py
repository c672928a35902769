"""Draws in compiled code, against those of numpy."""

import numpy as np

from crowdsim.core.random import uniform
from crowdsim.crowd import random


def test_compiled_draws_have_the_bits_of_numpys():
    for seed in (0, 1, 7, 2**63 - 1):
        for purpose in random.Purpose:
            for avatar, draw in ((0, 0), (1, 0), (7, 3), (999_999, 12), (np.int32(5), np.int64(2**33))):
                expected = random.uniform(seed, purpose, avatar, draw)
                assert uniform(random.stream(seed, purpose), avatar, draw) == expected
