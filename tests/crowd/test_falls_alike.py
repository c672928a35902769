"""Of falls that lead the same way, avatars fall by the one that begins most like what they do."""

from dataclasses import replace

import numpy as np
from avatar_fields import set_fields
from falling import falling_policy
from test_damage import fighters, rules

from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.falling import LASTS, LIKE, _unlike, pick_fall
from crowdsim.crowd.kernels.layout import Observed
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation
from crowdsim.motion import ground

NO_NEIGHBOURS = Observed(np.array([0], np.int32), np.array([0], np.int32), np.zeros((1, 1), np.int32))


def fighting(frames: int = 20) -> Simulation:
    """A dozen boxers in the middle of a fight, who may be knocked down."""
    policy = falling_policy()
    one = Simulation(replace(fighters(rules=rules()), policies=[policy]), model=build_model([policy]))
    one.run(frames)
    return one


def naive_gap(one: Simulation, own: int, row: int) -> float:
    """How unlike the end of an avatar's action and the start of a fall are, from points in the world [m2]."""
    database, model = falling_policy().database, one.model
    points = np.concatenate([model.bodies, model.arms], axis=1).astype(float)
    action, entered = one.avatars.motion["action"][own], model.falls["action"][row]
    stride = database.stride
    left = model.actions["origin"][action] + model.actions["length"][action] * stride
    begun = model.actions["origin"][entered]

    def moved(before: int, after: int) -> np.ndarray:
        way = ground.to_local(
            database.ground[before], np.array([database.ground[after, 0], 0.0, database.ground[after, 1]])
        )
        return points[after] - points[before] + way * [1.0, 0.0, 1.0]

    apart = points[left] - points[begun]
    speeds = moved(left - stride, left) - moved(begun, begun + stride)
    return float(np.sum(apart**2) + LASTS**2 * np.sum(speeds**2))


def test_avatars_fall_by_the_fall_that_begins_most_like_what_they_do() -> None:
    one, rng = fighting(), np.random.default_rng(1)
    falls, turns = one.model.falls, one.model.falls["direction"]
    chosen = set()
    for own in range(one.present):
        for kind in (layout.FALLS, layout.STUMBLES):
            blow = float(rng.uniform(-np.pi, np.pi))
            heading = one.avatars.heading[own]
            set_fields(one.avatars, "hit_x hit_z", own, (np.sin(blow + heading), np.cos(blow + heading)))
            rows = np.flatnonzero(falls["kind"] == kind)
            aside = np.abs(ground.wrap(turns[rows] - blow))
            rows = rows[aside - aside.min() <= LIKE + 1e-9]
            gaps = [_unlike(one.model, one.avatars, own, row) for row in rows]
            found = pick_fall(one.model, one.avatars, one._world, 0, own, kind, NO_NEIGHBOURS, 0)
            assert found == rows[int(np.argmin(gaps))]
            chosen.add(found)
    assert len(chosen) > 6


def test_how_unlike_poses_are_matches_naive() -> None:
    one = fighting()
    rows = np.flatnonzero(np.isin(one.model.falls["kind"], (layout.FALLS, layout.STUMBLES)))
    for own in range(one.present):
        for row in rows:
            np.testing.assert_allclose(_unlike(one.model, one.avatars, own, row), naive_gap(one, own, row), rtol=1e-6)
