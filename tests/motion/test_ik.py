"""Two-bone inverse kinematics: targets reached, limits kept, and nothing that snaps."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from naive_ik import end_place

from crowdsim.motion import quaternion
from crowdsim.motion.ik import flexion, hinge_axis, reach_with_joints, two_bone
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton

STILL = np.array([1.0, 0.0, 0.0, 0.0])
X, Y, Z = np.eye(3)


def random_limbs(count, seed=0, least=0.2, most=2.5):
    """Limbs anywhere, bent by ``least`` to ``most``, with the hinge axis they are bent about."""
    rng = np.random.default_rng(seed)
    turn = quaternion.normalise(rng.normal(size=(count, 4)))
    lengths = rng.uniform(0.2, 0.5, (count, 2))
    flexion = rng.uniform(least, most, count)
    upper = rng.normal(size=(count, 3))
    middle = upper + quaternion.rotate(turn, -Y * lengths[:, :1])
    lower = quaternion.rotate(quaternion.from_axis_angle(X, flexion), -Y) * lengths[:, 1:]
    end = middle + quaternion.rotate(turn, lower)
    return upper, middle, end, lengths, quaternion.rotate(turn, X), flexion, rng


def bones(upper, middle, end, reach):
    """Return where middle joint and end come to lie when the new rotations turn the limb, from unturned joints."""
    new_middle = upper + quaternion.rotate(reach.upper_rotations, middle - upper)
    return new_middle, new_middle + quaternion.rotate(reach.middle_rotations, end - middle)


def flexion_about(upper, middle, end, hinge):
    """Signed flexion [rad], positive about the hinge axis."""
    u, v = middle - upper, end - middle
    cross = np.cross(u, v)
    angle = np.arctan2(np.linalg.norm(cross, axis=-1), np.sum(u * v, axis=-1))
    return np.where(np.sum(cross * hinge, axis=-1) < 0.0, -angle, angle)


def test_targets_within_reach_are_reached_to_a_micrometre():
    upper, middle, end, lengths, hinge, _, rng = random_limbs(2000)
    limits = (0.05, 2.7)
    nearest, farthest = (
        np.sqrt(lengths[:, 0] ** 2 + lengths[:, 1] ** 2 + 2 * lengths.prod(axis=1) * math.cos(angle))
        for angle in limits[::-1]
    )
    direction = rng.normal(size=(2000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    target = upper + direction * rng.uniform(nearest, farthest)[:, None]
    reach = two_bone(upper, middle, end, STILL, STILL, target, hinge, limits)
    new_middle, new_end = bones(upper, middle, end, reach)
    np.testing.assert_allclose(new_end, target, atol=1e-6)
    np.testing.assert_allclose(reach.end_positions, new_end, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(new_middle - upper, axis=1), lengths[:, 0], rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(new_end - new_middle, axis=1), lengths[:, 1], rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(reach.middle_rotations, axis=1), 1.0, rtol=1e-12)


def test_the_end_comes_as_near_as_a_search_over_flexions_finds():
    upper, middle, end, _, hinge, _, rng = random_limbs(12, seed=1)
    target = upper + rng.normal(size=(12, 3)) * 0.6
    reach = two_bone(upper, middle, end, STILL, STILL, target, hinge, (0.3, 2.0))
    for limb in range(12):
        expected = end_place(upper[limb], middle[limb], end[limb], target[limb], hinge[limb], 0.3, 2.0)
        np.testing.assert_allclose(reach.end_positions[limb], expected, atol=1e-4)


def test_a_right_angle_has_the_answer_of_pythagoras():
    reach = two_bone([0, 0, 0], [0, -3, 0], [0, -3 * 1.9, 3], STILL, STILL, [0, 0, 5], -X, (0.0, math.pi))
    np.testing.assert_allclose(reach.end_positions, [0, 0, 5], atol=1e-12)
    equal = two_bone([0, 0, 0], [0, -1, 0], [0, -1.8, 0.6], STILL, STILL, [0, -math.sqrt(2), 0], -X, (0.0, math.pi))
    middle, end = bones(np.zeros(3), -Y, np.array([0, -1.8, 0.6]), equal)
    np.testing.assert_allclose(middle, [0, -math.sqrt(0.5), -math.sqrt(0.5)], atol=1e-12)
    np.testing.assert_allclose(end, [0, -math.sqrt(2), 0], atol=1e-12)


def test_a_limb_whose_end_is_at_the_target_does_not_move():
    upper, middle, end, _, hinge, _, rng = random_limbs(200, seed=2)
    turns = quaternion.normalise(rng.normal(size=(2, 200, 4)))
    reach = two_bone(upper, middle, end, turns[0], turns[1], end, hinge, (0.0, math.pi))
    np.testing.assert_allclose(reach.upper_rotations, turns[0], atol=1e-7)
    np.testing.assert_allclose(reach.middle_rotations, turns[1], atol=1e-7)


def test_rotations_carry_over_what_the_joints_had():
    upper, middle, end, _, hinge, _, rng = random_limbs(50, seed=3)
    turns = quaternion.normalise(rng.normal(size=(2, 50, 4)))
    target = upper + rng.normal(size=(50, 3)) * 0.3
    plain = two_bone(upper, middle, end, STILL, STILL, target, hinge)
    turned = two_bone(upper, middle, end, turns[0], turns[1], target, hinge)
    np.testing.assert_allclose(turned.upper_rotations, quaternion.multiply(plain.upper_rotations, turns[0]), atol=1e-12)
    np.testing.assert_allclose(
        turned.middle_rotations, quaternion.multiply(plain.middle_rotations, turns[1]), atol=1e-12
    )


@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 10**6),
    st.floats(0.0, 3.0),
    st.tuples(st.floats(0.0, math.pi), st.floats(0.0, math.pi)).map(sorted),
    st.floats(-3.0, 3.0),
    st.sampled_from([0.0, 0.05]),
)
def test_flexion_stays_within_its_limits_and_never_bends_backwards(seed, far, limits, flexion, softness):
    upper, middle, _, lengths, hinge, _, rng = random_limbs(1, seed=seed)
    bend = quaternion.rotate(quaternion.from_axis_angle(hinge, np.array([flexion])), middle - upper)
    end = middle + bend * lengths[:, 1:] / lengths[:, :1]
    target = upper + rng.normal(size=3) * far
    reach = two_bone(upper, middle, end, STILL, STILL, target, hinge, limits, softness)
    new_middle, new_end = bones(upper, middle, end, reach)
    axis = quaternion.rotate(reach.upper_rotations, hinge)
    found = flexion_about(upper, new_middle, new_end, axis)[0]
    assert limits[0] - 1e-6 <= abs(found) <= limits[1] + 1e-6
    assert found > -1e-6 or abs(found) > math.pi - 1e-6
    line, wanted = new_end - upper, target - upper
    size = np.linalg.norm(line) * np.linalg.norm(wanted)
    assume(min(np.linalg.norm(line), np.linalg.norm(wanted)) > 1e-6)
    assert np.sum(line * wanted) == pytest.approx(size, rel=1e-9, abs=1e-12)


def test_out_of_reach_the_limb_is_stretched_to_its_limit_along_the_line():
    upper, middle, end = np.zeros(3), np.array([0, -0.4, 0]), np.array([0, -0.5, 0.3])
    target = np.array([1.0, 2.0, -2.0])
    reach = two_bone(upper, middle, end, STILL, STILL, target, -X, (0.0, 2.5))
    length = 0.4 + math.hypot(0.1, 0.3)
    np.testing.assert_allclose(reach.end_positions, target / 3.0 * length, atol=1e-9)
    reach = two_bone(upper, middle, end, STILL, STILL, target, -X, (math.pi / 2, 2.5))
    np.testing.assert_allclose(reach.end_positions, target / 3.0 * math.hypot(0.4, math.hypot(0.1, 0.3)), atol=1e-9)


def test_a_target_too_near_folds_the_limb_to_its_limit():
    upper, middle, end = np.zeros(3), np.array([0, -0.4, 0]), np.array([0, -0.4, 0.4])
    reach = two_bone(upper, middle, end, STILL, STILL, [0, 0, 0.1], -X, (0.0, math.radians(120)))
    np.testing.assert_allclose(reach.end_positions, [0, 0, 0.4], atol=1e-9)
    on_the_joint = two_bone(upper, middle, end, STILL, STILL, upper, -X, (0.0, math.radians(120)))
    assert np.linalg.norm(on_the_joint.end_positions) == pytest.approx(0.4)
    folded = two_bone(upper, middle, end, STILL, STILL, upper, -X, (0.0, math.pi))
    np.testing.assert_allclose(folded.end_positions, upper, atol=1e-9)


def test_a_straight_limb_bends_about_its_hinge():
    upper, middle, end = np.zeros(3), np.array([0, -0.4, 0]), np.array([0, -0.8, 0])
    for hinge in (X, -X, Z, np.array([0.6, 0.5, 0.8])):
        reach = two_bone(upper, middle, end, STILL, STILL, [0, -0.6, 0], hinge, (0.0, math.pi))
        new_middle, new_end = bones(upper, middle, end, reach)
        np.testing.assert_allclose(new_end, [0, -0.6, 0], atol=1e-9)
        normal = np.cross(new_middle, new_end - new_middle)
        square = hinge - np.array([0, hinge[1], 0])
        np.testing.assert_allclose(normal / np.linalg.norm(normal), square / np.linalg.norm(square), atol=1e-9)


def test_a_straight_limb_with_no_known_hinge_or_one_along_the_bone_still_bends():
    for bone in (X, Y, Z, (X + Y) / math.sqrt(2)):
        for hinge in (np.zeros(3), bone):
            reach = two_bone([0, 0, 0], bone, 2 * bone, STILL, STILL, [0.3, 0.4, 0.5], hinge, (0.0, math.pi))
            np.testing.assert_allclose(reach.end_positions, [0.3, 0.4, 0.5], atol=1e-9)


def test_an_elbow_that_is_bent_backwards_is_bent_the_right_way():
    upper, middle, end = np.zeros(3), np.array([0, -0.4, 0]), np.array([0, -0.79, -0.08])
    assert flexion_about(upper, middle, end, -X) < 0
    reach = two_bone(upper, middle, end, STILL, STILL, [0, -0.7, 0.2], -X)
    new_middle, new_end = bones(upper, middle, end, reach)
    np.testing.assert_allclose(new_end, [0, -0.7, 0.2], atol=1e-9)
    assert flexion_about(upper, new_middle, new_end, quaternion.rotate(reach.upper_rotations, -X)) > 0


def test_an_opposite_target_turns_the_limb_round():
    upper, middle, end = np.zeros(3), np.array([0, -0.4, 0]), np.array([0, -0.7, 0.1])
    reach = two_bone(upper, middle, end, STILL, STILL, -end, -X, (0.0, math.pi))
    np.testing.assert_allclose(bones(upper, middle, end, reach)[1], -end, atol=1e-9)


@pytest.mark.parametrize("softness", [0.0, 0.05])
def test_rotations_move_smoothly_as_the_target_moves(softness):
    upper, middle, end = np.zeros(3), np.array([0, -0.4, 0.0]), np.array([0, -0.7, 0.2])
    angle = np.linspace(0, 2 * math.pi, 4001)[:, None]
    target = [0.1, -0.4, 0.2] + 0.25 * (np.cos(angle) * X + np.sin(angle) * (Y + Z))
    reach = two_bone(upper, middle, end, STILL, STILL, target, -X, (0.0, 2.7), softness)
    for turns in (reach.upper_rotations, reach.middle_rotations):
        steps = quaternion.multiply(quaternion.conjugate(turns[:-1]), turns[1:])
        assert np.linalg.norm(quaternion.to_rotation_vector(steps), axis=-1).max() < 0.03


def test_a_soft_limb_slows_down_before_it_is_straight():
    upper, middle, end = np.zeros(3), np.array([0, -0.4, 0.0]), np.array([0, -0.7, 0.2])
    far = np.linspace(0.4, 1.0, 601)
    target = far[:, None] * -Y

    def flexions(softness):
        reach = two_bone(upper, middle, end, STILL, STILL, target, -X, (0.0, 2.7), softness)
        new_middle, new_end = bones(upper, middle, end, reach)
        return flexion_about(upper, new_middle, new_end, -X), np.linalg.norm(reach.end_positions, axis=1)

    hard, hard_reach = flexions(0.0)
    soft, soft_reach = flexions(0.05)
    assert np.abs(np.diff(soft)).max() < 0.25 * np.abs(np.diff(hard)).max()
    assert (np.diff(soft_reach) > -1e-12).all()
    longest = hard_reach[-1]
    inside = far < 0.95 * longest
    np.testing.assert_allclose(soft_reach[inside], far[inside], atol=1e-9)
    assert (soft_reach <= hard_reach + 1e-12).all()


def test_a_nearly_straight_limb_does_not_flip_its_plane():
    upper, middle = np.zeros(3), np.array([0, -0.4, 0])
    bend = np.linspace(-0.2, 0.2, 401)[:, None]
    end = middle + 0.4 * (-np.cos(bend) * Y + np.sin(bend) * Z) + 0.001 * X
    reach = two_bone(upper, middle, end, STILL, STILL, [0.1, -0.6, 0.1], -X)
    new_middle, _ = bones(upper, middle, end, reach)
    assert np.linalg.norm(np.diff(new_middle, axis=0), axis=1).max() < 0.01


def test_a_limb_without_length_or_a_target_that_is_not_finite_leaves_it_as_it_is():
    turns = quaternion.normalise(np.array([[1.0, 2, 3, 4], [4, 3, 2, 1]]))
    for middle, target in (([0, 0, 0], [1, 0, 0]), ([0, 1, 0], [np.nan, 0, 0]), ([0, 1, 0], [0, np.inf, 0])):
        reach = two_bone([0, 0, 0], middle, [0, 1, 1], turns[0], turns[1], target)
        np.testing.assert_array_equal(reach.upper_rotations, turns[0])
        np.testing.assert_array_equal(reach.middle_rotations, turns[1])
        np.testing.assert_array_equal(reach.end_positions, [0, 1, 1])


def test_the_hinge_of_a_limb_is_found_from_its_poses():
    rng = np.random.default_rng(9)
    turns = quaternion.normalise(rng.normal(size=(60, 4)))
    hinge = np.array([0.6, 0.0, 0.8])
    bends = rng.uniform(0.0, 2.0, 60)
    uppers = rng.normal(size=(60, 3))
    middles = uppers + quaternion.rotate(turns, -Y * 0.3)
    ends = middles + quaternion.rotate(turns, quaternion.rotate(quaternion.from_axis_angle(hinge, bends), -Y)) * 0.25
    np.testing.assert_allclose(hinge_axis(uppers, middles, ends, turns), hinge, atol=1e-9)
    np.testing.assert_allclose(flexion(uppers, middles, ends), bends, atol=1e-9)
    straight = middles + (middles - uppers)
    np.testing.assert_array_equal(hinge_axis(uppers, middles, straight, turns), np.zeros(3))


def test_wrong_limits_are_refused():
    for limits in ((0.5, 0.4), (-0.1, 1.0), (0.0, 4.0), (np.nan, 1.0)):
        with pytest.raises(ValueError, match="expected 0 <= least <= most <= pi"):
            two_bone([0, 0, 0], Y, Y + X, STILL, STILL, X, limits=limits)


def test_leading_axes_broadcast():
    upper, middle, end, _, hinge, _, _ = random_limbs(6, seed=5)
    shape = (2, 3, 3)
    target = np.array([0.1, 0.2, 0.3])
    wide = two_bone(*(a.reshape(shape) for a in (upper, middle, end)), STILL, STILL, target, hinge.reshape(shape))
    flat = two_bone(upper, middle, end, STILL, STILL, target, hinge)
    assert wide.upper_rotations.shape == (2, 3, 4)
    np.testing.assert_array_equal(wide.middle_rotations.reshape(6, 4), flat.middle_rotations)
    np.testing.assert_array_equal(wide.end_positions.reshape(6, 3), flat.end_positions)


@pytest.mark.parametrize("keep_end", [False, True])
@pytest.mark.parametrize("with_twist_joints", [False, True])
def test_whole_poses_reach_their_targets_and_nothing_else_moves(keep_end, with_twist_joints):
    rng = np.random.default_rng(8)
    if with_twist_joints:
        parents, joints = [-1, 0, 1, 2, 3, 4, 5, 0], (1, 3, 5)
    else:
        parents, joints = [-1, 0, 1, 2, 3, 0], (1, 2, 3)
    count = len(parents)
    skeleton = Skeleton(tuple(map(str, range(count))), np.array(parents, np.int32), rng.normal(size=(count, 3)) * 0.2)
    rotations = quaternion.normalise(rng.normal(size=(40, count, 4)))
    roots = rng.normal(size=(40, 3))
    positions, world = forward_kinematics(skeleton, roots, rotations)
    lengths = [np.linalg.norm(positions[:, b] - positions[:, a], axis=1) for a, b in itertools.pairwise(joints)]
    direction = rng.normal(size=(40, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    target = positions[:, joints[0]] + direction * np.hypot(*lengths)[:, None]
    new = reach_with_joints(
        skeleton, rotations, positions, world, joints, target, limits=(0.0, math.pi), keep_end=keep_end
    )
    new_positions, new_world = forward_kinematics(skeleton, roots, new)
    np.testing.assert_allclose(new_positions[:, joints[2]], target, atol=1e-9)
    changed = {*joints} if keep_end else {*joints[:2]}
    for joint in range(count):
        if joint not in changed:
            np.testing.assert_array_equal(new[:, joint], rotations[:, joint])
    if keep_end:
        dots = np.abs(np.sum(new_world[:, joints[2]] * world[:, joints[2]], axis=-1))
        np.testing.assert_allclose(dots, 1.0, atol=1e-12)
