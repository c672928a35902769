"""How far landed strikes throw back those whom they hit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from take.synthetic_take import actions, build_take, database

from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.poses.kernels.columns import HEAD, TORSO
from crowdsim.poses.kernels.reactions import LEAST, LENGTH, MOST, RISE, Blows, strengthen
from crowdsim.poses.layers.reactions import build_trunk
from crowdsim.poses.motion import prepare_motion


def blows(times: list[float], ways: list[float], strengths: list[float]) -> Blows:
    """Blows on one avatar, along ways given by heading [rad]."""
    x, z = np.sin(ways), np.cos(ways)
    axes = np.stack([z, np.zeros(len(times)), -x], axis=1) * np.array(strengths)[:, None]
    return Blows(np.array([0, len(times)]), np.array(times), axes, np.full(len(times), HEAD))


def thrown(axes: np.ndarray, gain: float) -> np.ndarray:
    return np.asarray(np.linalg.norm(axes, axis=1) * gain)


def test_a_blow_that_brings_the_head_far_enough_is_left_alone() -> None:
    one = blows([1.0], [0.3], [1.0])
    for own in (LEAST, 0.3):
        np.testing.assert_allclose(strengthen(one, np.array([0.1]), np.array([own])), one.axes, rtol=1e-12)


@pytest.mark.parametrize("own", [-0.01, -0.05, -0.1])
def test_a_blow_on_someone_who_comes_closer_outweighs_what_they_come(own: float) -> None:
    far = thrown(strengthen(blows([1.0], [0.3], [0.5]), np.array([0.1]), np.array([own])), 0.1)[0]
    assert far + own == pytest.approx(LEAST)


def test_no_blow_is_strengthened_without_bound_nor_is_a_hard_one_weakened() -> None:
    axes = strengthen(blows([1.0], [0.0], [0.5]), np.array([0.1]), np.array([-5.0]))
    assert thrown(axes, 0.1)[0] == pytest.approx(MOST)
    axes = strengthen(blows([1.0], [0.0], [9.0]), np.array([0.1]), np.array([-5.0]))
    assert thrown(axes, 0.1)[0] == pytest.approx(0.9)


def test_a_blow_outweighs_the_springing_back_from_the_one_before() -> None:
    alone, gains = np.array([0.0, 0.0]), np.full(2, 0.1)
    same = thrown(strengthen(blows([1.0, 1.0 + RISE], [0.2, 0.2], [1.0, 0.5]), gains, alone), 0.1)
    against = thrown(strengthen(blows([1.0, 1.0 + RISE], [0.2, 0.2 + np.pi], [1.0, 0.5]), gains, alone), 0.1)
    apart = thrown(strengthen(blows([1.0, 1.0 + LENGTH], [0.2, 0.2], [1.0, 0.5]), gains, alone), 0.1)
    assert same[1] > apart[1] + 0.01
    assert against[1] < apart[1]
    assert same[0] == against[0] == apart[0]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_a_blow_depends_on_those_of_the_two_lengths_before_it_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.sort(rng.uniform(0.0, 4.0, 12))
    ways, strengths = rng.uniform(-3.0, 3.0, 12), rng.uniform(0.2, 1.5, 12)
    own, gains = rng.normal(0.0, 0.1, 12), rng.uniform(0.05, 0.15, 12)
    whole = strengthen(blows(times.tolist(), ways.tolist(), strengths.tolist()), gains, own)
    late = times >= times[-1] - 2.0 * LENGTH
    part = blows(times[late].tolist(), ways[late].tolist(), strengths[late].tolist())
    np.testing.assert_array_equal(strengthen(part, gains[late], own[late])[-1], whole[-1])


def test_gains_tell_how_far_a_small_blow_brings_the_head() -> None:
    _, policy = build_take([[0]], *actions(1), 2)
    motion = prepare_motion(policy)
    trunk, body, skeleton = build_trunk(motion), database().body, motion.skeleton
    upright = np.zeros((1, skeleton.joint_count, 4), np.float32)
    upright[..., 0] = 1.0
    for part in (HEAD, TORSO):
        bent = upright.copy()
        for joint, give in zip(trunk.chain, trunk.gives[:, part], strict=True):
            bent[0, joint, :2] = np.cos(0.05 * give), np.sin(0.05 * give)
        heads = []
        for rotations in (upright, bent):
            positions, turns = forward_kinematics(skeleton, np.zeros((1, 3), np.float32), rotations, threads=1)
            turn, head = turns[0, body.roles["head"]].astype(float), positions[0, body.roles["head"]]
            offset = np.asarray(body.head_offset, dtype=float)
            across = np.cross(turn[1:], offset)
            heads.append(head + offset + 2.0 * (turn[0] * across + np.cross(turn[1:], across)))
        assert np.linalg.norm(heads[1] - heads[0]) == pytest.approx(0.1 * trunk.gains[part], rel=0.05)
