"""How much avatars differ, on takes whose figures are known, and against a plain count."""

from dataclasses import replace

import numpy as np
import pytest
from take.test_measures import RATE, make_take, pair, random_take, strikes

from crowdsim.take import measures, spreads
from crowdsim.take.spreads import measure_spreads, medians_of


def test_medians_are_those_of_each_owner():
    rng = np.random.default_rng(0)
    owners, values = rng.integers(0, 9, 200), rng.normal(size=200)
    owners[owners == 4] = 3
    found = medians_of(owners, values, 10)
    for owner in range(10):
        own = values[owners == owner]
        assert np.isnan(found[owner]) if len(own) == 0 else found[owner] == np.median(own)


def naive(take, after):
    """Strikes thrown and landed per minute, and the median distance, of each avatar that fights for long enough."""
    x, z, opponent, action = (np.asarray(getattr(take, name)) for name in ("x", "z", "opponent", "action"))
    rows = []
    for n in range(take.avatar_count):
        distances = {}
        for frame in range(int(np.ceil(after * RATE)), take.frame_count):
            other = opponent[frame, n]
            if action[frame, n] < 0 or other == -1 or (other >= 0 and action[frame, other] < 0):
                continue
            place = (x[frame, other], z[frame, other]) if other >= 0 else take.targets[frame, -2 - other, [0, 2]]
            apart = np.hypot(place[0] - x[frame, n], place[1] - z[frame, n])
            if apart <= measures.OUT_OF_REACH:
                distances[frame] = apart
        if len(distances) >= spreads.ENOUGH * RATE:
            own = (take.events.attacker == n) & np.isin(np.ceil(take.events.frame), list(distances))
            minutes = len(distances) / RATE / 60
            hits = np.count_nonzero(own & take.events.landed)
            rows.append((np.count_nonzero(own) / minutes, hits / minutes, np.median(list(distances.values()))))
    return np.percentile(rows, spreads.PERCENTILES, axis=0).T if rows else None


@pytest.mark.parametrize("seed", range(4))
def test_spreads_match_naive_ones_whatever_the_chunks(seed, monkeypatch):
    take = random_take(seed)
    monkeypatch.setattr(spreads, "ENOUGH", 0.5)
    result = measure_spreads(take, after=3.0)
    found = [result.thrown_per_minute_spread, result.landed_per_minute_spread, result.distance_spread]
    np.testing.assert_allclose(found, naive(take, 3.0), rtol=1e-5)
    for read, block in ((6, 6), (100, 18), (1300, 7), (3000, 10_000)):
        monkeypatch.setattr(measures, "_READ_AVATAR_FRAMES", read)
        monkeypatch.setattr(spreads, "_BLOCK_AVATAR_FRAMES", block)
        assert measure_spreads(take, after=3.0) == result


def test_avatars_that_do_the_same_do_not_differ():
    events = strikes(*((200.0 + 20 * k, n, 1 - n, k % 2 == 0) for k in range(10) for n in (0, 1)))
    result = measure_spreads(pair(1.2, frames=450, events=events))
    assert result.thrown_per_minute_spread == pytest.approx([30.0] * 3)
    assert result.landed_per_minute_spread == pytest.approx([15.0] * 3)
    assert result.distance_spread == pytest.approx([1.2] * 3)


def test_time_without_an_opponent_in_reach_does_not_count():
    events = strikes(*((200.0 + 100 * k, 0, 1, True) for k in range(10)))
    alone = pair(1.2, frames=1200, events=events)
    opponent = alone.opponent.copy()
    opponent[525:] = -1
    distance = np.where(np.arange(1200) < 525, 1.2, 1.6)
    for take in (replace(alone, opponent=opponent), pair(distance, frames=1200, events=events)):
        result = measure_spreads(take)
        # Of two avatars one lands four strikes in 25 s, the other none.
        assert result.landed_per_minute_spread == pytest.approx([0.96, 4.8, 8.64])
        assert result.distance_spread == pytest.approx([1.2] * 3)


def test_frames_are_picked_evenly_in_large_crowds(monkeypatch):
    distance = 0.5 + np.arange(600) / 800
    exact = measure_spreads(pair(distance)).distance_spread
    monkeypatch.setattr(spreads, "_SAMPLED_AVATAR_FRAMES", 100)
    sampled = measure_spreads(pair(distance)).distance_spread
    assert sampled != exact
    assert sampled == pytest.approx(exact, abs=0.02)
    monkeypatch.setattr(measures, "_READ_AVATAR_FRAMES", 50)
    monkeypatch.setattr(spreads, "_BLOCK_AVATAR_FRAMES", 14)
    assert measure_spreads(pair(distance)).distance_spread == sampled


@pytest.mark.parametrize("take", [make_take([[0.0]], [[0.0]], [0.0], [-1], 600), pair(1.0, frames=440)])
def test_where_nobody_fights_for_long_nothing_is_compared(take):
    assert measure_spreads(take) == spreads.Spreads(None, None, None)
