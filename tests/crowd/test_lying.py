"""Where bodies lie: the axis from head to feet, how near it is to others, and which fall has room."""

from dataclasses import replace

import numpy as np
import pytest
from avatar_fields import fields, set_fields
from falling import falling_policy
from test_damage import POLICIES, fighters, with_falls

from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.fall_clearance import SLIDES, crowded
from crowdsim.crowd.kernels.falling import _unfit
from crowdsim.crowd.kernels.layout import Axis, Observed
from crowdsim.crowd.kernels.lying import axes_apart, axis_of, from_axis
from crowdsim.crowd.kernels.records import LINE
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation
from crowdsim.motion import ground
from crowdsim.motion.kinematics import forward_kinematics

SHARES = np.linspace(0.0, 1.0, 400)


def points(axis: Axis) -> np.ndarray:
    ends = np.array(axis).reshape(2, 2)
    return ends[0] + SHARES[:, None] * (ends[1] - ends[0])


@pytest.mark.parametrize("seed", range(30))
def test_distances_from_axes_match_naive_ones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = (Axis(*rng.uniform(-1.0, 1.0, 4).tolist()) for _ in range(2))
    x, z = rng.uniform(-1.5, 1.5, 2).tolist()
    to_point, apart = from_axis(one, x, z), axes_apart(one, other)
    assert to_point == pytest.approx(np.linalg.norm(points(one) - [x, z], axis=1).min(), abs=5e-3)
    naive = np.linalg.norm(points(one)[:, None] - points(other), axis=-1).min()
    assert apart == pytest.approx(naive, abs=1e-2)


def test_bodies_lie_where_the_motion_has_their_heads_and_feet() -> None:
    policy, model = falling_policy(), build_model([falling_policy()])
    database, falls = policy.database, policy.falls
    assert falls is not None
    positions, _ = forward_kinematics(database.skeleton, database.root_positions, database.rotations, threads=1)
    roles, stride = database.body.roles, database.stride
    spans = database.falls
    for number, (start, down) in enumerate(zip(spans.starts, spans.downs, strict=True)):
        row = int(np.flatnonzero(model.falls["action"] == falls.fall[number])[0])
        posed = positions[down * stride]
        feet = 0.5 * (posed[roles["left_foot"]] + posed[roles["right_foot"]])
        for seen_from, frame in ((layout.FROM_START, start), (layout.FROM_END, down)):
            head_and_feet = np.array(model.fall_axes[row, seen_from].tolist()).reshape(2, 2)
            seen = ground.to_local(database.ground[frame * stride], np.stack([posed[roles["head"]], feet]))
            assert np.linalg.norm(head_and_feet[0] - seen[0, [0, 2]]) < 0.15
            np.testing.assert_allclose(head_and_feet[1], seen[1, [0, 2]], atol=1e-4)


def test_ground_transforms_rest_while_a_body_lies() -> None:
    database = falling_policy().database
    for down, rise in zip(database.falls.downs, database.falls.rises, strict=True):
        lying = database.ground[down * database.stride : rise * database.stride + 1]
        assert np.ptp(lying, axis=0).max() < 1e-6


def placed_beside(model, direction: float) -> tuple[Simulation, int]:
    """Two avatars, of which the second lies beside the first, in a direction from it."""
    one = Simulation(replace(fighters(2), policies=POLICIES), model=model)
    first, second = (int(one.avatars.slot_of[number]) for number in (0, 1))
    turn = one.avatars.heading[first] + direction
    ends = fields(one.avatars, "x z", first) + np.array([np.sin(turn), np.cos(turn)])
    set_fields(one.avatars, "end_x end_z", second, ends)
    one.avatars.conditions["standing"][1], one.avatars.conditions["fall"][1] = layout.LYING, 0
    one.avatars.team[second] = -2
    return one, first


@pytest.mark.parametrize("direction", [0.0, np.pi])
def test_a_fall_is_less_fit_where_another_lies(direction: float) -> None:
    axes = np.zeros((6, 2), LINE)
    # The first fall leads ahead, the second behind, a metre each.
    axes["z"][:3, layout.FROM_START], axes["z"][3:, layout.FROM_START] = 1.0, -1.0
    model = with_falls()._replace(fall_axes=axes)
    one, own = placed_beside(model, direction)
    slot = int(one.avatars.slot_of[1])
    axis = axis_of(model, one.avatars, slot)
    one.avatars.motion["end_x"][slot] += one.avatars.motion["end_x"][slot] - axis.x
    one.avatars.motion["end_z"][slot] += one.avatars.motion["end_z"][slot] - axis.z
    observed = Observed(np.array([slot], np.int32), np.array([1], np.int32), np.array([[slot]], np.int32))
    world, blow = one._world, 0.5 * np.pi
    ahead, behind = (_unfit(model, one.avatars, world, 0, own, row, blow, blow, 0.0, observed, 0) for row in (0, 3))
    assert (ahead > behind) == (direction == 0.0)
    ways = [0.0, *(far * np.exp(1j * turn) for far in (0.5 * SLIDES, SLIDES) for turn in np.arange(8) * np.pi / 4)]
    row = 0 if direction == 0.0 else 3
    lacks = [crowded(model, one.avatars, own, row, np.imag(way), np.real(way), observed, 0) for way in ways]
    assert max(ahead, behind) == min(lacks) > 0.3  # by where it can slide to
    assert lacks[0] > 0.5
