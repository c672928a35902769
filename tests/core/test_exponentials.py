"""Exponentials in compiled code, against numpy."""

import numpy as np

from crowdsim.core.exponentials import exponential


def test_exponentials_are_those_of_numpy():
    values = -np.random.default_rng(0).exponential(5, 1990)
    values = np.concatenate([values, [0, -1e-12, -31.9, -32, -40, -1e9, -1, -2, -3, -4]])
    found = [exponential(value) for value in values]
    np.testing.assert_allclose(found, np.exp(np.maximum(values, -32)), rtol=2e-9)
