"""Limbs that swivel, and arms that point, change no more suddenly than what they are asked for."""

import numpy as np
import pytest
from take.synthetic_take import actions, build_take, sampler
from take.test_limbs import END, MIDDLE, UPPER, Posed

from crowdsim.poses.kernels.fists import FOLDED, point_arm
from crowdsim.poses.kernels.limbs import World, pose_chain, reach_of, swivel_limb


def swivelled(posed: Posed, goal: np.ndarray, straight: float = 0.03) -> np.ndarray:
    """Local rotations after a limb swivelled towards a goal. Shape (J, 4)."""
    rotations = posed.rotations.copy()
    swivel_limb(posed.limbs, 0, rotations, World(posed.places, posed.turns), tuple(map(float, goal)), straight)
    return rotations


def around(posed: Posed, radius: float, count: int) -> np.ndarray:
    """Points on a circle around the line from a limb's upper joint to its end, from its middle joint on."""
    upper, middle, end = posed.places[[UPPER, MIDDLE, END]]
    axis = (end - upper) / np.linalg.norm(end - upper)
    foot = upper + axis * (axis @ (middle - upper))
    out = (middle - foot) / np.linalg.norm(middle - foot)
    angles = np.linspace(0.0, 2.0 * np.pi, count)[:, None]
    return np.asarray(foot + radius * (np.cos(angles) * out + np.sin(angles) * np.cross(axis, out)))


def steps(rotations: np.ndarray) -> np.ndarray:
    """How far joints rotate between poses (n, J, 4) [rad]. Shape (n - 1, J)."""
    dots = np.abs(np.sum(rotations[1:] * rotations[:-1], axis=-1))
    return np.asarray(2.0 * np.arccos(np.minimum(dots, 1.0)))


@pytest.mark.parametrize("seed", range(5))
def test_a_limb_swivels_towards_a_goal_and_keeps_its_end(seed: int) -> None:
    first, lengths = actions(40)
    take, policy = build_take([[2 * k for k in range(20)]], first, lengths, 90)
    posing = sampler(take, policy)
    arms, poses = posing.motions[0].arms, posing.sample(20 + seed, 21 + seed, 60, np.array([0]))[0]
    pose, root = poses.rotations[0, 0].astype(float), poses.root_positions[0, 0].astype(float)
    joints = len(arms.parents)
    before, after = (World(np.empty((joints, 3)), np.empty((joints, 4))) for _ in range(2))
    pose_chain(arms, np.ones(3), root, pose, before)
    upper, middle, end = arms.joints[0]
    goal = before.positions[middle] + np.random.default_rng(seed).normal(0.0, 0.1, 3)
    swivel_limb(arms, 0, pose, before, tuple(goal), 0.1)
    pose_chain(arms, np.ones(3), root, pose, after)
    np.testing.assert_allclose(after.positions[end], before.positions[end], atol=1e-6)
    dot = abs(after.rotations[end] @ before.rotations[end])
    assert dot == pytest.approx(1.0, abs=1e-6)
    gaps = [np.linalg.norm(world.positions[middle] - goal) for world in (before, after)]
    assert gaps[1] < gaps[0]
    assert np.linalg.norm(after.positions[middle] - after.positions[upper]) == pytest.approx(
        np.linalg.norm(before.positions[middle] - before.positions[upper]), abs=1e-6
    )


@pytest.mark.parametrize("seed", range(5))
def test_a_goal_that_goes_around_a_limb_swivels_it_without_a_jump(seed: int) -> None:
    posed = Posed(1.2, seed)
    result = np.array([swivelled(posed, goal) for goal in around(posed, 0.2, 721)])
    assert np.degrees(steps(result).max()) < 1.5
    np.testing.assert_allclose(np.abs(np.sum(result[[0, 360]] * posed.rotations, axis=-1)), 1.0, atol=1e-9)


def test_a_limb_that_is_nearly_straight_hardly_swivels() -> None:
    bent, straight = Posed(1.2, 1), Posed(0.15, 1)
    far, near = (
        steps(np.stack([posed.rotations, swivelled(posed, around(posed, 0.1, 361)[60], 0.1)]))[0, UPPER]
        for posed in (bent, straight)
    )
    assert np.degrees(far) > 15.0
    assert near < 0.4 * far


def test_a_fist_that_goes_past_its_shoulder_does_not_swing_the_arm_around() -> None:
    """A target that passes a shoulder by a millimetre turns the arm no faster than one at the arm's shortest reach."""
    posed = Posed(2.0, 3, (0.28, 0.26))
    upper, end = posed.places[[UPPER, END]]
    way = (end - upper) / np.linalg.norm(end - upper)
    aside = np.cross(way, [0.3, 1.0, 0.2])
    aside /= np.linalg.norm(aside)
    offsets = np.linspace(-0.25, 0.25, 501)
    result = []
    for offset in offsets:
        rotations = posed.rotations.copy()
        target = tuple(map(float, upper + 0.001 * way + offset * aside))
        point_arm(posed.limbs, 0, rotations, World(posed.places, posed.turns), target)
        result.append(rotations)
    shortest = reach_of(0.28, 0.26, FOLDED)
    fastest = np.degrees(steps(np.array(result))[:, UPPER].max())
    assert fastest < np.degrees(3.0 * (offsets[1] - offsets[0]) / shortest)
