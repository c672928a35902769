"""An avatar that has knocked another down faces it, guard up, and steps back."""

import math
from dataclasses import replace

import numpy as np
import pytest
from falling import falling_policy
from test_damage import column, fighters, rules

from crowdsim.crowd.arrays import Arena
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.layout import Now, Target
from crowdsim.crowd.kernels.noticing import CORNER, FACES, FIGHTING, RETREAT, STAYS, noticed, see_fallen
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation
from crowdsim.motion import ground

FELLED = 100


def felling() -> Simulation:
    """A crowd in which avatar 0 has knocked down avatar 1."""
    policy = falling_policy()
    one = Simulation(replace(fighters(), policies=[policy]), model=build_model([policy]))
    one.run(3)
    conditions = one.avatars.conditions
    conditions["felled"][0], conditions["felled_frame"][0] = 2.0, FELLED
    conditions["standing"][1] = layout.LYING
    one.avatars.fight["hit_frame"][one.avatars.slot_of[0]] = FELLED - 5
    return one


def asked(one: Simulation, frame: int, opponent: int) -> int:
    return int(noticed(one.avatars, Now(frame, 0, one.present), int(one.avatars.slot_of[0]), opponent))


def test_an_avatar_faces_whom_it_has_knocked_down_for_a_while_and_longer_without_another_opponent() -> None:
    one = felling()
    assert asked(one, FELLED + 5, 3) == asked(one, FELLED + 5, -1) == 1
    assert asked(one, FELLED + int(FACES) + 1, 3) == -1
    assert asked(one, FELLED + 200, -1) == 1
    one.avatars.conditions["standing"][1] = layout.RISING
    assert asked(one, FELLED + 5, -1) == -1


def test_a_hit_ends_noticing_and_so_does_an_order_to_do_something_else() -> None:
    one = felling()
    one.avatars.fight["hit_frame"][one.avatars.slot_of[0]] = FELLED + 2
    assert asked(one, FELLED + 5, 3) == -1
    other = felling()
    other.avatars.conditions["mode"][0] = layout.FLEES
    assert asked(other, FELLED + 5, 3) == -1


def seen(one: Simulation, since: int, arena: Arena, away: tuple[float, float]) -> tuple[float, float]:
    """Where the avatar sees the fallen one that is ``away`` [m], from itself."""
    own = int(one.avatars.slot_of[0])
    x, z = float(one.avatars.x[own]), float(one.avatars.z[own])
    target = Target(x + away[0], 0.2, z + away[1], 0.0, 0.0, math.inf)
    world = one._world._replace(arena=arena)
    found = see_fallen(one.avatars, world, Now(FELLED + since, 0, one.present), own, target)
    assert one.avatars.conditions["does_next"][0] == layout.NOTICES
    return found.x - x, found.z - z


def test_it_stays_and_then_steps_back_as_far_as_it_keeps() -> None:
    one, nowhere = felling(), Arena(0.0, 0.0, 0.0, 0.0, 0.0)
    assert seen(one, int(STAYS), nowhere, (0.0, 1.2)) == pytest.approx((0.0, FIGHTING))
    assert seen(one, int(STAYS) + 1, nowhere, (0.0, 1.2)) == pytest.approx((0.0, RETREAT))
    assert seen(one, int(STAYS) + 1, nowhere, (3.0, 0.0)) == pytest.approx((FIGHTING, 0.0))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_without_another_opponent_it_goes_to_the_corner_that_is_furthest_from_the_fallen(side: float) -> None:
    one = felling()
    own = int(one.avatars.slot_of[0])
    x, z = float(one.avatars.x[own]), float(one.avatars.z[own])
    ring = Arena(layout.RECTANGLE, x, z, 3.0, 3.0)
    dx, dz = seen(one, int(FACES) + 1, ring, (side, 0.5))
    assert math.hypot(dx, dz) == pytest.approx(RETREAT)
    corner = np.array([-side, -1.0]) * (3.0 - CORNER)
    # It steps back from where it sees the fallen: towards the corner.
    assert np.array([-dx, -dz]) @ corner > 0.8 * RETREAT * np.linalg.norm(corner)
    there = Arena(layout.RECTANGLE, x + side * (3.0 - CORNER), z + 3.0 - CORNER, 3.0, 3.0)
    way = np.array([3.0 * side, 4.0])
    assert seen(one, int(FACES) + 1, there, tuple(way)) == pytest.approx(tuple(FIGHTING * way / 5.0))


def test_attackers_turn_to_whom_they_have_knocked_down() -> None:
    policy = falling_policy()
    given = rules()
    given[:, column("down_from")] = 4.0
    one = Simulation(replace(fighters(rules=given), policies=[policy]), model=build_model([policy]))
    off = []
    for _ in range(300):
        one.run(1)
        avatars = one.avatars
        rows = avatars.conditions
        for number in np.flatnonzero(rows["does"] == layout.NOTICES):
            own, fallen = avatars.slot_of[number], avatars.slot_of[int(rows["felled"][number]) - 1]
            if rows["standing"][number] != layout.UP:
                continue
            assert avatars.opponent[own] == rows["felled"][number] - 1 or rows["does_next"][number] != layout.NOTICES
            way = np.arctan2(avatars.x[fallen] - avatars.x[own], avatars.z[fallen] - avatars.z[own])
            off.append(abs(float(ground.wrap(way - avatars.heading[own]))))
    assert len(off) > 100
    assert np.mean(np.array(off) < 1.0) > 0.7
