"""Fists land on posed bodies as the naive twin says."""

import naive_core
import numpy as np

from crowdsim.core.bodies import PosedBody, lands_on_posed_body


def test_landing_on_a_posed_body_matches_naive():
    rng = np.random.default_rng(2)
    landed = 0
    for _ in range(400):
        head, neck, pelvis, fist = (tuple(point) for point in rng.normal(0.0, 0.3, (4, 3)).tolist())
        sizes = (*rng.uniform(0.05, 0.3, 2).tolist(), float(rng.choice([0.05, 0.2])))
        expected, spare = naive_core.lands(fist, head, neck, pelvis, *sizes)
        if spare > 1e-6:
            assert lands_on_posed_body(fist, PosedBody(head, neck, pelvis, *sizes[:2]), sizes[2]) == expected
        landed += expected
    assert 10 < landed < 390


def test_a_torso_without_length_is_a_ball():
    middle = (0.0, 1.0, 0.0)
    for away, lands in [(0.24, True), (0.26, False), (0.06, True), (0.04, False)]:
        assert (
            lands_on_posed_body((away, 1.0, 0.0), PosedBody((9.0, 9.0, 9.0), middle, middle, 0.1, 0.15), 0.1) is lands
        )
