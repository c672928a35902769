"""Avatars at ease walk off where nobody is left to fight and the way is free, once, and stand at ease again."""

import math
from dataclasses import replace

import numpy as np
import pytest
from avatar_fields import fields
from naive_walking import clear_of, distance, lines_of, naive_is_free, way_of
from resting import resting_policy

from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.walking import CLEAR, NEARER, is_free
from crowdsim.crowd.model import build_model, entry_actions
from crowdsim.crowd.script import Change
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.triggers import AtFrame

SECONDS = 15
RULES = np.array([[60.0, 6.0, 0.5, 0.1, 5.0, 9.0, 12.0, 3.0, 0.0, 0.0, 0.0, 0.0]])


def friends(x, z, **other):
    """Avatars of one team, which have nobody to fight."""
    fields = {"conditioned": True, "rules": 0.0 * RULES, "seed": 5, "team": 0, **other}
    return build_crowd(x, z, 1.3 * np.arange(len(x)), **fields)


def row(count, spacing, **other):
    return friends(spacing * np.arange(count), np.zeros(count), **other)


def walks():
    return resting_policy().rests.walks


def beginnings(action):
    """Frames and avatars in which walks begin."""
    first = np.isin(action, walks().take)
    first[1:] &= action[1:] != action[:-1]
    return np.argwhere(first)


def test_an_avatar_without_opponents_comes_to_rest_walks_off_once_and_stands_at_ease():
    one = Simulation(replace(row(1, 1.0), policies=[resting_policy()]))
    chunk = one.run(60 * SECONDS)
    ((frame, _),) = beginnings(chunk.action)
    assert np.isin(chunk.action[frame - 1, 0], resting_policy().rests.hold)
    assert np.isin(chunk.action[-1, 0], resting_policy().rests.hold)
    far = math.hypot(chunk.x[-1, 0] - chunk.x[frame, 0], chunk.z[-1, 0] - chunk.z[frame, 0])
    assert 2.5 < far < 6.0
    steps = np.hypot(np.diff(chunk.x[:, 0]), np.diff(chunk.z[:, 0]))
    assert steps.max() * one.rate < 2.5
    assert steps[frame + 8 * SECONDS :].max() * one.rate < 0.2


def test_a_walk_is_taken_part_by_part_to_where_others_see_it_halt():
    one = Simulation(replace(row(1, 1.0), policies=[resting_policy()]))
    rests, taken = resting_policy().rests, []
    while not (taken and np.isin(taken[-1], rests.hold)):
        action = int(one.run(1).action[0, 0])
        if np.isin(action, walks().take) and not taken:
            number = int(np.flatnonzero(walks().take == action)[0])
            halt = fields(one.avatars, "halt_x halt_z", 0)
        if taken or np.isin(action, walks().take):
            taken += [action] if taken[-1:] != [action] else []
            np.testing.assert_allclose(fields(one.avatars, "halt_x halt_z", 0), halt, atol=0.02)
    parts, at = [int(walks().take[number])], int(walks().row[number])
    while at >= len(rests.hold):
        at = int(walks().next[at - len(rests.hold)])
        parts.append(int(rests.hold[at] if at < len(rests.hold) else walks().hold[at - len(rests.hold)]))
    assert len(parts) > 3
    assert taken == parts
    np.testing.assert_allclose(fields(one.avatars, "end_x end_z", 0), halt, atol=0.02)


def test_those_that_are_told_to_rest_do_not_walk_off():
    told = Change(AtFrame(0), who=np.ones(2, bool), mode=layout.RESTS, distance=2.0)
    fighters = build_crowd([0.0, 3.0], [0.0, 0.0], conditioned=True, rules=0.0 * RULES, seed=4)
    chunk = Simulation(replace(fighters, policies=[resting_policy()], changes=(told,))).run(60 * SECONDS)
    assert np.isin(chunk.action[-1], resting_policy().rests.hold).all()
    assert not len(beginnings(chunk.action))
    alone = Simulation(
        replace(
            row(1, 1.0),
            policies=[resting_policy()],
            changes=(Change(AtFrame(0), who=np.ones(1, bool), mode=layout.RESTS, distance=2.0),),
        )
    )
    assert not len(beginnings(alone.run(60 * SECONDS).action))


@pytest.mark.parametrize(("rises", "goes"), [(1e6, False), (math.inf, True)])
def test_nobody_walks_off_while_an_opponent_may_get_up_again(rises, goes):
    fighters = build_crowd([0.0, 6.0], [0.0, 0.0], conditioned=True, rules=0.0 * RULES, seed=3)
    one = Simulation(replace(fighters, policies=[resting_policy()]))
    down = one.avatars.conditions[1]
    down["standing"], down["rises"], down["fall"] = layout.LYING, math.inf, 0.0
    one.avatars.team[one.avatars.slot_of[1]] = -2
    while not one.avatars.conditions["piece"][0]:
        one.run(1)
    down["rises"] = rises
    assert (len(beginnings(one.run(40 * SECONDS).action)) > 0) == goes


def test_nobody_leaves_the_arena_or_walks_into_others_that_stand():
    arena = np.array([layout.CIRCLE, 0.0, 0.0, 2.0, 2.0])
    chunk = Simulation(replace(row(1, 1.0, arena=arena), policies=[resting_policy()])).run(60 * SECONDS)
    assert np.isin(chunk.action[-1], resting_policy().rests.hold).all()
    assert not len(beginnings(chunk.action))
    around = 2.0 * np.pi * np.arange(12) / 12
    x, z = np.concatenate([[0.0], 1.6 * np.cos(around)]), np.concatenate([[0.0], 1.6 * np.sin(around)])
    chunk = Simulation(replace(friends(x, z), policies=[resting_policy()])).run(10 * SECONDS)
    assert not len(beginnings(chunk.action[:, :1]))


def test_walks_keep_clear_of_those_that_stand_walk_and_lie():
    x, z = np.meshgrid(2.2 * np.arange(5), 2.2 * np.arange(5))
    one = Simulation(replace(friends(x.ravel(), z.ravel()), policies=[resting_policy()]))
    for number in (3, 11, 17):
        down = one.avatars.conditions[number]
        down["standing"], down["rises"], down["fall"] = layout.LYING, math.inf, 0.0
        one.avatars.team[one.avatars.slot_of[number]] = -2
    went, last = 0, np.full(25, -1)
    for _ in range(40 * SECONDS):
        before = fields(one.avatars, "x z heading scale")
        (actions,) = one.run(1).action
        for number in np.flatnonzero(np.isin(actions, walks().take) & (actions != last)):
            own = one.avatars.slot_of[number]
            (walk,) = np.flatnonzero(one.model.walks["action"] == actions[number])
            others = [lines_of(one, slot) for slot in range(one.present) if slot != own]
            way, start = way_of(one, own, walk, before[:, own]), before[:2, own]
            for lines in others:
                clear = CLEAR if len(lines) > 1 else clear_of(lines[0], start)
                assert min(distance(p, *line) for p in way for line in lines) > clear - 0.1
            went += 1
        last = actions
        apart = np.hypot(one.avatars.x - one.avatars.x[:, None], one.avatars.z - one.avatars.z[:, None])
        assert apart[~np.eye(25, dtype=bool)].min() > 0.5
    assert went > 5


def test_walks_lead_away_from_a_body_at_an_avatars_feet():
    one = Simulation(replace(friends([0.0, 3.0], [0.0, 0.0]), policies=[resting_policy()]))
    down = one.avatars.conditions[1]
    down["standing"], down["rises"], down["fall"] = layout.LYING, math.inf, 0.0
    own, other = one.avatars.slot_of
    one.avatars.team[other] = -2
    (body,) = lines_of(one, other)
    free = 0
    for angle in np.linspace(0.0, 2.0 * math.pi, 24):
        one.avatars.x[own] = 0.5 * (body[0][0] + body[1][0]) + 0.2 * math.cos(angle)
        one.avatars.z[own] = 0.5 * (body[0][1] + body[1][1]) + 0.2 * math.sin(angle)
        start = distance(fields(one.avatars, "x z", own), *body)
        for walk in range(len(one.model.walks)):
            if is_free(one.model, one.avatars, one._world, one._now, own, walk):
                free += 1
                assert min(distance(point, *body) for point in way_of(one, own, walk)) >= start - NEARER - 1e-9
    assert free > 10


@pytest.mark.parametrize("arena", [np.zeros(5), np.array([layout.CIRCLE, 2.0, 2.0, 6.0, 6.0])])
def test_free_ways_match_naive(arena):
    rng = np.random.default_rng(3)
    scale = rng.uniform(0.9, 1.1, 9)
    one = Simulation(
        replace(
            friends(6.0 * rng.random(9), 6.0 * rng.random(9), arena=arena, scale=scale), policies=[resting_policy()]
        )
    )
    lying = one.avatars.conditions[4]
    lying["standing"], lying["rises"], lying["fall"] = layout.LYING, math.inf, 0.0
    one.avatars.team[one.avatars.slot_of[4]] = -2
    found = []
    for turn in range(30):
        one.run(13)
        # As if all avatars came to the end of their actions in this frame.
        phases = one.avatars.motion["phase"].copy()
        one.avatars.motion["phase"][:] = one.model.actions["length"][one.avatars.motion["action"]]
        for own in range(9):
            for walk in range(turn % 25, len(one.model.walks), 25):
                free = bool(is_free(one.model, one.avatars, one._world, one._now, own, walk))
                assert free == naive_is_free(one, own, walk)
                found.append(free)
        one.avatars.motion["phase"][:] = phases
    assert 0.05 < np.mean(found) < 0.95


def test_a_crowd_does_not_leave_in_step():
    count = 6
    chunk = Simulation(replace(row(count, 12.0), policies=[resting_policy()])).run(30 * SECONDS)
    begun = beginnings(chunk.action)
    assert len({avatar for _, avatar in begun}) == count
    assert len({frame for frame, _ in begun}) > count // 2


def test_an_opponent_that_enters_is_fought_when_the_walk_has_ended():
    crowd = build_crowd(
        [0.0, 9.0], [0.0, 0.0], conditioned=True, rules=0.0 * RULES, seed=4, present=np.array([True, False])
    )
    comes = Change(AtFrame(300), who=np.array([False, True]), present=True)
    one = Simulation(replace(crowd, policies=[resting_policy()], changes=(comes,)))
    action = one.run(60 * SECONDS).action[:, 0]
    begun = beginnings(action[:, None])
    walking = np.isin(action, np.concatenate([walks().take, walks().hold]))
    assert (len(begun) == 1) == walking.any()
    assert np.isin(action, resting_policy().rests.leave).any()
    assert action[-1] < resting_policy().graph.choice_count


def bytes_of(chunk):
    return [np.asarray(values).tobytes() for values in (chunk.action, chunk.x, chunk.z, chunk.heading)]


def test_walks_have_the_same_bytes_for_any_threads_and_after_a_resume():
    crowd = row(14, 2.5)
    small = Simulation(replace(crowd, policies=[resting_policy()])).run(300)
    assert len(beginnings(small.action)) > 3
    for threads in (1, 2):
        order = np.random.default_rng(threads).permutation(14)
        staged = Simulation(replace(crowd, policies=[resting_policy()]), threads=threads, search="kd_tree", order=order)
        assert bytes_of(staged.run(300)) == bytes_of(small)
        staged.close()
    middle = int(beginnings(small.action)[1, 0]) + 20
    first = Simulation(replace(crowd, policies=[resting_policy()]))
    first.run(middle)
    again = Simulation(replace(crowd, policies=[resting_policy()]))
    again.restore(first.state())
    assert bytes_of(first.run(100)) == bytes_of(again.run(100))


def test_no_avatar_enters_a_run_by_a_walk():
    model = build_model([resting_policy()] * 2)
    entries = entry_actions(model)
    assert len(model.walks) == 2 * len(walks().take) + np.count_nonzero(model.ways_to_rest["walk"] >= 0)
    assert not np.isin(entries, model.walks["action"]).any()
