"""How much better the best action is than the median one."""

import numpy as np

from crowdsim.training.kernels.judging import spread_of


def test_spread_is_the_greatest_value_less_the_median():
    rng = np.random.default_rng(0)
    for count in [2, 3, *rng.integers(2, 60, 200).tolist()]:
        values = rng.normal(size=count + 3).round(int(rng.integers(0, 8)))
        expected = values[:count].max() - np.median(values[:count])
        assert spread_of(values.copy(), count) == expected
