"""Strikes that are blocked: fists stop at the arm that is in their way, and push the victim less."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from take.synthetic_take import database
from take.test_poses import duel, sampler

from crowdsim.crowd.kernels.layout import BLOCKED, LANDED, MISSED
from crowdsim.crowd.model_arms import arm_radii
from crowdsim.poses.contacts import body_points
from crowdsim.poses.guards import _GIVES, Guard, guard_of, guard_points
from crowdsim.take.hits_plot import build_silhouette, find_hits


def line_gap(point, start, end):
    """Distance of a point from the line between two others."""
    axis = end - start
    share = np.clip((point - start) @ axis / max(axis @ axis, 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(point - start - share * axis))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_fists_stay_outside_of_the_nearest_arm_on_the_side_they_come_from(seed):
    rng = np.random.default_rng(seed)
    elbows = rng.normal([[0.25, 1.2, 0.1], [-0.25, 1.2, 0.1]], 0.05, (1, 2, 3))
    fists = elbows + rng.normal([0.0, 0.25, 0.0], 0.03, (1, 2, 3))
    arm, share = int(rng.integers(2)), rng.uniform()
    middle = elbows[0, arm] + share * (fists[0, arm] - elbows[0, arm])
    point, origin = middle + rng.normal(0.0, 0.02, 3), middle + np.array([0.1, 0.0, 0.7])
    guard = Guard(elbows, fists, np.array([0.04]), np.array([0.06]))
    found = guard_points(point[None], origin[None], guard)[0]
    gaps = line_gap(found, elbows[0, arm], fists[0, arm]) - 0.04, float(np.linalg.norm(found - fists[0, arm])) - 0.06
    assert abs(min(gaps) - 0.06 + _GIVES) < 0.025
    assert (found - middle) @ (origin - middle) > 0.0


def blocked_duel():
    """A duel whose strike meets the glove of the other, who looks at who strikes; its frame, and the glove's side."""
    take, policy, frame = duel(0.0, landed=False)
    take = replace(take, collision_avoidance=False, heading=take.heading + np.array([0.0, np.pi], np.float32))
    poses = sampler(without(take), policy).sample(frame, frame + 1, 60)[0]
    positions, turns = (a[0] for a in poses.joints())
    fist = body_points(database().body, positions, turns, poses.scales)[3][0, int(take.events.hand[0])]
    gloves = guard_of(database().body, positions[1:], turns[1:], poses.scales[1:], poses.scales[1:]).fists[0]
    side = int(np.argmin(np.abs(gloves[:, 1] - fist[1])))
    way = fist - positions[0, database().body.roles["pelvis"]]
    goal = fist - 0.1 * way / np.linalg.norm(way)
    x, z = take.x.copy(), take.z.copy()
    x[:, 1] += goal[0] - gloves[side, 0]
    z[:, 1] += goal[2] - gloves[side, 2]
    met = np.array([goal[0], gloves[side, 1], goal[2]], np.float32)
    events = replace(take.events, point=met[None], outcome=np.array([BLOCKED], np.uint8))
    return replace(take, x=x, z=z, events=events), policy, frame, side


def without(take):
    """The take without its strike."""
    return replace(take, events=replace(take.events, outcome=np.array([MISSED], np.uint8), victim=np.array([-1])))


def test_a_fist_that_is_blocked_stops_at_the_glove():
    take, policy, frame, side = blocked_duel()
    body, hand = database().body, int(take.events.hand[0])
    gaps = []
    for one in (take, without(take)):
        poses = sampler(one, policy).sample(frame, frame + 1, 60)[0]
        positions, turns = (a[0] for a in poses.joints())
        fist = body_points(body, positions, turns, poses.scales)[3][0, hand]
        guard = guard_of(body, positions[1:], turns[1:], poses.scales[1:], poses.scales[1:])
        arm = line_gap(fist, guard.elbows[0, side], guard.fists[0, side]) - guard.forearms[0]
        gaps.append(min(arm, float(np.linalg.norm(fist - guard.fists[0, side])) - guard.gloves[0]))
    stops = arm_radii(body)[1] - _GIVES
    assert abs(gaps[0] - stops) < 0.015
    assert abs(gaps[1] - stops) > 0.02


def test_a_strike_that_is_blocked_pushes_less_than_one_that_lands():
    take, policy, frame, _ = blocked_duel()
    landed = replace(take, events=replace(take.events, outcome=np.array([LANDED], np.uint8), landed=np.array([True])))
    head = database().body.roles["head"]
    heads = [
        sampler(one, policy).sample(frame, frame + 20, 60)[0].joints()[0][:, 1, head]
        for one in (take, landed, without(take))
    ]
    pushed, thrown = (float(np.linalg.norm(one - heads[2], axis=-1).max()) for one in heads[:2])
    assert 0.002 < pushed < 0.5 * thrown


def test_the_plot_of_hits_shows_blocked_strikes_apart():
    take, policy, _, _ = blocked_duel()
    one = sampler(take, policy)
    hits = find_hits(one, build_silhouette(one.policies[0].database))
    assert (hits.count, len(hits.points), len(hits.blocked)) == (0, 0, 1)


def test_a_fist_that_is_blocked_is_on_its_captured_path_until_it_is_close_to_the_glove():
    take, policy, frame, _ = blocked_duel()
    body, hand = database().body, int(take.events.hand[0])
    paths = []
    for one in (take, without(take)):
        poses = sampler(one, policy).sample(frame - 12, frame + 1, 60)[0]
        paths.append(body_points(body, *(a[:, 0] for a in poses.joints()), np.ones(13))[3][:, hand])
    shift = paths[0][-1] - paths[1][-1]
    length = float(np.linalg.norm(shift))
    before = (paths[1] - paths[0][-1]) @ (shift / length)
    moved = np.linalg.norm(paths[0] - paths[1], axis=1)
    assert length > 0.08
    assert np.count_nonzero(before > 0.1) > 3
    assert moved[before > 0.1].max() < 0.06
