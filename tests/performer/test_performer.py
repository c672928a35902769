"""The embedded boxer: what is promised of its motion, and of the truth that comes with it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfiltfilt

from crowdsim.bvh.io import read_bvh, to_clip
from crowdsim.motion import ground, quaternion
from crowdsim.motion.body import build_body
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.tracks import build_tracks
from crowdsim.performer.choreographer import Choreographer
from crowdsim.performer.moves import DEFENCES, PUNCHES, part
from crowdsim.performer.score import Accent, Channel
from crowdsim.performer.session import perform, perform_solo, write_performance
from crowdsim.performer.skeleton import (
    BALL_HEIGHT,
    FIST_AHEAD,
    FOREARMS,
    HANDS,
    HEAD,
    HEAD_CENTRE,
    LEGS,
    SPINE2,
    TOES,
    build_skeleton,
)
from crowdsim.performer.solo import FOOTWORK

FPS = 60.0


@pytest.fixture(scope="module")
def session():
    return perform(70.0, 5)


@pytest.fixture(scope="module")
def long_session():
    return perform(150.0, 8)


@pytest.fixture(scope="module")
def posed(session):
    return [clip_kinematics(performance.clip) for performance in session]


def _fists(positions, rotations):
    """Middle of both fists (F, 2, 3)."""
    ahead = [np.array([FIST_AHEAD * sign, 0.0, 0.0]) for sign in (1.0, -1.0)]
    return np.stack([positions[:, HANDS[s]] + quaternion.rotate(rotations[:, HANDS[s]], ahead[s]) for s in (0, 1)], 1)


def _travelling(performance, gaits, margin):
    """Frames of travel in one of the gaits, and a few more on either side (F,)."""
    frames = np.zeros(performance.clip.frame_count, bool)
    for travel in performance.truth.travels:
        if travel.gait in gaits:
            frames[max(travel.start - margin, 0) : travel.end + margin] = True
    return frames


def _headings(rotations):
    ahead = quaternion.rotate(rotations, np.array([0.0, 0.0, 1.0]))
    return np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 2]))


def _folds(clip, joints):
    """How far elbows or knees are folded [rad]."""
    return 2.0 * np.arctan2(
        np.linalg.norm(clip.rotations[:, joints, 1:], axis=-1), np.abs(clip.rotations[:, joints, 0])
    )


def test_a_session_has_the_given_length_in_several_clips(session):
    assert len(session) == 2
    assert sum(p.clip.frame_count for p in session) == 4200
    assert {p.clip.fps for p in session} == {60.0}


def test_the_same_seed_gives_the_same_bytes_and_another_seed_does_not():
    a, b, c = (perform(8.0, seed)[0].clip for seed in (3, 3, 4))
    assert a.rotations.tobytes() == b.rotations.tobytes()
    assert a.root_positions.tobytes() == b.root_positions.tobytes()
    assert not np.array_equal(a.rotations, c.rotations)


def test_the_skeleton_is_on_the_floor_and_has_the_documented_height():
    skeleton = build_skeleton()
    rest = skeleton.rest_positions()
    crown = rest[skeleton.end_parents[0]] + skeleton.end_offsets[0]
    assert crown[1] == pytest.approx(1.75, abs=1e-9)
    assert rest[TOES, 1] == pytest.approx(BALL_HEIGHT)
    assert skeleton.joint_count == 22


def test_the_ball_of_a_planted_foot_does_not_move(session):
    for performance in session:
        positions, _ = clip_kinematics(performance.clip)
        balls = positions[:, TOES]
        speed = np.linalg.norm(np.diff(balls, axis=0), axis=-1) * 60.0
        planted = performance.truth.contacts
        assert speed[planted[1:] & planted[:-1]].max() < 0.01
        assert balls[..., 1].min() >= BALL_HEIGHT - 1e-9


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_a_length_that_is_not_positive_is_refused(seconds):
    with pytest.raises(ValueError, match="expected both above 0"):
        perform(seconds, 1)


def test_an_unknown_stance_is_refused_with_the_choices():
    with pytest.raises(ValueError, match="'goofy'; expected one of orthodox, southpaw"):
        perform(5.0, 1, stance="goofy")


def test_a_southpaw_is_the_mirror_image_of_an_orthodox_boxer():
    left = perform(6.0, 2)[0]
    right = perform(6.0, 2, stance="southpaw")[0]
    names = left.clip.skeleton.names
    ours, _ = clip_kinematics(left.clip)
    theirs, _ = clip_kinematics(right.clip)
    for name in ("LeftHand", "RightToe", "Head"):
        other = name.replace("Left", "?").replace("Right", "Left").replace("?", "Right")
        mirrored = theirs[:, names.index(other)] * [-1.0, 1.0, 1.0]
        np.testing.assert_allclose(ours[:, names.index(name)], mirrored, atol=1e-9)
    assert [s.hand for s in left.truth.strikes] == [1 - s.hand for s in right.truth.strikes]
    assert np.array_equal(left.truth.contacts[:, 0], right.truth.contacts[:, 1])


def test_strike_detection_finds_the_fist_that_punches():
    body = build_body(build_skeleton())
    np.testing.assert_allclose(body.fist_offsets, [[FIST_AHEAD, 0.0, 0.0], [-FIST_AHEAD, 0.0, 0.0]], atol=1e-3)
    assert body.height == pytest.approx(1.75, abs=0.01)


def test_strikes_are_as_fast_as_punches_and_about_eighty_a_minute(long_session):
    strikes = [strike for performance in long_session for strike in performance.truth.strikes]
    seen = np.array([strike.speed for strike in strikes])
    assert seen.min() > 3.5
    assert seen.max() < 12.0
    assert np.mean(seen >= 5.0) > 0.98
    assert 5.5 < np.median(seen) < 8.0
    assert 60.0 < len(strikes) / 150.0 * 60.0 < 105.0
    assert {strike.kind for strike in strikes} == set(PUNCHES)
    kinds = {defence.kind for performance in long_session for defence in performance.truth.defences}
    assert len(kinds) >= 0.6 * len(DEFENCES)


def test_no_two_strikes_are_the_same(long_session):
    strikes = [strike for performance in long_session for strike in performance.truth.strikes]
    looks = {(round(strike.speed, 4), *(round(x, 4) for x in strike.position)) for strike in strikes}
    assert len(looks) == len(strikes)


def test_targets_are_spread_over_what_a_boxer_reaches(long_session):
    places = np.array([strike.position for performance in long_session for strike in performance.truth.strikes])
    height, ahead = places[:, 1], places[:, 2]
    assert np.mean(height < 1.25) > 0.1
    assert np.percentile(height, 95) > 1.5
    assert np.percentile(ahead, 95) > 0.85
    assert np.percentile(np.arctan2(places[:, 0], ahead), [2, 98]) == pytest.approx([-0.5, 0.5], abs=0.2)


def test_hooks_and_uppercuts_hit_at_close_quarters_and_straights_at_arms_length(long_session):
    strikes = [strike for performance in long_session for strike in performance.truth.strikes]
    far = {kind: [np.hypot(s.position[0], s.position[2]) for s in strikes if s.kind == kind] for kind in PUNCHES}
    for kind in ("lead_hook", "rear_hook", "lead_uppercut", "rear_uppercut"):
        assert min(far[kind]) < 0.5
    assert max(far["jab"]) > 0.92
    assert max(far["straight"]) > 0.92
    near = [s for s in strikes if np.hypot(s.position[0], s.position[2]) < 0.58]
    assert 0.05 < len(near) / len(strikes) < 0.35


def test_joints_stay_within_their_limits(session, posed):
    for performance, (positions, rotations) in zip(session, posed, strict=True):
        elbows, knees = _folds(performance.clip, list(FOREARMS)), _folds(performance.clip, list(LEGS))
        assert elbows.min() > np.radians(8)
        assert elbows.max() < np.radians(155)
        assert knees.min() > np.radians(8)
        assert knees.max() < np.radians(135)
        head = positions[:, HEAD] + quaternion.rotate(rotations[:, HEAD], np.array([0.0, HEAD_CENTRE, 0.0]))
        assert np.linalg.norm(_fists(positions, rotations) - head[:, None], axis=-1).min() > 0.16
        elbow = positions[:, FOREARMS] - positions[:, [SPINE2]]
        behind = quaternion.rotate(quaternion.conjugate(rotations[:, [SPINE2]]), elbow)[..., 2]
        assert np.percentile(behind, 2) > -0.2
        neck = 2.0 * np.arccos(np.clip(np.abs(performance.clip.rotations[:, [4, 5], 0]), 0.0, 1.0)).sum(axis=1)
        assert neck.max() < np.radians(80)


def test_knees_point_over_the_toes(session, posed):
    for positions, _ in posed:
        for leg, toe in zip(LEGS, TOES, strict=True):
            line = positions[:, leg + 1] - positions[:, leg - 1]
            line /= np.linalg.norm(line, axis=1, keepdims=True)
            knee = positions[:, leg] - positions[:, leg - 1]
            knee -= line * np.sum(knee * line, axis=1, keepdims=True)
            foot = positions[:, toe] - positions[:, toe - 1]
            ahead = np.sum(knee[:, [0, 2]] * foot[:, [0, 2]], axis=1)
            assert np.all(ahead > 0.0)


def test_nothing_goes_through_the_floor(session, posed):
    for performance, (positions, rotations) in zip(session, posed, strict=True):
        skeleton = performance.clip.skeleton
        ends = positions[:, skeleton.end_parents] + quaternion.rotate(
            rotations[:, skeleton.end_parents], skeleton.end_offsets
        )
        assert positions[..., 1].min() >= BALL_HEIGHT - 1e-9
        assert ends[..., 1].min() > 0.0


def test_motion_has_no_pops(session):
    for performance in session:
        clip = performance.clip
        turns = quaternion.to_rotation_vector(
            quaternion.multiply(quaternion.conjugate(clip.rotations[:-1]), clip.rotations[1:])
        )
        assert np.linalg.norm(turns, axis=-1).max() * FPS < 75.0
        trunk = turns[:, : SPINE2 + 1]
        assert np.linalg.norm(np.diff(trunk, axis=0), axis=-1).max() * FPS**2 < 450.0
        assert np.linalg.norm(np.diff(clip.root_positions, 2, axis=0), axis=-1).max() * FPS**2 < 120.0


def test_the_same_motion_at_twice_the_rate_moves_as_smoothly():
    """Where accelerations are bounded and continuous, halving the step halves the change of acceleration."""
    jumps = []
    for fps in (480.0, 960.0):
        clip = perform(9.0, 4, fps=fps)[0].clip
        local = quaternion.continuous(clip.rotations)
        turns = quaternion.to_rotation_vector(quaternion.multiply(quaternion.conjugate(local[:-1]), local[1:])) * fps
        bends = np.diff(turns, axis=0) * fps
        moves = np.diff(clip.root_positions, 2, axis=0) * fps**2
        change = [np.linalg.norm(np.diff(part, axis=0), axis=-1).max(axis=0) for part in (bends, moves)]
        jumps.append(np.append(change[0], change[1]))
    assert np.all(jumps[1] < 0.7 * jumps[0])


def test_boxers_are_never_quite_still(session):
    """In the quietest moments joints tremble at 3 to 10 Hz, as those of captured boxers do, and the head the least."""
    for performance in session:
        clip = performance.clip
        local = quaternion.continuous(clip.rotations)
        turns = quaternion.to_rotation_vector(quaternion.multiply(quaternion.conjugate(local[:-1]), local[1:])) * FPS
        quick = sosfiltfilt(butter(2, (3.0, 10.0), "band", fs=FPS, output="sos"), turns[:, 0], axis=0)
        size = np.sqrt(uniform_filter1d(np.sum(quick**2, axis=-1), 24))
        assert 0.15 < np.percentile(size, 10) < 0.7
        positions, _ = clip_kinematics(clip)
        moves = np.diff(positions[:, HEAD], axis=0) * FPS
        nods = sosfiltfilt(butter(2, (3.0, 10.0), "band", fs=FPS, output="sos"), moves, axis=0)
        assert np.percentile(np.sqrt(uniform_filter1d(np.sum(nods**2, axis=-1), 24)), 10) < 0.25


def test_the_body_comes_out_of_a_punch_slower_than_the_fist(session, posed):
    """A pelvis that snaps back with the fist looks like a machine."""
    for performance, (positions, _) in zip(session, posed, strict=True):
        rising = np.gradient(positions[:, 0, 1]) * FPS
        assert rising.max() < 1.8
        assert np.percentile(np.abs(rising), 95) < 0.85
        turning = np.abs(np.gradient(_headings(performance.clip.rotations[:, 0]))) * FPS
        assert np.percentile(turning, 95) < 6.0


def test_feet_never_cross_in_the_guard(session, posed):
    for performance, (positions, _) in zip(session, posed, strict=True):
        guard = ~_travelling(performance, ("walk", "jog"), 12)
        balls = [ground.to_local(performance.truth.stance, positions[:, toe]) for toe in TOES]
        apart = (balls[0] - balls[1])[guard]
        assert apart[:, 2].min() > 0.1, "the lead foot stays ahead of the rear foot"
        assert apart[:, 0].min() > -0.1, "the lead foot stays on its own side"


def test_one_foot_is_planted_nearly_always_but_in_quick_travel(session):
    slow = np.concatenate([~_travelling(performance, ("shuffle", "jog"), 2) for performance in session])
    aloft = np.concatenate([~performance.truth.contacts.any(axis=1) for performance in session])
    assert aloft[slow].mean() < 0.04


def test_clips_begin_and_end_in_the_guard(session):
    guards = []
    for performance in session:
        assert performance.truth.contacts[[0, -1]].all()
        positions, rotations = clip_kinematics(performance.clip)
        local = ground.to_local(performance.truth.stance[:, None], _fists(positions, rotations))
        guards.extend([local[0], local[-1]])
        assert all(strike.start > 0.2 and strike.end < performance.clip.seconds for strike in performance.truth.strikes)
    guards = np.array(guards)
    assert np.all(np.ptp(guards, axis=0) < 0.25)
    assert np.all((guards[..., 1] > 1.2) & (guards[..., 2] > 0.2))


def test_hips_turn_before_the_trunk_and_the_trunk_before_the_fist(session, posed):
    after, of = [], []
    for performance, (_, rotations) in zip(session, posed, strict=True):
        hips = np.gradient(_headings(rotations[:, 0]))
        trunk = np.gradient(_headings(rotations[:, SPINE2])) - hips
        for strike in performance.truth.strikes:
            if strike.kind in ("straight", "rear_hook", "rear_uppercut"):
                way = slice(max(round(strike.start * FPS) - 12, 0), strike.frame + 1)
                of.append(strike.kind)
                peaks = [int(np.argmax(path[way])) for path in (hips, trunk)]
                after.append((strike.peak - way.start - peaks[0], strike.peak - way.start - peaks[1]))
    assert len(of) > 10
    assert np.mean(np.array(after)[:, 0] > 0) > 0.95
    assert np.median(np.array(after)[:, 0]) > np.median(np.array(after)[:, 1]) >= 1


def test_a_fist_comes_back_about_as_quick_as_it_went(session, posed):
    ratios = []
    for performance, (positions, rotations) in zip(session, posed, strict=True):
        relative = _fists(positions, rotations) - positions[:, :1]
        speed = np.linalg.norm(np.gradient(relative, axis=0), axis=-1) * FPS
        for strike in performance.truth.strikes:
            back = speed[strike.frame : round(strike.end * FPS) + 3, strike.hand].max()
            ratios.append(back / strike.speed)
    assert 0.65 < np.median(ratios) < 1.1


def test_the_rear_heel_lifts_when_the_rear_hand_strikes(session, posed):
    for performance, (_, rotations) in zip(session, posed, strict=True):
        for strike in performance.truth.strikes:
            if strike.hand == 1:
                sole = quaternion.rotate(rotations[strike.frame, TOES[1] - 1], np.array([0.0, 0.0, 1.0]))
                assert np.arcsin(-sole[1]) > np.radians(18)


def test_a_session_turns_and_steps_in_all_directions(long_session):
    turned = np.concatenate([performance.truth.stance[:, 2] for performance in long_session])
    assert np.ptp(turned) > 1.8 * np.pi
    steps = []
    for performance in long_session:
        stance = performance.truth.stance[::30]
        steps.append(ground.to_local(stance[:-1], np.stack([stance[1:, 0], 0 * stance[1:, 0], stance[1:, 1]], axis=1)))
    way = np.concatenate(steps)[:, [0, 2]]
    assert np.all(way.max(axis=0) > 0.15)
    assert np.all(way.min(axis=0) < -0.15)


def test_in_the_guard_the_pelvis_moves_over_the_ground_as_a_boxers_does(session):
    speed = np.concatenate(
        [np.linalg.norm(np.gradient(p.clip.root_positions[:, [0, 2]], axis=0), axis=1) * FPS for p in session]
    )
    speed = speed[
        ~np.concatenate([_travelling(performance, ("shuffle", "walk", "jog"), 18) for performance in session])
    ]
    assert np.median(speed) == pytest.approx(0.29, abs=0.07)
    assert np.percentile(speed, 95) == pytest.approx(0.76, abs=0.15)


def test_the_truth_of_a_strike_is_where_its_fist_is(session, posed):
    for performance, (positions, rotations) in zip(session, posed, strict=True):
        tracks = build_tracks(build_body(performance.clip.skeleton), positions, rotations)
        for strike in performance.truth.strikes:
            place = ground.to_local(performance.truth.stance[strike.frame], tracks.fists[strike.frame, strike.hand])
            assert place == pytest.approx(strike.position, abs=0.02)
            assert strike.start * FPS - 1 <= strike.peak <= strike.frame


@pytest.mark.parametrize("move", [*PUNCHES, *DEFENCES, *FOOTWORK])
def test_every_move_can_be_performed_alone(move):
    performance = perform_solo(move, 3)
    truth = performance.truth
    assert [strike.kind for strike in truth.strikes] == ([move] if move in PUNCHES else [])
    assert [defence.kind for defence in truth.defences] == ([move] if move in DEFENCES else [])
    assert truth.contacts.all() == (move not in FOOTWORK)


def test_a_duck_takes_the_head_down_by_knees_and_spine():
    performance = perform_solo("duck", 3)
    positions, _ = clip_kinematics(performance.clip)
    drop = positions[0, [HEAD, 0], 1] - positions[:, [HEAD, 0], 1].min(axis=0)
    assert drop[0] > 0.28
    assert 0.15 < drop[1] < drop[0]


@pytest.mark.parametrize("move", [*PUNCHES, *DEFENCES])
def test_accents_of_a_move_rise_before_they_fall(move):
    for accent in {**PUNCHES, **DEFENCES}[move].parts:
        start, peak, fall, end = accent.at
        assert start < peak <= fall < end, accent


def test_parts_are_played_around_the_times_of_a_move():
    plan = Choreographer(np.random.default_rng(1), facing=0.0)
    plan.play(part(0.0, 0.25, -0.5, 0.0, FLEX=0.2, TWIST=-0.1), (1.0, 1.0, 4.0, 4.0), scale=2.0, unit=2.0)
    at = (1.0, 1.5, 3.0, 4.0)
    assert plan.score.accents == [Accent(Channel.FLEX, 0.4, at), Accent(Channel.TWIST, -0.2, at)]


def test_accents_are_no_faster_than_a_body():
    plan = Choreographer(np.random.default_rng(1), facing=0.0)
    plan.accent(Channel.FLEX, 0.3, 1.0, 1.01, 1.02, 1.03)
    assert plan.score.accents[0].at == pytest.approx((1.0, 1.07, 1.07, 1.18))


def test_an_unknown_move_is_refused_with_the_choices():
    with pytest.raises(ValueError, match=r"unknown move 'jabb'; expected one of jab, .*did you mean 'jab'"):
        perform_solo("jabb")


def test_clips_are_written_as_bvh_that_reads_back_to_the_same_motion(tmp_path):
    steps = []
    paths = write_performance(tmp_path / "new", 40.0, 6, progress=lambda *step: steps.append(step))
    assert [path.name for path in paths] == ["performer_00.bvh"]
    assert sorted(tmp_path.rglob("*")) == [tmp_path / "new", *paths]
    assert steps[-1] == ("perform", 1, 1)
    clip = perform(40.0, 6)[0].clip
    back = to_clip(read_bvh(paths[0]), 0.01, "y")
    assert back.fps == FPS
    assert back.skeleton.names == clip.skeleton.names
    np.testing.assert_allclose(clip_kinematics(back)[0], clip_kinematics(clip)[0], atol=1e-5)
