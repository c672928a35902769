"""Soles and bodies on the floor: what an action treads on, and ways around bodies, against slow and plain versions."""

from dataclasses import replace

import numpy as np
import pytest
from avatar_fields import fields, set_fields
from falling import falling_policy
from test_damage import fighters, with_falls
from test_lying import placed_beside
from test_room_of_the_lying import seen

from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.layout import Target
from crowdsim.crowd.kernels.lying import axis_of, floor_transform
from crowdsim.crowd.kernels.obstacle_steering import AROUND, BEYOND, go_around
from crowdsim.crowd.kernels.records import LINE
from crowdsim.crowd.kernels.sole_contact import BESIDE, CLEAR, NEARER, STEPS_ON, treads_on
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation
from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics

ALONG = np.linspace(0.0, 1.0, 60)[:, None]


def line(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    return start + ALONG * (end - start)


def posed(database, frame):
    pose = database.root_positions[frame, None], database.rotations[frame, None]
    positions, rotations = forward_kinematics(database.skeleton, *pose, threads=1)
    return positions[0], rotations[0].astype(float)


def soles_at(database, frame, stands, size):
    """Points of both soles of a body of a size that stands somewhere, in a frame."""
    positions, rotations = posed(database, frame)
    for side, offsets in zip(("left", "right"), database.body.sole_offsets, strict=True):
        foot = database.body.roles[f"{side}_foot"]
        ends = positions[foot] + quaternion.rotate(rotations[foot], offsets)
        yield line(*ground.to_world(stands, ground.to_local(database.ground[frame], ends) * size))


def gap(points, body, database, frame, size):
    """How far points are from a body that lies somewhere as it does in a frame."""
    positions, rotations = posed(database, frame)
    found = np.inf
    own = database.body
    for k, joint in enumerate(own.capsule_joints):
        ends = np.stack([own.capsule_starts[k], own.capsule_ends[k]])
        ends = positions[joint] + quaternion.rotate(rotations[joint], ends)
        axis = line(*ground.to_world(body, ground.to_local(database.ground[frame], ends) * size))
        far = np.linalg.norm(points[:, None] - axis, axis=-1).min()
        found = min(found, far - own.capsule_radii[k].max() * size)
    return found


@pytest.mark.parametrize("seed", range(3))
def test_what_an_action_treads_on_matches_naive(seed):
    policy = falling_policy()
    database, model = policy.database, build_model([policy])
    one = Simulation(replace(fighters(2, seed=seed), policies=[policy]), model=model)
    avatars, rng = one.avatars, np.random.default_rng(seed)
    own, other = (int(avatars.slot_of[number]) for number in (0, 1))
    fall = int(np.flatnonzero(model.falls["kind"] == layout.FALLS)[seed])
    avatars.conditions["standing"][1], avatars.conditions["fall"][1] = layout.LYING, fall
    avatars.motion["action"][other] = model.falls["action"][fall + 1]
    size, its_size = avatars.playback["scale"][own], avatars.playback["scale"][other]
    down = int(database.falls.downs[fall // 3]) * database.stride
    stands = fields(avatars, "x z heading", own)
    where = stands[:2] + rng.uniform(-0.5, 0.5, 2) - np.array(floor_transform(model, avatars, other)[:2])
    set_fields(avatars, "end_x end_z", other, fields(avatars, "end_x end_z", other) + (where))
    body = np.array(floor_transform(model, avatars, other))
    state = model.actions["next"][avatars.motion["action"][own]]
    counts = []
    for action in range(model.offsets[state], model.offsets[state + 1]):
        origin, length = model.actions["origin"][action], model.actions["length"][action]
        path = model.actions["paths"][action]
        ways = [np.zeros(3)]
        for x, z, cos, sin in np.transpose([rows[path : path + length] for rows in model.paths[:4]]):
            ways.append(np.array([x * size, z * size, np.arctan2(sin, cos)]))
        gaps = []
        for t, way in enumerate(ways):
            feet = soles_at(database, origin + t * database.stride, ground.compose(stands, way), size)
            gaps.append([gap(foot, body, database, down, its_size) for foot in feet])
        gaps = np.array(gaps)
        steps = (gaps[1:] < np.minimum(gaps[0] - NEARER, CLEAR)).sum()
        expected = np.maximum(1.0 - gaps[-1] / BESIDE, 0.0).sum()
        found = treads_on(model, avatars, own, action, other)
        counted = (found - expected) / STEPS_ON
        assert abs(counted - steps) <= 1.05  # points are some millimetres apart, so that a frame may be on the edge
        assert counted == pytest.approx(round(counted), abs=0.1)
        counts.append(found)
    assert max(counts) > 0.5
    avatars.conditions["standing"][1] = layout.RISING
    assert treads_on(model, avatars, own, action, other) == 0.0


def body_ahead(shift=0.0):
    """An avatar, and one that lies across its way a metre ahead, moved to the side by ``shift`` [m]."""
    model = with_falls()
    one, own = placed_beside(model, 0.0)
    axes = np.zeros((len(model.falls), 2), LINE)
    other = int(one.avatars.slot_of[1])
    turn = floor_transform(model, one.avatars, other)[2]
    aside = one.avatars.heading[own] + 0.5 * np.pi - turn
    for names, far in ((("x", "z"), shift - 0.8), (("to_x", "to_z"), shift + 0.8)):
        for name, value in zip(names, (np.sin(aside), np.cos(aside)), strict=True):
            axes[name][:, layout.FROM_END] = far * value
    model = model._replace(fall_axes=axes)
    axis = np.array(axis_of(model, one.avatars, other)).reshape(2, 2)
    heading = one.avatars.heading[own]
    ahead = fields(one.avatars, "x z", own) + np.array([np.sin(heading), np.cos(heading)])
    middle = ahead + shift * np.array([np.cos(heading), -np.sin(heading)])
    set_fields(
        one.avatars, "end_x end_z", other, fields(one.avatars, "end_x end_z", other) + (middle - axis.mean(axis=0))
    )
    return model, one.avatars, own, other


def detour(model, avatars, own, *others, far=3.0):
    """Where an avatar sees a target that is straight ahead: to its left, and ahead [m]."""
    x, z, heading = fields(avatars, "x z heading", own)
    target = Target(x + far * np.sin(heading), 1.6, z + far * np.cos(heading), 0.1, 0.2, 5.0)
    found = go_around(model, avatars, own, target, seen(*others), 0)
    assert (found.y, found.vx, found.vz, found.lasts) == (1.6, 0.1, 0.2, 5.0)
    return ground.to_local([x, z, heading], np.array([found.x, 0.0, found.z]))[[0, 2]]


@pytest.mark.parametrize("shift", [-0.6, -0.2, 0.2, 0.6])
def test_ways_lead_around_the_nearer_end_of_a_body(shift):
    model, avatars, own, other = body_ahead(shift)
    size = avatars.playback["scale"][other]
    seen_at = detour(model, avatars, own, other)
    axis = np.array(axis_of(model, avatars, other)).reshape(2, 2)
    half = 0.5 * np.linalg.norm(axis[1] - axis[0])
    corner = np.array([shift - np.sign(shift) * (half + AROUND * size), 1.0])
    np.testing.assert_allclose(seen_at, 3.0 * corner / np.linalg.norm(corner), atol=1e-6)


def test_targets_are_seen_where_they_are_if_no_body_is_in_between():
    model, avatars, own, other = body_ahead()
    straight = [0.0, 3.0]
    np.testing.assert_allclose(detour(model, avatars, own), straight, atol=1e-7)
    np.testing.assert_allclose(detour(model, avatars, own, other, far=0.9), [0.0, 0.9], atol=1e-7)
    size = avatars.playback["scale"][other]
    for shift, crosses in ((0.75 * size + BEYOND * size, True), (0.85 * size + BEYOND * size, False)):
        model, avatars, own, other = body_ahead(shift)
        assert np.allclose(detour(model, avatars, own, other), straight, atol=1e-6) != crosses
    avatars.team[other] = 1
    model, avatars, own, other = body_ahead()
    avatars.team[other] = 1
    avatars.conditions["standing"][1] = layout.UP
    np.testing.assert_allclose(detour(model, avatars, own, other), straight, atol=1e-7)
