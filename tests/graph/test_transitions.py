import itertools

import naive_graph
import numpy as np
import pytest
import synthetic_motion
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdsim.core.workers import limited
from crowdsim.graph.features import frame_features
from crowdsim.graph.settings import GraphSettings
from crowdsim.graph.transitions import Transitions, decision_frames, find_transitions, with_images


def as_dict(found):
    return {(int(i), int(j)): float(c) for i, j, c in zip(found.sources, found.targets, found.costs, strict=True)}


def random_case(seed, lengths):
    generator = np.random.default_rng(seed)
    frames = sum(lengths)
    # Smooth along time, so that minima are sparse as in motion, with noise, so that no two costs are equal.
    features = np.cumsum(generator.normal(0, 0.1, (frames, 30)), axis=0) * 0.2 + generator.normal(0, 0.05, (frames, 30))
    contacts = np.repeat(generator.random((frames // 5 + 1, 2)) < 0.6, 5, axis=0)[:frames]
    return features.astype(np.float32), np.cumsum([0, *lengths]).astype(np.int32), contacts


def same_bytes(one, other):
    return all(a.tobytes() == b.tobytes() for a, b in zip(vars(one).values(), vars(other).values(), strict=True))


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    lengths=st.lists(st.integers(1, 45), min_size=1, max_size=4),
    near=st.integers(1, 8),
    most=st.sampled_from([1, 2, 5, 100]),
    ceiling=st.sampled_from([0.3, 0.6, 1.5, np.inf]),
)
def test_transitions_equal_those_of_the_naive_twin(seed, lengths, near, most, ceiling):
    features, starts, contacts = random_case(seed, lengths)
    found = as_dict(find_transitions(features, starts, contacts, near, most, ceiling))
    pairs = naive_graph.pairs(features, starts, contacts, near, ceiling)
    expected = naive_graph.cheapest(naive_graph.transitions(pairs, starts), most)
    assert found.keys() == expected.keys()
    for edge, cost in found.items():
        assert cost == pytest.approx(expected[edge], rel=1e-5)


def test_transitions_do_not_depend_on_the_block_size_and_are_sorted(monkeypatch):
    features, starts, contacts = random_case(3, [150, 80, 90])
    whole = find_transitions(features, starts, contacts, 4, 6, 1.0)
    monkeypatch.setattr("crowdsim.graph.transitions._BLOCK_BYTES", 1)
    assert len(whole) > 200
    assert np.array_equal(np.lexsort((whole.targets, whole.sources)), np.arange(len(whole)))
    assert same_bytes(whole, find_transitions(features, starts, contacts, 4, 6, 1.0))


def test_transitions_are_the_same_bytes_for_one_thread_and_two():
    features, starts, contacts = random_case(4, [300, 200])
    results = []
    for threads in (1, 2):
        with limited(threads):
            results.append(find_transitions(features, starts, contacts, 4, 12, 1.0))
    assert len(results[0]) > 500
    assert same_bytes(*results)


def test_a_ceiling_leaves_off_the_dear_ones_of_the_cheapest_and_nothing_else():
    features, starts, contacts = random_case(6, [200, 100])
    every = find_transitions(features, starts, contacts, 4, 8)
    ceiling = float(np.median(every.costs))
    assert same_bytes(
        every.chosen(every.costs <= np.float32(ceiling)), find_transitions(features, starts, contacts, 4, 8, ceiling)
    )


def test_transitions_of_the_leading_frames_are_those_of_all_frames_that_begin_there():
    features, starts, contacts = random_case(5, [150, 90, 160])
    for ceiling in (np.inf, 1.0):
        every = find_transitions(features, starts, contacts, 4, 6, ceiling)
        leading = find_transitions(features, starts, contacts, 4, 6, ceiling, leading=240)
        assert (leading.targets > 240).any()
        assert same_bytes(leading, every.chosen(every.sources < 240))


def test_images_of_transitions_lie_as_far_behind_them_as_captured_frames_are_many():
    some = Transitions(*(np.array(part, np.int32) for part in ([0, 0, 3], [2, 7, 9])), np.array([1, 2, 3], np.float32))
    both = with_images(some, 5, 10)
    assert both.sources.tolist() == [0, 0, 3, 5, 5, 8]
    assert both.targets.tolist() == [2, 7, 9, 2, 7, 4]
    assert both.costs.tolist() == [1, 2, 3, 2, 1, 3]
    assert with_images(some, 10, 10) is some


def test_a_walk_that_repeats_exactly_has_transitions_at_cost_zero_whole_periods_apart_and_nowhere_else():
    period = 20
    database = synthetic_motion.database([synthetic_motion.walk(3, period)])
    features = frame_features(database, GraphSettings())
    contacts = database.contacts[:: database.stride]
    found = find_transitions(features, database.clip_starts, contacts, near=5, most=100)
    zero = found.costs < 1e-5
    assert zero.sum() >= 10
    assert set((found.targets - 1 - found.sources)[zero]) == {-40, -20, 20, 40}
    assert found.costs[~zero].min(initial=1.0) > 0.01


def test_a_motionless_clip_yields_scattered_transitions_and_not_all_of_them():
    frames = 60
    features = np.ones((frames, 6), np.float32)
    contacts = np.ones((frames, 2), bool)
    found = find_transitions(features, np.array([0, frames], np.int32), contacts, near=5, most=1000)
    possible = (frames - 5) * (frames - 4)
    assert possible / 20 < len(found) < possible / 5
    assert not found.costs.any()


def test_feet_that_touch_the_floor_otherwise_are_no_transition():
    features, starts, contacts = random_case(7, [200])
    found = find_transitions(features, starts, contacts, 4, 100)
    assert len(found) > 100
    assert np.array_equal(contacts[found.sources], contacts[found.targets - 1])
    free = find_transitions(features, starts, np.ones_like(contacts), 4, 100)
    assert set(as_dict(found)) < set(as_dict(free))


def test_no_transition_leads_past_the_end_of_a_clip():
    features, starts, contacts = random_case(8, [5] * 30)
    found = find_transitions(features, starts, np.ones_like(contacts), 1, 100)
    assert np.isin(starts[1:] - 1, found.sources).any()
    assert not np.isin(found.targets, starts).any()


@settings(max_examples=60, deadline=None)
@given(
    worths=st.lists(st.lists(st.integers(0, 9), min_size=1, max_size=11), min_size=1, max_size=3),
    spacing=st.integers(1, 5),
)
def test_decisions_lie_apart_and_are_worth_as_much_as_trying_everything_finds(worths, spacing):
    flat = np.concatenate(worths).astype(float)
    starts = np.cumsum([0, *map(len, worths)]).astype(np.int32)
    sources = np.flatnonzero(flat).astype(np.int32)
    transitions = Transitions(sources, sources + 1, flat[sources].astype(np.float32))
    chosen = decision_frames(transitions, flat[sources], starts, spacing)
    assert flat[chosen].sum() == sum(naive_graph.largest_worth_apart(worth, spacing) for worth in worths)
    assert flat[chosen].all()
    for start, stop in itertools.pairwise(starts):
        assert np.diff(np.flatnonzero(chosen[start:stop])).min(initial=spacing) >= spacing
