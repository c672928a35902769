"""Exponentials in compiled code, against numpy."""

import numpy as np

from crowdsim.core.exponentials import faded


def test_exponentials_are_those_of_numpy():
    values = np.random.default_rng(0).exponential(5, 1990)
    values = np.concatenate([values, [0, 1e-12, 31.9, 32, 40, 1e9, 1, 2, 3, 4]]).astype(np.float32)
    found = np.array([faded(value) for value in values])
    assert {type(faded(value)) for value in values[:3]} <= {float, np.float32}
    np.testing.assert_allclose(found, np.exp(-np.minimum(values, 32).astype(float)), rtol=6e-6)
