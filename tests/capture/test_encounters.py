"""Strikes between the people of one file: whom they are thrown at, and what becomes of them."""

from __future__ import annotations

import numpy as np
import pytest
from people import placed, together

from crowdsim.bvh.io import write_bvh
from crowdsim.capture.encounters import FAR, describe_encounters, find_encounters
from crowdsim.capture.loading import load_people
from crowdsim.motion import quaternion
from crowdsim.motion.skeleton import Clip
from crowdsim.performer.skeleton import ARMS, FOREARMS, PELVIS_HEIGHT, build_skeleton

FPS = 60.0
HANGING, GUARD = 80.0, 60.0


def boxer(strike_at: float | None = None, guard: bool = False, seconds: float = 3.0) -> Clip:
    """Return someone who stands at the origin facing +z, and may throw a straight right at a time."""
    skeleton, frames = build_skeleton(), round(seconds * FPS)
    rotations = np.zeros((frames, skeleton.joint_count, 4))
    rotations[..., 0] = 1.0
    times = np.arange(frames) / FPS
    share = np.zeros(frames)
    if strike_at is not None:
        share = np.interp(times, [strike_at - 0.18, strike_at, strike_at + 0.05, strike_at + 0.4], [0.0, 1.0, 1.0, 0.0])
        share = share * share * (3.0 - 2.0 * share)
    for side, sign in enumerate((1.0, -1.0)):
        reach = share if side == 1 else 0.0 * share
        lower = GUARD if guard or strike_at is not None else HANGING
        # The arm hangs in a guard, and swings level and ahead as it strikes; the forearm folds up.
        down = quaternion.from_rotation_vector(np.outer(-np.deg2rad(lower * (1.0 - reach)) * sign, [0.0, 0.0, 1.0]))
        ahead = quaternion.from_rotation_vector(
            np.outer(-np.deg2rad(85.0 * reach + 20.0 * (1 - reach)) * sign, [0, 1.0, 0])
        )
        rotations[:, ARMS[side]] = quaternion.multiply(ahead, down)
        fold = 130.0 if guard or strike_at is not None else 5.0
        rotations[:, FOREARMS[side]] = quaternion.from_rotation_vector(
            np.outer(-np.deg2rad(fold * (1.0 - reach) + 2.0) * sign, [0.0, 1.0, 0.0])
        )
    return Clip("boxer", skeleton, FPS, np.tile([0.0, PELVIS_HEIGHT, 0.0], (frames, 1)), rotations)


def found(tmp_path, distance: float, victim: Clip):
    path = tmp_path / "pair.bvh"
    write_bvh(path, together([boxer(1.5), placed(victim, -0.16, distance, np.pi)], ["A:", "B:"]))
    people = load_people(path)
    return people, find_encounters(people)


@pytest.mark.parametrize(
    ("distance", "guard", "outcome"),
    [(0.78, False, "landed"), (0.88, True, "blocked"), (1.2, False, "missed"), (FAR + 0.3, False, "air")],
)
def test_a_straight_lands_is_blocked_or_misses(tmp_path, distance, guard, outcome):
    people, encounters = found(tmp_path, distance, boxer(guard=guard))
    assert [(one.attacker, one.victim, one.limb, one.outcome) for one in encounters] == [(0, 1, 1, outcome)]
    assert encounters[0].seconds == pytest.approx(1.5, abs=0.06)
    told = describe_encounters(people, encounters)[0]
    assert (told["attacker"], told["victim"], told["limb"]) == ("pair#1", "pair#2", "right_hand")


def test_a_person_alone_meets_nobody(tmp_path):
    path = tmp_path / "one.bvh"
    write_bvh(path, together([boxer(1.5)], [""]))
    assert find_encounters(load_people(path)) == []
