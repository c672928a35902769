"""Roles of joints are found in the conventions of many exporters, and in no animal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from animals import ANIMALS, export_animal
from conventions import CONVENTIONS
from exporters import UPS, Export, export_motion

from crowdsim.bvh.io import to_clip
from crowdsim.motion.joint_names import split_name
from crowdsim.motion.joint_tree import JointTree
from crowdsim.motion.measuring import human_roles, measure_body, sample_poses
from crowdsim.motion.roles import find_roles, misfit
from crowdsim.motion.skeleton import Skeleton
from crowdsim.performer.session import perform

EXPORTS = {
    "t_pose": Export(),
    "six_channels_z_up": Export(scale=1.0, up=UPS["z"], six=True, order="mixed"),
    "bones_along_one_axis": Export(rest="bones", up=UPS["z"]),
    "i_pose_turned": Export(rest="I", up=UPS["-y"], heading=2.0),
    "single_frame": Export(frames=slice(50, 51)),
}


@pytest.fixture(scope="module")
def boxer():
    clip = perform(6.0, 2)[0].clip
    return clip, find_roles(clip.skeleton)


@pytest.mark.parametrize("export", EXPORTS)
@pytest.mark.parametrize("how", CONVENTIONS, ids=lambda how: how.name)
def test_every_joint_that_plays_a_role_is_found(boxer, how, export):
    clip = to_clip(export_motion(*boxer, how, EXPORTS[export]))
    found = {
        role: clip.skeleton.names[joint] for role, joint in human_roles(clip.skeleton, *sample_poses(clip)).items()
    }
    for role, name in how.roles.items():
        assert found[role] == name, role
    assert {role for role in found if "toe" in role} == {role for role in how.roles if "toe" in role}


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("rest", ["T", "bones"])
@pytest.mark.parametrize("how", CONVENTIONS, ids=lambda how: how.name)
def test_roles_are_those_of_the_skeleton_whatever_part_of_a_motion_a_file_holds(boxer, how, rest, named):
    found = []
    for frames in (slice(None), slice(0, 20), slice(50, 51), slice(200, 260)):
        clip = to_clip(export_motion(*boxer, how, Export(rest=rest, frames=frames)))
        if not named:
            names = tuple(f"n{joint}" for joint in range(clip.skeleton.joint_count))
            clip = replace(clip, skeleton=replace(clip.skeleton, names=names))
        found.append(human_roles(clip.skeleton, *sample_poses(clip)))
    assert all(one == found[0] for one in found[1:])


def test_a_connector_that_never_rotates_is_no_hip_even_where_it_lies_aside(boxer):
    how = next(how for how in CONVENTIONS if how.name == "connectors")
    clip = to_clip(export_motion(*boxer, how, Export(scale=1.0)))
    # Connectors that lie apart are known by their rotations alone.
    offsets = clip.skeleton.offsets.copy()
    for side, sign in (("L", 1.0), ("R", -1.0)):
        joint = clip.skeleton.names.index(f"__UpLeg_{side}")
        offsets[joint] += [0.06 * sign, 0.0, 0.0]
        offsets[joint + 1] -= [0.06 * sign, 0.0, 0.0]
    skeleton = replace(clip.skeleton, offsets=offsets)
    roles = human_roles(skeleton, *sample_poses(clip))
    assert skeleton.names[roles["left_hip"]] == "UpLeg_L"
    assert measure_body(clip).height == pytest.approx(measure_body(boxer[0]).height, abs=0.01)


def test_a_prefix_that_all_joints_have_says_nothing(boxer):
    clip, roles = boxer
    for prefix in ("Alex:", "Ball_", "Left_", "Foot|Hand:"):
        names = tuple(prefix + name for name in clip.skeleton.names)
        assert find_roles(replace(clip.skeleton, names=names)) == roles


@pytest.mark.parametrize("along_x", [False, True])
@pytest.mark.parametrize("frames", [90, 1])
@pytest.mark.parametrize("name", ANIMALS)
def test_no_animal_is_taken_for_a_human(name, frames, along_x):
    clip = to_clip(export_animal(ANIMALS[name], frames, along_x=along_x))
    assert human_roles(clip.skeleton, *sample_poses(clip)) == {}


@pytest.mark.parametrize(
    ("name", "side", "words"),
    [
        ("mixamorig:LeftUpLeg", 0, {"upleg"}),
        ("lShldr", 0, {"shldr"}),
        ("Bip01 R Thigh", 1, {"thigh"}),
        ("J_Bip_L_UpperLeg", 0, {"upperleg"}),
        ("upper_arm.R", 1, {"upperarm"}),
        ("lfemur", 0, {"femur"}),
        ("LUArm", 0, {"uarm"}),
        ("lowerarm_r", 1, {"lowerarm"}),
        ("ball_l", 0, {"ball"}),
        ("HandTipLeft", 0, {"handtip"}),
        ("WRIST_RIGHT", 1, {"wrist"}),
        ("CC_Base_L_Calf", 0, {"calf"}),
        ("左ひざ", 0, set()),
        ("hip", None, {"hip"}),
        ("Leg", None, {"leg"}),
        ("lowerleg", None, {"lowerleg"}),
        ("Root", None, {"root"}),
    ],
)
def test_names_are_split_into_a_side_and_words(name, side, words):
    found_side, found_words = split_name(name)
    assert found_side == side
    assert words <= found_words


def test_a_limb_is_followed_past_a_joint_that_only_twists(boxer):
    how = next(how for how in CONVENTIONS if how.name == "twist")
    clip = to_clip(export_motion(*boxer, how, Export()))
    names = clip.skeleton.names
    tree = JointTree(clip.skeleton, sample_poses(clip)[0])
    limb = [names[joint] for joint in tree.limb(names.index("LeftUpLeg"))]
    assert limb[:3] == ["LeftUpLeg", "LeftLeg", "LeftFoot"]


def test_left_and_right_without_names_follow_the_heading_of_the_body(boxer):
    how = next(how for how in CONVENTIONS if how.name == "flat")
    for heading in (0.0, 1.6, 3.1, -1.6):
        clip = to_clip(export_motion(*boxer, how, Export(heading=heading)))
        roles = human_roles(clip.skeleton, *sample_poses(clip))
        assert clip.skeleton.names[roles["left_foot"]] == "joint3a"
        assert clip.skeleton.names[roles["right_hand"]] == "joint10b"


def test_proportions_of_a_human_fit_and_those_of_a_giraffe_do_not(boxer):
    clip, roles = boxer
    assert misfit(JointTree(clip.skeleton, None), roles) < 0.3
    offsets = clip.skeleton.offsets.copy()
    offsets[roles["head"]] *= 15.0
    assert misfit(JointTree(Skeleton(clip.skeleton.names, clip.skeleton.parents, offsets), None), roles) > 0.8


def test_a_skeleton_of_few_joints_is_no_body():
    skeleton = Skeleton(("Head", "LeftHand"), np.array([-1, 0], np.int32), np.ones((2, 3)))
    assert find_roles(skeleton) == {}


def test_a_sword_in_the_hand_changes_nothing(boxer):
    clip, roles = boxer
    skeleton = clip.skeleton
    hand = roles["right_hand"]
    longer = Skeleton(
        (*skeleton.names, "x1", "x2", "x3"),
        np.concatenate([skeleton.parents, [hand, skeleton.joint_count, skeleton.joint_count + 1]]).astype(np.int32),
        np.concatenate([skeleton.offsets, [[0.0, 0.0, 0.1], [0.0, 0.0, 0.5], [0.0, 0.0, 0.5]]]),
    )
    assert find_roles(longer) == roles
    nameless = Skeleton(tuple(f"n{i}" for i in range(len(longer.names))), longer.parents, longer.offsets)
    found = find_roles(nameless)
    assert found["right_hand"] == roles["right_hand"]
    assert found["left_hand"] == roles["left_hand"]
