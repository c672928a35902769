"""Kicks that land: the foot touches, the other one stays, and whoever is hit reacts."""

from dataclasses import replace
from functools import cache
from typing import Any

import kicker
import numpy as np
import pytest
from synthetic_take import NO_EVENTS, build_take, sampler, touch_gap

from crowdsim.motion import quaternion
from crowdsim.motion.database import MotionDatabase, build_database
from crowdsim.motion.measuring import measure_clips
from crowdsim.poses.contacts import body_points
from crowdsim.poses.layers.kicks import _plan_moves
from crowdsim.take.take import Events, Take

HIP_HEIGHT, FPS = 0.9, 60


@cache
def database() -> MotionDatabase:
    """A left front kick, one of the right foot to the side, and someone who stands."""
    clips = [kicker.kicks((0,))[0], kicker.kicks((1,), "side")[0], kicker.stand(3.0)]
    return build_database(measure_clips(clips), limbs=(0, 1, 2, 3))


def duel(kick: int, gap: float, landed: bool = True, scale: float = 1.0) -> tuple[Take, Any, int]:
    """One who kicks another that stands, its torso ``gap`` [m] further than the foot comes; the kick's output frame."""
    motion = database()
    starts, stride = motion.clip_starts, motion.stride
    strike = int(motion.strike_frames[kick])
    limb = int(motion.strike_limbs[kick])
    first, lengths = np.array([starts[kick] + 1, starts[2] + 1]), np.array([28, 28])
    when = strike / stride - starts[kick]
    still = {"scales": [scale, scale], "start": [(0, 0, 0), (0, 0, 0)], "motion": motion}
    take, policy = build_take([[0], [1]], first, lengths, 27, **still)
    body, frame = motion.body, round(when * 4)
    alone = sampler(replace(take, collision_avoidance=False), policy).sample(frame, frame + 1, FPS)[0]
    _, neck, pelvis, strikers = body_points(body, *(a[0] for a in alone.joints()), alone.scales)
    way = strikers[0, limb] - 0.5 * (neck[1] + pelvis[1])
    way[1] = 0.0
    way *= (np.linalg.norm(way) + body.torso_radius * scale + gap) / np.linalg.norm(way)
    x, z = take.x.copy(), take.z.copy()
    x[:, 1] += way[0]
    z[:, 1] += way[2]
    events = Events(
        np.array([when], np.float32), np.array([0], np.int32), np.array([1], np.int32),
        np.array([limb % 2], np.uint8), strikers[:1, limb].astype(np.float32), np.array([8.0], np.float32),
        np.array([landed]), np.array([limb], np.uint8),
    )  # fmt: skip
    return replace(take, x=x, z=z, events=events), policy, frame


@pytest.mark.parametrize("gap", [-0.08, 0.0, 0.08])
@pytest.mark.parametrize("kick", [0, 1])
@pytest.mark.parametrize("scale", [1.0, 0.9])
def test_a_kick_that_lands_touches(kick: int, gap: float, scale: float) -> None:
    take, policy, frame = duel(kick, gap, scale=scale)
    poses = sampler(take, policy).sample(frame, frame + 1, FPS)[0]
    assert abs(touch_gap(database().body, poses, int(take.events.limb[0]))) < 0.02


# A kick to the side meets the skin of the flank, which is further out than the capsule of the torso.
@pytest.mark.parametrize(("kick", "gap"), [(0, 0.08), (1, 0.1)])
def test_the_other_foot_stays_and_the_kicking_one_is_free_when_it_is_planted(kick: int, gap: float) -> None:
    take, policy, frame = duel(kick, gap)
    take = replace(take, collision_avoidance=False)
    frames = take.output_frames(FPS)
    kicking, calm = (
        sampler(one, policy).sample(0, frames, FPS)[0].joints() for one in (take, replace(take, events=NO_EVENTS))
    )
    moved = np.linalg.norm(kicking[0] - calm[0], axis=-1)[:, 0]
    roles, limb = database().body.roles, int(take.events.limb[0])
    mine, other = (roles[f"{side}_foot"] for side in (("left", "right") if limb == 2 else ("right", "left")))
    assert moved[frame, mine] > 0.03
    assert moved[:, other].max() < 0.003
    assert moved[: frame - 21].max() == 0.0
    assert moved[frame + 21 :].max() == 0.0
    assert moved[frame, roles["pelvis"]] < 0.09
    turned = quaternion.multiply(quaternion.conjugate(calm[1][:, 0, mine]), kicking[1][:, 0, mine])
    assert np.abs(turned[..., 1:]).max() < 1e-5
    planted = np.asarray(database().contacts)[4 * database().clip_starts[kick] :][:frames, limb - 2]
    assert moved[planted[: len(moved)], mine].max() < 0.002


@pytest.mark.parametrize("gap", [-0.08, 0.08])
@pytest.mark.parametrize("kick", [0, 1])
def test_legs_that_kick_move_without_a_jerk(kick: int, gap: float) -> None:
    take, policy, _ = duel(kick, gap)
    frames, none = take.output_frames(FPS), replace(take, events=NO_EVENTS, collision_avoidance=False)
    kicking, calm = (sampler(one, policy).sample(0, frames, FPS)[0].joints()[0][:, 0] for one in (take, none))
    change, own, all_in_all = (
        np.linalg.norm(np.diff(path, 2, axis=0), axis=-1).max() * FPS**2 for path in (kicking - calm, calm, kicking)
    )
    # A foot that goes 12 cm and back in 0.4 s, evenly, accelerates by 27 m/s2; the kick itself by over 150.
    assert change < 650.0 * np.linalg.norm(kicking - calm, axis=-1).max()
    assert all_in_all < 1.15 * own


def test_a_kick_that_misses_leaves_poses_alone() -> None:
    take, policy, _ = duel(0, 0.08, landed=False)
    frames = take.output_frames(FPS)
    one, two = (sampler(t, policy).sample(0, frames, FPS)[0] for t in (take, replace(take, events=NO_EVENTS)))
    assert np.array_equal(one.rotations, two.rotations)
    assert np.array_equal(one.root_positions, two.root_positions)


def test_an_avatar_that_is_kicked_in_the_body_folds_over_the_foot_and_its_pelvis_goes_back() -> None:
    take, policy, frame = duel(0, 0.0)
    roles = database().body.roles
    kicking, calm = (
        sampler(one, policy).sample(frame, frame + 14, FPS)[0].joints()[0][:, 1]
        for one in (take, replace(take, events=NO_EVENTS))
    )
    neck, pelvis = ((kicking - calm)[:, roles[role]] for role in ("neck", "pelvis"))
    assert np.abs([neck[0], pelvis[0]]).max() < 0.005
    # The front kick goes along +z.
    assert pelvis[9:, 2].min() > 0.01
    assert (neck - pelvis)[9:, 2].max() < -0.05


def test_any_range_of_kicking_poses_has_the_same_bytes() -> None:
    take, policy, frame = duel(1, 0.08)
    whole = sampler(take, policy).sample(0, take.output_frames(FPS), FPS)[0]
    part = sampler(take, policy, threads=2).sample(frame - 3, frame + 5, FPS)[0]
    assert np.array_equal(whole.rotations[frame - 3 : frame + 5], part.rotations)
    for which, _, _, positions, _ in sampler(take, policy).moments(np.array([0]), np.array([frame / FPS])):
        np.testing.assert_allclose(positions[0], whole.joints()[0][frame, which[0]], atol=1e-5)


def test_the_pelvis_goes_as_far_as_a_leg_is_too_short() -> None:
    # A leg that is nearly straight, level, ahead: hip, knee, ankle.
    leg = np.array([[[0.0, 0.9, 0.0], [0.0, 0.92, 0.42], [0.0, 0.9, 0.83]]])
    ahead, back, bent = np.array([[0.0, 0.0, 0.05]]), np.array([[0.0, 0.0, -0.05]]), leg.copy()
    bent[0, 1] = 0.0, 1.2, 0.3
    bent[0, 2] = 0.0, 0.9, 0.5
    assert 0.04 < _plan_moves(leg, ahead)[0, 2] <= 0.0501
    assert -0.03 < _plan_moves(leg, back)[0, 2] < -0.02
    assert abs(_plan_moves(bent, ahead)[0, 2]) == 0.0
    assert np.linalg.norm(_plan_moves(leg, 10.0 * ahead)) < 0.125
    assert not _plan_moves(np.full((1, 3, 3), np.nan), ahead).any()
