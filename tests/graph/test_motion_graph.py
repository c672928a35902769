import itertools
import re

import naive_graph
import numpy as np
import pytest
import synthetic_motion
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdsim.bvh.io import read_bvh, to_clip
from crowdsim.errors import MotionError
from crowdsim.graph.motion_graph import build_graph
from crowdsim.graph.settings import GraphSettings
from crowdsim.graph.states import graph_of_transitions
from crowdsim.graph.statistics import frames_kept_by_clip, graph_statistics
from crowdsim.graph.transitions import Transitions
from crowdsim.motion.database import build_database
from crowdsim.motion.measuring import measure_clips


def transitions_of(edges):
    ordered = [(i, j, cost) for (i, j), cost in sorted(edges.items())]
    return Transitions(
        np.array([row[0] for row in ordered], np.int32),
        np.array([row[1] for row in ordered], np.int32),
        np.array([row[2] for row in ordered], np.float32),
    )


def as_dict(graph):
    result = {}
    for state, frame in enumerate(graph.state_frames):
        span = range(graph.action_offsets[state], graph.action_offsets[state + 1])
        result[int(frame)] = [
            (int(graph.action_first[a]), int(graph.action_lengths[a]), float(graph.action_costs[a])) for a in span
        ]
    return result


@st.composite
def random_edges(draw):
    lengths = draw(st.lists(st.integers(2, 30), min_size=1, max_size=4))
    starts = np.cumsum([0, *lengths]).astype(np.int32)
    frame = st.integers(0, sum(lengths) - 1)
    couples = draw(st.sets(st.tuples(frame, frame), max_size=60))
    edges = {
        (i, j): float(np.float32(draw(st.integers(0, 100)) / 100))
        for i, j in sorted(couples)
        if j not in starts and j not in (i, i + 1)
    }
    return starts, edges


@settings(max_examples=100, deadline=None)
@given(case=random_edges())
def test_states_and_actions_equal_those_of_the_naive_twin(case):
    starts, edges = case
    kept = naive_graph.component(edges, starts)
    expected = naive_graph.actions(edges, kept, starts)
    if not any(len(successors) > 1 for successors in expected.values()):
        with pytest.raises(MotionError, match="no cycle" if not kept else "single loop"):
            graph_of_transitions(transitions_of(edges), starts, 1.0)
        return
    graph = graph_of_transitions(transitions_of(edges), starts, 1.0)
    assert set(np.flatnonzero(graph.frames_kept).tolist()) == kept
    assert as_dict(graph) == expected
    inside = {(i, j): c for (i, j), c in edges.items() if i in kept and j in kept}
    sources, targets = graph.transition_from.tolist(), graph.transition_to.tolist()
    assert dict(zip(zip(sources, targets, strict=True), graph.transition_costs.tolist(), strict=True)) == inside


@pytest.fixture(scope="module")
def wandering():
    generator = np.random.default_rng(11)
    return synthetic_motion.database([synthetic_motion.wander(generator, n) for n in (150, 90, 200)])


@pytest.fixture(scope="module")
def graph(wandering):
    return build_graph(wandering, GraphSettings(threshold=0.3))


def test_every_action_ends_in_the_frame_of_its_next_state(graph):
    assert graph.action_count > graph.state_count > 20
    last = graph.action_first + graph.action_lengths - 1
    assert np.array_equal(last, graph.state_frames[graph.action_next])
    assert graph.action_lengths.min() >= 1


def test_every_action_shows_frames_of_one_clip_that_are_all_kept(graph, wandering):
    for first, length in zip(graph.action_first, graph.action_lengths, strict=True):
        assert graph.frames_kept[first : first + length].all()
        assert not np.isin(np.arange(first + 1, first + length), wandering.clip_starts).any()


def test_there_is_no_dead_end_and_every_state_reaches_every_state(graph):
    counts = np.diff(graph.action_offsets)
    assert counts.min() >= 1
    successors = {
        s: graph.action_next[graph.action_offsets[s] : graph.action_offsets[s + 1]].tolist()
        for s in range(graph.state_count)
    }
    assert naive_graph.reachable(successors, 0) == set(range(graph.state_count))
    backwards = {s: [] for s in successors}
    for source, targets in successors.items():
        for target in targets:
            backwards[target].append(source)
    assert naive_graph.reachable(backwards, 0) == set(range(graph.state_count))


def test_only_frames_that_a_transition_alone_leads_out_of_are_states_with_one_action(graph):
    single = np.flatnonzero(np.diff(graph.action_offsets) == 1)
    assert graph.action_has_transition[graph.action_offsets[single]].all()


def test_costs_are_zero_where_capture_continues_and_that_of_the_transition_elsewhere(graph):
    jumps = graph.action_has_transition
    assert not graph.action_costs[~jumps].any()
    sources = graph.state_frames[graph.action_states]
    assert np.array_equal(sources[jumps], graph.transition_from)
    assert np.array_equal(graph.action_first[jumps], graph.transition_to)
    assert np.array_equal(graph.action_costs[jumps], graph.transition_costs)
    assert graph.transition_costs.max() <= np.float32(0.3)


def test_arrays_have_the_documented_types_and_order(graph):
    for name in ("state_frames", "action_offsets", "action_next", "action_first", "action_lengths"):
        assert getattr(graph, name).dtype == np.int32, name
    assert graph.action_costs.dtype == graph.transition_costs.dtype == np.float32
    assert graph.frames_kept.dtype == bool
    assert (np.diff(graph.state_frames) > 0).all()
    assert graph.action_offsets[0] == 0
    assert graph.action_offsets[-1] == graph.action_count


def test_no_transition_joins_frames_near_in_time(wandering):
    graph = build_graph(wandering, GraphSettings(threshold=1.0, near=1.0))
    clips = np.searchsorted(wandering.clip_starts, np.arange(wandering.frame_count), side="right")
    same = clips[graph.transition_from] == clips[graph.transition_to]
    assert same.any()
    assert np.abs(graph.transition_from - (graph.transition_to - 1))[same].min() >= 15


def test_contacts_agree_at_every_transition(graph, wandering):
    contacts = wandering.contacts[:: wandering.stride]
    assert np.array_equal(contacts[graph.transition_from], contacts[graph.transition_to - 1])


def test_the_threshold_is_chosen_for_a_number_of_actions(wandering):
    chosen = build_graph(wandering, GraphSettings(actions=400))
    assert chosen.action_count == pytest.approx(400, abs=15)
    given_again = build_graph(wandering, GraphSettings(threshold=chosen.threshold))
    assert given_again.action_count == chosen.action_count
    assert not any("asked for" in warning for warning in chosen.warnings)


def test_more_actions_than_there_are_is_a_warning(wandering):
    graph = build_graph(wandering, GraphSettings(actions=1_000_000))
    assert f"1000000 actions were asked for, and there are only {graph.action_count}" in graph.warnings[0]


def test_states_of_a_clip_lie_apart_but_where_a_clip_ends(wandering):
    graph = build_graph(wandering, GraphSettings(threshold=0.3, spacing=0.4))
    sources = np.unique(graph.transition_from)
    clips = np.searchsorted(wandering.clip_starts, sources, side="right")
    assert np.diff(sources)[np.diff(clips) == 0].min() == 6
    assert build_graph(wandering, GraphSettings(threshold=0.3, spacing=0)).state_count > 2 * graph.state_count


def test_no_state_has_more_transitions_than_allowed(wandering):
    graph = build_graph(wandering, GraphSettings(threshold=0.3, branching=3))
    assert np.diff(graph.action_offsets).max() == 4


def test_a_clip_that_drops_out_is_named():
    generator = np.random.default_rng(5)
    clips = [synthetic_motion.wander(generator, n) for n in (150, 90)]
    roots, rotations, headings, contacts = synthetic_motion.wander(generator, 40)
    graph = build_graph(
        synthetic_motion.database([*clips, (roots + np.array([0, 5, 0]), rotations, headings, contacts)]),
        GraphSettings(threshold=0.4),
    )
    assert graph.warnings == (
        "clip 'clip_2' drops out of the motion graph: none of its 40 frames can be reached and left again",
    )


def test_a_graph_without_a_cycle_is_reported_with_a_threshold_that_gives_one(wandering):
    with pytest.raises(MotionError, match=r"no cycle: 440 frames in 3 clips, and 0 transitions") as caught:
        build_graph(wandering, GraphSettings(threshold=1e-4))
    least = float(re.search(r"the least threshold that gives one is (\d\.\d{3}) m", str(caught.value)).group(1))
    assert build_graph(wandering, GraphSettings(threshold=least)).action_count >= 2
    with pytest.raises(MotionError):
        build_graph(wandering, GraphSettings(threshold=least - 0.001))


def test_motion_that_never_comes_back_has_no_graph_at_any_threshold():
    generator = np.random.default_rng(5)
    database = synthetic_motion.database([synthetic_motion.wander(generator, 4)])
    with pytest.raises(MotionError, match=r"no cycle: 4 frames in 1 clips, and 0 .* \(no threshold gives one\)"):
        build_graph(database)
    with pytest.raises(MotionError, match="no cycle"):
        build_graph(database, GraphSettings(actions=10))


def test_a_single_loop_has_no_decision():
    with pytest.raises(MotionError, match="single loop of 10 frames without a decision: 1 transitions"):
        graph_of_transitions(transitions_of({(14, 5): 0.1}), np.array([0, 15], np.int32), 0.2)


def test_a_walk_that_repeats_exactly_becomes_a_graph_that_never_leaves_its_cycle():
    database = synthetic_motion.database([synthetic_motion.walk(4)])
    graph = build_graph(database, GraphSettings(threshold=0.01, spacing=0))
    shift = (graph.transition_to - 1 - graph.transition_from) % 20
    assert graph.transition_costs.max() < 1e-4
    assert not shift.any()


def test_the_graph_is_the_same_when_built_again(wandering, graph):
    again = build_graph(wandering, GraphSettings(threshold=0.3))
    for name, value in vars(graph).items():
        other = getattr(again, name)
        assert other.tobytes() == value.tobytes() if isinstance(value, np.ndarray) else other == value


def test_progress_ends_at_its_total(wandering):
    seen = {}
    build_graph(wandering, GraphSettings(threshold=0.3), lambda stage, done, total: seen.update({stage: (done, total)}))
    assert list(seen) == ["features", "transitions", "states"]
    assert all(done == total for done, total in seen.values())


def test_statistics_count_what_the_arrays_hold(graph, wandering):
    numbers = graph_statistics(graph, 15.0)
    assert (numbers.states, numbers.actions) == (graph.state_count, graph.action_count)
    assert numbers.transitions == len(graph.transition_from)
    assert numbers.frames == graph.frames_kept.sum() == frames_kept_by_clip(graph, wandering.clip_starts).sum()
    assert numbers.branching == pytest.approx(graph.action_count / graph.state_count)


def test_frames_kept_are_counted_by_clip(graph, wandering):
    counts = [graph.frames_kept[a:b].sum() for a, b in itertools.pairwise(wandering.clip_starts)]
    assert frames_kept_by_clip(graph, wandering.clip_starts).tolist() == counts


def test_transition_statistics_equal_those_of_a_long_random_walk(graph):
    generator = np.random.default_rng(2)
    state, frames, jumps, run, runs = 0, 0, 0, 0, []
    offsets, lengths = graph.action_offsets.tolist(), graph.action_lengths.tolist()
    nexts, has_transition = graph.action_next.tolist(), graph.action_has_transition.tolist()
    for draw in generator.random(60_000).tolist():
        action = offsets[state] + int(draw * (offsets[state + 1] - offsets[state]))
        if has_transition[action]:
            runs.append(run)
            jumps, run = jumps + 1, 0
        run += lengths[action]
        frames += lengths[action]
        state = nexts[action]
    numbers = graph_statistics(graph, 15.0)
    assert numbers.transitions_per_second == pytest.approx(jumps / frames * 15.0, rel=0.03)
    assert numbers.seconds_between_transitions == pytest.approx(np.median(runs) / 15.0, abs=1.1 / 15.0)


def test_transition_statistics_of_one_loop_match_the_analytic_values():
    # After frame 4 comes frame 1 or frame 2, both by a transition: runs of 4 or 3 frames, as often as each other.
    edges = {(4, 1): 0.1, (4, 2): 0.1}
    graph = graph_of_transitions(transitions_of(edges), np.array([0, 6], np.int32), 0.2)
    numbers = graph_statistics(graph, 10.0)
    assert numbers.action_frames == 3.5
    assert numbers.transitions_per_second == pytest.approx(10.0 / 3.5)
    assert numbers.seconds_between_transitions == pytest.approx(0.3)


@pytest.mark.mocap
def test_real_capture_of_several_people_becomes_one_graph_that_keeps_nearly_every_frame_and_strike(mocap):
    clips = [to_clip(read_bvh(path), 0.01) for path in sorted((mocap / "fight_daz").glob("*.bvh"))]
    database = build_database(measure_clips(clips))
    graph = build_graph(database)
    assert not graph.warnings
    shares = frames_kept_by_clip(graph, database.clip_starts) / np.diff(database.clip_starts)
    assert shares.min() > 0.9
    shown = np.zeros(database.frame_count + 1, bool)
    for first, length in zip(graph.action_first, graph.action_lengths, strict=True):
        shown[first : first + length] = True
    assert shown[-(-database.strike_frames // database.stride)].mean() > 0.95
    assert graph_statistics(graph, database.control_rate).branching > 5
