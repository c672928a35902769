"""Hands of bodies with longer arms stay over the floor."""

import numpy as np
import pytest
from synthetic_take import actions, build_take, database, sampler

from crowdsim.crowd.model_arms import arm_radii
from crowdsim.motion import quaternion
from crowdsim.poses.kernels.hands import lift_hands
from crowdsim.poses.kernels.records import Moments, Posed
from crowdsim.poses.world import world_joints

SIZES = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.1], [1.2, 1.1, 1.2], [0.9, 0.9, 0.9]])


@pytest.fixture(scope="module")
def motion():
    first, lengths = actions(1)
    return sampler(*build_take([[0]], first, lengths, 2)).motions[0]


def gloves(motion, poses: Posed) -> np.ndarray:
    """Heights of the undersides of gloves. Shape (T, n, 2)."""
    scales = SIZES[:, 0]
    positions, rotations = world_joints(motion.skeleton, motion.segments, scales, SIZES / scales[:, None], poses)
    ends = motion.arms.joints[:, 2]
    fists = quaternion.rotate(rotations[:, :, ends], motion.arms.points[:, 0]) * scales[:, None, None]
    return (positions[:, :, ends] + fists)[..., 1] - arm_radii(database().body)[1] * scales[:, None]


def test_hands_come_onto_the_floor_and_nothing_else_moves(motion) -> None:
    rows = np.linspace(0, len(motion.frames.rotations) - 1, 40).astype(int)
    rotations = np.repeat(motion.frames.rotations[rows, None], 4, axis=1)
    roots = np.repeat(motion.frames.roots[rows, None], 4, axis=1) * SIZES[:, :1].astype(np.float32)
    # As low as this most hands are a little under the floor.
    low = Posed(roots, rotations.copy())
    heights = gloves(motion, low)
    low.roots[..., 1] -= heights.mean(axis=2) + 0.02
    low.roots[3, 1] = np.nan
    before = gloves(motion, low)
    after = Posed(low.roots.copy(), low.rotations.copy())
    glove = float(arm_radii(database().body)[1])
    times = np.arange(40.0)[:, None]
    lift_hands(0, 4, Moments(np.arange(4), times), SIZES, motion.arms, glove, after)
    lifted, there = gloves(motion, after), np.isfinite(before)
    longer = np.zeros_like(there)
    longer[:, 1:3] = True
    under = there & longer & (before < -0.01) & (before > -0.06)
    assert under.sum() > 30
    assert lifted[under].min() > -0.004
    assert np.percentile(lifted[under], 90) < 0.006
    high = there & longer & (before > 0.1)
    np.testing.assert_allclose(lifted[high], before[high], atol=1e-5)
    for n in (0, 3):
        assert after.rotations[:, n].tobytes() == low.rotations[:, n].tobytes()
    assert after.roots.tobytes() == low.roots.tobytes()
    arms = np.zeros(motion.skeleton.joint_count, bool)
    arms[motion.arms.joints.ravel()] = True
    np.testing.assert_array_equal(after.rotations[:, :, ~arms], low.rotations[:, :, ~arms])
