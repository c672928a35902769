"""Of falls that lead the same way, avatars fall by the one that begins most like what they do."""

from dataclasses import replace

import numpy as np
from avatar_fields import set_fields
from falling import falling_policy
from test_damage import fighters, rules

from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.falling import (
    ASIDE,
    BESIDE,
    FURTHEST_ASIDE,
    GRAIN,
    LASTS,
    LATELY,
    LIKE,
    NEARBY,
    OFF,
    SHOWN,
    UNLIKE,
    _unlike,
    pick_fall,
    shown_anywhere,
    shown_before,
)
from crowdsim.crowd.kernels.kd_tree import everyone
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


def last_frame(one: Simulation, own: int) -> int:
    """The playback frame in which an avatar's action ends."""
    action = one.avatars.motion["action"][own]
    return int(
        one.model.actions["origin"][action] + one.model.actions["length"][action] * falling_policy().database.stride
    )


def naive_gap(one: Simulation, own: int, row: int, left: int) -> float:
    """How unlike a playback frame of an avatar and the start of a fall are, from points in the world [m2]."""
    database, model = falling_policy().database, one.model
    points = np.concatenate([model.bodies, model.arms], axis=1).astype(float)
    entered, stride = model.falls["action"][row], database.stride
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
    chosen, world = set(), one._world._replace(arena=one._world.arena._replace(kind=0.0))
    for own in range(one.present):
        for kind in (layout.FALLS, layout.STUMBLES):
            blow = float(rng.uniform(-np.pi, np.pi))
            heading = one.avatars.heading[own]
            set_fields(one.avatars, "hit_x hit_z", own, (np.sin(blow + heading), np.cos(blow + heading)))
            rows = np.flatnonzero(falls["kind"] == kind)
            aside = np.abs(ground.wrap(turns[rows] - blow))
            further = np.maximum(aside - aside.min() - LIKE, 0.0)
            left = last_frame(one, own) - int(rng.integers(0, 6))
            gaps = np.array([_unlike(one.model, one.avatars, own, row, left) for row in rows])
            moves, push = one.model.moves[falls["action"][rows]], float(rng.uniform(0.2, 0.9))
            costs = ASIDE * further + UNLIKE * gaps
            if kind == layout.STUMBLES:
                costs += OFF * np.abs(one.avatars.playback["scale"][own] * np.hypot(moves["x"], moves["z"]) - push)
            costs[further > (0.0 if kind == layout.STUMBLES else FURTHEST_ASIDE - LIKE)] = np.inf
            shown = np.zeros(0)
            found = pick_fall(one.model, one.avatars, world, 0, own, kind, push, left, shown, NO_NEIGHBOURS, 0)
            assert found == rows[int(np.argmin(costs))]
            chosen.add(found)
    assert len(chosen) > 6


def test_how_unlike_poses_are_matches_naive() -> None:
    one = fighting()
    rows = np.flatnonzero(np.isin(one.model.falls["kind"], (layout.FALLS, layout.STUMBLES)))
    for own in range(one.present):
        for row in rows:
            for left in (last_frame(one, own), last_frame(one, own) - 3):
                gap = naive_gap(one, own, row, left)
                np.testing.assert_allclose(_unlike(one.model, one.avatars, own, row, left), gap, rtol=1e-6)


def test_falls_that_were_shown_cost_more_the_nearer_and_the_later_they_were() -> None:
    one, frame = fighting(), 500
    avatars, falls = one.avatars, one.model.falls
    rng = np.random.default_rng(3)
    rows = np.flatnonzero(falls["kind"] == layout.FALLS)
    for number in range(0, one.present, 2):
        avatars.conditions["fell"][number] = rng.choice(rows) + 1
        avatars.conditions["fell_frame"][number] = rng.integers(0, frame)
    avatars.x[avatars.slot_of[4]] += 30.0
    anywhere, stack = np.full(len(falls), np.inf), np.empty(64, np.int64)
    shown_anywhere(one.model, avatars, frame, anywhere)
    for own in range(one.present):
        expected = np.zeros(len(falls))
        for number, row in enumerate(avatars.conditions):
            if row["fell"] > 0:
                slot = avatars.slot_of[number]
                far = np.hypot(avatars.x[slot] - avatars.x[own], avatars.z[slot] - avatars.z[own])
                of_late = LATELY / (LATELY + frame - row["fell_frame"])
                twin = falls["twin"][int(row["fell"]) - 1]
                expected[twin] += (SHOWN + (BESIDE if far < NEARBY else 0.0)) * of_late
        found = np.full(len(falls), np.inf)
        shown_before(one.model, avatars, frame, own, everyone(avatars, one.present), anywhere, stack, found)
        np.testing.assert_allclose(found, expected, rtol=0, atol=one.present / GRAIN)
        assert found.sum() > 0.0


def test_a_fall_that_has_just_been_shown_is_not_shown_again_if_another_leads_the_same_way() -> None:
    one, falls = fighting(), fighting().model.falls
    rows = np.flatnonzero(falls["kind"] == layout.FALLS)
    for own in range(one.present):
        left, shown = last_frame(one, own), np.zeros(len(falls))
        first = pick_fall(one.model, one.avatars, one._world, 0, own, layout.FALLS, 0.0, left, shown, NO_NEIGHBOURS, 0)
        shown[falls["twin"][first]] = 1e6
        second = pick_fall(one.model, one.avatars, one._world, 0, own, layout.FALLS, 0.0, left, shown, NO_NEIGHBOURS, 0)
        assert second in rows
        assert falls["twin"][second] != falls["twin"][first]


def test_mirror_images_of_a_fall_are_twins() -> None:
    model, policy = build_model([falling_policy()]), falling_policy()
    falls = model.falls[model.falls["kind"] == layout.FALLS]
    names = [policy.database.clip_names[int(np.searchsorted(policy.database.clip_starts, frame, "right")) - 1]
             for frame in policy.graph.action_first[falls["action"]]]  # fmt: skip
    for one, name in zip(falls, names, strict=True):
        for other, its in zip(falls, names, strict=True):
            assert (one["twin"] == other["twin"]) == (name.split("~")[0] == its.split("~")[0])
