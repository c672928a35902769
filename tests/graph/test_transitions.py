import naive_graph
import numba
import numpy as np
import pytest
import synthetic_motion
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdsim.graph.features import frame_features
from crowdsim.graph.settings import GraphSettings
from crowdsim.graph.transitions import Pairs, cheapest, control_contacts, directed, find_pairs


def as_dict(pairs):
    return {(int(i), int(k)): float(c) for i, k, c in zip(pairs.first, pairs.second, pairs.costs, strict=True)}


def random_case(seed, lengths):
    generator = np.random.default_rng(seed)
    frames = sum(lengths)
    # Smooth along time, so that minima are sparse as in motion, with noise, so that no two costs are equal.
    features = np.cumsum(generator.normal(0, 0.1, (frames, 30)), axis=0) * 0.2 + generator.normal(0, 0.05, (frames, 30))
    contacts = np.repeat(generator.random((frames // 5 + 1, 2)) < 0.6, 5, axis=0)[:frames]
    return features.astype(np.float32), np.cumsum([0, *lengths]).astype(np.int32), contacts


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    lengths=st.lists(st.integers(1, 45), min_size=1, max_size=4),
    near=st.integers(1, 8),
    radius=st.integers(1, 4),
    ceiling=st.sampled_from([0.3, 0.6, 1.5, np.inf]),
)
def test_pairs_equal_those_of_the_naive_twin(seed, lengths, near, radius, ceiling):
    features, starts, contacts = random_case(seed, lengths)
    found = as_dict(find_pairs(features, starts, contacts, near, radius, ceiling))
    expected = naive_graph.pairs(features, starts, contacts, near, radius, ceiling)
    assert found.keys() == expected.keys()
    for pair, cost in found.items():
        assert cost == pytest.approx(expected[pair], rel=1e-5)


def test_pairs_do_not_depend_on_the_block_size_and_are_sorted(monkeypatch):
    features, starts, contacts = random_case(3, [150, 80, 90])
    whole = find_pairs(features, starts, contacts, 4, 2, 1.0)
    monkeypatch.setattr("crowdsim.graph.transitions._BLOCK_BYTES", 4 * 320 * 16)
    blocks = find_pairs(features, starts, contacts, 4, 2, 1.0)
    assert len(whole) > 50
    assert np.array_equal(np.lexsort((whole.second, whole.first)), np.arange(len(whole)))
    for one, other in zip(vars(whole).values(), vars(blocks).values(), strict=True):
        assert one.tobytes() == other.tobytes()


def test_pairs_are_the_same_bytes_for_one_thread_and_two():
    features, starts, contacts = random_case(4, [300, 200])
    before = numba.get_num_threads()
    try:
        results = []
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            results.append(find_pairs(features, starts, contacts, 4, 1, 1.0))
    finally:
        numba.set_num_threads(before)
    assert len(results[0]) > 50
    for one, other in zip(vars(results[0]).values(), vars(results[1]).values(), strict=True):
        assert one.tobytes() == other.tobytes()


def test_a_bound_on_the_number_of_pairs_keeps_exactly_the_cheapest(monkeypatch):
    monkeypatch.setattr("crowdsim.graph.transitions._BLOCK_BYTES", 1)
    features, starts, contacts = random_case(5, [400])
    every = find_pairs(features, starts, contacts, 4)
    most = len(every) // 10
    bounded = find_pairs(features, starts, contacts, 4, most=most)
    assert most <= len(bounded) < len(every)
    assert as_dict(cheapest(bounded, most)) == as_dict(cheapest(every, most))
    assert len(cheapest(every, most)) == most


def test_a_walk_that_repeats_exactly_has_pairs_at_cost_zero_one_period_apart_and_nowhere_else():
    period = 20
    database = synthetic_motion.database([synthetic_motion.walk(3, period)])
    features = frame_features(database, GraphSettings())
    found = find_pairs(features, database.clip_starts, control_contacts(database), near=5)
    zero = found.costs < 1e-5
    # Velocities at the ends of a clip are one-sided differences, so its first frames differ a little.
    assert zero.sum() >= 5
    assert set((found.second - found.first)[zero]) == {period, 2 * period}
    assert found.costs[~zero].min(initial=1.0) > 0.01


def test_a_motionless_clip_yields_scattered_pairs_and_not_all_of_them():
    frames = 60
    features = np.ones((frames, 6), np.float32)
    found = find_pairs(features, np.array([0, frames], np.int32), np.ones((frames, 2), bool), near=5)
    possible = (frames - 5) * (frames - 4) // 2
    assert possible / 20 < len(found) < possible / 5
    assert not found.costs.any()


def test_transitions_go_both_ways_but_not_past_the_end_of_a_clip():
    pairs = Pairs(np.array([2, 4], np.int32), np.array([8, 9], np.int32), np.array([0.1, 0.2], np.float32))
    sources, targets, costs = directed(pairs, np.array([0, 5, 10], np.int32))
    assert list(zip(sources.tolist(), targets.tolist(), strict=True)) == [(2, 9), (8, 3)]
    assert costs.tolist() == pytest.approx([0.1, 0.1])
