"""Elbows that fold backward are found and turned."""

from __future__ import annotations

import numpy as np
import pytest

from crowdsim.bvh.io import write_bvh
from crowdsim.capture.folding import backward_elbows, fold_forward
from crowdsim.capture.loading import load_capture
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import human_roles, sample_poses
from crowdsim.performer.session import MOVES, perform_solo

ELBOWS = ("left_elbow", "right_elbow")


@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("stance", ["orthodox", "southpaw"])
def test_elbows_of_a_boxer_fold_forward(move, stance):
    clip = perform_solo(move, stance=stance).clip
    assert backward_elbows(clip, human_roles(clip.skeleton, sample_poses(clip)[0])) == ()


@pytest.mark.parametrize("wrong", [ELBOWS, ELBOWS[:1], ELBOWS[1:]])
def test_elbows_that_fold_backward_are_named_and_corrected(wrong, tmp_path):
    clip = perform_solo("jab").clip
    roles = human_roles(clip.skeleton, sample_poses(clip)[0])
    broken = fold_forward(clip, roles, wrong)
    assert backward_elbows(broken, roles) == wrong
    write_bvh(tmp_path / "broken.bvh", broken)
    capture = load_capture(tmp_path / "broken.bvh")
    names = " and ".join(role.replace("_", " ") for role in wrong)
    verb, they = ("folds", "it is") if len(wrong) == 1 else ("fold", "they are")
    assert capture.findings == (f"elbows: {names} {verb} backward (95 % sure); {they} corrected to fold forward",)
    assert capture.faults == ()
    np.testing.assert_allclose(clip_kinematics(capture.clip)[0], clip_kinematics(clip)[0], atol=1e-5)


def test_a_corrected_elbow_moves_only_its_forearm_and_bends_as_far():
    clip = perform_solo("hook").clip if "hook" in MOVES else perform_solo("jab").clip
    roles = human_roles(clip.skeleton, sample_poses(clip)[0])
    positions, turned = (clip_kinematics(c)[0] for c in (clip, fold_forward(clip, roles, ELBOWS[:1])))
    moved = np.abs(positions - turned).max(axis=(0, 2)) > 1e-6
    assert list(np.flatnonzero(moved)) == [roles["left_hand"]]

    def reach(p):
        return np.linalg.norm(p[:, roles["left_hand"]] - p[:, roles["left_shoulder"]], axis=1)

    np.testing.assert_allclose(reach(positions), reach(turned), atol=1e-6)


def test_where_the_rest_pose_is_no_body_nothing_is_reported():
    clip = perform_solo("jab").clip
    assert backward_elbows(clip, {}) == ()


@pytest.mark.mocap
def test_both_elbows_of_one_captured_boxer_fold_backward_in_the_file(mocap):
    wrong = {
        path.name: [line for line in load_capture(path).findings if "backward" in line]
        for path in sorted((mocap / "fight_daz").glob("*.bvh"))
    }
    assert [name for name, lines in wrong.items() if lines] == ["cmu_13_18_boxing.bvh"]
    assert "left elbow and right elbow fold" in wrong["cmu_13_18_boxing.bvh"][0]
