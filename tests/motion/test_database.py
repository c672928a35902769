"""One database over all clips: whole control frames, one floor, what was found, and plain errors."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from conventions import CONVENTIONS
from exporters import Export, export_motion
from scipy.ndimage import maximum_filter1d

from crowdsim.bvh.io import to_clip
from crowdsim.errors import MotionError
from crowdsim.motion import ground
from crowdsim.motion.database import build_database
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.measuring import measure_clips
from crowdsim.motion.roles import find_roles
from crowdsim.motion.tracks import build_tracks, speeds
from crowdsim.performer.session import perform, perform_solo

BY_NAME = {how.name: how for how in CONVENTIONS}


@pytest.fixture(scope="module")
def clips():
    first = perform(9.0, 1)[0].clip
    second = perform(7.03, 2)[0].clip
    return [replace(first, name="first"), replace(second, name="second")]


@pytest.fixture(scope="module")
def database(clips):
    return build_database(measure_clips(clips))


def test_clips_are_ranges_of_whole_control_frames(database, clips):
    assert database.stride == 4
    assert database.clip_names == ("first", "second")
    lengths = [clip.frame_count // 4 for clip in clips]
    assert database.clip_starts.tolist() == [0, lengths[0], sum(lengths)]
    assert database.frame_count == sum(lengths)
    assert database.seconds == pytest.approx(sum(lengths) / 15.0)
    playback = 4 * database.frame_count
    for name in ("root_positions", "rotations", "ground", "contacts", "fists", "heads", "necks", "pelvises"):
        assert len(getattr(database, name)) == playback, name
    assert database.rotations.dtype == np.float32
    assert database.ground.dtype == np.float64


def test_what_is_kept_is_what_the_poses_give(database):
    positions, rotations = forward_kinematics(database.skeleton, database.root_positions, database.rotations)
    tracks = build_tracks(database.body, positions, rotations)
    gap = ground.wrap(tracks.stances - database.ground)
    turn = gap[0, 2]
    speed = maximum_filter1d(speeds(tracks.pelvises[:, [0, 2]], 60.0), 73)
    slow = speed < 0.6
    assert slow.sum() > 150
    assert np.abs(gap[:, :2]).max() < 1e-4
    assert np.abs(ground.wrap(gap[slow, 2] - turn)).max() < 1e-4
    np.testing.assert_allclose(ground.to_local(database.ground[:, None], tracks.fists), database.fists, atol=1e-4)
    np.testing.assert_allclose(ground.to_local(database.ground, tracks.heads), database.heads, atol=1e-4)
    frames, hands = database.strike_frames, database.strike_limbs
    assert len(frames) > 5
    np.testing.assert_allclose(database.strike_positions, database.fists[frames, hands], atol=1e-4)


def test_ground_frames_hardly_move_while_feet_do_not_and_mean_headings_are_ahead(database):
    positions, rotations = forward_kinematics(database.skeleton, database.root_positions, database.rotations)
    tracks = build_tracks(database.body, positions, rotations)
    ahead = ground.wrap(tracks.ground[:, 2] - database.ground[:, 2])
    assert np.abs(np.angle(np.exp(1j * ahead).mean())) < 0.02
    both = database.contacts.all(axis=1)
    still = both[1:] & both[:-1]
    still[4 * database.clip_starts[1:-1] - 1] = False
    distances = [np.hypot(*np.diff(places[:, :2], axis=0)[still].T) for places in (database.ground, tracks.ground)]
    turns = [np.abs(np.diff(places[:, 2])[still]) for places in (database.ground, tracks.ground)]
    assert still.sum() > 300
    assert distances[0].mean() < 0.1 * distances[1].mean()
    assert turns[0].mean() < 0.3 * turns[1].mean()


@pytest.mark.parametrize("move", ["walk", "jog", "walk_curve"])
def test_feet_that_pass_one_another_do_not_rotate_the_ground_frame(move):
    performance = perform_solo(move)
    database = build_database(measure_clips([performance.clip]))
    travel = performance.truth.travels[0]
    frames = slice(travel.start + 15, travel.end - 15)
    gap = ground.wrap(database.ground[frames, 2] - performance.truth.stance[frames, 2])
    assert np.ptp(gap) < 0.6
    assert np.abs(np.diff(gap)).max() * 60.0 < 3.5


def test_ground_frames_of_mirror_images_are_mirrored(clips):
    both = build_database(measure_clips(clips[:1]), mirror=True)
    own, image = np.split(both.ground, 2)
    np.testing.assert_allclose(image[:, 0], -own[:, 0], atol=1e-9)
    np.testing.assert_allclose(ground.wrap(image[:, 2] + own[:, 2]), 0.0, atol=1e-9)


def test_strikes_are_in_order_within_clips_and_after_their_peaks(database):
    assert (np.diff(database.strike_frames) >= 0).all()
    assert (database.strike_peaks <= database.strike_frames).all()
    clip_of = np.searchsorted(4 * database.clip_starts, [database.strike_frames, database.strike_peaks], side="right")
    assert np.array_equal(clip_of[0], clip_of[1])
    assert database.strike_frames.dtype == np.int32


def test_rotations_do_not_change_sign_and_headings_do_not_jump_within_clips(database):
    for start, stop in zip(4 * database.clip_starts[:-1], 4 * database.clip_starts[1:], strict=True):
        part = database.rotations[start:stop]
        assert np.sum(part[1:] * part[:-1], axis=-1).min() > 0.0
        assert np.abs(np.diff(database.ground[start:stop, 2])).max() < 1.0


def test_the_same_clips_give_the_same_bytes(database, clips):
    again = build_database(measure_clips(clips))
    for entry in fields(database):
        value = getattr(database, entry.name)
        if isinstance(value, np.ndarray):
            assert value.tobytes() == getattr(again, entry.name).tobytes(), entry.name


def test_mirror_images_follow_the_clips(database, clips):
    both = build_database(measure_clips(clips), mirror=True)
    assert both.clip_names == ("first", "second", "first~mirror", "second~mirror")
    assert both.captured_frames == database.captured_frames == database.frame_count
    half = database.frame_count
    assert both.clip_starts.tolist() == [*database.clip_starts.tolist(), *(half + database.clip_starts[1:]).tolist()]
    np.testing.assert_allclose(both.ground[4 * half :, 0], -both.ground[: 4 * half, 0], atol=1e-6)
    assert np.array_equal(both.contacts[4 * half :], both.contacts[: 4 * half, ::-1])
    flip = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(both.fists[4 * half :], both.fists[: 4 * half, ::-1] * flip, atol=1e-5)
    ours = both.strike_frames < 4 * half
    assert ours.sum() * 2 == len(ours)
    assert (both.strike_limbs[ours] == 0).sum() == (both.strike_limbs[~ours] == 1).sum()


@pytest.mark.parametrize(("control", "playback"), [(10.0, 60.0), (30.0, 30.0), (15.0, 30.0), (12.5, 50.0)])
def test_any_pair_of_rates_that_divide_will_do(clips, control, playback):
    database = build_database(measure_clips(clips[:1]), control, playback)
    assert database.stride == round(playback / control)
    assert database.frame_count * database.stride == len(database.rotations)
    assert database.seconds == pytest.approx(9.0, abs=1.5 / control)


def test_clips_of_different_rates_are_combined(clips):
    slow = to_clip(export_motion(clips[0], find_roles(clips[0].skeleton), BY_NAME["lafan"], Export(every=2)), 0.01)
    fast = to_clip(export_motion(clips[1], find_roles(clips[1].skeleton), BY_NAME["lafan"], Export()), 0.01)
    database = build_database(measure_clips([slow, fast]))
    assert database.seconds == pytest.approx(16.0, abs=0.2)


def test_trimming_and_the_floor_can_be_left_out(clips):
    raised = replace(clips[0], root_positions=clips[0].root_positions + np.array([0.0, 0.4, 0.0]))
    assert build_database(measure_clips([raised])).heads[:, 1].mean() < 1.6
    assert build_database(measure_clips([raised]), calibrate_floor=False).heads[:, 1].mean() > 1.7
    assert build_database(measure_clips([raised]), trim=False).frame_count == 135


def test_progress_is_reported_clip_by_clip(clips):
    result = []
    build_database(measure_clips(clips), mirror=True, progress=lambda *step: result.append(step))
    assert result == [("motion", done, 4) for done in (1, 2, 3, 4)]


def test_no_clips_are_refused():
    with pytest.raises(MotionError, match="no clips; expected at least one"):
        build_database([])


def test_rates_that_do_not_divide_are_refused_with_some_that_do(clips):
    with pytest.raises(MotionError) as error:
        build_database(measure_clips(clips), 15.0, 50.0)
    assert str(error.value) == ("playback rate 50 is no whole multiple of the control rate 15; expected 15, 30, 45 ...")


def test_a_clip_too_short_is_refused_by_name(clips):
    with pytest.raises(MotionError) as error:
        build_database(measure_clips([clips[0], clips[1].sliced(0, 5)]))
    assert str(error.value) == (
        "clip 'second' has 5 frames (0.08 s), expected 0.13 s or more after any calibration pose"
    )


@pytest.mark.parametrize("frames", [0, 1])
def test_clips_without_motion_are_refused(clips, frames):
    with pytest.raises(MotionError, match=f"clip 'second' has {frames} frames"):
        build_database(measure_clips([clips[0], clips[1].sliced(0, frames)]))


def test_another_skeleton_is_refused_with_the_first_difference(clips):
    other = clips[1].skeleton
    renamed = replace(clips[1], skeleton=replace(other, names=("Pelvis", *other.names[1:])))
    with pytest.raises(MotionError) as error:
        build_database(measure_clips([clips[0], renamed]))
    assert str(error.value) == ("clip 'second' has another skeleton than 'first': joint 0 is 'Pelvis', expected 'Hips'")


def test_numbers_that_are_not_finite_are_refused(clips):
    rotations = clips[1].rotations.copy()
    rotations[40, 3] = np.nan
    with pytest.raises(MotionError, match="clip 'second' is not finite in frame 40"):
        measure_clips([clips[0], replace(clips[1], rotations=rotations)])


def test_what_is_no_body_is_refused(clips):
    skeleton = clips[0].skeleton
    offsets = np.ones_like(skeleton.offsets)
    with pytest.raises(MotionError, match="no human body found"):
        measure_clips([replace(clips[0], skeleton=replace(skeleton, offsets=offsets))])


def test_a_skeleton_without_a_true_rest_pose_goes_in(clips, database):
    clip = clips[0]
    export = export_motion(clip, find_roles(clip.skeleton), BY_NAME["unreal"], Export(rest="bones"))
    odd = build_database(measure_clips([to_clip(export, 0.01)]))
    ours = (database.strike_frames < 4 * database.clip_starts[1]).sum()
    assert abs(len(odd.strike_frames) - ours) <= 1
    assert (odd.contacts == database.contacts[: len(odd.contacts)]).mean() > 0.95
