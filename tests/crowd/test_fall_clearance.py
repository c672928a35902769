"""Room where bodies fall: how much of it lacks beside bodies and soles, against slow and plain versions."""

from dataclasses import replace

import numpy as np
import pytest
from avatar_fields import fields, set_fields
from falling import falling_policy
from test_damage import POLICIES, fighters, with_falls
from test_room_of_the_lying import seen
from test_sole_contact import gap, line, posed, soles_at

from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.fall_clearance import FIRMLY, FREE, PARTS, SIDE_BY_SIDE, STANDS_BY, crowded
from crowdsim.crowd.kernels.layout import FROM_START, Axis
from crowdsim.crowd.kernels.lying import axes_apart, axis_after, axis_of, floor_transform, from_axis
from crowdsim.crowd.kernels.records import LINE
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation
from crowdsim.motion import ground, quaternion

SHIFT = np.array([0.1, -0.05])


def body_gap(policy, down, lies, size, its_down, body, its_size):
    """How far a body that lies as in a frame is from one that lies as in another, by points along their axes."""
    database, own, least = policy.database, policy.database.body, FREE
    positions, rotations = posed(database, down)
    for k, joint in enumerate(own.capsule_joints):
        ends = np.stack([own.capsule_starts[k], own.capsule_ends[k]])
        ends = positions[joint] + quaternion.rotate(rotations[joint], ends)
        points = line(*ground.to_world(lies, ground.to_local(database.ground[down], ends) * size))
        far = gap(points, body, database, its_down, its_size)
        least = min(least, far - own.capsule_radii[k].max() * size)
    return least


@pytest.mark.parametrize("seed", range(1, 7))
def test_room_that_lacks_matches_naive(seed: int) -> None:
    policy, rng = falling_policy(), np.random.default_rng(seed)
    database, model = policy.database, build_model([policy])
    avatars = Simulation(replace(fighters(3, seed=seed), policies=[policy]), model=model).avatars
    own, lying, standing = (int(avatars.slot_of[number]) for number in range(3))
    falls = np.flatnonzero(model.falls["kind"] == layout.FALLS)
    row, fall = (int(one) for one in rng.choice(falls, 2))
    action = model.falls["action"][row]
    before = int(model.actions["origin"][action])
    down, its_down = (int(database.falls.downs[one // 3]) * database.stride for one in (row, fall))
    size, its_size = avatars.playback["scale"][[own, lying]]
    stands = fields(avatars, "x z heading", own) + np.array([*SHIFT, 0.0])
    way = ground.compose(ground.inverse(database.ground[before]), database.ground[down])
    lies = ground.compose(stands, way * [size, size, 1.0])
    # One lies near by, and another one ends its action there.
    avatars.conditions["standing"][1], avatars.conditions["fall"][1] = layout.LYING, fall
    avatars.team[lying] = -2
    avatars.motion["action"][lying] = model.falls["action"][fall + 1]
    place = lies[:2] + rng.uniform(-0.8, 0.8, 2) - np.array(floor_transform(model, avatars, lying)[:2])
    set_fields(avatars, "end_x end_z", lying, fields(avatars, "end_x end_z", lying) + place)
    body = np.array(floor_transform(model, avatars, lying))
    set_fields(avatars, "end_x end_z", standing, lies[:2] + rng.uniform(-0.4, 0.4, 2))
    doing = model.actions[avatars.motion["action"][standing]]
    frame = int(doing["origin"] + doing["length"] * database.stride)
    there = fields(avatars, "end_x end_z base_turn", standing) + np.array([0.0, 0.0, database.ground[frame, 2]])

    cos, sin = size * np.cos(stands[2]), size * np.sin(stands[2])
    axis = axis_after(model, row, FROM_START, stands[0], stands[1], cos, sin)
    apart = axes_apart(axis, axis_of(model, avatars, lying))
    from_body = body_gap(policy, down, lies, size, its_down, body, its_size)
    soles = soles_at(database, frame, there, avatars.playback["scale"][standing])
    from_soles = min(FREE, *(gap(sole, lies, database, down, size) for sole in soles))
    beside = max(SIDE_BY_SIDE - apart, 0.0) ** 2 + FIRMLY * (FREE - from_body) ** 2
    aside = from_axis(axis, *fields(avatars, "end_x end_z", standing))
    around = 0.5 * max(STANDS_BY - aside, 0.0) ** 2 + FIRMLY * (FREE - from_soles) ** 2
    assert min(from_body, from_soles) < FREE
    for others, expected in (([lying], beside), ([standing], around), ([lying, standing], beside + around)):
        lacks = crowded(model, avatars, own, row, *SHIFT, seen(*others), 0)
        assert lacks == pytest.approx(expected, rel=0.1, abs=0.02)  # points are some centimetres apart
        assert lacks * PARTS == round(lacks * PARTS)


@pytest.mark.parametrize("direction", [0.0, np.pi])
def test_two_who_fall_at_once_leave_each_other_room(direction: float) -> None:
    axes = np.zeros((6, 2), LINE)
    axes["z"][:3, FROM_START], axes["z"][3:, FROM_START] = (
        1.0,
        -1.0,
    )  # the first fall leads a metre ahead, the second as far behind
    model = with_falls()._replace(fall_axes=axes)
    avatars = Simulation(replace(fighters(2), policies=POLICIES), model=model).avatars
    own, other = (int(avatars.slot_of[number]) for number in (0, 1))
    heading = avatars.heading[own]
    ahead = np.array([np.sin(heading), np.cos(heading)])
    set_fields(avatars, "end_x end_z", other, fields(avatars, "x z", own) + ahead)
    blow = heading + direction
    set_fields(avatars, "hit_x hit_z", other, (3.0 * np.sin(blow), 3.0 * np.cos(blow)))
    avatars.conditions["standing"][1] = layout.DROPS
    avatars.team[other] = -2
    size, its_size = avatars.playback["scale"][[own, other]]
    end = fields(avatars, "end_x end_z", other)
    far = its_size * np.array([np.sin(blow), np.cos(blow)])
    its = Axis(*end, *(end + far))
    for row, way in ((0, 1.0), (3, -1.0)):
        start = fields(avatars, "x z", own)
        apart = axes_apart(Axis(*start, *(start + way * size * ahead)), its)
        lacks = crowded(model, avatars, own, row, 0.0, 0.0, seen(other), 0)
        assert lacks == pytest.approx(max(SIDE_BY_SIDE - apart, 0.0) ** 2, abs=1e-3)
