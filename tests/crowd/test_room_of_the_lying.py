"""Bodies that are down are left room: by soles, by those who stagger, and by those who fall beside them."""

from dataclasses import replace

import numpy as np
import pytest
from falling import falling_policy
from test_damage import POLICIES, falling, fighters, with_falls
from test_lying import placed_beside

from crowdsim.crowd.crowd import enter
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.fall_clearance import SLIDES, crowded, slide
from crowdsim.crowd.kernels.falling import _unfit
from crowdsim.crowd.kernels.layout import Observed
from crowdsim.crowd.kernels.lying import axis_of, floor_transform
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


@pytest.mark.parametrize("seed", range(4))
def test_what_it_costs_to_tread_on_a_body_matches_naive(seed: int) -> None:
    rng, model = np.random.default_rng(seed), with_falls()
    capsules = rng.uniform(-0.5, 0.5, (len(model.falls), 2, 8))
    capsules[..., 6:] = 0.1, 1.0  # radius, and a sphere around it that holds any of these
    model = model._replace(fall_capsules=capsules)
    avatars = Simulation(replace(fighters(3, seed=seed), policies=POLICIES), model=model).avatars
    own, size = 1, avatars.real[layout.SCALE, 1]
    near, work = np.zeros((1, 10)), np.zeros((7, 64))
    near[0] = [
        *rng.uniform(-0.5, 0.5, 2),
        *rng.uniform(-1.0, 1.0, 2),
        0.75,
        collision_avoidance.ON_FLOOR,
        3.0,
        1.0,
        2.0,
        2.0,
    ]
    axis = np.array([near[0, :2], near[0, :2] + near[0, 2:4]])
    collision_avoidance._find_ends(model, avatars, own, work)
    before = rng.uniform(0.0, 2.0, 64)
    work[3] = before
    collision_avoidance._add_lying(model, avatars, own, near, 0, work)
    state, heading = model.actions[avatars.whole[layout.ACTION, own], layout.NEXT], avatars.real[layout.HEADING, own]
    actions = range(model.offsets[state], model.offsets[state + 1])
    costs = []
    for k, action in enumerate(actions):
        move = model.moves[action]
        end = turned(*(move[:2] * size), heading)
        cost = max(naive_cost(end, axis, 3.0), naive_cost(0.5 * end, axis, 1.0))
        cost += 2.0 * treads_on(model, avatars, own, action, 2)
        costs.append(max(cost, before[k]))
    np.testing.assert_allclose(work[3, : len(costs)], costs, atol=5e-3)
    assert (np.array(costs) > before[: len(costs)]).any()


@pytest.mark.parametrize("direction", [0.0, np.pi])
def test_nobody_staggers_onto_a_body(direction: float) -> None:
    model = with_falls()
    moves = model.moves.copy()
    moves[ACTION, [layout.MOVE_X, layout.MOVE_Z]] = 0.0, 0.7
    rows, directions = [*model.falls, (0, layout.STUMBLES, ACTION, 0)], [*model.fall_directions, 0.0]
    model = falling(model._replace(moves=moves), rows, directions)
    one, own = placed_beside(model, direction)
    row = len(model.falls) - 1
    unfit = _unfit(model, one.avatars, own, row, 0.0, 0.0, seen(int(one.avatars.slot_of[1])), 0)
    assert np.isinf(unfit) == (direction == 0.0)
    assert _unfit(model, one.avatars, own, row, 0.0, 0.0, seen(), 0) == 0.0


@pytest.mark.parametrize("direction", np.linspace(0.0, 6.0, 7))
def test_a_body_slides_away_from_one_that_lies_where_it_falls(direction: float) -> None:
    model = with_falls()
    one, own = placed_beside(model, direction)
    real, other = one.avatars.real, int(one.avatars.slot_of[1])
    slide(model, one.avatars, own, 0, seen(), 0)
    assert not real[[layout.SLIDE_X, layout.SLIDE_Z], own].any()
    axis = axis_of(model, one.avatars, other)
    away = np.array([real[layout.X, own] - axis.x, real[layout.Z, own] - axis.z])
    real[[layout.END_X, layout.END_Z], other] += (1.0 - 0.5 / np.linalg.norm(away)) * away
    slide(model, one.avatars, own, 0, seen(other), 0)
    moved = real[[layout.SLIDE_X, layout.SLIDE_Z], own]
    assert np.linalg.norm(moved) == pytest.approx(SLIDES)
    assert moved @ away > 0.9 * SLIDES * np.linalg.norm(away)
    room = [crowded(model, one.avatars, own, 0, *way, seen(other), 0) for way in ((0.0, 0.0), moved)]
    assert room[1] < room[0]


def test_a_body_slides_smoothly_over_the_action_in_which_it_falls() -> None:
    one, other = (Simulation(replace(fighters(4), policies=POLICIES), model=with_falls()) for _ in range(2))
    for simulation in (one, other):
        simulation.run(1)
    slot, action = 2, int(one.avatars.whole[layout.ACTION, 2])
    one.avatars.real[[layout.SLIDE_X, layout.SLIDE_Z], slot] = 0.3, -0.1
    rise = np.polynomial.Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    begun, length = one.avatars.real[layout.PHASE, slot], one.model.actions[action, layout.LENGTH]
    while one.avatars.real[layout.PHASE, slot] + one.avatars.real[layout.SPEED, slot] < length:
        one.run(1)
        other.run(1)
        share = rise(one.avatars.real[layout.PHASE, slot] / length) - rise(begun / length)
        moved = np.subtract(*(each.avatars.real[[layout.X, layout.Z], slot] for each in (one, other)))
        np.testing.assert_allclose(moved, share * np.array([0.3, -0.1]), atol=1e-12)
    assert share > 0.5


def test_a_body_that_slides_is_seen_where_it_will_lie() -> None:
    policy = falling_policy()
    one = Simulation(replace(fighters(12, spacing=0.5), policies=[policy]), model=build_model([policy]))
    avatars, number = one.avatars, one.avatars.number
    place, slid = {}, 0.0
    for _ in range(400):
        one.run(1)
        standing = avatars.conditions[number, layout.STANDING]
        down = np.flatnonzero((standing == layout.FALLING) | (standing == layout.LYING))
        before, place = place, {int(slot): floor_transform(one.model, avatars, slot)[:2] for slot in down}
        for slot in place.keys() & before.keys():
            assert place[slot] == pytest.approx(before[slot], abs=2e-3)
            slid = max(slid, np.linalg.norm(avatars.real[[layout.SLIDE_X, layout.SLIDE_Z], slot]))
    assert slid > 0.1


def test_who_left_while_it_slid_does_not_slide_when_it_enters_again() -> None:
    crowd, model = fighters(3), with_falls()
    avatars = Simulation(replace(crowd, policies=POLICIES), model=model).avatars
    avatars.real[[layout.SLIDE_X, layout.SLIDE_Z]] = 0.3
    enter(avatars, crowd, model, np.array([1]))
    assert avatars.real[[layout.SLIDE_X, layout.SLIDE_Z], 1].tolist() == [0.0, 0.0]
    assert (avatars.real[layout.SLIDE_X, [0, 2]] == 0.3).all()
