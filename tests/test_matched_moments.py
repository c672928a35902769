"""Pairs of moments that are alike, as benchmarks of transitions compare them."""

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest


@pytest.fixture
def matched(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    return importlib.import_module("_motion.matched_moments")


def test_pairs_of_two_kinds_are_alike_where_the_kinds_are_not(matched: ModuleType) -> None:
    rng = np.random.default_rng(1)
    slow, fast = rng.normal(0.0, 1.0, (400, 3)), rng.normal(1.0, 1.0, (60, 3))
    one, other = matched.match_moments(slow, fast)
    assert len(one) == len(other) == 30
    assert len(set(one.tolist())) == len(set(other.tolist())) == 30
    apart = np.linalg.norm(slow[one] - fast[other], axis=1)
    by_chance = np.linalg.norm(slow[rng.permutation(400)[:30]] - fast[other], axis=1)
    assert apart.max() < by_chance.mean()
    assert np.abs(slow[one].mean(axis=0) - fast[other].mean(axis=0)).max() < 0.25


def test_equal_moments_are_paired_with_one_another(matched: ModuleType) -> None:
    moments = np.random.default_rng(2).normal(size=(20, 4))
    order = np.random.default_rng(3).permutation(20)
    one, other = matched.match_moments(moments, moments[order])
    np.testing.assert_array_equal(order[other], one)


def test_without_moments_of_either_kind_there_are_no_pairs(matched: ModuleType) -> None:
    for sizes in ((0, 5), (5, 0)):
        one, other = matched.match_moments(*(np.zeros((size, 2)) for size in sizes))
        assert len(one) == len(other) == 0


def test_speeds_are_those_before_and_after(matched: ModuleType) -> None:
    steps = np.arange(7.0)[None, :, None, None] * [1.0, 0.0, 0.0]
    found = matched.speeds_around(0.1 * steps, 0.02 * steps, 60.0)
    np.testing.assert_allclose(np.exp(found) - 0.05, [[6.0, 1.2]])
