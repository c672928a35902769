"""How actions are laid on their states: feet that stand on stay where they are."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from crowdsim.graph.motion_graph import build_graph
from crowdsim.motion import ground
from crowdsim.motion.contacts import plant_spans
from crowdsim.motion.database import build_database
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.measuring import measure_clips
from crowdsim.performer.session import perform
from crowdsim.policy.actions import LEG, STEP, build_actions
from crowdsim.policy.alignment import HARDLY, SETTLED, align_actions, align_transitions


@cache
def database():
    return build_database(measure_clips([performed.clip for performed in perform(30, 3)]))


@pytest.fixture(scope="module")
def graph():
    return build_graph(database())


def toes_at(frames):
    """Toes of both feet in the frame's ground frame. Shape (n, 2, 3)."""
    motion = database()
    places, _ = forward_kinematics(motion.skeleton, motion.root_positions[frames], motion.rotations[frames])
    feet = places[:, [motion.body.roles["left_toe"], motion.body.roles["right_toe"]]]
    return ground.to_local(motion.ground[frames][:, None], feet)


def time_in_stand(frame, foot, step):
    """For how long a foot stands from a playback frame on [s], frame by frame; for ever up to the edge of its clip."""
    motion = database()
    starts = np.asarray(motion.clip_starts) * motion.stride
    clip = np.searchsorted(starts, frame, side="right") - 1
    count = 0
    while motion.contacts[frame, foot]:
        count += 1
        frame += step
        if not starts[clip] <= frame < starts[clip + 1]:
            return np.inf
    return count / motion.playback_rate


def test_spans_of_foot_plants_match_naive():
    rng = np.random.default_rng(0)
    contacts = rng.random((60, 2)) < 0.7
    starts = np.array([0, 13, 14, 40, 60])
    spans = plant_spans(contacts, starts)
    for frame in range(60):
        clip = np.searchsorted(starts, frame, side="right") - 1
        for foot in range(2):
            first = last = frame
            while contacts[frame, foot] and first > starts[clip] and contacts[first - 1, foot]:
                first -= 1
            while contacts[frame, foot] and last + 1 < starts[clip + 1] and contacts[last + 1, foot]:
                last += 1
            assert spans[frame, foot].tolist() == [first, last]


def test_a_planted_foot_does_not_slide_and_one_of_two_steps(graph):
    motion = database()
    aligned = align_actions(motion, graph)
    jumps = np.flatnonzero(graph.action_has_transition)
    before = graph.state_frames[graph.action_states[jumps]].astype(int) * motion.stride
    after = (graph.action_first[jumps].astype(int) - 1) * motion.stride
    assert not aligned.shifts[~graph.action_has_transition].any()
    assert not aligned.steps[~graph.action_has_transition].any()
    moved = ground.to_world(aligned.shifts[jumps][:, None].astype(float), toes_at(after))
    away = np.linalg.norm((moved - toes_at(before))[..., [0, 2]], axis=-1)
    alone, together = 0, 0
    for k in range(0, len(jumps), 3):
        both = motion.contacts[before[k]] & motion.contacts[after[k]]
        since = [time_in_stand(before[k], foot, -1) for foot in range(2)]
        until = [time_in_stand(after[k], foot, 1) for foot in range(2)]
        stays = [
            both[foot] and since[foot] > SETTLED[0] + 0.02 and until[foot] > SETTLED[1] + 0.02 for foot in range(2)
        ]
        goes = [not both[foot] or since[foot] < SETTLED[0] - 0.02 or until[foot] < 0.5 for foot in range(2)]
        for foot in range(2):
            if stays[foot] and goes[1 - foot]:
                alone += 1
                assert away[k, foot] < 5e-4
                assert aligned.steps[jumps[k]] == 0.0
        if all(stays) and until[0] != until[1]:
            together += 1
            later = int(until[1] > until[0])
            assert away[k, later] < 5e-4
            assert aligned.steps[jumps[k]] == (away[k, 1 - later] > HARDLY)
    assert alone > 20
    assert together > 20


def test_equal_frames_are_laid_on_each_other_as_they_are():
    frames = np.arange(100, 200)
    aligned = align_transitions(database(), frames, frames)
    np.testing.assert_allclose(aligned.shifts, 0.0, atol=1e-6)
    assert not aligned.steps.any()


def test_actions_start_where_they_are_laid_and_steps_are_paid(graph):
    motion = database()
    aligned = align_actions(motion, graph)
    actions = build_actions(motion, graph)
    plain = build_actions(motion, graph, aligned._replace(shifts=0.0 * aligned.shifts, steps=0.0 * aligned.steps))
    assert np.abs(actions.shifts).max() > 0.01
    np.testing.assert_allclose(actions.displacements, ground.compose(aligned.shifts, plain.displacements), atol=1e-5)
    np.testing.assert_allclose(actions.costs - plain.costs, STEP * aligned.steps, atol=1e-5)
    assert (aligned.steps > 0.0).any()


def test_kicks_count_by_the_mass_of_a_leg_over_the_mean_of_punches(graph):
    motion = database()
    plain = build_actions(motion, graph)
    limbs = np.asarray(motion.strike_limbs) + 2 * (np.arange(len(motion.strike_frames)) % 3 == 0).astype(np.uint8)
    speeds, kicks = motion.strike_speeds[plain.strike_ids], limbs[plain.strike_ids] >= 2
    mixed = build_actions(replace(motion, strike_limbs=limbs), graph)
    expected = speeds / motion.strike_speeds[limbs < 2].mean() * np.where(kicks, LEG, 1.0)
    np.testing.assert_allclose(mixed.strike_speeds, expected, rtol=1e-5)
    assert kicks.any()
    alone = build_actions(replace(motion, strike_limbs=np.full_like(limbs, 3)), graph)
    np.testing.assert_array_equal(alone.strike_speeds, plain.strike_speeds)


def test_kicks_come_from_where_the_avatar_is_and_punches_from_anywhere(graph):
    motion = database()
    limbs = np.asarray(motion.strike_limbs) + 2 * (np.arange(len(motion.strike_frames)) % 3 == 0).astype(np.uint8)
    actions = build_actions(replace(motion, strike_limbs=limbs), graph)
    kicks, ends = limbs[actions.strike_ids] >= 2, actions.strike_positions[:, [0, 2]]
    np.testing.assert_array_equal(actions.strike_origins[~kicks], ends[~kicks])
    reach = np.hypot(*motion.strike_positions[actions.strike_ids[kicks]][:, [0, 2]].T)
    np.testing.assert_allclose(np.linalg.norm(ends[kicks] - actions.strike_origins[kicks], axis=1), reach, atol=1e-4)
