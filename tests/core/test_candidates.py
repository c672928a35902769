"""Actions are drawn among the best ones as the naive twin draws them."""

import math

import naive_core
import numpy as np
import pytest

from crowdsim.core.candidates import CandidateRules, draw_candidate


@pytest.mark.parametrize("most", [1, 2, 3, 40])
@pytest.mark.parametrize("margin", [0.0, 1.0, 2.5, 100.0])
@pytest.mark.parametrize("temperature", [0.0, 0.01, 1.5])
def test_drawn_candidates_match_naive(most, margin, temperature):
    rng = np.random.default_rng(6)
    rules, chances = CandidateRules(margin, float(most), temperature), np.empty(24)
    for count in [1, 2, *rng.integers(3, 24, 60).tolist()]:
        values, number = rng.integers(0, 5, count).astype(float), float(rng.random())
        expected = naive_core.draw_candidate(values.tolist(), margin, most, temperature, number)
        assert draw_candidate(values, count, rules, number, chances) == expected


def test_without_a_finite_best_value_nothing_is_drawn():
    rules, chances = CandidateRules(0.1, 4.0, 0.05), np.empty(2)
    for first in (math.nan, math.inf, -math.inf):
        assert draw_candidate(np.array([first, -math.inf]), 2, rules, 0.5, chances) == -1


def test_chances_follow_the_temperature():
    rules, chances = CandidateRules(1.0, 2.0, 0.5), np.empty(3)
    values, share = np.array([1.0, 0.5, 0.9]), math.exp(0.1 / 0.5) / (1.0 + math.exp(0.1 / 0.5))
    drawn = [draw_candidate(values, 3, rules, number, chances) for number in (np.arange(1000) + 0.5) / 1000]
    assert drawn.count(0) / 1000 == pytest.approx(share, abs=2e-3)
    assert drawn.count(1) == 0
