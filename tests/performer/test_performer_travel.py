"""The embedded boxer in travel: how fast every gait is, what feet and knees do, and how a session travels."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from crowdsim.motion import ground, quaternion
from crowdsim.motion.body import build_body
from crowdsim.motion.contacts import find_contacts, runs
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.tracks import build_tracks
from crowdsim.performer.session import perform, perform_solo
from crowdsim.performer.skeleton import BALL_HEIGHT, FEET, HIPS, LEGS, SPINE2, TOES, UP_LEGS
from crowdsim.performer.solo import FOOTWORK

FPS = 60.0
SHUFFLES = [move for move in FOOTWORK if move.startswith("shuffle")]
ON_FOOT = [move for move in FOOTWORK if "walk" in move or "jog" in move]
GAITS = [*SHUFFLES, *ON_FOOT, "quick_turn"]


@functools.cache
def solo(move, seed=3):
    performance = perform_solo(move, seed)
    return performance, *clip_kinematics(performance.clip)


@pytest.fixture(scope="module")
def session():
    return perform(420.0, 1)


def _speed(positions, seconds):
    """Speed of the pelvis over the ground, averaged over some time (F,) [m/s]."""
    path = uniform_filter1d(positions[:, HIPS][:, [0, 2]], round(seconds * FPS), axis=0)
    return np.linalg.norm(np.gradient(path, axis=0), axis=1) * FPS


def _way(performance, positions):
    """Displacement in the frame of the first stance (x, z) [m], and how long it took [s]."""
    travels = performance.truth.travels
    first, last = travels[0].start, travels[-1].end - 1
    place = ground.to_local(performance.truth.stance[first], positions[last, HIPS])
    return place[[0, 2]], (last - first) / FPS


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("move", SHUFFLES)
def test_a_shuffle_is_faster_than_1_2_metres_per_second(move, seed):
    performance, positions, _ = solo(move, seed)
    way, seconds = _way(performance, positions)
    left = ("left" in move) - ("right" in move)
    ahead = ("forward" in move) - ("back" in move)
    along = np.array([left, ahead]) / np.hypot(left, ahead)
    assert way @ along > 0.95 * np.linalg.norm(way)
    assert np.linalg.norm(way) / seconds > 1.2
    assert [travel.gait for travel in performance.truth.travels] == ["shuffle"]


@pytest.mark.parametrize(
    ("move", "least", "most"),
    [("walk", 1.4, 1.8), ("walk_curve", 1.3, 1.8), ("jog", 2.5, 3.2), ("jog_curve", 2.4, 3.2)],
)
def test_gaits_are_as_fast_as_they_should_be(move, least, most):
    _, positions, _ = solo(move)
    assert least < _speed(positions, 1.0).max() < most


@pytest.mark.parametrize("move", ["shuffle_forward", "walk", "jog"])
def test_travel_sets_off_and_comes_to_rest_within_a_step_or_two(move):
    performance, positions, _ = solo(move)
    speed = _speed(positions, 0.15)
    start, end = performance.truth.travels[0].start, performance.truth.travels[-1].end
    assert speed[start : start + 30].max() > 1.1
    assert speed[end + 12 :].max() < 0.6


@pytest.mark.parametrize("move", GAITS)
def test_planted_feet_do_not_slide_and_nothing_sinks_into_the_floor(move):
    performance, positions, _ = solo(move)
    planted = performance.truth.contacts
    speed = np.linalg.norm(np.diff(positions[:, TOES], axis=0), axis=-1) * FPS
    assert speed[planted[1:] & planted[:-1]].max() < 0.01
    assert positions[:, TOES, 1].min() >= BALL_HEIGHT - 1e-9
    assert positions[..., 1].min() >= BALL_HEIGHT - 1e-9
    tracks = build_tracks(build_body(performance.clip.skeleton), *clip_kinematics(performance.clip))
    assert tracks.heels[..., 1].min() > -0.02


@pytest.mark.parametrize("move", GAITS)
def test_contacts_of_travel_are_found(move):
    performance, positions, rotations = solo(move)
    body = build_body(performance.clip.skeleton)
    found = find_contacts(build_tracks(body, positions, rotations), body.height, FPS)
    true = performance.truth.contacts
    assert 2 * (found & true).sum() / (found.sum() + true.sum()) > 0.93
    for foot in range(2):
        assert len(runs(found[:, foot])) == len(runs(true[:, foot]))


@pytest.mark.parametrize("move", GAITS)
def test_knees_bend_forward_and_stay_within_their_limits(move):
    performance, positions, _ = solo(move)
    for side in range(2):
        hip, knee, ankle, toe = (positions[:, joints[side]] for joints in (UP_LEGS, LEGS, FEET, TOES))
        line = (ankle - hip) / np.linalg.norm(ankle - hip, axis=1, keepdims=True)
        out = knee - hip - line * np.sum((knee - hip) * line, axis=1, keepdims=True)
        assert np.all(np.sum(out[:, [0, 2]] * (toe - ankle)[:, [0, 2]], axis=1) > 0.0)
    folds = 2.0 * np.arccos(np.clip(np.abs(performance.clip.rotations[:, list(LEGS), 0]), 0.0, 1.0))
    assert folds.min() > np.radians(8)
    assert folds.max() < np.radians(125)


@pytest.mark.parametrize("move", GAITS)
def test_travel_has_no_pops(move):
    """The bounds of test_performer, tighter: no fist is faster here than an arm that swings."""
    performance, positions, _ = solo(move)
    rotations = performance.clip.rotations
    turns = quaternion.to_rotation_vector(quaternion.multiply(quaternion.conjugate(rotations[:-1]), rotations[1:]))
    assert np.linalg.norm(turns, axis=-1).max() * FPS < 25.0
    assert np.linalg.norm(np.diff(turns[:, : SPINE2 + 1], axis=0), axis=-1).max() * FPS**2 < 120.0
    assert np.linalg.norm(np.diff(positions[:, HIPS], 2, axis=0), axis=-1).max() * FPS**2 < 90.0
    assert np.ptp(positions[:, HIPS, 1]) < 0.16


def test_feet_pass_one_another_in_a_walk_with_one_always_down_and_fly_in_a_jog():
    for move, aloft in (("walk", (0.0, 0.0)), ("jog", (0.12, 0.4))):
        performance, positions, _ = solo(move)
        travel = performance.truth.travels[0]
        frames = slice(travel.start, travel.end)
        ahead = [ground.to_local(performance.truth.stance, positions[:, toe])[frames, 2] for toe in TOES]
        assert np.sum(np.diff(np.sign(ahead[0] - ahead[1])) != 0) >= 6
        flying = ~performance.truth.contacts[frames].any(axis=1)
        assert aloft[0] <= flying.mean() <= aloft[1]


def test_boxers_turn_by_180_degrees_on_the_spot_and_out_of_a_walk():
    for move, seconds in (("quick_turn", 1.1), ("walk_about_turn", 2.4), ("turn_and_walk", 2.4)):
        performance, _, _ = solo(move)
        heading = performance.truth.stance[:, 2]
        turned = heading[-1] - heading[0]
        assert abs(turned) > 3.0
        share = (heading - heading[0]) / turned
        assert (np.argmax(share > 0.95) - np.argmax(share > 0.05)) / FPS < seconds


def test_bodies_lean_into_a_start_and_against_a_stop():
    performance, positions, _ = solo("jog")
    lean = ground.to_local(performance.truth.stance, positions[:, SPINE2])[:, 2]
    lean -= ground.to_local(performance.truth.stance, positions[:, HIPS])[:, 2]
    travels = performance.truth.travels
    start, end = travels[0].start, travels[-1].end
    assert lean[start + 6 : start + 24].max() > np.median(lean[start + 60 : start + 100]) + 0.03
    assert lean[end - 30 : end].min() < np.median(lean[start + 60 : start + 100]) - 0.01


def test_a_southpaw_travels_as_the_mirror_image_of_an_orthodox_boxer():
    left, right = (perform_solo("walk_curve", 2, stance=stance) for stance in ("orthodox", "southpaw"))
    np.testing.assert_allclose(right.clip.root_positions * [-1.0, 1.0, 1.0], left.clip.root_positions)
    assert np.array_equal(left.truth.contacts, right.truth.contacts[:, ::-1])
    assert left.truth.travels == right.truth.travels


def test_a_session_travels_in_all_directions_for_a_fifth_of_its_time(session):
    seconds, walked = {"shuffle": 0.0, "walk": 0.0, "jog": 0.0}, []
    for performance in session:
        for travel in performance.truth.travels:
            seconds[travel.gait] += (travel.end - travel.start) / FPS
        flags = np.zeros(performance.clip.frame_count + 1, np.int8)
        for travel in performance.truth.travels:
            flags[travel.start : travel.end] = travel.gait != "shuffle"
        path = performance.clip.root_positions[:, [0, 2]]
        walked += [float(np.linalg.norm(path[b - 1] - path[a])) for a, b in runs(flags[:-1])]
    assert seconds["shuffle"] > 20.0
    assert seconds["walk"] > 30.0
    assert seconds["jog"] > 8.0
    assert 75.0 < sum(seconds.values()) < 140.0
    assert np.all(np.histogram(walked, [0.3, 1.0, 2.0, 3.0, 4.5, 8.0])[0] > 0)
    assert max(np.hypot(*p.clip.root_positions[:, [0, 2]].T).max() for p in session) < 6.5


def test_a_session_sets_off_straight_after_punches_and_strikes_on_arrival(session):
    after = before = 0
    for performance in session:
        for travel in performance.truth.travels:
            start, end = travel.start / FPS, travel.end / FPS
            after += any(strike.hit < start < strike.hit + 0.3 for strike in performance.truth.strikes)
            before += any(end - 0.3 < strike.start < end + 0.4 for strike in performance.truth.strikes)
    assert after >= 8
    assert before >= 15


def test_a_session_has_pauses_in_the_guard(session):
    pauses = []
    for performance in session:
        busy = np.zeros(performance.clip.frame_count, bool)
        for strike in performance.truth.strikes:
            busy[round(strike.start * FPS) - 6 : round(strike.end * FPS) + 9] = True
        for event in (*performance.truth.defences, *performance.truth.travels):
            busy[event.start : event.end] = True
        pauses += [(stop - start) / FPS for start, stop in runs(~busy)]
    assert sum(pauses) > 60.0
    assert sum(pause > 1.0 for pause in pauses) >= 15
