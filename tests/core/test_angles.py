"""Angles in compiled code, against numpy."""

import numpy as np

from crowdsim.core.angles import bearings, cos_sin


def test_cosines_and_sines_are_those_of_numpy():
    whole_turns = np.arange(-40, 41) * (np.pi / 4)
    angles = np.concatenate([np.random.default_rng(0).normal(0, 100, 3000), whole_turns, [0.0, -0.0, 9e4]])
    found = np.array([cos_sin(angle) for angle in angles])
    np.testing.assert_allclose(found, np.stack([np.cos(angles), np.sin(angles)], axis=-1), rtol=0, atol=4e-16)


def test_bearings_are_those_of_numpy():
    x, z = np.random.default_rng(0).normal(0, 2, (2, 2000))
    x[:8], z[:8] = [0, 0, 0, 1, -1, 1, -1, 1e-9], [1, -1, 0, 0, 0, 1, -1, 1]
    found = np.full(2000, np.inf)
    bearings(x, z, 2000, found)
    np.testing.assert_allclose(found, np.arctan2(x, z), atol=3e-9)
