"""Joints above what strikes turn until it touches: chains, frames of joints, and weights over time."""

from dataclasses import replace

import numpy as np
import pytest

from crowdsim.motion import quaternion
from crowdsim.motion.body import build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.strikers import LIMBS
from crowdsim.performer.session import perform_solo
from crowdsim.performer.skeleton import HANDS
from crowdsim.poses.hits import Landed
from crowdsim.poses.kernels.reaches import reach_out
from crowdsim.poses.kernels.records import Moments, Posed
from crowdsim.poses.layers import reaches
from crowdsim.poses.layers.reaches import chains_of, plan_reaches, turn_chain

CLIP = perform_solo("straight").clip
BODY = replace(
    build_body(CLIP.skeleton),
    props=tuple(
        {"joint": HANDS[side], "side": side, "offset": [(-0.4, 0.4)[1 - side], 0.0, 0.3], "radius": 0.02}
        for side in range(2)
    ),
)
FRAME = 40


class Motion:
    """What planning reads of a motion."""

    body, skeleton, target = BODY, CLIP.skeleton, None


def landed(limb: int) -> Landed:
    one = np.ones(1)
    return Landed(
        times=one, attackers=np.zeros(1, int), victims=np.ones(1, int), hands=np.array([limb % 2]),
        limbs=np.array([limb]), points=np.zeros((1, 3)), speeds=one, spans=np.array([[0.16, 0.22]]),
        again=np.zeros(1, bool), missed=np.zeros(1, bool), blocked=np.zeros(1, bool),
    )  # fmt: skip


def pose_at(avatars, times):
    positions, rotations = forward_kinematics(
        CLIP.skeleton, CLIP.root_positions[FRAME : FRAME + 1], CLIP.rotations[FRAME : FRAME + 1]
    )
    return [(np.arange(1), BODY, np.ones(1), positions, rotations)]


def point_of(limb: int, posed: Posed) -> np.ndarray:
    positions, rotations = forward_kinematics(CLIP.skeleton, posed.roots[0].astype(float), posed.rotations[0])
    row = BODY.strikers[limb]
    return positions[0, row["joint"]] + quaternion.rotate(rotations[0, row["joint"]].astype(float), row["offset"])


def shown(limb: int, shift: np.ndarray, time: float, monkeypatch) -> tuple[np.ndarray, np.ndarray]:
    """Where what strikes is before and after it is carried, for a strike at 1 s."""
    pose = Posed(
        CLIP.root_positions[None, FRAME : FRAME + 1].astype(np.float32),
        CLIP.rotations[None, FRAME : FRAME + 1].astype(np.float32),
    )
    before = point_of(limb, pose)

    def surfaces(take, near, points, origins, radii, *_, **__):
        np.testing.assert_allclose(radii, BODY.strikers[limb]["radius"])
        return points + shift, None

    monkeypatch.setattr(reaches, "find_surfaces", surfaces)
    turns = plan_reaches(None, landed(limb), np.zeros(1, int), 1, pose_at, pose_at, Motion)
    reach_out(0, 1, Moments(np.zeros(1, np.int64), np.array([[time]])), turns, 0.34, pose)
    return before, point_of(limb, pose)


@pytest.mark.parametrize("limb", range(4, 11))
def test_what_strikes_comes_to_where_it_is_to_be(limb, monkeypatch):
    # Knees swing about the hip alone: a shift at a right angle to the thigh.
    shift = np.array([0.07, 0.02, 0.0]) if "knee" in LIMBS[limb] else np.array([0.06, -0.05, 0.04])
    before, after = shown(limb, shift, 1.0, monkeypatch)
    assert np.linalg.norm(after - before - shift) < 0.3 * np.linalg.norm(shift) + 0.002
    assert np.linalg.norm(after - before) > 0.6 * np.linalg.norm(shift)


def test_a_stick_reaches_its_place_within_a_millimetre(monkeypatch):
    before, after = shown(9, np.array([0.1, 0.08, 0.02]), 1.0, monkeypatch)
    np.testing.assert_allclose(after - before, [0.1, 0.08, 0.02], atol=0.001)


@pytest.mark.parametrize(("time", "share"), [(0.83, 0.0), (0.92, 0.5), (1.11, 0.5), (1.23, 0.0)])
def test_it_leaves_its_path_a_little_before_and_comes_back(time, share, monkeypatch):
    before, after = shown(9, np.array([0.1, 0.0, 0.0]), time, monkeypatch)
    assert np.linalg.norm(after - before) == pytest.approx(0.1 * share, abs=0.012)


def test_chains_lead_from_what_strikes_to_the_trunk():
    joints, shares = chains_of(BODY, np.array([5, 7, 9, 10]))
    roles = BODY.roles
    assert joints[0, :3].tolist() == [roles["right_shoulder"], roles["chest"], roles["spine"]]
    assert joints[1].tolist() == [roles["right_hip"], -1, -1, -1, -1]
    arm = [roles[f"right_{joint}"] for joint in ("hand", "elbow", "shoulder")]
    assert joints[2].tolist() == [*arm, roles["chest"], roles["spine"]]
    assert joints[3, 0] == roles["neck"]
    assert ((shares > 0.0) == (joints >= 0)).all()


def test_a_chain_that_does_not_turn_is_no_turn():
    points = np.array([[0.0, 1.0, 0.5]])
    pivots = np.array([[[0.0, 1.0, 0.2], [0.0, 1.0, 0.0]]])
    np.testing.assert_allclose(turn_chain(pivots, points, points, np.ones((1, 2)))[..., 0], 1.0)
