"""Bodies that are down are left room: by soles, by those who stagger, and by those who fall beside them."""

from dataclasses import replace

import numpy as np
import pytest
from avatar_fields import fields, set_fields
from falling import falling_policy
from test_damage import POLICIES, falling, fighters, with_falls
from test_lying import placed_beside

from crowdsim.crowd.crowd import enter
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.fall_clearance import SLIDES, crowded, slide
from crowdsim.crowd.kernels.falling import _unfit
from crowdsim.crowd.kernels.layout import Observed
from crowdsim.crowd.kernels.lying import axis_of, floor_transform
from crowdsim.crowd.kernels.records import CAPSULE, NEIGHBOUR, records
from crowdsim.crowd.kernels.sole_contact import treads_on
from crowdsim.crowd.kernels.terms import collision_avoidance
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation

ACTION = 5


def seen(*slots: int) -> Observed:
    return Observed(np.array([0], np.int32), np.array([len(slots)], np.int32), np.array([[*slots, 0]], np.int32))


def turned(x: float, z: float, heading: float) -> np.ndarray:
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([x * cos + z * sin, z * cos - x * sin])


def naive_cost(point: np.ndarray, axis: np.ndarray, cost: float) -> float:
    """What it costs to be at a point (x, z), by the nearest of many points of the axis."""
    points = axis[0] + np.linspace(0.0, 1.0, 2001)[:, None] * (axis[1] - axis[0])
    return float(max(cost * (1.0 - (np.linalg.norm(points - point, axis=1).min() / 0.75) ** 2), 0.0))


def naive_from_ends(point: np.ndarray, axis: np.ndarray) -> float:
    """How far along the axis a point is from both ends, by the nearer one; 0 beyond them."""
    way = (axis[1] - axis[0]) / np.linalg.norm(axis[1] - axis[0])
    return float(max(min((point - axis[0]) @ way, (axis[1] - point) @ way), 0.0))


@pytest.mark.parametrize("seed", range(4))
def test_what_it_costs_to_tread_on_a_body_matches_naive(seed: int) -> None:
    rng, model = np.random.default_rng(seed), with_falls()
    capsules = records(rng.uniform(-0.5, 0.5, (2 * len(model.falls), 8)), CAPSULE).reshape(-1, 2)
    capsules["radius"], capsules["bound"] = 0.1, 1.0  # radius, and a sphere around it that holds any of these
    model = model._replace(fall_capsules=capsules)
    avatars = Simulation(replace(fighters(3, seed=seed), policies=POLICIES), model=model).avatars
    own, size = 1, avatars.playback["scale"][1]
    near, work = np.zeros(1, NEIGHBOUR), np.zeros((7, 64))
    head, way = rng.uniform(-0.5, 0.5, 2), rng.uniform(-1.0, 1.0, 2)
    near["x"], near["z"], near["way_x"], near["way_z"] = *head, *way
    near["room"], near["end_cost"], near["path_cost"], near["step_cost"], near["slot"] = 0.75, 3.0, 1.0, 2.0, 2.0
    near["frames"] = collision_avoidance.ON_FLOOR
    axis = np.array([head, head + way])
    lanes = collision_avoidance._find_ends(model, avatars, own, work).lanes
    ends = collision_avoidance.Ends(*work[:6], lanes)  # views of it that Python is handed are the whole of it
    before = rng.uniform(0.0, 2.0, 64)
    work[3] = before
    collision_avoidance._add_lying(model, avatars, own, near, 0, ends)
    state, heading = model.actions["next"][avatars.motion["action"][own]], avatars.heading[own]
    actions = range(model.offsets[state], model.offsets[state + 1])
    costs = []
    for k, action in enumerate(actions):
        move = model.moves[action]
        end = turned(move["x"] * size, move["z"] * size, heading)
        inwards = 1.0 + collision_avoidance.ALONG * naive_from_ends(end, axis)
        cost = max(naive_cost(end, axis, 3.0) * inwards, naive_cost(0.5 * end, axis, 1.0))
        cost += 2.0 * treads_on(model, avatars, own, action, 2)
        costs.append(max(cost, before[k]))
    np.testing.assert_allclose(work[3, : len(costs)], costs, atol=5e-3)
    assert (np.array(costs) > before[: len(costs)]).any()


@pytest.mark.parametrize("direction", [0.0, np.pi])
def test_nobody_staggers_onto_a_body(direction: float) -> None:
    model = with_falls()
    moves = model.moves.copy()
    moves["x"][ACTION], moves["z"][ACTION] = 0.0, 0.7
    rows = [*(row[:5] for row in model.falls.tolist()), (0.0, 0, layout.STUMBLES, ACTION, 0)]
    model = falling(model._replace(moves=moves), rows)
    one, own = placed_beside(model, direction)
    row, push = len(model.falls) - 1, 0.7 * float(one.avatars.playback["scale"][own])
    unfit = _unfit(model, one.avatars, one._world, 0, own, row, 0.0, 0.0, push, seen(int(one.avatars.slot_of[1])), 0)
    assert np.isinf(unfit) == (direction == 0.0)
    assert _unfit(model, one.avatars, one._world, 0, own, row, 0.0, 0.0, push, seen(), 0) == pytest.approx(
        0.0, abs=1e-6
    )


@pytest.mark.parametrize("direction", np.linspace(0.0, 6.0, 7))
def test_a_body_slides_away_from_one_that_lies_where_it_falls(direction: float) -> None:
    model = with_falls()
    one, own = placed_beside(model, direction)
    other = int(one.avatars.slot_of[1])
    slide(model, one.avatars, one._world, 0, own, 0, seen(), 0)
    assert not fields(one.avatars, "slide_x slide_z", own).any()
    axis = axis_of(model, one.avatars, other)
    away = np.array([one.avatars.x[own] - axis.x, one.avatars.z[own] - axis.z])
    end = fields(one.avatars, "end_x end_z", other)
    set_fields(one.avatars, "end_x end_z", other, end + (1.0 - 0.5 / np.linalg.norm(away)) * away)
    slide(model, one.avatars, one._world, 0, own, 0, seen(other), 0)
    moved = fields(one.avatars, "slide_x slide_z", own)
    assert np.linalg.norm(moved) == pytest.approx(SLIDES)
    assert moved @ away > 0.9 * SLIDES * np.linalg.norm(away)
    room = [crowded(model, one.avatars, own, 0, *way, seen(other), 0) for way in ((0.0, 0.0), moved)]
    assert room[1] < room[0]


def test_a_body_slides_smoothly_over_the_action_in_which_it_falls() -> None:
    one, other = (Simulation(replace(fighters(4), policies=POLICIES), model=with_falls()) for _ in range(2))
    for simulation in (one, other):
        simulation.run(1)
    slot, action = 2, int(one.avatars.motion["action"][2])
    set_fields(one.avatars, "slide_x slide_z", slot, (0.3, -0.1))
    rise = np.polynomial.Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    begun, length = one.avatars.motion["phase"][slot], one.model.actions["length"][action]
    end = fields(one.avatars, "end_x end_z", slot) + (1.0 - rise(begun / length)) * np.array([0.3, -0.1])
    set_fields(one.avatars, "end_x end_z", slot, end)
    while one.avatars.motion["phase"][slot] + one.avatars.motion["speed"][slot] < length:
        one.run(1)
        other.run(1)
        share = rise(one.avatars.motion["phase"][slot] / length) - rise(begun / length)
        moved = np.subtract(*(fields(each.avatars, "x z", slot) for each in (one, other)))
        np.testing.assert_allclose(moved, share * np.array([0.3, -0.1]), atol=1e-6)
    assert share > 0.5


def test_a_body_that_slides_is_seen_where_it_will_lie() -> None:
    policy = falling_policy()
    one = Simulation(replace(fighters(12, spacing=0.5), policies=[policy]), model=build_model([policy]))
    avatars, number = one.avatars, one.avatars.number
    place, slid = {}, 0.0
    for _ in range(400):
        one.run(1)
        standing = avatars.conditions["standing"][number]
        down = np.flatnonzero((standing == layout.FALLING) | (standing == layout.LYING))
        before, place = place, {int(slot): floor_transform(one.model, avatars, slot)[:2] for slot in down}
        for slot in place.keys() & before.keys():
            assert place[slot] == pytest.approx(before[slot], abs=2e-3)
            slid = max(slid, np.linalg.norm(fields(avatars, "slide_x slide_z", slot)))
    assert slid > 0.1


def test_who_left_while_it_slid_does_not_slide_when_it_enters_again() -> None:
    crowd, model = fighters(3), with_falls()
    avatars = Simulation(replace(crowd, policies=POLICIES), model=model).avatars
    set_fields(avatars, "slide_x slide_z", slice(None), 0.3)
    enter(avatars, crowd, model, np.array([1]))
    assert fields(avatars, "slide_x slide_z", 1).tolist() == [0.0, 0.0]
    assert (avatars.slides["x"][[0, 2]] == 0.3).all()
