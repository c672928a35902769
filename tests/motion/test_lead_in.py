"""Calibration poses in front of a capture are found, however long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from turns import about

from crowdsim.motion import quaternion
from crowdsim.motion.measuring import lead_in, measure_body
from crowdsim.motion.resampling import resample
from crowdsim.motion.skeleton import Clip
from crowdsim.performer.session import perform


@pytest.fixture(scope="module")
def boxer():
    clip = perform(5.0, 2)[0].clip
    return clip, measure_body(clip)


def _pose(clip: Clip, arms: float) -> np.ndarray:
    """Rotations (J, 4) of a rest pose whose arms hang by an angle [deg] under level."""
    names = clip.skeleton.names
    pose = np.zeros((clip.skeleton.joint_count, 4))
    pose[:, 0] = 1.0
    for side, sign in (("Left", -1.0), ("Right", 1.0)):
        turn = about([0.0, 0.0, 1.0], sign * np.deg2rad(arms))
        pose[names.index(f"{side}Arm")] = turn
    return pose


def _lead(clip: Clip, frames: int, arms: float = 0.0, blend: int = 0) -> Clip:
    """The clip after a held pose that blends into it."""
    pose = _pose(clip, arms)
    shares = np.concatenate([np.zeros(frames), (np.arange(blend) + 1.0) / (blend + 1.0)])
    lead = quaternion.slerp(pose[None], clip.rotations[:1], shares[:, None])
    roots = np.repeat(clip.root_positions[:1], len(shares), axis=0)
    return replace(
        clip,
        rotations=np.concatenate([lead, clip.rotations]),
        root_positions=np.concatenate([roots, clip.root_positions]),
    )


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
@pytest.mark.parametrize("arms", [0.0, 45.0])
@pytest.mark.parametrize("seconds", [0.0, 0.5, 3.0, 9.0])
def test_a_held_lead_in_pose_is_trimmed_whole_and_little_more(boxer, fps, arms, seconds):
    clip = resample(boxer[0], fps)
    frames = max(1, round(seconds * fps))
    found = lead_in(_lead(clip, frames, arms), boxer[1])
    assert frames <= found <= frames + round(0.1 * fps) + 1


@pytest.mark.parametrize("blend", [2, 4, 6])
def test_frames_that_leave_the_pose_faster_than_a_body_moves_are_trimmed_too(boxer, blend):
    clip = resample(boxer[0], 120.0)
    found = lead_in(_lead(clip, 1, 0.0, blend), boxer[1])
    assert blend <= found <= blend + 14


def test_a_clip_that_starts_in_its_guard_is_left_whole(boxer):
    for seed in range(3):
        clip = perform(4.0, seed)[0].clip
        assert lead_in(clip, boxer[1]) == 0


def test_a_clip_of_nothing_but_a_calibration_pose_is_left_whole(boxer):
    clip = boxer[0]
    still = replace(clip, rotations=np.repeat(_pose(clip, 0.0)[None], clip.frame_count, axis=0))
    assert lead_in(still, boxer[1]) == 0


def test_standing_with_hanging_arms_is_not_trimmed(boxer):
    assert lead_in(_lead(boxer[0], 120, 85.0, blend=30), boxer[1]) == 0


def test_arms_that_pass_through_an_a_pose_are_motion(boxer):
    clip = boxer[0]
    rotations = np.stack([_pose(clip, angle) for angle in np.linspace(80.0, 20.0, 40)])
    moved = replace(clip, rotations=rotations, root_positions=clip.root_positions[:40])
    assert lead_in(moved, boxer[1]) == 0


@pytest.mark.parametrize("count", [0, 1, 2])
def test_next_to_no_frames_are_no_lead_in(boxer, count):
    assert lead_in(boxer[0].sliced(0, count), boxer[1]) == 0
