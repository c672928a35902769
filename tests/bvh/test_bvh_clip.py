"""What a BVH file means: places and turns in metres, y up."""

import itertools
import math

import numpy as np
import pytest
from bvh_text import PLAIN, bvh
from naive_bvh import read, world_positions

from crowdsim.bvh.io import parse_bvh, read_bvh, rotate_up, to_clip
from crowdsim.errors import BvhError
from crowdsim.motion.kinematics import clip_kinematics

ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]


@pytest.mark.parametrize("order", ORDERS)
def test_world_positions_are_those_of_matrices_in_channel_order(order):
    text = PLAIN.replace("Zrotation Xrotation Yrotation", " ".join(f"{letter}rotation" for letter in order))
    _, parents, offsets, channels, motion = read(text)
    positions, _ = clip_kinematics(to_clip(bvh(text), unit_scale=0.01))
    np.testing.assert_allclose(positions, world_positions(parents, offsets, channels, motion) / 100, atol=1e-12)


def test_positions_replace_offsets_and_missing_axes_keep_them():
    text = PLAIN.replace("CHANNELS 6 Xposition Yposition Zposition Z", "CHANNELS 4 Yposition Z").replace(
        "CHANNELS 6 Xrotation Yrotation Zrotation Zposition Xposition Yposition", "CHANNELS 2 Zposition Xrotation"
    )
    head = text[: text.index("0 90")]
    clip = to_clip(bvh(head + "90 1 2 3 4 5 6 10 20\n91 1 2 3 4 5 6 11 20\n"))
    np.testing.assert_array_equal(clip.root_positions, [[1, 90, 3], [1, 91, 3]])
    np.testing.assert_array_equal(clip.translations[:, 2], [[4, -1, 10], [4, -1, 11]])
    np.testing.assert_array_equal(clip.translations[:, 0], clip.root_positions)
    np.testing.assert_array_equal(clip.translations[:, 1], [[0, 10, 0]] * 2)


def test_positions_that_do_not_change_become_the_offset():
    head = PLAIN[: PLAIN.index("0 90")]
    clip = to_clip(bvh(head + "0 90 1 10 20 30 40 50 60 7 8 9 1 4 -2\n" * 2), unit_scale=0.5)
    assert clip.translations is None
    np.testing.assert_array_equal(clip.skeleton.offsets[2], [2.0, -1.0, 0.5])
    np.testing.assert_array_equal(clip.skeleton.offsets[0], [0.5, 1.0, 1.5])


def test_a_root_without_position_channels_stays_at_its_offset():
    text = PLAIN.replace("CHANNELS 6 Xposition Yposition Zposition Z", "CHANNELS 3 Z")
    clip = to_clip(bvh(text[: text.index("0 90")] + "1 2 3 4 5 6 7 8 9 1 4 -1"))
    np.testing.assert_array_equal(clip.root_positions, [[1, 2, 3]])


@pytest.mark.parametrize("up_axis", ["y", "z", "x", "-y", "-z", "-x"])
def test_rotating_a_file_upright_rotates_rest_pose_and_poses_alike(up_axis):
    walk = bvh(PLAIN)
    plain, turned = to_clip(walk), to_clip(walk, up_axis=up_axis)
    up = np.zeros(3)
    up["xyz".index(up_axis[-1])] = -1.0 if up_axis.startswith("-") else 1.0
    np.testing.assert_array_equal(rotate_up(up, up_axis), [0, 1, 0])
    turn = rotate_up(np.eye(3), up_axis)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    positions, _ = clip_kinematics(plain)
    turned_positions, _ = clip_kinematics(turned)
    np.testing.assert_allclose(turned_positions, rotate_up(positions, up_axis), atol=1e-12)
    rest = plain.skeleton.rest_positions()
    np.testing.assert_allclose(turned.skeleton.rest_positions(), rotate_up(rest, up_axis), atol=1e-12)
    ends = rotate_up(plain.skeleton.end_offsets, up_axis)
    np.testing.assert_array_equal(turned.skeleton.end_offsets, ends)


def test_wrong_arguments_name_the_choices():
    with pytest.raises(BvhError, match="up axis 'w' is unknown, expected one of y, -y, z, -z, x, -x"):
        to_clip(bvh(PLAIN), up_axis="w")
    for scale in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(BvhError, match="unit scale"):
            to_clip(bvh(PLAIN), unit_scale=scale)


def test_quaternions_do_not_change_sides_from_frame_to_frame():
    head = "HIERARCHY ROOT a {OFFSET 0 0 0 CHANNELS 1 Yrotation} MOTION Frames: 800 Frame Time: .01\n"
    clip = to_clip(parse_bvh((head + "\n".join(str(angle % 360 - 180) for angle in range(800))).encode()))
    dots = np.sum(clip.rotations[1:] * clip.rotations[:-1], axis=-1)
    assert dots.min() > 0.99


@pytest.mark.mocap
def test_real_capture_matches_other_readers(mocap):
    import bvhio
    import pybvh

    for name in ("fight_daz/cmu_13_18_boxing.bvh", "locomotion_daz/cmu_09_01.bvh"):
        walk = read_bvh(mocap / name)
        assert walk.findings == ()
        assert walk.fps == 120.0
        positions, _ = clip_kinematics(to_clip(walk))
        other = pybvh.read_bvh_file(str(mocap / name))
        np.testing.assert_allclose(positions, other.joint_positions(), atol=1e-6)
    tree = bvhio.readAsHierarchy(str(mocap / name))
    for frame in (0, 30, 148):
        tree.loadPose(frame)
        for joint, _, _ in tree.layout():
            if joint.Name in walk.names:
                place = positions[frame, walk.names.index(joint.Name)]
                np.testing.assert_allclose(place, list(joint.PositionWorld), atol=2e-3)


def test_joints_without_channels_take_no_more_memory_than_the_rows_of_a_file_could_hold():
    def file(joints, rows):
        tree = "".join(f"JOINT b{joint} {{OFFSET 0 1 0}} " for joint in range(joints))
        head = f"HIERARCHY ROOT a {{OFFSET 0 0 0 CHANNELS 1 Xrotation {tree}}} MOTION Frames: 1 Frame Time: 0.01\n"
        return parse_bvh((head + "0\n" * rows).encode(), "a.bvh")

    assert to_clip(file(900, 100)).rotations.shape == (100, 901, 4)
    with pytest.raises(BvhError, match="60000 frames of 901 joints are more than fit in memory, expected at most"):
        to_clip(file(900, 60_000))
