"""Forward kinematics against a slow twin, and what a pose must obey."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_kinematics import forward
from scipy.spatial.transform import Rotation
from turns import about

from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import clip_kinematics, forward_kinematics
from crowdsim.motion.skeleton import Clip, Skeleton


def random_body(rng, joints):
    parents = np.array([-1, *(rng.integers(0, joint) for joint in range(1, joints))], np.int32)
    return Skeleton(tuple(map(str, range(joints))), parents, rng.normal(size=(joints, 3)))


def matrices(rotations):
    turns = Rotation.from_quat(np.roll(rotations, -1, axis=-1).reshape(-1, 4))
    return turns.as_matrix().reshape(*rotations.shape[:2], 3, 3)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 12), st.integers(0, 6), st.booleans())
def test_forward_kinematics_matches_naive(seed, joints, frames, moving):
    rng = np.random.default_rng(seed)
    body = random_body(rng, joints)
    roots = rng.normal(size=(frames, 3))
    rotations = quaternion.normalise(rng.normal(size=(frames, joints, 4)))
    translations = rng.normal(size=(frames, joints, 3)) if moving else None
    positions, turns = forward_kinematics(body, roots, rotations, translations)
    expected_positions, expected_turns = forward(body.parents, body.offsets, roots, rotations, translations)
    np.testing.assert_allclose(positions, expected_positions, atol=1e-12)
    if frames:
        np.testing.assert_allclose(matrices(turns), expected_turns, atol=1e-12)


def test_the_rest_pose_is_the_sum_of_offsets():
    body = random_body(np.random.default_rng(1), 20)
    rotations = np.zeros((1, 20, 4))
    rotations[..., 0] = 1.0
    positions, turns = forward_kinematics(body, body.offsets[:1], rotations)
    np.testing.assert_allclose(positions[0], body.rest_positions(), atol=1e-12)
    np.testing.assert_array_equal(turns, rotations)


def test_forward_kinematics_of_two_perpendicular_bones_is_analytic():
    body = Skeleton(("a", "b", "c"), np.array([-1, 0, 1], np.int32), np.array([[0, 0, 0], [1, 0, 0], [2.0, 0, 0]]))
    quarter = about([0, 0, 1], np.pi / 2)
    positions, turns = forward_kinematics(body, np.array([[5.0, 6, 7]]), np.repeat(quarter[None], 3, axis=0)[None])
    np.testing.assert_allclose(positions[0], [[5, 6, 7], [5, 7, 7], [3, 7, 7]], atol=1e-12)
    np.testing.assert_allclose(quaternion.rotate(turns[0, 2], [1, 0, 0]), [0, -1, 0], atol=1e-12)


def test_bones_keep_their_lengths():
    rng = np.random.default_rng(2)
    body = random_body(rng, 31)
    rotations = quaternion.normalise(rng.normal(size=(100, 31, 4)))
    positions, _ = forward_kinematics(body, np.zeros((100, 3)), rotations)
    lengths = np.linalg.norm(positions[:, 1:] - positions[:, body.parents[1:]], axis=-1)
    np.testing.assert_allclose(
        lengths, np.broadcast_to(np.linalg.norm(body.offsets[1:], axis=1), (100, 30)), rtol=1e-12
    )


def test_moving_the_root_moves_all_joints_alike():
    rng = np.random.default_rng(3)
    body = random_body(rng, 9)
    rotations = quaternion.normalise(rng.normal(size=(5, 9, 4)))
    roots = rng.normal(size=(5, 3))
    turn = quaternion.normalise(rng.normal(size=4))
    positions, turns = forward_kinematics(body, roots, rotations)
    moved = rotations.copy()
    moved[:, 0] = quaternion.multiply(turn, rotations[:, 0])
    new_positions, new_turns = forward_kinematics(body, quaternion.rotate(turn, roots) + 1.0, moved)
    np.testing.assert_allclose(new_positions, quaternion.rotate(turn, positions) + 1.0, atol=1e-12)
    np.testing.assert_allclose(new_turns, quaternion.multiply(turn, turns), atol=1e-12)


@pytest.mark.parametrize("moving", [False, True])
def test_threads_do_not_change_a_byte(moving):
    rng = np.random.default_rng(4)
    body = random_body(rng, 7)
    for frames in (1, 2047, 2048, 2049, 5000):
        rotations = quaternion.normalise(rng.normal(size=(frames, 7, 4)))
        roots = rng.normal(size=(frames, 3))
        translations = rng.normal(size=(frames, 7, 3)) if moving else None
        one = forward_kinematics(body, roots, rotations, translations, threads=1)
        three = forward_kinematics(body, roots, rotations, translations, threads=3)
        for ours, theirs in zip(one, three, strict=True):
            assert ours.tobytes() == theirs.tobytes()


def test_single_precision_stays_single_and_agrees():
    rng = np.random.default_rng(5)
    body = random_body(rng, 31)
    rotations = quaternion.normalise(rng.normal(size=(10, 31, 4)))
    roots = rng.normal(size=(10, 3))
    positions, turns = forward_kinematics(body, roots, rotations)
    small_positions, small_turns = forward_kinematics(body, roots.astype(np.float32), rotations.astype(np.float32))
    assert small_positions.dtype == small_turns.dtype == np.float32
    np.testing.assert_allclose(small_positions, positions, atol=1e-4)
    np.testing.assert_allclose(small_turns, turns, atol=1e-5)


def test_arrays_may_be_slices_of_larger_ones():
    rng = np.random.default_rng(6)
    body = random_body(rng, 4)
    rotations = quaternion.normalise(rng.normal(size=(20, 8, 4)))
    roots = rng.normal(size=(20, 6))
    sliced = forward_kinematics(body, roots[::2, ::2], rotations[::2, ::2])
    copied = forward_kinematics(body, roots[::2, ::2].copy(), rotations[::2, ::2].copy())
    np.testing.assert_array_equal(sliced[0], copied[0])


def test_a_clip_is_posed_with_its_translations():
    rng = np.random.default_rng(7)
    body = random_body(rng, 5)
    rotations = quaternion.normalise(rng.normal(size=(3, 5, 4)))
    translations = rng.normal(size=(3, 5, 3))
    clip = Clip("a", body, 60.0, translations[:, 0], rotations, translations)
    expected = forward_kinematics(body, translations[:, 0], rotations, translations)
    np.testing.assert_array_equal(clip_kinematics(clip)[0], expected[0])


@pytest.mark.parametrize(
    ("roots", "rotations"), [((4, 3), (4, 6, 4)), ((5, 3), (4, 5, 4)), ((4, 2), (4, 5, 4)), ((4, 3), (4, 5, 3))]
)
def test_shapes_that_do_not_fit_are_refused(roots, rotations):
    body = random_body(np.random.default_rng(8), 5)
    with pytest.raises(ValueError, match=r"expected \(F, 5, 4\) and \(F, 3\)"):
        forward_kinematics(body, np.zeros(roots), np.zeros(rotations))
