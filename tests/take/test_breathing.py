"""Avatars at ease and on the floor breathe, the quicker and deeper the more they have thrown."""

from dataclasses import replace

import numpy as np
import pytest
from take.synthetic_take import sampler
from take.test_down_state import FPS, FRAMES, spans, takes

from crowdsim.motion import quaternion
from crowdsim.poses.facing import face_direction
from crowdsim.poses.kernels.records import Moments, Offsets, Posed
from crowdsim.poses.kernels.turning import Turning, turn_joints
from crowdsim.poses.layers.breathing import breath
from crowdsim.take.take import Events, Take

TIMES = np.arange(0.0, 60.0, 0.05)


@pytest.mark.parametrize(("effort", "rate", "depth"), [(0.0, 0.27, 1.6), (1.0, 0.62, 4.2)])
def test_breaths_are_quicker_and_deeper_after_strikes(effort: float, rate: float, depth: float) -> None:
    for avatar in range(5):
        bent = breath(TIMES, np.full(len(TIMES), effort), avatar)
        assert bent.min() >= 0.0
        assert bent.max() == pytest.approx(np.deg2rad(depth), rel=0.01)
        tops = np.count_nonzero((bent[1:-1] > bent[:-2]) & (bent[1:-1] >= bent[2:]))
        assert tops == pytest.approx(60.0 * rate, rel=0.2)


def test_avatars_breathe_out_of_step() -> None:
    bent = np.array([breath(TIMES, np.zeros(len(TIMES)), avatar) for avatar in range(6)])
    assert (np.corrcoef(bent) - 2.0 * np.eye(6) < 0.99).all()


def test_breaths_pass_evenly_from_slow_to_quick() -> None:
    bent = breath(TIMES, np.clip(TIMES / 30.0, 0.0, 1.0), 3)
    assert np.abs(np.diff(bent)).max() < np.pi * 0.7 * np.deg2rad(4.2) * 0.05


def test_a_breath_bends_the_trunk_about_the_hips_and_keeps_the_head_as_it_is() -> None:
    parents = np.array([-1, 0, 1, 2], np.int64)
    shares, across = np.array([0.0, 0.4, 0.6, -1.0]), np.array([1.0, 0.0, 0.0])
    chest = Turning(parents, np.arange(4), shares, across, of_root=True)
    rotations = quaternion.from_euler(np.random.default_rng(2).uniform(-0.6, 0.6, (4, 3)), "YXZ")
    poses = Posed(np.zeros((3, 1, 3)), np.broadcast_to(rotations, (3, 1, 4, 4)).copy())
    poses.roots[2] = np.nan
    moments = Moments(np.zeros(1, np.int64), np.array([[0.5], [1.5], [1.5]]))
    turn_joints(0, 1, moments, Offsets(np.full((8, 1), 0.05, np.float32), -2, 1.0), chest, poses)

    def world(pose: np.ndarray) -> list[np.ndarray]:
        found = [pose[0]]
        for joint in pose[1:]:
            found.append(quaternion.multiply(found[-1], joint))
        return found

    before, after = world(rotations), world(poses.rotations[1, 0])
    turned = quaternion.multiply(after[2], quaternion.conjugate(before[2]))
    across = quaternion.rotate(before[0], np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(turned[1:], np.sin(0.025) * across, atol=1e-6)
    np.testing.assert_allclose(after[3], before[3], atol=1e-7)
    np.testing.assert_array_equal(poses.rotations[2, 0], rotations)


def breaths_of(take: Take, policy: object) -> np.ndarray:
    """How far trunks are bent in each control frame [rad]. Shape (T, N)."""
    kept = sampler(take, policy).poser.layers["breathing"].breaths
    return np.asarray(kept.rows(np.arange(FRAMES), np.arange(take.avatar_count)))


def test_bodies_on_the_floor_breathe_by_the_side_that_is_up_and_none_that_stands_does() -> None:
    take, policy = takes()
    breaths, seen = breaths_of(take, policy), set()
    poses = sampler(take, policy, reactions=False).sample(0, int(FRAMES / take.control_rate * FPS) - 8, FPS)[0]
    chest, ahead = policy.database.body.roles["chest"], face_direction(policy.database.body)
    for avatar, (start, down, rise, _) in enumerate(spans()):
        lying = np.arange(down, rise + 1)
        rotations = poses.joints()[1][(lying * FPS / take.control_rate).astype(int), avatar, chest].astype(float)
        up = quaternion.rotate(rotations, ahead)[:, 1]
        assert not breaths[: start - 6, avatar].any()
        if np.abs(up).min() > 0.5:
            side = np.sign(up[0])
            assert (side * breaths[lying, avatar] >= 0.0).all()
            assert (side * breaths[lying, avatar]).max() > np.deg2rad(0.2)
            seen.add(side)
    assert seen == {-1.0, 1.0}


def test_an_avatar_that_has_thrown_much_breathes_deeper_as_it_lies() -> None:
    take, policy = takes()
    thrown = {name: np.zeros((8, 3) if name == "point" else 8, np.int32) for name in Events.__dataclass_fields__}
    down = int(spans()[0, 1])
    thrown["frame"], thrown["victim"] = np.full(8, down - 2.0), np.full(8, -1)
    calm, tired = breaths_of(take, policy), breaths_of(replace(take, events=Events(**thrown)), policy)
    np.testing.assert_array_equal(tired[: down - 8], calm[: down - 8])
    np.testing.assert_array_equal(tired[:, 1:], calm[:, 1:])
    assert np.abs(tired[:, 0]).max() > 1.5 * np.abs(calm[:, 0]).max() > 0.0


def test_nobody_breathes_where_reactions_are_off() -> None:
    take, policy = takes()
    frames = int(FRAMES / take.control_rate * FPS) - 8
    still = sampler(take, policy, reactions=False).sample(0, frames, FPS)[0]
    quiet = sampler(replace(take, reactions=False), policy).sample(0, frames, FPS)[0]
    moved = sampler(take, policy).sample(0, frames, FPS)[0]
    np.testing.assert_array_equal(still.rotations, quiet.rotations)
    spine = policy.database.body.roles["spine"]
    assert (still.rotations[:, :, spine] != moved.rotations[:, :, spine]).any()
