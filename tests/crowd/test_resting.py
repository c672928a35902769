"""Avatars stand at ease when they are told to, and where nobody is left to fight."""

import math
from dataclasses import replace

import numpy as np
import pytest
from resting import resting_policy, restless_policy

from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.intents import FIGHTING, PATIENT, RAISES, STEPS_BACK, TOO_NEAR, see_by_intent
from crowdsim.crowd.kernels.kd_tree import everyone
from crowdsim.crowd.kernels.knock_downs import empty_room, knock_down
from crowdsim.crowd.kernels.records import STRIKE
from crowdsim.crowd.kernels.resting import (
    ALIKE,
    BEYOND,
    FACING,
    LACKING,
    LASTING,
    NO_WAY,
    SHORT,
    TURNED,
    nearest_rest,
    own_share,
)
from crowdsim.crowd.kernels.walking import WALLS, is_free
from crowdsim.crowd.model import build_model, entry_actions
from crowdsim.crowd.resting import actions_until, leads_away, rest_rows
from crowdsim.crowd.script import Change
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.triggers import AtFrame

RULES = np.array([[60.0, 6.0, 0.5, 0.1, 5.0, 9.0, 12.0, 3.0, 0.0, 0.0, 0.0, 0.0]])
ENTER, HOLD, LEAVE = 1, 2, 3


def people(count=2, **other):
    number = np.arange(count)
    fields = {"conditioned": True, "rules": 0.0 * RULES, "seed": 4, "spacing": 0.8, **other}
    spacing = fields.pop("spacing")
    heading = np.where(number % 2 == 0, np.pi / 2, -np.pi / 2)
    return build_crowd(spacing * (number % 6), 1.5 * (number // 6), heading, **fields)


def modes(count, *given, distance=2.0):
    """A script in which all avatars get modes at frames."""
    who = np.ones(count, bool)
    return dict(changes=tuple(Change(AtFrame(f), who=who, mode=mode, distance=distance) for f, mode in given))


def kinds(action):
    """What of a rest actions are: 0 nothing."""
    rests = resting_policy().rests
    found = np.zeros(np.shape(action), int)
    for kind, actions in ((ENTER, rests.enter), (HOLD, rests.hold), (LEAVE, rests.leave)):
        found[np.isin(action, actions)] = kind
    return found


@pytest.mark.parametrize("count", [1, 2])
def test_rows_of_rests_are_those_of_each_policy(count):
    policies, rests = [resting_policy(), restless_policy()][:count] * 2, resting_policy().rests
    model = build_model(policies)
    assert model.ways_to_rest.shape == (len(model.offsets) - 1,)
    assert len(model.rests) == 2 * (len(rests.hold) + len(rests.walks.hold))
    for number, policy in enumerate(policies):
        first, state = model.policies["actions"][number], model.policies["states"][number]
        own = model.ways_to_rest[state : model.policies["states"][number + 1]]
        if policy.rests is None:
            assert (own["enter"] == -1).all()
            assert (own["until"] == NO_WAY).all()
            continue
        np.testing.assert_array_equal(own["enter"][rests.state], first + rests.enter)
        for entry, row, *_ in own[rests.state].tolist():
            assert entry - first in rests.enter
            assert model.rests["hold"][row] - first in rests.hold
            assert model.rests["leave"][row] - first in rests.leave
            assert model.rests["hold"][model.rests["follows"][row]] - first in rests.hold
    entries = entry_actions(model)
    apart = np.concatenate([model.rests["hold"], model.rests["leave"], model.ways_to_rest["enter"]])
    assert not np.isin(entries[entries >= 0], apart).any()


def test_policies_without_rests_have_no_rows():
    rows, ways = rest_rows([restless_policy()], {"state": np.zeros(2), "action": np.zeros(2)})
    assert rows.shape == (0, 5)
    assert ways.shape == (0, 4)


def test_actions_until_a_rest_match_a_search_state_by_state():
    policy = resting_policy()
    on_the_spot = policy.rests.state[~leads_away(policy.actions, policy.rests)]
    found = actions_until(policy.actions, on_the_spot)
    for state in range(0, policy.graph.state_count, 7):
        reached, far = {state}, 0
        while not reached & set(on_the_spot.tolist()):
            actions = np.concatenate([np.arange(*policy.actions.offsets[[s, s + 1]]) for s in sorted(reached)])
            reached, far = reached | set(policy.actions.next[actions].tolist()), far + 1
        assert found[state] == far


def test_avatars_go_to_their_distance_stand_at_ease_and_fight_again():
    one = Simulation(
        replace(people(), policies=[resting_policy()], **modes(2, (60, layout.RESTS), (360, layout.FIGHTS)))
    )
    chunk = one.run(480)
    found = kinds(chunk.action)
    assert not found[:60].any()
    apart = np.hypot(chunk.x[:, 0] - chunk.x[:, 1], chunk.z[:, 0] - chunk.z[:, 1])
    for avatar in range(2):
        entered = int(np.flatnonzero(found[:, avatar] == ENTER)[0])
        assert entered < 60 + 12 * 15
        assert apart[entered] > TOO_NEAR * 2.0
        assert (found[300:360, avatar] == HOLD).all()
        assert not found[420:, avatar].any()
        left = found[360:420, avatar]
        assert (left == LEAVE).any()
    ease = np.ptp(np.stack([chunk.x, chunk.z])[:, 300:360], axis=1)
    assert ease.max() < 0.1


def seen_before_rest(apart, heading, since=0):
    """What an avatar does that is to rest 2 m from an opponent, and how far away it sees that."""
    crowd = build_crowd([0.0, apart], [0.0, 0.0], [heading, 0.0], conditioned=True, rules=0.0 * RULES)
    one = Simulation(replace(crowd, policies=[resting_policy()]))
    row = one.avatars.conditions[0]
    row["mode"], row["does"], row["keeps"], row["since"] = layout.RESTS, layout.WATCHES, 2.0, -since
    own = one.avatars.slot_of[0]
    target = layout.Target(apart, 1.6, 0.0, 0.0, 0.0, 1.0)
    observed = layout.Observed(np.zeros(2, np.int32), np.zeros(2, np.int32), np.zeros((2, 1), np.int32))
    seen = see_by_intent(one.model, one.avatars, one._world, one._now, own, np.int32(1), target, observed, 0)
    return row["does_next"], seen.x


@pytest.mark.parametrize("apart", [2.4, 3.0])
def test_an_avatar_that_turns_round_to_rest_sees_its_opponent_no_nearer_than_in_a_fight(apart):
    does, seen = seen_before_rest(apart, -np.pi / 2)
    assert does == layout.WATCHES
    assert seen == pytest.approx(max(FIGHTING, apart - 2.0 + FIGHTING))


@pytest.mark.parametrize("heading", [-np.pi / 2, np.pi / 2])
@pytest.mark.parametrize("apart", [1.0, 1.6, 2.2])
def test_an_avatar_that_is_too_near_to_rest_steps_back(apart, heading):
    does, seen = seen_before_rest(apart, heading)
    assert does == layout.WATCHES
    assert seen == pytest.approx(max(STEPS_BACK, apart - 2.0 + FIGHTING))


def test_an_avatar_rests_at_its_distance_and_later_is_content_with_less():
    ahead = np.pi / 2
    assert [seen_before_rest(2.4, ahead + off)[0] for off in (0.0, 0.9)] == [layout.RESTS, layout.WATCHES]
    late = 2 * int(PATIENT)
    assert [seen_before_rest(apart, ahead, late)[0] for apart in (1.4, 1.2)] == [layout.RESTS, layout.WATCHES]
    assert seen_before_rest(2.4, ahead + 0.9, late)[0] == layout.RESTS


@pytest.mark.parametrize("content", [True, False])
@pytest.mark.parametrize("spacing", [0.9, 2.2, 3.4])
def test_an_event_lets_avatars_rest_from_the_state_that_is_most_like_a_rest(spacing, content):
    policy = resting_policy()
    one = Simulation(replace(people(spacing=spacing), policies=[policy]))
    one.run(40)
    one.avatars.conditions["mode"], one.avatars.conditions["keeps"] = layout.RESTS, 3.0
    one.avatars.conditions["does_next"] = layout.RESTS if content else layout.WATCHES
    model, ways = one.model, one.model.ways_to_rest
    points = np.concatenate([model.bodies, model.arms], axis=1).astype(float)
    entries, avatars = np.flatnonzero(ways["enter"] >= 0), one.avatars
    enter, walks = ways["enter"][entries], ways["walk"][entries]
    for own in range(one.present):
        other = 1 - own
        avatars.fight["next_opponent"][own] = avatars.number[other]
        left = model.actions[avatars.motion["action"][own]]
        left = left["origin"] + left["length"] * policy.database.stride
        gaps = ((points[left] - points[model.actions["origin"][enter]]) ** 2).sum(axis=(1, 2))
        moves, heading = model.moves[enter], avatars.heading[own]
        x = avatars.x[own] + moves["x"] * np.cos(heading) + moves["z"] * np.sin(heading)
        z = avatars.z[own] + moves["z"] * np.cos(heading) - moves["x"] * np.sin(heading)
        turned = heading + np.arctan2(moves["sin"], moves["cos"])
        dx, dz = avatars.motion["end_x"][other] - x, avatars.motion["end_z"][other] - z
        far = np.hypot(dx, dz)
        ahead, wanted = (dx * np.sin(turned) + dz * np.cos(turned)) / far, own_share(avatars, one._world, own, other)
        costs = gaps + LASTING * model.actions["length"][enter] + TURNED * (1.0 - ahead)
        costs += np.where(far < wanted, LACKING * (wanted - far), BEYOND * (far - wanted))
        free = np.array([w < 0 or is_free(model, avatars, one._world, one._now, own, w) for w in walks])
        fits = (gaps < ALIKE) & free & (content | ((far >= wanted - SHORT) & (ahead >= FACING)))
        found = nearest_rest(model, avatars, one._world, one._now, own)
        assert found == (entries[np.argmin(np.where(fits, costs, np.inf))] if fits.any() else -1)


def share_of(apart, half=0.0, other=layout.RESTS, does=layout.FIGHTS):
    """How far an avatar goes from one at the origin that is to rest 3 m from it, in a square arena or in none."""
    crowd = build_crowd([apart, 0.0], [0.0, 0.0], [0.0, 0.0], conditioned=True, rules=0.0 * RULES)
    arena = (layout.RECTANGLE, 0.0, 0.0, half, half) if half else crowd.arena
    one = Simulation(replace(crowd, policies=[resting_policy()], arena=arena))
    row = one.avatars.conditions[1]
    row["mode"], row["does"], one.avatars.conditions["keeps"] = other, does, 3.0
    return own_share(one.avatars, one._world, one.avatars.slot_of[0], one.avatars.slot_of[1])


def test_two_that_are_to_rest_go_half_the_way_each_unless_one_stays_or_has_no_room():
    assert share_of(1.0) == pytest.approx(2.0)
    assert share_of(1.0, other=layout.FIGHTS) == pytest.approx(3.0)
    assert share_of(1.0, does=layout.RESTS) == pytest.approx(3.0)
    assert share_of(3.2) == pytest.approx(3.0)
    assert share_of(1.0, half=1.0 + WALLS + 0.1) == pytest.approx(2.0)
    assert share_of(1.0, half=1.0 + WALLS - 0.1) == pytest.approx(3.0)


def test_avatars_step_back_at_once_and_have_dropped_their_guard_within_three_seconds():
    one = Simulation(replace(people(), policies=[resting_policy()], **modes(2, (60, layout.RESTS), distance=3.0)))
    chunk = one.run(60 + 45 + 60)
    rests = resting_policy().rests
    away = rests.enter[leads_away(resting_policy().actions, rests)]
    assert np.isin(chunk.action, away).any(axis=0).all()
    apart = np.hypot(chunk.x[105:, 0] - chunk.x[105:, 1], chunk.z[105:, 0] - chunk.z[105:, 1])
    assert apart.min() > 2.5
    assert (kinds(chunk.action[105:]) == HOLD).all()


def test_nobody_strikes_at_one_that_raises_its_guard_again():
    one = Simulation(
        replace(people(), policies=[resting_policy()], **modes(2, (0, layout.RESTS), (240, layout.FIGHTS)))
    )
    one.run(236)
    assert (one.avatars.conditions["piece"] > 0.0).all()
    seen = set()
    for _ in range(int(RAISES)):
        chunk = one.run(1)
        assert not len(chunk.events.frame)
        seen |= set(one.avatars.conditions["does_next"].tolist())
    assert layout.WATCHES in seen
    assert len(one.run(200).events.frame) > 0


def test_rests_follow_the_rows_of_the_model_one_after_another():
    one = Simulation(replace(people(spacing=3.0), policies=[resting_policy()], **modes(2, (0, layout.RESTS))))
    rests = resting_policy().rests
    piece, before = np.zeros(2, int), np.full(2, -1)
    for _ in range(400):
        (actions,) = one.run(1).action
        for avatar, action in enumerate(actions):
            if action == before[avatar]:
                continue
            if action in rests.enter:
                piece[avatar] = rests.row[np.flatnonzero(rests.enter == action)[0]]
            elif before[avatar] in (*rests.enter, *rests.hold):
                piece[avatar] = rests.next[piece[avatar]]
                assert action == rests.hold[piece[avatar]]
        before = actions.copy()
    assert np.isin(before, rests.hold).all()


def test_an_avatar_whose_opponent_has_left_stands_at_ease():
    gone = Change(AtFrame(40), who=np.array([False, True]), present=False)
    chunk = Simulation(replace(people(), policies=[resting_policy()], changes=(gone,))).run(240)
    assert not kinds(chunk.action[:40]).any()
    assert (kinds(chunk.action[210:, 0]) == HOLD).all()


def test_an_avatar_waits_in_its_guard_for_one_that_will_get_up_again():
    one = Simulation(replace(people(), policies=[resting_policy()]))
    one.run(20)
    row, slot = one.avatars.conditions[1], one.avatars.slot_of[1]
    for rises, kind in ((1e6, 0), (math.inf, HOLD)):
        row["standing"], row["rises"] = layout.LYING, rises
        row["fall"] = 0.0
        one.avatars.team[slot] = -2
        assert kinds(one.run(150).action[-1, 0]) == kind


def test_a_knock_down_ends_a_rest():
    one = Simulation(replace(people(rules=RULES), policies=[resting_policy()], **modes(2, (0, layout.RESTS))))
    one.run(240)
    assert (one.avatars.conditions["piece"] > 0.0).all()
    one.avatars.conditions["standing"][0] = layout.DROPS
    one.avatars.team[one.avatars.slot_of[0]] = -2
    strikes = np.zeros(1, STRIKE)
    strikes["frame"], strikes["attacker"], strikes["down"] = one.frame - 1.5, 1, 1
    one.avatars.fight["hit_x"][one.avatars.slot_of[0]] = 1.0
    observed = layout.Observed(np.zeros(1, np.int32), np.zeros(1, np.int32), np.zeros((1, 8), np.int32))
    now = layout.Now(one.frame - 1, 0, one.present)
    room = empty_room(one.model, 8)
    knock_down(one.model, one.avatars, one._world, now, strikes, 0, 1, everyone(one.avatars, 2), observed, room)
    action = one.run(30).action[-1, 0]
    assert action in resting_policy().falls.actions
    assert one.avatars.conditions["piece"][0] == 0.0


def bytes_of(chunk):
    return [np.asarray(values).tobytes() for values in (chunk.action, chunk.x, chunk.z, chunk.heading)]


def test_rests_have_the_same_bytes_for_any_threads_and_after_a_resume():
    count = 12
    script = modes(count, (30, layout.RESTS), (200, layout.FIGHTS))
    small = Simulation(replace(people(count, rules=RULES), policies=[resting_policy()], **script)).run(260)
    assert kinds(small.action).any(axis=0).sum() > count // 2
    for threads in (1, 2):
        staged = Simulation(
            replace(people(count, rules=RULES), policies=[resting_policy()], **script),
            threads=threads,
            search="kd_tree",
        )
        assert bytes_of(staged.run(260)) == bytes_of(small)
        staged.close()
    first = Simulation(replace(people(count, rules=RULES), policies=[resting_policy()], **script))
    first.run(150)
    again = Simulation(replace(people(count, rules=RULES), policies=[resting_policy()], **script))
    again.restore(first.state())
    assert bytes_of(first.run(110)) == bytes_of(again.run(110))


def test_a_piece_that_no_rest_has_is_refused():
    one = Simulation(replace(people(), policies=[resting_policy()]))
    state = one.state()
    state["avatars.conditions.piece"][0] = len(one.model.rests) + 1.0
    with pytest.raises(ValueError, match="piece"):
        one.restore(state)


def test_without_rests_nothing_of_a_fight_changes():
    # The restless policy decides by the same tables; what is told to rest keeps its distance in its guard.
    script = modes(2, (30, layout.RESTS))
    chunk = Simulation(replace(people(), policies=[restless_policy()], **script)).run(200)
    falls, count = restless_policy().falls, restless_policy().graph.choice_count
    assert falls is not None
    assert ((chunk.action < count) | np.isin(chunk.action, falls.stagger)).all()
