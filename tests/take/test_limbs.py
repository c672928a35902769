"""The limb solver of poses: beside a naive one, at its limits, and where a limb is straight."""

import math
from typing import Any

import naive_limbs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.limbs import flexion, hinge_axis
from crowdsim.motion.skeleton import Skeleton
from crowdsim.poses.kernels.limbs import MOST, World, bend_limb
from crowdsim.poses.limbs import Limbs

# A root, two joints above the limb, the limb with a joint that only twists between its bones, and two joints beside it.
PARENTS = np.array([-1, 0, 1, 2, 3, 4, 5, 0])
UPPER, MIDDLE, END = 2, 4, 5
AT_REST = np.array([1.0, 0.0, 0.0, 0.0])
X, Y, Z = np.eye(3)


class Posed:
    """A pose of a skeleton with one limb.

    Args:
        bend: How far the limb is bent about its hinge [rad].
        seed: Seed of everything else.
        lengths: Lengths of its bones [m].
    """

    def __init__(self, bend: float, seed: int, lengths: tuple[float, float] = (0.3, 0.25)) -> None:
        rng = np.random.default_rng(seed)
        offsets = rng.normal(size=(len(PARENTS), 3)) * 0.2
        offsets[3], offsets[4], offsets[5] = -0.4 * lengths[0] * Y, -0.6 * lengths[0] * Y, -lengths[1] * Y
        self.skeleton = Skeleton(tuple(map(str, range(len(PARENTS)))), PARENTS.astype(np.int32), offsets)
        self.rotations = quaternion.normalise(rng.normal(size=(len(PARENTS), 4)))
        self.rotations[3], self.rotations[4] = AT_REST, quaternion.from_rotation_vector(bend * X)
        self.root = rng.normal(size=3)
        self.places, self.turns = self.pose(self.rotations)
        self.hinge = quaternion.rotate(self.turns[UPPER], X)
        self.direction = rng.normal(size=3)
        self.direction /= np.linalg.norm(self.direction)
        joints = np.array([[UPPER, MIDDLE, END]] * 2)
        none: Any = None
        self.limbs = Limbs(PARENTS, offsets, none, none, none, joints, np.stack([X, X]), none, none, none, none)

    def pose(self, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (J, 3) and rotations (J, 4) of the joints in the world."""
        positions, turns = forward_kinematics(self.skeleton, self.root[None], rotations[None], threads=1)
        return positions[0], turns[0]

    def bent(self, target: np.ndarray, distance: float) -> np.ndarray:
        """Local rotations after the limb was bent. Shape (J, 4)."""
        rotations = self.rotations.copy()
        x, y, z = map(float, target)
        bend_limb(self.limbs, 0, rotations, World(self.places, self.turns), (x, y, z), float(distance))
        return rotations

    def target(self, distance: float) -> np.ndarray:
        """A point at a distance from the upper joint. Shape (3,)."""
        return np.asarray(self.places[UPPER] + distance * self.direction)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 2.6), st.floats(0.02, 0.8))
def test_a_bent_limb_matches_the_naive_solver(seed: int, bend: float, distance: float) -> None:
    posed = Posed(bend, seed)
    target = posed.target(0.4)
    places, turns = posed.pose(posed.bent(target, distance))
    upper, middle, end = posed.places[[UPPER, MIDDLE, END]]
    swing, lower = naive_limbs.bend(upper, middle, end, posed.hinge, target, distance, MOST)
    np.testing.assert_allclose(places[MIDDLE], upper + swing.apply(middle - upper), atol=1e-3)
    np.testing.assert_allclose(places[END], upper + swing.apply(middle - upper) + lower.apply(end - middle), atol=1e-3)
    for joint, turn in ((UPPER, swing), (3, swing), (MIDDLE, lower), (END, Rotation.identity())):
        expected = turn * Rotation.from_quat(np.roll(posed.turns[joint], -1))
        apart = expected.inv() * Rotation.from_quat(np.roll(turns[joint], -1))
        assert apart.magnitude() < 4e-3


@settings(deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 2.5), st.floats(0.16, 0.549))
def test_a_target_within_reach_is_reached(seed: int, bend: float, distance: float) -> None:
    posed = Posed(bend, seed)
    target = posed.target(distance)
    rotations = posed.bent(target, distance)
    places, turns = posed.pose(rotations)
    np.testing.assert_allclose(places[END], target, atol=1e-6)
    assert abs(turns[END] @ posed.turns[END]) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=1), 1.0, atol=1e-12)
    others = [joint for joint in range(len(PARENTS)) if joint not in (UPPER, MIDDLE, END)]
    np.testing.assert_array_equal(rotations[others], posed.rotations[others])


def test_a_right_angle_has_the_answer_of_pythagoras() -> None:
    posed = Posed(0.7, 1, (0.3, 0.4))
    places, _ = posed.pose(posed.bent(posed.target(0.5), 0.5))
    assert flexion(*places[[UPPER, MIDDLE, END]]) == pytest.approx(0.5 * math.pi, abs=1e-7)
    np.testing.assert_allclose(places[END], posed.target(0.5), atol=1e-7)


def test_a_limb_whose_end_is_at_the_target_does_not_move() -> None:
    for seed in range(20):
        posed = Posed(0.1 * seed, seed)
        end = posed.places[END]
        rotations = posed.bent(end, float(np.linalg.norm(end - posed.places[UPPER])))
        np.testing.assert_allclose(np.abs(np.sum(rotations * posed.rotations, axis=1)), 1.0, atol=1e-9)


def test_out_of_reach_a_limb_is_straight_and_points_at_the_target() -> None:
    posed = Posed(1.0, 2)
    places, _ = posed.pose(posed.bent(posed.target(2.0), 2.0))
    np.testing.assert_allclose(places[END], posed.target(0.55), atol=1e-6)


@pytest.mark.parametrize(("bend", "most"), [(1.0, MOST), (2.8, 2.8)])
def test_no_limb_is_bent_beyond_its_limit_or_what_it_is_bent_already(bend: float, most: float) -> None:
    posed = Posed(bend, 3)
    places, _ = posed.pose(posed.bent(posed.target(0.2), 0.0))
    assert flexion(*places[[UPPER, MIDDLE, END]]) == pytest.approx(most, abs=1e-7)


def test_a_straight_limb_bends_about_its_hinge() -> None:
    for seed in range(10):
        posed = Posed(0.0, seed)
        rotations = posed.bent(posed.target(0.4), 0.4)
        places, turns = posed.pose(rotations)
        normal = np.cross(places[MIDDLE] - places[UPPER], places[END] - places[MIDDLE])
        np.testing.assert_allclose(normal / np.linalg.norm(normal), quaternion.rotate(turns[UPPER], X), atol=1e-6)


def test_rotations_move_smoothly_as_the_target_moves() -> None:
    posed = Posed(0.6, 4)
    distances = 0.4 + 0.14 * np.sin(np.linspace(0.0, 2.0 * math.pi, 2001))
    result = np.array([posed.bent(posed.target(distance), distance) for distance in distances])
    dots = np.abs(np.sum(result[1:] * result[:-1], axis=-1))
    assert (2.0 * np.arccos(np.minimum(dots, 1.0))).max() < 0.01


def test_a_limb_with_nowhere_to_point_stays_as_it_is() -> None:
    posed = Posed(0.6, 5)
    np.testing.assert_array_equal(posed.bent(posed.places[UPPER], 0.3), posed.rotations)


def test_the_hinge_of_a_limb_is_found_from_its_poses() -> None:
    rng = np.random.default_rng(9)
    turns = quaternion.normalise(rng.normal(size=(60, 4)))
    hinge = np.array([0.6, 0.0, 0.8])
    bends = rng.uniform(0.0, 2.0, 60)
    uppers = rng.normal(size=(60, 3))
    middles = uppers + quaternion.rotate(turns, -Y * 0.3)
    bent = quaternion.rotate(quaternion.from_rotation_vector(bends[:, None] * hinge), -Y)
    ends = middles + quaternion.rotate(turns, bent) * 0.25
    np.testing.assert_allclose(hinge_axis(uppers, middles, ends, turns), hinge, atol=1e-9)
    np.testing.assert_allclose(flexion(uppers, middles, ends), bends, atol=1e-9)
    straight = middles + (middles - uppers)
    np.testing.assert_array_equal(hinge_axis(uppers, middles, straight, turns), np.zeros(3))
