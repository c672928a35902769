"""Fists that land: where on a body, how the trunk helps, and what that does to the rest of the pose."""

from dataclasses import replace
from typing import Any

import naive_leans
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_take import build_take, database, sampler, touch_gap
from test_poses import duel, same

from crowdsim.motion.limbs import flexion
from crowdsim.policy.rewards import target_body
from crowdsim.poses.contacts import body_points, surface_point
from crowdsim.poses.kernels.leans import Reaches, lean_trunks
from crowdsim.poses.outlines import striker_radii
from crowdsim.take.quality import measure_take
from crowdsim.take.take import Events, Take


def without_strikes(take: Take) -> Take:
    return replace(take, events=Events(*(getattr(take.events, n)[:0] for n in Events.__dataclass_fields__)))


def places(take: Take, policy: Any, fps: float = 60.0) -> np.ndarray:
    return np.asarray(sampler(take, policy).sample(0, take.output_frames(fps), fps)[0].joints()[0], dtype=float)


@given(st.integers(0, 10_000), st.sampled_from([(1.7, 0.11), (1.2, 0.15)]))
def test_a_point_that_is_hit_lies_on_the_surface_and_not_behind_the_body(seed: int, part: tuple[float, float]) -> None:
    rng = np.random.default_rng(seed)
    height, radius = part
    head, neck, pelvis = np.array([[0.0, 1.7, 0.0]]), np.array([[0.0, 1.5, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    middle = np.array([[0.0, height, 0.0]])
    fist = middle + rng.normal(size=(1, 3)) * [0.1, 0.0, 0.1] + [0.0, 0.02, 0.0]
    origin = fist * [0.0, 1.0, 0.0] + np.array([[np.cos(seed), 0.0, np.sin(seed)]]) * 0.6
    found = surface_point(fist, head, neck, pelvis, np.array([0.11]), np.array([0.15]), origin)
    out = (found - middle) * ([1.0, 1.0, 1.0] if height > 1.5 else [1.0, 0.0, 1.0])
    assert np.linalg.norm(out) == pytest.approx(radius, abs=1e-3)
    assert float(np.sum(out * origin)) > 0.3 * 0.6 * radius
    there = surface_point(found, head, neck, pelvis, np.array([0.11]), np.array([0.15]), origin)
    assert np.linalg.norm(there - found) < 1e-3


@pytest.mark.parametrize("gap", [-0.15, 0.12, 0.17])
def test_what_a_straight_arm_does_not_reach_the_trunk_gives(gap: float) -> None:
    take, policy, frame = duel(gap)
    body, hand = database().body, int(take.events.hand[0])
    poses = sampler(take, policy).sample(frame, frame + 1, 60)[0]
    positions = poses.joints()[0][0]
    assert abs(touch_gap(body, poses, hand)) < 0.01
    arm = [body.roles[f"{('left', 'right')[hand]}_{name}"] for name in ("shoulder", "elbow", "hand")]
    bend = np.rad2deg(flexion(*(positions[0, joint] for joint in arm)))
    assert 6.0 < bend < 146.0


@pytest.mark.parametrize("seed", range(4))
def test_leans_match_naive(seed: int) -> None:
    rng, count = np.random.default_rng(seed), 40
    base, levers, fists = (
        rng.normal(size=(count, 3)),
        rng.normal(0, 0.2, (count, 3, 3)),
        rng.normal(0, 0.05, (count, 3)),
    )
    targets = base + rng.normal(0, 0.6, (count, 3))
    goals, compliance = rng.uniform(0.2, 0.7, count), rng.choice([0.0, 1.0, 1.5], (count, 3))
    goals[0] = np.nan
    turns, moves = np.full((count, 3, 3), np.inf), np.full((count, 3), np.inf)
    lean_trunks(0, count, Reaches(base, levers, fists, targets, goals, compliance), turns, moves)
    assert not turns[0].any()
    assert not moves[0].any()
    for e in range(1, count):
        expected = naive_leans.lean(base[e], levers[e], fists[e], targets[e], goals[e], compliance[e])
        np.testing.assert_allclose(turns[e], expected[0], atol=1e-9)
        np.testing.assert_allclose(moves[e], expected[1], atol=1e-9)


def test_trunks_lean_for_fists_without_a_jerk_over_feet_that_stay() -> None:
    take, policy, frame = duel(0.17)
    roles = database().body.roles
    take = replace(take, reactions=False)
    moved = (places(take, policy) - places(without_strikes(take), policy))[:, 0]
    head = moved[:, roles["head"]]
    assert np.linalg.norm(head[frame]) > 0.005
    assert np.linalg.norm(np.diff(head, 2, axis=0), axis=1).max() * 3600.0 < 20.0
    feet = moved[:, [roles["left_foot"], roles["right_foot"]]]
    assert np.linalg.norm(feet, axis=-1).max() < 2e-3


def test_a_strike_repeated_by_a_transition_causes_one_reaction() -> None:
    take, policy, _ = duel(0.0)
    twice = Events(*(np.repeat(getattr(take.events, n), 2, axis=0) for n in Events.__dataclass_fields__))
    twice = replace(twice, frame=twice.frame + np.array([0.0, 0.5], np.float32))
    frames = take.output_frames(60)
    one, both = (sampler(t, policy).sample(0, frames, 60)[0] for t in (take, replace(take, events=twice)))
    assert same(one.at(0), both.at(0))
    arms = [n for n, name in enumerate(database().skeleton.names) if "Arm" in name or "Hand" in name]
    trunk = np.setdiff1d(np.arange(one.rotations.shape[2]), arms)
    assert np.array_equal(one.rotations[:, 1][:, trunk], both.rotations[:, 1][:, trunk])
    # Arms give way to the arm that strikes, which stays a little longer.
    np.testing.assert_allclose(one.rotations[:, 1], both.rotations[:, 1], atol=1e-3)


def test_figures_of_a_run_hold_the_distance_of_fists_from_what_they_hit() -> None:
    take, policy, _ = duel(0.1)
    report = measure_take(sampler(take, policy))
    assert report["fist_gap_most"] < 0.01
    assert report["fists_off_share"] == 0.0
    far = replace(take, x=take.x + np.array([0.0, 3.0], np.float32))
    assert measure_take(sampler(far, policy))["fists_off_share"] == 1.0
    assert measure_take(sampler(without_strikes(take), policy))["fist_gap_most"] is None


def test_a_fist_that_misses_for_being_deep_in_a_body_stays_at_its_surface_and_is_no_blow() -> None:
    take, policy, frame = duel(-0.2, landed=False)
    body, hand = database().body, int(take.events.hand[0])
    poses = sampler(take, policy).sample(frame, frame + 1, 60)[0]
    # Nothing is hit, so the fist leaves the body, but for what a pose in single precision and half a picture lack.
    assert -0.005 < touch_gap(body, poses, hand) < 0.1
    frames = take.output_frames(60)
    # Without the limbs that leave other bodies.
    take = replace(take, collision_avoidance=False)
    one, none = (sampler(t, policy).sample(0, frames, 60)[0] for t in (take, without_strikes(take)))
    assert np.array_equal(one.rotations[:, 1], none.rotations[:, 1])
    assert not np.array_equal(one.rotations[:, 0], none.rotations[:, 0])


@pytest.mark.parametrize("scale", [0.9, 1.0, 1.1])
def test_a_strike_that_lands_touches_a_scripted_target_of_the_size_that_control_gives_it(scale: float) -> None:
    motion = database()
    best = int(np.argmax(motion.strike_speeds))
    strike, hand, stride = int(motion.strike_frames[best]), int(motion.strike_limbs[best]), motion.stride
    frame = strike // stride
    first, lengths = np.array([frame - 20]), np.array([60])
    take, policy = build_take([[0]], first, lengths, 45, scales=[scale], start=[(0, 0, 0)])
    when = (strike - (frame - 21) * stride) / stride
    at = round(when * 4)
    body = policy.body
    alone = sampler(take, policy).sample(at, at + 1, 60)[0]
    positions, turns = (a[0] for a in alone.joints())
    fist = body_points(motion.body, positions, turns, alone.scales)[3][0, hand]
    way = (fist - positions[0, motion.body.roles["chest"]]) * [1.0, 0.0, 1.0]
    target = fist + way / np.linalg.norm(way) * (body.head_radius * scale + 0.05)
    events = Events(
        np.array([when], np.float32), np.array([0], np.int32), np.array([-2], np.int32), np.array([hand], np.uint8),
        fist[None].astype(np.float32), np.array([7.0], np.float32), np.array([True]),
    )  # fmt: skip
    targets = np.tile(target, (take.frame_count, 1, 1)).astype(np.float32)
    take = replace(take, events=events, targets=targets, target_names=("bag",))
    poses = sampler(take, policy).sample(at, at + 1, 60)[0]
    struck = body_points(motion.body, *(a[0] for a in poses.joints()), poses.scales)[3][0, hand]
    assert np.linalg.norm(fist - target) - body.head_radius * scale == pytest.approx(0.05, abs=0.005)
    thick = float(striker_radii(motion.body, np.array([hand]), np.array([scale]), np.array([False]))[0])
    assert np.linalg.norm(struck - target) - body.head_radius * scale == pytest.approx(thick, abs=0.005)
    assert body == target_body(motion)
