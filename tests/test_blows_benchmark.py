"""The benchmark of blows: what it takes from several seeds, and what it calls met."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))
from blows import GOALS, is_met, key, summarise

BY_NAME = {key(one): one for one in GOALS}


def test_a_figure_is_the_mean_of_the_seeds_that_have_it_beside_the_worst() -> None:
    fists, heads = BY_NAME["fists_beyond_2_cm"], BY_NAME["blows_head_correlation"]
    seeds = [{key(fists): one, key(heads): two} for one, two in ((0.001, 0.7), (None, None), (0.009, 0.4))]
    assert summarise(fists, seeds) == {"mean": pytest.approx(0.005), "worst": 0.009}
    assert summarise(heads, seeds) == {"mean": pytest.approx(0.55), "worst": 0.4}
    assert summarise(heads, seeds[1:2]) == {"mean": None, "worst": None}


def test_means_meet_goals_and_of_a_greatest_distance_the_worst_does() -> None:
    assert is_met(BY_NAME["blows_head_correlation"], "bout", 0.55, 0.4)
    assert not is_met(BY_NAME["blows_head_correlation"], "bout", 0.45, 0.4)
    assert not is_met(BY_NAME["fists_gap_greatest"], "bout", 0.03, 0.07)
    assert is_met(BY_NAME["fists_gap_greatest"], "bout", 0.03, 0.06)
    assert len(GOALS) == 8
