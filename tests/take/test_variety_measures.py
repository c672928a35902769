"""How much captured motion a run repeats, and how hits come, on takes whose figures are known."""

from dataclasses import replace

import numpy as np
import pytest
from take.synthetic_take import RATE, actions, build_take

from crowdsim.crowd.events import Events
from crowdsim.crowd.model import strong_speed
from crowdsim.take.variety import measure_variety

FIRST, LENGTHS = actions(60)
LONG = int(np.argmax(LENGTHS))
"""An action that is repeated."""


def take_of(queues, frames=45, start=None, events=None):
    take, policy = build_take(queues, FIRST, LENGTHS, frames, start=start or [(0.0, 0.0, 0.0)] * len(queues))
    return (take if events is None else replace(take, events=events)), policy


def strikes(rows):
    """Events: frame, attacker, victim, speed, landed."""
    columns = list(zip(*rows, strict=True))
    count = len(rows)
    return Events(
        np.array(columns[0], np.float32), np.array(columns[1], np.int32), np.array(columns[2], np.int32),
        np.zeros(count, np.uint8), np.zeros((count, 3), np.float32), np.array(columns[3], np.float32),
        np.array(columns[4], bool),
    )  # fmt: skip


def test_own_repetition_is_how_often_a_moment_is_shown_per_minute():
    take, policy = take_of([[LONG] * 60])
    rounds = np.ceil(take.frame_count / LENGTHS[LONG])
    assert measure_variety(take, [policy]).repeated_second_per_minute == pytest.approx(
        rounds / (take.frame_count / RATE / 60.0), rel=0.35
    )


def test_others_that_show_the_same_motion_count_when_they_are_near():
    same = [list(range(60)), list(range(60))]
    near, policy = take_of(same)
    assert measure_variety(near, [policy]).same_source_share == 1.0
    far, policy = take_of(same, start=[(0.0, 0.0, 0.0), (9.5, 0.0, 0.0)])
    assert measure_variety(far, [policy]).same_source_share == 0.0
    alone, policy = take_of(same[:1])
    assert measure_variety(alone, [policy]).same_source_share is None


def test_stillness_of_all_motion_is_that_of_the_capture():
    take, policy = take_of([list(range(60))], frames=150)
    figures = measure_variety(take, [policy])
    assert 0.0 <= figures.stillness_share <= 1.0
    assert 0.0 < figures.stillness_share_captured < 1.0


def test_hits_from_behind_are_those_outside_of_what_victims_see():
    # Avatar 0 looks along z; the others lie ahead, aside and behind.
    start = [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)]
    queues = [list(range(n, 60)) for n in range(4)]
    events = strikes([(0.0, 1, 0, 5.0, True), (0.0, 2, 0, 5.0, True), (0.0, 3, 0, 5.0, True), (0.0, 3, 0, 5.0, False)])
    take, policy = take_of(queues, start=start, events=events)
    take = replace(take, heading=np.zeros_like(take.heading))
    assert measure_variety(take, [policy]).hits_from_behind_share == pytest.approx(1 / 3)


def test_the_step_after_a_strong_hit_is_measured_along_it():
    take, policy = take_of([list(range(60)), list(range(60))], start=[(0.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    strong = strong_speed(policy)
    take = replace(take, events=strikes([(0.0, 0, 1, strong + 0.1, True), (0.0, 1, 0, strong - 0.1, True)]))
    z = np.zeros_like(take.z)
    z[:, 1] = 1.0 + 0.25 * (np.arange(len(z)) >= 5)
    take = replace(take, x=np.zeros_like(take.x), z=z)
    assert measure_variety(take, [policy]).step_after_hit == pytest.approx(0.25)


def test_opponents_that_throw_the_same_strike_at_once_are_found():
    take, policy = build_take([[LONG] * 9] * 2, FIRST, LENGTHS, 30)
    take = replace(take, opponent=np.tile(np.array([1, 0], np.int32), (30, 1)))
    at_once = strikes([(3.0, 0, 1, 5.0, False), (3.2, 1, 0, 5.0, False)])
    later = strikes([(3.0, 0, 1, 5.0, False), (20.0, 1, 0, 5.0, False)])
    assert measure_variety(replace(take, events=at_once), [policy]).same_strike_share == 1.0
    assert measure_variety(replace(take, events=later), [policy]).same_strike_share == 0.0


def test_a_take_without_frames_has_no_figures():
    take, policy = take_of([list(range(60))], frames=1)
    figures = measure_variety(take, [policy])
    assert figures.same_strike_share is None
    assert figures.hits_from_behind_share is None
    assert figures.step_after_hit is None
