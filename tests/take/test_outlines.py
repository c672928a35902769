"""Where fists stay on bodies as pictures show them."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_take import database

from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.rewards import posed_distance
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules
from crowdsim.poses.contacts import body_points, surface_point
from crowdsim.poses.outlines import GIVES, WRIST_IN, Outline, leave_capsules

COUNT = 40


def depths_in(points, bodies):
    """How deep points (n, 3) are in the capsules of trunks and heads, the deepest, one by one [m]. Shape (n,)."""
    body, capsules = bodies.body, place_capsules([bodies], 1, COUNT)
    limbs = [joint for role, joint in body.roles.items() if role.split("_")[0] in ("left", "right")]
    found = np.full(len(points), -np.inf)
    for k, capsule in enumerate(capsule_order(body)):
        if body.capsule_joints[capsule] in limbs:
            continue
        for n, point in enumerate(points):
            start, end = capsules.starts[0, n, k].astype(float), capsules.ends[0, n, k].astype(float)
            axis = end - start
            along = float(np.clip((point - start) @ axis / max(axis @ axis, 1e-12), 0.0, 1.0))
            radius = capsules.radii[n, k, 0] + along * (capsules.radii[n, k, 1] - capsules.radii[n, k, 0])
            found[n] = max(found[n], radius - float(np.linalg.norm(point - start - along * axis)))
    return found


def points_on_bodies(seed):
    """Points on what counts as hit of bodies in frames that are drawn, the bodies, and what counts as hit."""
    rng, data = np.random.default_rng(seed), database()
    body, frames = data.body, rng.integers(0, len(data.rotations), COUNT)
    positions, turns = forward_kinematics(data.skeleton, data.root_positions[frames], data.rotations[frames])
    ones = np.ones(COUNT)
    head, neck, pelvis, _ = body_points(body, positions, turns, ones)
    outline = Outline(head, neck, pelvis, body.head_radius * ones, body.torso_radius * ones)
    bodies = PosedBodies(body, np.arange(COUNT), ones, ones, np.ones((COUNT, 3)), positions[None], turns[None])
    points = surface_point(neck + rng.normal(size=(COUNT, 3)) * 0.3, *outline)
    return points, bodies, outline


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_fists_leave_capsules_as_far_as_they_still_touch_what_counts_as_hit(seed: int) -> None:
    points, bodies, outline = points_on_bodies(seed)
    head, body = outline.head, bodies.body
    before, found = depths_in(points, bodies) + GIVES, leave_capsules(points, np.zeros_like(points), bodies, outline)
    after, gaps = depths_in(found, bodies) + GIVES, posed_distance(found, *outline)
    assert gaps.max() < GIVES + 1e-6
    free = before <= 0.0
    np.testing.assert_allclose(found[free], points[free], atol=1e-7)
    np.testing.assert_array_less(after[~free], before[~free] + 1e-6)
    near_head = np.abs(np.linalg.norm(points - head, axis=1) - body.head_radius) < 1e-6
    high = near_head & (points[:, 1] > head[:, 1])
    assert np.abs(after[high]).max(initial=0.0) < 1e-4


def test_wrists_behind_fists_leave_capsules_too_and_fists_still_touch() -> None:
    alone: list[np.ndarray] = []
    along: list[np.ndarray] = []
    for seed in range(5):
        points, bodies, outline = points_on_bodies(seed)
        wrists = np.random.default_rng(seed).normal(size=(COUNT, 3)) * 0.08
        for depths, way in ((alone, np.zeros_like(wrists)), (along, wrists)):
            found = leave_capsules(points, way, bodies, outline)
            assert posed_distance(found, *outline).max() < GIVES + 1e-6
            depths.append(depths_in(found + wrists, bodies))
    deep = np.concatenate(alone) > WRIST_IN + 0.01
    assert deep.sum() > 20
    assert np.mean(np.concatenate(along)[deep]) < np.mean(np.concatenate(alone)[deep]) - 0.01
